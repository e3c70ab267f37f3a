"""The field-of-view camera of Devernay and Faugeras, as Kalibr and COLMAP write it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.cameras.base import FocalCamera, check_focal_lengths, check_parameters, sin_cos
from geoloc.cameras.radial import LinearTerms, RadialCamera
from geoloc.errors import CalibrationError

# Kalibr's own limit: the formula begins with a point in a plane before the camera.
_MAX_ANGLE_RAD = math.radians(89.0)
# Beyond, the radius all but ends a few degrees from the axis; no lens is like that.
_NARROWEST_RAD, _WIDEST_RAD = 1e-6, 3.0


@dataclass(frozen=True, slots=True)
class FovCamera(FocalCamera, RadialCamera):
    """Intrinsics with the FOV distortion: Kalibr's ``pinhole`` with ``fov``, COLMAP's ``FOV``.

    With θ the angle between the ray and the optical axis, at azimuth φ in the image::

        θ_d          = atan(2 tan(ω / 2) tan θ) / ω
        (u, v)       = (fx θ_d cos φ + cx, fy θ_d sin φ + cy)

    Both directions are closed forms. It is a `RadialCamera` with the linear term ``c = fx / fy``. The domain
    ends 89° from the axis.

    Begins with the fields of `FocalCamera`.

    Attributes
    ----------
    omega_rad : float
        ω, the field of view of the ideal fisheye lens: Kalibr's w. Near 0 it is the pinhole camera.
    r_max_px, theta_max_rad : float
        Limits of the domain, derived.

    Raises
    ------
    CalibrationError
        If a number is not finite, a focal length or the image is not positive, or ω is not from 1e-6 to 3.

    Notes
    -----
    Devernay and Faugeras (2001), "Straight lines have to be straight", doi:10.1007/PL00013269.
    """

    model: ClassVar[str] = "fov"

    omega_rad: float
    r_max_px: float = field(init=False, repr=False, compare=False)
    theta_max_rad: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, self.omega_rad)
        check_parameters("fov", self.width_px, self.height_px, numbers)
        check_focal_lengths("fov", self.fx_px, self.fy_px)
        if not _NARROWEST_RAD <= self.omega_rad <= _WIDEST_RAD:
            raise CalibrationError(
                f"a fov camera with omega {self.omega_rad:g} is none: it must be from {_NARROWEST_RAD:g} to"
                f" {_WIDEST_RAD:g} rad"
            )
        object.__setattr__(self, "theta_max_rad", _MAX_ANGLE_RAD)
        object.__setattr__(self, "r_max_px", float(self._radius_from_theta(np.array(_MAX_ANGLE_RAD))))

    @property
    def _linear(self) -> LinearTerms:
        return LinearTerms(self.fx_px / self.fy_px, 0.0, 0.0)

    @property
    def _scale(self) -> float:
        """Of the tangent of θ."""
        return 2.0 * math.tan(0.5 * self.omega_rad)

    def _radius_from_theta(self, theta_rad: FloatArray) -> FloatArray:
        bent = np.arctan2(self._scale * np.sin(theta_rad), np.cos(theta_rad))
        return np.asarray(self.fy_px / self.omega_rad * bent)

    def _theta_from_radius(self, radius_px: FloatArray) -> FloatArray:
        sin, cos = sin_cos(self.omega_rad / self.fy_px * radius_px)
        return np.arctan2(sin, self._scale * cos)

    def _theta_slope(self, radius_px: FloatArray, _theta_rad: FloatArray) -> FloatArray:
        bend = self.omega_rad / self.fy_px
        sin, cos = sin_cos(bend * radius_px)
        return np.asarray(bend * self._scale / (sin * sin + (self._scale * cos) ** 2))
