"""The f-theta camera of NVIDIA DriveWorks: radius in the image as a polynomial of the ray's angle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from geoloc.angles import sin_cos
from geoloc.cameras.base import (
    BoolArray,
    Columns,
    FloatArray,
    Rays,
    check_parameters,
    inside_image,
    nan_where_not,
    on_image,
)
from geoloc.cameras.linear import LinearTerms
from geoloc.cameras.monotonic import derivative, invert_rising_polynomial, polynomial, reach, rising_limit
from geoloc.errors import CalibrationError

# A constant term below this (about a thousandth of a pixel) is rounding in a file, above it another model.
_CONSTANT_TOLERANCE = {"theta_from_r": 1e-6, "r_from_theta": 1e-3}
_MAX_DISAGREEMENT_PX = 2.0
# No calibration means anything farther out than this many diagonals of its image.
_MAX_DIAGONALS = 10.0
_TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True)
class FThetaCamera:
    """F-theta intrinsics, in either direction of the polynomial.

    With ``r`` the radius in pixels before the linear terms and ``θ`` the angle between the ray and the
    optical axis::

        ray (RDF)        = (sin θ · x/r, sin θ · y/r, cos θ)
        [u - cx, v - cy] = [[c, d], [e, 1]] @ [x, y]

    One polynomial is the *reference*, and the other direction is always its numerical inverse, so that pixel
    → ray → pixel closes to rounding. Where both are given, `theta_from_r` is the reference and
    `r_from_theta`, usually a fitted approximation of the inverse, is only checked against it.

    The domain is where the reference rises (`r_max_px`, `theta_max_rad`), at most θ = π and ten diagonals of
    the image. Outside it pixels and rays are NaN. A point inside the domain but off the image has its true
    pixel, and a false mask.

    Attributes
    ----------
    width_px, height_px : int
    cx_px, cy_px : float
        Principal point; (0, 0) is the centre of the first pixel.
    theta_from_r : tuple of float or None
        Ascending coefficients, pixels to radians (``bw-poly``, ``pixeldistance-to-angle``). No constant term.
    r_from_theta : tuple of float or None
        Ascending coefficients, radians to pixels (``angle-to-pixeldistance``). No constant term.
    c, d, e : float
        Linear terms. All zero means none were calibrated: the identity.
    r_max_px, theta_max_rad : float
        Limits of the domain, derived.

    Raises
    ------
    CalibrationError
        If there is no polynomial, it does not rise from zero, the linear terms are singular, a number is not
        finite, or the two polynomials differ by more than 2 pixels on the image.

    Notes
    -----
    NVIDIA DriveWorks 4.0, "Camera models"; pixel centres as in NVIDIA ncore, "Sensor models".
    """

    width_px: int
    height_px: int
    cx_px: float
    cy_px: float
    theta_from_r: tuple[float, ...] | None = None
    r_from_theta: tuple[float, ...] | None = None
    c: float = 1.0
    d: float = 0.0
    e: float = 0.0
    r_max_px: float = field(init=False, repr=False, compare=False)
    theta_max_rad: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        if self.c == 0.0 and self.d == 0.0 and self.e == 0.0:
            object.__setattr__(self, "c", 1.0)
        for name, tolerance in _CONSTANT_TOLERANCE.items():
            if getattr(self, name) is not None:
                coefficients = tuple(float(coefficient) for coefficient in getattr(self, name))
                object.__setattr__(self, name, _without_constant(name, coefficients, tolerance))
        self._check_numbers()
        r_max_px, theta_max_rad = self._domain()
        object.__setattr__(self, "r_max_px", r_max_px)
        object.__setattr__(self, "theta_max_rad", theta_max_rad)
        self._check_agreement()

    @property
    def model(self) -> str:
        """``ftheta``."""
        return "ftheta"

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle between the rays of the left and right image edge in the row of the principal point.

        More than π for a fisheye that sees behind itself. NaN if an edge is outside the domain.
        """
        edges_px = np.array([-0.5 - self.cx_px, self.width_px - 0.5 - self.cx_px])
        radius = np.hypot(*self._linear.plane_from_offset(edges_px, np.zeros(2)))
        if (radius > self.r_max_px).any():
            return math.nan
        left, right = np.sign(edges_px) * self._theta_from_radius(radius)
        return float(right - left)

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project points ``(..., 3)`` (RDF, any length) to pixels ``(..., 2)`` with a mask ``(...)``.

        NaN outside the domain; the mask is true inside it where the pixel is on the image.
        """
        point = np.asarray(point_camera, dtype=np.float64)
        across = np.hypot(point[..., 0], point[..., 1])
        theta = np.arctan2(across, point[..., 2])
        # The camera's centre has no direction, and straight behind the camera every azimuth is the same ray.
        defined = (across > 0.0) | (point[..., 2] > 0.0)
        inside = defined & (theta <= self.theta_max_rad) & np.isfinite(point).all(-1)
        radius = self._radius_from_theta(np.where(inside, theta, 0.0))
        # On the axis the direction in the image is undefined, and the radius is 0.
        stretch = radius / np.where(inside & (across > 0.0), across, 1.0)
        x, y = (stretch * np.where(inside, point[..., axis], 0.0) for axis in (0, 1))
        du_px, dv_px = self._linear.offset_from_plane(x, y)
        pixel = nan_where_not(inside, np.stack([self.cx_px + du_px, self.cy_px + dv_px], axis=-1))
        return pixel, on_image(pixel, self.width_px, self.height_px)

    def camera_ray_from_pixel(self, pixel_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Unit rays ``(..., 3)`` (RDF) of pixels ``(..., 2)`` with a mask ``(...)``.

        NaN outside the domain; the mask is true inside it where the pixel is on the image.
        """
        pixel = np.asarray(pixel_px, dtype=np.float64)
        pixel = np.where(np.isfinite(pixel), pixel, np.nan)
        x, y = self._linear.plane_from_offset(pixel[..., 0] - self.cx_px, pixel[..., 1] - self.cy_px)
        radius = np.hypot(x, y)
        inside = radius <= self.r_max_px
        theta = self._theta_from_radius(np.where(inside, radius, 0.0))
        stretch = np.sin(theta) / np.where(radius > 0.0, radius, 1.0)
        ray = nan_where_not(inside, np.stack([stretch * x, stretch * y, np.cos(theta)], axis=-1))
        return ray, inside & on_image(pixel, self.width_px, self.height_px)

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> Rays:
        """Give the rays of `camera_ray_from_pixel` by component, with their derivatives by pixel if asked.

        With ``k = sin θ / r`` and a dash for the derivative by r, the ray ``(k x, k y, cos θ)`` changes by x
        as ``(k + m x², m x y, -k θ' x)``, where ``m = k' / r = (θ' cos θ - k) / r²``; by y in the same way.
        """
        x, y = self._linear.plane_from_offset(u_px - self.cx_px, v_px - self.cy_px)
        # The smallest number keeps the axis, where x = y = 0, from being divided by 0; elsewhere it is lost.
        square = x * x + y * y + _TINY
        radius = np.sqrt(square)
        inside = (radius <= self.r_max_px) & inside_image(u_px, v_px, self.width_px, self.height_px)
        theta = self._theta_from_radius(radius)
        sin, cos = sin_cos(theta)
        k = sin / radius
        ray = Columns(k * x, k * y, cos)
        if not slopes:
            return Rays(ray, None, None, inside)
        slope = self._theta_slope(radius, theta)
        m, down = (slope * cos - k) / square, -k * slope
        by_x = Columns(k + m * x * x, cross := m * x * y, down * x)
        by_y = Columns(cross, k + m * y * y, down * y)
        return Rays(ray, *self._linear.by_pixel(by_x, by_y), inside)

    @property
    def _linear(self) -> LinearTerms:
        return LinearTerms(self.c, self.d, self.e)

    def _theta_from_radius(self, radius_px: FloatArray) -> FloatArray:
        if self.theta_from_r is not None:
            return polynomial(self.theta_from_r, radius_px)
        return invert_rising_polynomial(self.r_from_theta or (), radius_px, self.theta_max_rad)

    def _theta_slope(self, radius_px: FloatArray, theta_rad: FloatArray) -> FloatArray:
        """Derivative of the angle by the radius, at a pair of both."""
        if self.theta_from_r is not None:
            return polynomial(derivative(self.theta_from_r), radius_px)
        return 1.0 / polynomial(derivative(self.r_from_theta or ()), theta_rad)

    def _radius_from_theta(self, theta_rad: FloatArray) -> FloatArray:
        if self.theta_from_r is not None:
            return invert_rising_polynomial(self.theta_from_r, theta_rad, self.r_max_px)
        return polynomial(self.r_from_theta or (), theta_rad)

    def _domain(self) -> tuple[float, float]:
        """Largest radius and angle up to which the reference polynomial rises."""
        reference = self.theta_from_r or self.r_from_theta
        if reference is None:
            raise CalibrationError("an f-theta camera needs a polynomial: theta_from_r or r_from_theta")
        widest = (_MAX_DIAGONALS * self._diagonal_px(), math.pi)
        x_max, y_max = widest if self.theta_from_r is not None else widest[::-1]
        limit = rising_limit(reference, x_max)
        if limit <= 0.0:
            raise CalibrationError(f"the f-theta polynomial {reference} does not rise from zero")
        limit = reach(reference, y_max, limit)
        value = float(polynomial(reference, np.array(limit)))
        return (limit, value) if self.theta_from_r is not None else (value, limit)

    def _diagonal_px(self) -> float:
        """A length no shorter than the way from the principal point to any corner of the image."""
        return math.hypot(self.width_px + abs(self.cx_px), self.height_px + abs(self.cy_px))

    def _check_numbers(self) -> None:
        numbers = [self.cx_px, self.cy_px, self.c, self.d, self.e]
        numbers += [*(self.theta_from_r or ()), *(self.r_from_theta or ())]
        check_parameters("f-theta", self.width_px, self.height_px, numbers)
        if self._linear.singular:
            raise CalibrationError(f"the linear terms c={self.c}, d={self.d}, e={self.e} are singular")

    def _check_agreement(self) -> None:
        if self.theta_from_r is None or self.r_from_theta is None:
            return
        corner = math.hypot(
            max(self.cx_px, self.width_px - self.cx_px), max(self.cy_px, self.height_px - self.cy_px)
        )
        radius = np.linspace(0.0, min(corner, self.r_max_px), 64)
        apart = np.abs(polynomial(self.r_from_theta, polynomial(self.theta_from_r, radius)) - radius)
        if apart.max() > _MAX_DISAGREEMENT_PX:
            raise CalibrationError(
                f"the two f-theta polynomials differ by up to {apart.max():.1f} px at r = "
                f"{radius[apart.argmax()]:.0f} px: they are not inverses of each other"
            )


def _without_constant(name: str, coefficients: tuple[float, ...], tolerance: float) -> tuple[float, ...]:
    if len(coefficients) < 2 or not abs(coefficients[0]) <= tolerance:
        raise CalibrationError(
            f"{name} = {coefficients} must be a constant term of 0 and at least a linear one"
        )
    return (0.0, *coefficients[1:])
