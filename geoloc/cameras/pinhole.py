"""The pinhole camera with Brown's lens distortion, as OpenCV writes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras.base import Columns, FocalCamera, check_with_distortion
from geoloc.cameras.brown import BrownDistortion
from geoloc.cameras.planar import PlanarCamera

# No lens of this kind sees farther from its axis; the bound keeps every radius finite.
_MAX_ANGLE_DEG = 89.0


@dataclass(frozen=True, slots=True)
class PinholeCamera(FocalCamera, PlanarCamera):
    """Pinhole intrinsics: a `PlanarCamera` whose plane lies across the axis.

    The domain is the part of the plane over which the distortion is one-to-one: up to `r_max`, where its
    radial part stops rising, and 89° from the axis at most.

    Begins with the fields of `FocalCamera`.

    Attributes
    ----------
    distortion : tuple of float
        OpenCV's order: ``()``, ``(k1, k2, p1, p2)``, ``(…, k3)``, ``(…, k3, k4, k5, k6)`` or, with a thin
        prism, ``(…, s1, s2, s3, s4)``.
    r_max : float
        Largest tangent of the angle from the axis, before distortion. Derived.

    Raises
    ------
    CalibrationError
        If a number is not finite, a focal length or the image is not positive, or `distortion` has another
        length.
    """

    model: ClassVar[str] = "pinhole"

    distortion: tuple[float, ...] = ()
    r_max: float = field(init=False, repr=False, compare=False)
    _brown: BrownDistortion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        check_with_distortion(self)
        brown = BrownDistortion.of_opencv(self.distortion, math.tan(math.radians(_MAX_ANGLE_DEG)))
        object.__setattr__(self, "_brown", brown)
        object.__setattr__(self, "r_max", brown.r_max)

    def _plane_from_point(self, point: FloatArray) -> tuple[FloatArray, BoolArray]:
        inside = (point[..., 2] > 0.0) & np.isfinite(point).all(-1)
        point = np.where(inside[..., np.newaxis], point, (0.0, 0.0, 1.0))
        inside &= np.hypot(point[..., 0], point[..., 1]) <= self.r_max * point[..., 2]
        point = np.where(inside[..., np.newaxis], point, (0.0, 0.0, 1.0))
        return point[..., :2] / point[..., 2:], inside

    def _lifted(self, plane: FloatArray, *, slopes: bool) -> tuple[Columns, tuple[Columns, Columns] | None]:
        """Rays ``(x, y, 1) / n``: they move by ``(dx, dy, 0) / n`` less the part along themselves."""
        x, y = plane[..., 0], plane[..., 1]
        forward = 1.0 / np.sqrt(1.0 + x * x + y * y)
        ray = Columns(x * forward, y * forward, forward)
        if not slopes:
            return ray, None
        cross = -forward * ray.x * ray.y
        by_x = Columns(forward * (1.0 - ray.x * ray.x), cross, -forward * ray.x * forward)
        return ray, (by_x, Columns(cross, forward * (1.0 - ray.y * ray.y), -forward * ray.y * forward))
