"""The fisheye camera of Kannala and Brandt with tangential distortion and a thin prism, as OpenSfM has it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras.base import Columns, FocalCamera, check_with_distortion, sin_cos
from geoloc.cameras.brown import BrownDistortion
from geoloc.cameras.planar import PlanarCamera
from geoloc.errors import CalibrationError

_MOST_COEFFICIENTS = 12
_TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True)
class Fisheye624Camera(FocalCamera, PlanarCamera):
    """OpenSfM's ``fisheye624`` and ``fisheye62``, COLMAP's ``THIN_PRISM_FISHEYE``.

    The ray at the angle θ from the axis and the azimuth φ meets the plane of this `PlanarCamera` at
    ``(x, y) = θ (cos φ, sin φ)``, which is distorted with ``R = 1 + k1 θ² + k2 θ⁴ + … + k6 θ¹²``. With k1 to
    k4 alone it is the `FisheyeCamera`. The domain is where ``θ R`` rises, at most θ = π, and the distortion
    is one-to-one.

    Project Aria's ``FISHEYE624`` is another model: it bends what the radial part has moved, and swaps p1, p2.

    Begins with the fields of `FocalCamera`.

    Attributes
    ----------
    distortion : tuple of float
        Up to ``(k1, k2, k3, k4, k5, k6, p1, p2, s0, s1, s2, s3)``; what is not given is 0. p1 and p2 are
        OpenCV's, and s0 to s3 what OpenCV calls s1 to s4.
    theta_max_rad : float
        Angle from the axis up to which ``θ R`` rises. Derived.

    Raises
    ------
    CalibrationError
        If a number is not finite, a focal length or the image is not positive, or there are more than twelve
        coefficients.

    Notes
    -----
    OpenSfM, ``opensfm/src/geometry/camera_distortions_functions.h`` (its documentation gives θ, θ², θ³ where
    the program takes θ², θ⁴, θ⁶); COLMAP, ``src/colmap/sensor/models.h``.
    """

    model: ClassVar[str] = "fisheye624"

    distortion: tuple[float, ...] = ()
    theta_max_rad: float = field(init=False, repr=False, compare=False)
    _brown: BrownDistortion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        check_with_distortion(self)
        if len(self.distortion) > _MOST_COEFFICIENTS:
            raise CalibrationError(
                f"{len(self.distortion)} fisheye624 coefficients given: expected at most {_MOST_COEFFICIENTS}"
                " (k1 to k6, p1, p2, s0 to s3)"
            )
        k = (*self.distortion, *(0.0,) * (_MOST_COEFFICIENTS - len(self.distortion)))
        brown = BrownDistortion(math.pi, (1.0, *k[:6]), tangential=k[6:8], prism=k[8:])
        object.__setattr__(self, "_brown", brown)
        object.__setattr__(self, "theta_max_rad", brown.r_max)

    def _plane_from_point(self, point: FloatArray) -> tuple[FloatArray, BoolArray]:
        across = np.hypot(point[..., 0], point[..., 1])
        theta = np.arctan2(across, point[..., 2])
        # The camera's centre has no direction, and straight behind the camera every azimuth is the same ray.
        defined = (across > 0.0) | (point[..., 2] > 0.0)
        inside = defined & (theta <= self.theta_max_rad) & np.isfinite(point).all(-1)
        stretch = theta / np.where(inside & (across > 0.0), across, 1.0)
        plane = stretch[..., np.newaxis] * np.where(inside[..., np.newaxis], point[..., :2], 0.0)
        return np.where(inside[..., np.newaxis], plane, 0.0), inside

    def _lifted(self, plane: FloatArray, *, slopes: bool) -> tuple[Columns, tuple[Columns, Columns] | None]:
        """Rays ``(k x, k y, cos θ)`` with ``k = sin θ / θ``; the slope of k by θ, over θ, is m."""
        x, y = plane[..., 0], plane[..., 1]
        # The smallest number keeps the axis, where x = y = 0, from being divided by 0; elsewhere it is lost.
        square = x * x + y * y + _TINY
        theta = np.sqrt(square)
        sin, cos = sin_cos(theta)
        k = sin / theta
        ray = Columns(k * x, k * y, cos)
        if not slopes:
            return ray, None
        m = (cos - k) / square
        cross = m * x * y
        return ray, (Columns(k + m * x * x, cross, -k * x), Columns(cross, k + m * y * y, -k * y))
