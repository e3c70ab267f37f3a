"""The fisheye camera of Kannala and Brandt with four coefficients, as OpenCV and Kalibr write it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras.base import FocalCamera, PixelRays, check_with_distortion
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.errors import CalibrationError


@dataclass(frozen=True, slots=True)
class FisheyeCamera(FocalCamera):
    """Kannala-Brandt intrinsics: ``cv2.fisheye``, and Kalibr's ``pinhole`` with ``equidistant``.

    With θ the angle between the ray and the optical axis, at azimuth φ in the image::

        θ_d          = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)
        (u, v)       = (fx θ_d cos φ + cx, fy θ_d sin φ + cy)

    That is the f-theta model with the polynomial ``fy θ_d`` and the linear term ``c = fx / fy``, which does
    the work here. The domain is where θ_d rises, at most θ = π and ten diagonals of the image. Outside it
    pixels and rays are NaN.

    Begins with the fields of `FocalCamera`.

    Attributes
    ----------
    distortion : tuple of float
        ``()`` or up to ``(k1, k2, k3, k4)``; what is not given is 0.

    Raises
    ------
    CalibrationError
        If a number is not finite, a focal length or the image is not positive, or there are more than four
        coefficients.

    Notes
    -----
    Kannala and Brandt (2006), doi:10.1109/TPAMI.2006.153; OpenCV, "Fisheye camera model".
    """

    model: ClassVar[str] = "fisheye"

    distortion: tuple[float, ...] = ()
    _ftheta: FThetaCamera = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and build the f-theta camera that is the same."""
        check_with_distortion(self)
        if len(self.distortion) > 4:
            raise CalibrationError(
                f"{len(self.distortion)} fisheye coefficients given: expected 4 (k1 k2 k3 k4)"
            )
        odd = [part for k in (1.0, *self.distortion) for part in (0.0, self.fy_px * k)]
        ftheta = FThetaCamera(
            self.width_px,
            self.height_px,
            self.cx_px,
            self.cy_px,
            r_from_theta=tuple(odd),
            c=self.fx_px / self.fy_px,
        )
        object.__setattr__(self, "_ftheta", ftheta)

    @property
    def theta_max_rad(self) -> float:
        """Angle from the axis at which the domain ends."""
        return self._ftheta.theta_max_rad

    @property
    def horizontal_fov_rad(self) -> float:
        """See `CameraModel`; more than π for a lens that sees behind itself."""
        return self._ftheta.horizontal_fov_rad

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """See `CameraModel`."""
        return self._ftheta.pixel_from_camera_point(point_camera)

    def camera_ray_from_pixel(self, pixel_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """See `CameraModel`."""
        return self._ftheta.camera_ray_from_pixel(pixel_px)

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> PixelRays:
        """See `CameraModel`."""
        return self._ftheta.rays(u_px, v_px, slopes=slopes)
