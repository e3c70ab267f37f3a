"""Two calibrations of the same cameras: how far they part, and whether their uncertainty explains it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.calibration.intrinsics.coverage import map_pixels, part_name
from geoloc.calibration.lens_difference import LensDifference, lens_difference
from geoloc.calibration.mounting_difference import MountingDifference, mounting_difference
from geoloc.calibration.sign_shift import foot_slopes, height_m
from geoloc.errors import CalibrationError
from geoloc.rig.rig import RigCamera
from twin.calibrate.difference.fits import CameraFit, read_fits
from twin.errors import ConfigError

BY_CHANCE = 0.01
"""Differences that chance makes in fewer of all pairs are none of chance."""
_SAME_RAD = 1e-9
SIGN_M = 20.0
"""Distance of the sign that a difference is told for."""


class FitVerdict(StrEnum):
    """What two fits say of each other."""

    AGREE = "agree"
    DIFFER = "differ"
    SAME = "same"
    """It is the same fit in both."""
    NOT_JUDGED = "not_judged"
    """A fit has no covariance: how large a difference chance makes is not known."""


@dataclass(frozen=True, slots=True)
class LensCompared:
    """Rays of two fits of one lens, after one common rotation.

    Attributes
    ----------
    verdict : FitVerdict
    turned_deg : float
        The rotation that was taken out: the two fits put the camera's axes so far apart.
    rms_deg, largest_deg : float
        Angle between the rays of a pixel.
    rms_px, largest_px : float
        The same in the picture.
    where : str
        Part of the picture with the largest one: ``top left``, ``middle``.
    sideways_m, along_m : float
        Largest shift of a sign's foot 20 m away.
    in_sigmas : float or None
        RMS of the differences in units of their joint uncertainty: about 1 where both are right.
    by_chance : float or None
        Probability that chance makes it as large.
    part_compared : float
        Part of the picture that both vouch for; of the whole where neither says.
    """

    verdict: FitVerdict
    turned_deg: float
    rms_deg: float
    largest_deg: float
    rms_px: float
    largest_px: float
    where: str
    sideways_m: float
    along_m: float
    in_sigmas: float | None
    by_chance: float | None
    part_compared: float


@dataclass(frozen=True, slots=True)
class MountingCompared:
    """Two fits of where a camera sits: the second against the first.

    Attributes
    ----------
    verdict : FitVerdict
    roll_pitch_yaw_deg, sigma_deg : tuple of float
        Turn about the rig's axes, with the lens's own rotation made up for; joint sigma, None where unknown.
    moved_m, sigma_m : tuple of float
        Along the rig's axes.
    sideways_m, along_m : float
        Largest shift of a sign's foot 20 m away, lens and mounting together.
    by_chance : float or None
        Probability that chance makes turn and move as large.
    """

    verdict: FitVerdict
    roll_pitch_yaw_deg: tuple[float, ...]
    sigma_deg: tuple[float, ...] | None
    moved_m: tuple[float, ...]
    sigma_m: tuple[float, ...] | None
    sideways_m: float
    along_m: float
    by_chance: float | None


@dataclass(frozen=True, slots=True)
class CameraCompared:
    """One camera in two calibrations.

    Attributes
    ----------
    camera : str
    other : str
        Its name in the second calibration.
    lens : LensCompared
    mounting : MountingCompared or None
        None where one of the two does not say where the camera sits.
    """

    camera: str
    other: str
    lens: LensCompared
    mounting: MountingCompared | None

    @property
    def differs(self) -> bool:
        """Whether more than chance parts the two."""
        mounting = FitVerdict.AGREE if self.mounting is None else self.mounting.verdict
        return FitVerdict.DIFFER in {self.lens.verdict, mounting}


@dataclass(frozen=True, slots=True)
class ComparedMaps:
    """What a picture shows of one camera, in cells of the image; NaN where nothing is compared.

    Attributes
    ----------
    compared : CameraCompared
    size_px : tuple of int
        Width and height of the picture.
    pixel_px : float64 (rows, columns, 2)
    apart_deg : float64 (rows, columns)
        Between the rays, the rotation taken out.
    apart_px : float64 (rows, columns, 2)
        The same in the picture.
    in_sigmas : float64 (rows, columns) or None
    sign_m : float64 (rows, columns, 2)
        Shift of a sign's foot 20 m away, to the left and along, lens and mounting together.
    """

    compared: CameraCompared
    size_px: tuple[int, int]
    pixel_px: FloatArray
    apart_deg: FloatArray
    apart_px: FloatArray
    in_sigmas: FloatArray | None
    sign_m: FloatArray


def compare_calibrations(first: Path, second: Path, camera: str | None = None) -> tuple[ComparedMaps, ...]:
    """Compare two calibrations camera by camera.

    Parameters
    ----------
    first, second : Path
        As `read_fits` takes them; fitted to different pictures, else their errors are the same ones.
    camera : str, optional
        Only this one. A file with a single camera is compared whatever it is called there.

    Raises
    ------
    CalibrationError, ConfigError, FileError, DriveError
        If one cannot be read, there is nothing to compare, or the pictures' sizes differ.
    """
    fits = read_fits(first), read_fits(second)
    return tuple(_compared(fits[0][a], fits[1][b]) for a, b in _pairs(*fits, camera))


def _pairs(
    first: Mapping[str, CameraFit], second: Mapping[str, CameraFit], camera: str | None
) -> list[tuple[str, str]]:
    if camera is not None and camera not in {*first, *second}:
        names = ", ".join(dict.fromkeys([*first, *second])) or "none"
        raise ConfigError(f"There is no camera {camera} in either calibration (their cameras: {names}).")
    wanted = [name for name in first if camera in {None, name}]
    common = [(name, name) for name in wanted if name in second]
    if common:
        return common
    one, other = (list(f) if len(f) == 1 else [n for n in f if n == camera] for f in (first, second))
    if len(one) == len(other) == 1:
        return [(one[0], other[0])]
    raise ConfigError(
        f"The two calibrations have no camera in common ({', '.join(first)} and {', '.join(second)}): name "
        "the one to compare with --camera."
    )


def _compared(first: CameraFit, second: CameraFit) -> ComparedMaps:
    a, b = first.camera, second.camera
    size = a.model.width_px, a.model.height_px
    if size != (b.model.width_px, b.model.height_px):
        raise CalibrationError(
            f"Camera {a.name} has {size[0]} x {size[1]} pixels in the first calibration and "
            f"{b.model.width_px} x {b.model.height_px} in the second: compare two of the same camera in its "
            "full size."
        )
    pixel, both = map_pixels(*size), _both_cover(first, second, size)
    known = None
    if first.lens is not None and second.lens is not None:
        known = first.lens.known, second.lens.known
    apart = lens_difference(a.model, b.model, pixel[both], known)
    good = np.isfinite(apart.angle_rad)
    if not good.any():
        raise CalibrationError(f"No part of the picture has rays in both calibrations of {a.name}.")
    mounting = _mountings(first, second, apart)
    foot_m = _foot_shift(a, b, apart, None, pixel[both])
    off_px = _pixels_apart(a, b, apart, pixel[both])
    lens = _lens_compared(
        apart, off_px, foot_m, [part_name(p, *size) for p in pixel[both]], float(both.mean())
    )
    mounted = None
    if mounting is not None:
        foot_m = _foot_shift(a, b, apart, mounting, pixel[both])
        mounted = _mounting_compared(mounting, foot_m)
    compared = CameraCompared(a.name, b.name, lens, mounted)
    sigma = apart.sigma_rad
    return ComparedMaps(
        compared,
        size,
        pixel,
        _spread(both, np.degrees(apart.angle_rad)),
        _spread(both, off_px),
        None if sigma is None else _spread(both, apart.angle_rad / sigma),
        _spread(both, foot_m),
    )


def _both_cover(first: CameraFit, second: CameraFit, size: tuple[int, int]) -> BoolArray:
    """Cells (rows, columns) that both vouch for; all where neither says."""
    both = np.ones(map_pixels(*size).shape[:2], dtype=bool)
    for fit in (first, second):
        if fit.lens is not None and fit.lens.covered is not None:
            both &= fit.lens.covered
    if not both.any():
        raise CalibrationError(
            f"The boards of the two calibrations of {first.camera.name} cover no part of the picture in "
            "common: take pictures all over it (twin calibrate coverage says where)."
        )
    return both


def _mountings(first: CameraFit, second: CameraFit, apart: LensDifference) -> MountingDifference | None:
    if not (first.camera.is_placed and second.camera.is_placed):
        return None
    covariances = None
    if first.mounting_covariance is not None and second.mounting_covariance is not None:
        covariances = first.mounting_covariance, second.mounting_covariance
    return mounting_difference(first.camera, second.camera, apart.rotation, covariances)


def _foot_shift(
    a: RigCamera,
    b: RigCamera,
    apart: LensDifference,
    mounting: MountingDifference | None,
    pixel: FloatArray,
) -> FloatArray:
    """Shift (n, 2) of a sign's foot 20 m away, left and along: by the lens alone without `mounting`."""
    ray, _ = a.model.camera_ray_from_pixel(pixel)
    before = ray @ a.rig_R_camera.T
    moved = np.zeros_like(before)
    if mounting is None:
        change = apart.apart_rad @ apart.rotation @ a.rig_R_camera.T
    else:
        change = b.model.camera_ray_from_pixel(pixel)[0] @ b.rig_R_camera.T - before
        moved += mounting.moved_m
    slopes = foot_slopes(before, SIGN_M, height_m(a))
    return np.asarray((slopes @ np.concatenate([change, moved], axis=-1)[:, :, np.newaxis])[:, :, 0])


def _pixels_apart(a: RigCamera, b: RigCamera, apart: LensDifference, pixel: FloatArray) -> FloatArray:
    """Where the second fit sees what the first one sees in a pixel, less that pixel (n, 2)."""
    ray, inside = a.model.camera_ray_from_pixel(pixel)
    seen, _ = b.model.pixel_from_camera_point(np.where(inside[:, np.newaxis], ray, np.nan) @ apart.rotation.T)
    return np.asarray(seen - pixel)


def _lens_compared(
    apart: LensDifference, off_px: FloatArray, foot_m: FloatArray, where: Sequence[str], part: float
) -> LensCompared:
    from scipy.spatial.transform import Rotation

    angle = apart.angle_rad
    largest = int(np.nanargmax(angle))
    sideways_m, along_m = np.nanmax(np.abs(foot_m), axis=0).tolist()
    length_px = np.linalg.norm(off_px, axis=-1)
    turn = Rotation.from_matrix(apart.rotation).magnitude()
    return LensCompared(
        verdict=FitVerdict.SAME if angle[largest] < _SAME_RAD else _verdict(apart.by_chance),
        turned_deg=float(np.degrees(turn)),
        rms_deg=float(np.degrees(np.sqrt(np.nanmean(angle**2)))),
        largest_deg=float(np.degrees(angle[largest])),
        rms_px=float(np.sqrt(np.nanmean(length_px**2))),
        largest_px=float(np.nanmax(length_px)),
        where=where[largest],
        sideways_m=sideways_m,
        along_m=along_m,
        in_sigmas=None if apart.mean_square is None else float(np.sqrt(apart.mean_square)),
        by_chance=apart.by_chance,
        part_compared=part,
    )


def _mounting_compared(difference: MountingDifference, foot_m: FloatArray) -> MountingCompared:
    sideways_m, along_m = np.nanmax(np.abs(foot_m), axis=0).tolist()
    covariance = difference.covariance
    sigma = None if covariance is None else np.sqrt(np.diag(covariance))
    return MountingCompared(
        verdict=_verdict(difference.by_chance),
        roll_pitch_yaw_deg=tuple(np.degrees(difference.turn_rad).tolist()),
        sigma_deg=None if sigma is None else tuple(np.degrees(sigma[:3]).tolist()),
        moved_m=tuple(difference.moved_m.tolist()),
        sigma_m=None if sigma is None else tuple(sigma[3:].tolist()),
        sideways_m=sideways_m,
        along_m=along_m,
        by_chance=difference.by_chance,
    )


def _verdict(by_chance: float | None) -> FitVerdict:
    if by_chance is None:
        return FitVerdict.NOT_JUDGED
    return FitVerdict.DIFFER if by_chance < BY_CHANCE else FitVerdict.AGREE


def _spread(both: BoolArray, values: FloatArray) -> FloatArray:
    """Values (n, ...) of the cells compared over all cells (rows, columns, ...), NaN elsewhere."""
    whole = np.full((*both.shape, *values.shape[1:]), np.nan)
    whole[both] = values
    return whole
