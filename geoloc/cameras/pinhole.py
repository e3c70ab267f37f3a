"""The pinhole camera with Brown's lens distortion, as OpenCV writes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Polynomial

from geoloc.cameras.base import BoolArray, Columns, FloatArray, Rays, inside_image, nan_where_not, on_image
from geoloc.cameras.monotonic import (
    MIN_SLOPE_RATIO,
    derivative,
    invert_rising,
    polynomial,
    smallest_root,
)
from geoloc.errors import CalibrationError

# No lens of this kind sees farther from its axis; the bound keeps every radius finite.
_MAX_ANGLE_DEG = 89.0
_NEWTON_ITERATIONS = 20
# In units of the focal length: 1e-12 of a 2000 px focal length is 2e-9 px.
_NEWTON_TOLERANCE = 1e-12


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """Pinhole intrinsics with radial (plain or rational) and tangential distortion.

    The domain is the part of the image plane over which the distortion is one-to-one: up to `r_max`, where
    its radial part stops rising, and 89° from the axis at most. Points beyond it, which the formula would
    fold back into the image, are NaN, as are points behind the camera. A point inside the domain but off the
    image has its true pixel, and a false mask.

    Attributes
    ----------
    width_px, height_px : int
    fx_px, fy_px : float
        Focal lengths.
    cx_px, cy_px : float
        Principal point; (0, 0) is the centre of the first pixel.
    distortion : tuple of float
        OpenCV's order: ``()``, ``(k1, k2, p1, p2)``, ``(…, k3)`` or ``(…, k3, k4, k5, k6)``.
    r_max : float
        Largest tangent of the angle from the axis, before distortion. Derived.

    Raises
    ------
    CalibrationError
        If a number is not finite, a focal length or the image is not positive, or `distortion` has another
        length.

    Notes
    -----
    OpenCV, "Camera Calibration and 3D Reconstruction", detailed description; Brown (1966). The inverse is our
    own Newton iteration to machine precision: ``cv2.undistortPoints`` stops after 5 fixed-point steps unless
    told otherwise, 0.14 px off at k1 = -0.3.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()
    r_max: float = field(init=False, repr=False, compare=False)
    _radial: tuple[tuple[float, ...], tuple[float, ...]] = field(init=False, repr=False, compare=False)
    _radial_slope: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _tangential: tuple[float, float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers, sort the coefficients and find the domain."""
        object.__setattr__(self, "distortion", tuple(float(coefficient) for coefficient in self.distortion))
        numbers = [self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion]
        if not all(math.isfinite(number) for number in numbers):
            raise CalibrationError("a pinhole parameter is not a finite number")
        if min(self.width_px, self.height_px, self.fx_px, self.fy_px) <= 0:
            raise CalibrationError(
                f"a pinhole camera of {self.width_px} x {self.height_px} pixels with focal lengths "
                f"{self.fx_px} and {self.fy_px} is not one: all four must be positive"
            )
        if len(self.distortion) not in {0, 4, 5, 8}:
            raise CalibrationError(
                f"{len(self.distortion)} distortion coefficients given: expected 0, 4, 5 or 8 "
                "(k1 k2 p1 p2 k3 k4 k5 k6)"
            )
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, *(0.0,) * (8 - len(self.distortion)))
        object.__setattr__(self, "_radial", ((1.0, k1, k2, k3), (1.0, k4, k5, k6)))
        object.__setattr__(self, "_tangential", (p1, p2))
        object.__setattr__(self, "_radial_slope", _slope_numerator(*self._radial))
        object.__setattr__(self, "r_max", _radial_limit(self._radial_slope, self._radial[1]))

    @property
    def model(self) -> str:
        """``pinhole``."""
        return "pinhole"

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle between the rays of the left and right image edge in the row of the principal point.

        NaN if an edge is outside the domain.
        """
        edges_px = np.array([[-0.5, self.cy_px], [self.width_px - 0.5, self.cy_px]])
        left, right = self.camera_ray_from_pixel(edges_px)[0]
        return float(np.arctan2(np.linalg.norm(np.cross(left, right)), left @ right))

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project points ``(..., 3)`` (RDF, any length) to pixels ``(..., 2)`` with a mask ``(...)``.

        NaN outside the domain; the mask is true inside it where the pixel is on the image.
        """
        point = np.asarray(point_camera, dtype=np.float64)
        inside = (point[..., 2] > 0.0) & np.isfinite(point).all(-1)
        point = np.where(inside[..., np.newaxis], point, (0.0, 0.0, 1.0))
        inside &= np.hypot(point[..., 0], point[..., 1]) <= self.r_max * point[..., 2]
        point = np.where(inside[..., np.newaxis], point, (0.0, 0.0, 1.0))
        plane = point[..., :2] / point[..., 2:]
        distorted, jacobian = self._distort(plane)
        inside &= _one_to_one(jacobian)
        focal, centre = np.array([self.fx_px, self.fy_px]), np.array([self.cx_px, self.cy_px])
        pixel = nan_where_not(inside, centre + focal * distorted)
        return pixel, on_image(pixel, self.width_px, self.height_px)

    def camera_ray_from_pixel(self, pixel_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Unit rays ``(..., 3)`` (RDF) of pixels ``(..., 2)`` with a mask ``(...)``.

        NaN outside the domain; the mask is true inside it where the pixel is on the image.
        """
        pixel = np.asarray(pixel_px, dtype=np.float64)
        focal, centre = np.array([self.fx_px, self.fy_px]), np.array([self.cx_px, self.cy_px])
        plane, inside = self._undistort((pixel - centre) / focal)
        ray = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
        ray = nan_where_not(inside, ray / np.linalg.norm(ray, axis=-1, keepdims=True))
        return ray, inside & on_image(pixel, self.width_px, self.height_px)

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> Rays:
        """Give the rays of `camera_ray_from_pixel` by component, with their derivatives by pixel if asked.

        The ray ``(x, y, 1) / n`` moves by ``(dx, dy, 0) / n`` less its part along itself; (dx, dy) a pixel is
        the inverse Jacobian of the distortion.
        """
        distorted = np.stack([(u_px - self.cx_px) / self.fx_px, (v_px - self.cy_px) / self.fy_px], axis=-1)
        plane, inside = self._undistort(distorted)
        inside &= inside_image(u_px, v_px, self.width_px, self.height_px)
        x, y = plane[..., 0], plane[..., 1]
        forward = 1.0 / np.sqrt(1.0 + x * x + y * y)
        ray = Columns(x * forward, y * forward, forward)
        if not slopes:
            return Rays(ray, None, None, inside)
        jacobian = self._distort(plane)[1]
        determinant = _determinant(jacobian)
        by_u = (
            jacobian[..., 1, 1] / (determinant * self.fx_px),
            -jacobian[..., 1, 0] / (determinant * self.fx_px),
        )
        by_v = (
            -jacobian[..., 0, 1] / (determinant * self.fy_px),
            jacobian[..., 0, 0] / (determinant * self.fy_px),
        )
        return Rays(ray, _turned(ray, *by_u), _turned(ray, *by_v), inside)

    def _radius(self, r: FloatArray) -> FloatArray:
        """Distorted radius of an undistorted one, tangential part left out."""
        numerator, denominator = self._radial
        s = r * r
        return r * polynomial(numerator, s) / polynomial(denominator, s)

    def _radius_slope(self, r: FloatArray) -> FloatArray:
        s = r * r
        return polynomial(self._radial_slope, s) / polynomial(self._radial[1], s) ** 2

    def _distort(self, plane: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted plane coordinates ``(..., 2)`` and their Jacobian ``(..., 2, 2)``."""
        numerator, denominator = self._radial
        p1, p2 = self._tangential
        x, y = plane[..., 0], plane[..., 1]
        s = x * x + y * y
        over, under = polynomial(numerator, s), polynomial(denominator, s)
        factor = over / under
        # Derivative of the factor by s.
        factor_s = (
            polynomial(derivative(numerator), s) * under - over * polynomial(derivative(denominator), s)
        ) / under**2
        distorted = np.stack(
            [
                x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
                y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )
        cross = 2.0 * x * y * factor_s + 2.0 * p1 * x + 2.0 * p2 * y
        jacobian = np.stack(
            [
                np.stack([factor + 2.0 * x * x * factor_s + 2.0 * p1 * y + 6.0 * p2 * x, cross], axis=-1),
                np.stack([cross, factor + 2.0 * y * y * factor_s + 6.0 * p1 * y + 2.0 * p2 * x], axis=-1),
            ],
            axis=-2,
        )
        return distorted, jacobian

    def _undistort(self, distorted: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Plane coordinates ``(..., 2)`` before distortion, and where they were found inside the domain."""
        radius = np.hypot(distorted[..., 0], distorted[..., 1])
        finite = np.isfinite(radius)
        target = np.where(finite[..., np.newaxis], distorted, 0.0)
        radius = np.where(finite, radius, 0.0)
        undistorted = invert_rising(self._radius, self._radius_slope, radius, self.r_max)
        inside = finite & ~np.isnan(undistorted)
        start = np.where(np.isnan(undistorted), self.r_max, undistorted)
        plane = target * (start / np.where(radius > 0.0, radius, 1.0))[..., np.newaxis]
        if not any(self._tangential):
            return plane, inside
        return self._polish(plane, target, finite)

    def _polish(
        self, plane: FloatArray, target: FloatArray, wanted: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """Newton's method in two dimensions from a start near the answer."""
        for _ in range(_NEWTON_ITERATIONS):
            distorted, jacobian = self._distort(plane)
            residual = target - distorted
            if (np.abs(residual) <= _NEWTON_TOLERANCE).all():
                break
            plane = plane + _newton_step(jacobian, residual)
            reached = np.hypot(plane[..., 0], plane[..., 1])
            plane = plane * (self.r_max / np.maximum(reached, self.r_max))[..., np.newaxis]
        distorted, jacobian = self._distort(plane)
        solved = (np.abs(target - distorted) <= 10.0 * _NEWTON_TOLERANCE).all(-1)
        return plane, wanted & solved & _one_to_one(jacobian)


def _turned(ray: Columns, dx: FloatArray, dy: FloatArray) -> Columns:
    """Move of the unit ray when its plane coordinates move by (dx, dy)."""
    along = ray.x * dx + ray.y * dy
    return Columns(ray.z * (dx - along * ray.x), ray.z * (dy - along * ray.y), -ray.z * along * ray.z)


def _determinant(jacobian: FloatArray) -> FloatArray:
    return np.asarray(jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0])


def _one_to_one(jacobian: FloatArray) -> BoolArray:
    return np.asarray(_determinant(jacobian) > MIN_SLOPE_RATIO**2)


def _newton_step(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Residual through the inverse Jacobian; the residual itself where that has no use."""
    usable = _one_to_one(jacobian)
    matrix = np.where(usable[..., np.newaxis, np.newaxis], jacobian, np.eye(2))
    x, y = residual[..., 0], residual[..., 1]
    step = np.stack(
        [
            matrix[..., 1, 1] * x - matrix[..., 0, 1] * y,
            matrix[..., 0, 0] * y - matrix[..., 1, 0] * x,
        ],
        axis=-1,
    )
    return np.asarray(step / _determinant(matrix)[..., np.newaxis])


def _slope_numerator(numerator: tuple[float, ...], denominator: tuple[float, ...]) -> tuple[float, ...]:
    """Numerator, in s = r², of the slope by r of r N(s)/D(s); its denominator is D(s)²."""
    N, D = Polynomial(numerator), Polynomial(denominator)
    return tuple((N * D + Polynomial((0.0, 2.0)) * (N.deriv() * D - N * D.deriv())).coef)


def _radial_limit(slope: tuple[float, ...], denominator: tuple[float, ...]) -> float:
    """Largest r up to which the radial part rises (`MIN_SLOPE_RATIO`) and has no pole."""
    widest = math.tan(math.radians(_MAX_ANGLE_DEG)) ** 2
    flat = Polynomial(slope) - MIN_SLOPE_RATIO * Polynomial(denominator) ** 2
    # Before a pole the radius grows without bound: no image reaches the last thousandth of the way.
    s = min(smallest_root(tuple(flat.coef), widest), 0.999 * smallest_root(denominator, widest / 0.999))
    return math.sqrt(s)
