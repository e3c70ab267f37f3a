"""Camera models as functions of their parameters, with derivatives: what a calibration fits.

`geoloc.cameras` has the models with their parameters fixed. Here the parameters are unknowns: a lens projects
points for any of them, and says how the pixel moves with each. `Lens.camera` builds the fixed model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras import CameraModel, PinholeCamera


class Projection(NamedTuple):
    """Pixels of n points and how they move; undefined where `valid` is false."""

    pixel_px: FloatArray
    """(n, 2)"""
    by_point: FloatArray
    """(n, 2, 3), pixels a metre."""
    by_lens: FloatArray
    """(n, 2, p)"""
    valid: BoolArray
    """(n,): inside the model's domain."""


@dataclass(frozen=True, slots=True)
class RadialCurve:
    """A lens as samples of angle from the axis and radius in the image, both rising, and its centre."""

    theta_rad: FloatArray
    radius_px: FloatArray
    cx_px: float
    cy_px: float


class Lens(Protocol):
    """One camera model with unknown parameters."""

    @property
    def name(self) -> str:
        """Name of the model: ``ftheta``, ``fisheye``, ``pinhole``, ``ocam``."""
        ...

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the p unknowns, units included."""
        ...

    @property
    def units(self) -> FloatArray:
        """(p,): an unknown times this is the parameter as calibration files write it."""
        ...

    def project(self, k: FloatArray, point_camera: FloatArray) -> Projection:
        """Project points ``(n, 3)`` (RDF) with parameters ``(p,)``."""
        ...

    def start(self, curve: RadialCurve) -> FloatArray:
        """Parameters ``(p,)`` that come near a radial curve."""
        ...

    def camera(self, k: FloatArray) -> CameraModel:
        """Build the model with these parameters.

        Raises
        ------
        CalibrationError
            If they make no camera.
        """
        ...


def least_squares(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve ``matrix @ x = right`` in the sense of least squares."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])


_NEAREST_M = 1e-9


@dataclass(frozen=True, slots=True)
class PinholeLens:
    """Pinhole with Brown's distortion, as in OpenCV: k1, k2, p1, p2, k3."""

    name: ClassVar[str] = "pinhole"

    width_px: int
    height_px: int

    @property
    def parameters(self) -> tuple[str, ...]:
        """Centre, focal lengths, distortion."""
        return ("cx_px", "cy_px", "fx_px", "fy_px", "k1", "k2", "p1", "p2", "k3")

    @property
    def units(self) -> FloatArray:
        """As in files."""
        return np.ones(9)

    def project(self, k: FloatArray, point_camera: FloatArray) -> Projection:
        """Project points ``(n, 3)``; valid in front of the camera, where the distorted radius rises."""
        cx, cy, fx, fy, k1, k2, p1, p2, k3 = k.tolist()
        valid = point_camera[:, 2] > _NEAREST_M
        depth = np.where(valid, point_camera[:, 2], 1.0)
        x, y = point_camera[:, 0] / depth, point_camera[:, 1] / depth
        s = x * x + y * y
        factor, factor_s = 1.0 + s * (k1 + s * (k2 + s * k3)), k1 + s * (2.0 * k2 + 3.0 * s * k3)
        xd = x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x)
        yd = y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y
        cross = 2.0 * x * y * factor_s + 2.0 * p1 * x + 2.0 * p2 * y
        xx = factor + 2.0 * x * x * factor_s + 2.0 * p1 * y + 6.0 * p2 * x
        yy = factor + 2.0 * y * y * factor_s + 6.0 * p1 * y + 2.0 * p2 * x
        valid = valid & (factor + 2.0 * s * factor_s > 0.0) & (factor > 0.0)
        by_point = np.stack(
            [
                np.stack([fx * xx, fx * cross, -fx * (xx * x + cross * y)], axis=-1),
                np.stack([fy * cross, fy * yy, -fy * (cross * x + yy * y)], axis=-1),
            ],
            axis=-2,
        )
        one, nil = np.ones_like(x), np.zeros_like(x)
        across = [one, nil, xd, nil, fx * x * s, fx * x * s**2, 2.0 * fx * x * y, fx * (s + 2.0 * x * x)]
        down = [nil, one, nil, yd, fy * y * s, fy * y * s**2, fy * (s + 2.0 * y * y), 2.0 * fy * x * y]
        by_lens = np.stack(
            [np.stack([*across, fx * x * s**3], axis=-1), np.stack([*down, fy * y * s**3], axis=-1)],
            axis=-2,
        )
        pixel = np.stack([cx + fx * xd, cy + fy * yd], axis=-1)
        return Projection(pixel, by_point / depth[:, np.newaxis, np.newaxis], by_lens, valid)

    def start(self, curve: RadialCurve) -> FloatArray:
        """Least squares over the samples as far as 70° from the axis."""
        near = curve.theta_rad < np.radians(70.0)
        plane = np.tan(curve.theta_rad[near])
        # Weighted so that angles count alike: the plane grows without bound.
        weight = np.cos(curve.theta_rad[near]) ** 2
        powers = (weight * plane)[:, np.newaxis] * plane[:, np.newaxis] ** np.array([0, 2, 4, 6])
        focal_px, a, b, c = least_squares(powers, weight * curve.radius_px[near]).tolist()
        k1, k2, k3 = a / focal_px, b / focal_px, c / focal_px
        return np.array([curve.cx_px, curve.cy_px, focal_px, focal_px, k1, k2, 0.0, 0.0, k3])

    def camera(self, k: FloatArray) -> CameraModel:
        """Build the `PinholeCamera`."""
        cx, cy, fx, fy, *distortion = k.tolist()
        return PinholeCamera(self.width_px, self.height_px, fx, fy, cx, cy, tuple(distortion))
