"""Lenses that nobody has calibrated: nominal intrinsics, how far they may be off, and what that moves."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.cameras.base import CameraModel
from geoloc.cameras.fisheye import FisheyeCamera
from geoloc.cameras.pinhole import PinholeCamera
from geoloc.errors import CalibrationError

PINHOLE, FISHEYE = "pinhole", "fisheye"
LENS_ERRORS = 5
"""What is unknown of a lens: focal length, centre across and down, distortion by two powers."""
NARROWEST_DEG, WIDEST_DEG = 5.0, 175.0
_WIDE_DEG = 100.0
_CENTRE_SHARE = 0.01
_DISTORTION = {PINHOLE: 0.03, FISHEYE: 0.04}
FOV_SIGMA = 0.06
"""One sigma of a focal length that follows from a field of view which somebody states, as a share of it."""


@dataclass(frozen=True, slots=True)
class LensSigmas:
    """How far intrinsics may be off, one sigma each; 0 for a lens that was calibrated.

    Attributes
    ----------
    focal_share : float
        Of the focal length, as a share of it.
    centre_px : float
        Of the principal point, each axis.
    distortion_share : float
        Of the distance from the centre half the longer side away, as a share of it: a part that grows with
        the square of the distance, and one with its fourth power.
    """

    focal_share: float = 0.0
    centre_px: float = 0.0
    distortion_share: float = 0.0

    @property
    def is_exact(self) -> bool:
        """Whether the lens is taken as it was calibrated."""
        return not any(self.of_errors())

    def of_errors(self) -> tuple[float, ...]:
        """One sigma of each of the `LENS_ERRORS`, in their order."""
        bent = self.distortion_share
        return self.focal_share, self.centre_px, self.centre_px, bent, bent


EXACT: Final = LensSigmas()


@dataclass(frozen=True, slots=True)
class NominalLens:
    """The lens of a common camera, as a share of its picture's longer side.

    Attributes
    ----------
    name : str
    focal_share : float
        Focal length over the longer side.
    focal_sigma : float
        One sigma of it, as a share of it.
    source : str
        Where the numbers are from.
    distortion : tuple of float or None
        Of a fisheye, ``(k1, k2, k3, k4)``; None for a pinhole.
    """

    name: str
    focal_share: float
    focal_sigma: float
    source: str
    distortion: tuple[float, ...] | None = None

    @classmethod
    def of_fov(cls, fov_deg: float, projection: str | None = None) -> NominalLens:
        """A lens of which only the field of view across the longer side is known.

        Parameters
        ----------
        projection : {"pinhole", "fisheye"}, optional
            Default: a fisheye (``r = f θ``) from 100° on, as wide lenses of small cameras nearly are.

        Raises
        ------
        CalibrationError
            If no lens of this projection sees that much.
        """
        kind = projection or (FISHEYE if fov_deg >= _WIDE_DEG else PINHOLE)
        if not NARROWEST_DEG <= fov_deg <= (WIDEST_DEG if kind == FISHEYE else WIDEST_DEG - 15.0):
            raise CalibrationError(f"a field of view of {fov_deg:g}° is none of a {kind} lens")
        half = math.radians(0.5 * fov_deg)
        name, source = f"{fov_deg:g}° across", "the field of view that drive.toml states"
        if kind == FISHEYE:
            return cls(name, 0.5 / half, FOV_SIGMA, source, (0.0, 0.0, 0.0, 0.0))
        return cls(name, 0.5 / math.tan(half), FOV_SIGMA, source)

    def camera(self, width_px: int, height_px: int) -> CameraModel:
        """Intrinsics for pictures of this size, the axis in the middle."""
        focal = self.focal_share * max(width_px, height_px)
        shape = (width_px, height_px, focal, focal, 0.5 * (width_px - 1), 0.5 * (height_px - 1))
        return PinholeCamera(*shape) if self.distortion is None else FisheyeCamera(*shape, self.distortion)

    def sigmas(self, width_px: int, height_px: int) -> LensSigmas:
        """How far these intrinsics may be off."""
        kind = PINHOLE if self.distortion is None else FISHEYE
        centre_px = _CENTRE_SHARE * max(width_px, height_px)
        return LensSigmas(self.focal_sigma, centre_px, _DISTORTION[kind])


@cache
def nominal_lenses() -> dict[str, NominalLens]:
    """Return the table of common cameras, by name."""
    document = tomllib.loads(files("geoloc.cameras").joinpath("nominal.toml").read_text(encoding="utf-8"))
    lenses = {}
    for row in document["lens"]:
        shape = tuple(row["distortion"]) if "distortion" in row else None
        one = NominalLens(row["name"], row["focal_share"], row["focal_sigma"], row["source"], shape)
        lenses[one.name] = one
    return lenses


def lens_moves(model: CameraModel, pixel_px: FloatArray) -> FloatArray:
    """How far each of the lens's errors moves pixels ``(n, 2)``: float64 (n, 2, `LENS_ERRORS`).

    ``pixel + moves @ error`` is where the nominal lens sees what the true lens sees at `pixel`. The errors:
    the focal length too large by a share of it, the centre across and down (px), and distances from the
    centre that are short by a share of it half the longer side away, less within, with its square and with
    its fourth power.
    """
    return moves_at(*from_axis(model, pixel_px))


def from_axis(model: CameraModel, pixel_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) as seen from that of the optical axis, and half the picture's longer side (n,)."""
    axis_px, _ = model.pixel_from_camera_point(np.array([[0.0, 0.0, 1.0]]))
    return pixel_px - axis_px, np.full(len(pixel_px), 0.5 * max(model.width_px, model.height_px))


def moves_at(away_px: FloatArray, half_px: FloatArray) -> FloatArray:
    """`lens_moves` of pixels (n, 2) as `from_axis` gives them."""
    square = (np.sum(away_px**2, axis=1) / half_px**2)[:, None]
    moves = np.zeros((len(away_px), 2, LENS_ERRORS))
    moves[:, :, 0], moves[:, 0, 1], moves[:, 1, 2] = away_px, 1.0, 1.0
    moves[:, :, 3], moves[:, :, 4] = away_px * square, away_px * square**2
    return moves
