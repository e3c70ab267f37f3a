"""The omnidirectional camera of Scaramuzza: the ray's depth as a polynomial of the radius in the image."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Polynomial

from geoloc.cameras.base import (
    SHORTEST_FOCAL_LENGTH_PX,
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
from geoloc.cameras.monotonic import MIN_SLOPE_RATIO, derivative, invert_rising, polynomial, smallest_root
from geoloc.errors import CalibrationError

# No calibration means anything farther out than this many diagonals of its image.
_MAX_DIAGONALS = 10.0


@dataclass(frozen=True, slots=True)
class OcamCamera:
    """Scaramuzza's intrinsics, as OCamCalib fits them.

    With ρ the radius in pixels before the linear terms and ``f(ρ) = a0 + a2 ρ² + a3 ρ³ + …``, a0 negative::

        ray (RDF)        ∝ (x, y, -f(ρ)),   ρ = |(x, y)|
        [u - cx, v - cy] = [[c, d], [e, 1]] @ [x, y]

    OCamCalib's own axes are row, column and backward; its files put the row first in the linear terms, which
    `geoloc.calibration_files` converts without loss.

    The domain is where the angle from the axis rises with ρ, at most ten diagonals of the image: for a
    fisheye far beyond 90°. Pixel → ray is the formula itself; ray → pixel its numerical inverse, so that both
    close to rounding. The inverse polynomial that OCamCalib fits beside it is not used: it leaves up to some
    0.02 px.

    Attributes
    ----------
    width_px, height_px : int
    cx_px, cy_px : float
        Principal point; (0, 0) is the centre of the first pixel.
    polynomial : tuple of float
        ``(a0, 0, a2, a3, …)``, ascending, pixels.
    c, d, e : float
        Linear terms.
    r_max_px, theta_max_rad : float
        Limits of the domain, derived.

    Raises
    ------
    CalibrationError
        If a number is not finite, the image is empty, the polynomial's constant is not negative or its linear
        term not zero, or the linear terms are singular.

    Notes
    -----
    Scaramuzza, Martinelli and Siegwart (2006), doi:10.1109/IROS.2006.282372; OCamCalib toolbox.
    """

    width_px: int
    height_px: int
    cx_px: float
    cy_px: float
    polynomial: tuple[float, ...]
    c: float = 1.0
    d: float = 0.0
    e: float = 0.0
    r_max_px: float = field(init=False, repr=False, compare=False)
    theta_max_rad: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        object.__setattr__(self, "polynomial", tuple(float(coefficient) for coefficient in self.polynomial))
        numbers = (self.cx_px, self.cy_px, self.c, self.d, self.e, *self.polynomial)
        check_parameters("ocam", self.width_px, self.height_px, numbers)
        if not self.polynomial or self.polynomial[0] > -SHORTEST_FOCAL_LENGTH_PX:
            raise CalibrationError(
                f"the ocam polynomial {self.polynomial} must begin with a negative constant, minus the focal"
                " length in pixels"
            )
        if len(self.polynomial) > 1 and self.polynomial[1] != 0.0:
            raise CalibrationError(
                f"the linear term of the ocam polynomial is {self.polynomial[1]}: OCamCalib always has 0"
            )
        if self._linear.singular:
            raise CalibrationError(f"the linear terms c={self.c}, d={self.d}, e={self.e} are singular")
        r_max_px = self._rising_limit()
        object.__setattr__(self, "r_max_px", r_max_px)
        object.__setattr__(self, "theta_max_rad", float(self._theta(np.array(r_max_px))))

    @property
    def model(self) -> str:
        """``ocam``."""
        return "ocam"

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle between the rays of the left and right image edge in the row of the principal point.

        More than π for a lens that sees behind itself. NaN if an edge is outside the domain.
        """
        edges_px = np.array([-0.5 - self.cx_px, self.width_px - 0.5 - self.cx_px])
        radius = np.hypot(*self._linear.plane_from_offset(edges_px, np.zeros(2)))
        if (radius > self.r_max_px).any():
            return math.nan
        left, right = np.sign(edges_px) * self._theta(radius)
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
        radius = invert_rising(self._theta, self._slope, np.where(inside, theta, 0.0), self.r_max_px)
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
        x, y = self._linear.plane_from_offset(
            *(np.where(np.isfinite(pixel).all(-1), pixel[..., i] - c, np.nan) for i, c in self._centre)
        )
        radius = np.hypot(x, y)
        inside = radius <= self.r_max_px
        depth = -polynomial(self.polynomial, np.where(inside, radius, 0.0))
        ray = np.stack([x, y, depth], axis=-1) / np.hypot(radius, depth)[..., np.newaxis]
        return nan_where_not(inside, ray), inside & on_image(pixel, self.width_px, self.height_px)

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> Rays:
        """Give the rays of `camera_ray_from_pixel` by component, with their derivatives by pixel if asked.

        With the depth ``z = -f(ρ)``, its slope over the radius ``s = z' / ρ`` and ``n = 1 / |(ρ, z)|``, the
        ray ``n (x, y, z)`` changes by x as ``n (1, 0, s x) - n³ x (1 + z s) (x, y, z)``; by y likewise.
        """
        x, y = self._linear.plane_from_offset(u_px - self.cx_px, v_px - self.cy_px)
        square = x * x + y * y
        radius = np.sqrt(square)
        inside = (radius <= self.r_max_px) & inside_image(u_px, v_px, self.width_px, self.height_px)
        z = -polynomial(self.polynomial, radius)
        n = 1.0 / np.sqrt(square + z * z)
        ray = Columns(n * x, n * y, n * z)
        if not slopes:
            return Rays(ray, None, None, inside)
        s = -polynomial(derivative(self.polynomial)[1:], radius)
        shrink = n * n * (1.0 + z * s)
        by_x = Columns(n - shrink * x * ray.x, cross := -shrink * x * ray.y, n * s * x - shrink * x * ray.z)
        by_y = Columns(cross, n - shrink * y * ray.y, n * s * y - shrink * y * ray.z)
        return Rays(ray, *self._linear.by_pixel(by_x, by_y), inside)

    @property
    def _linear(self) -> LinearTerms:
        return LinearTerms(self.c, self.d, self.e)

    @property
    def _centre(self) -> tuple[tuple[int, float], tuple[int, float]]:
        return (0, self.cx_px), (1, self.cy_px)

    def _theta(self, radius_px: FloatArray) -> FloatArray:
        return np.arctan2(radius_px, -polynomial(self.polynomial, radius_px))

    def _slope(self, radius_px: FloatArray) -> FloatArray:
        """Derivative of the angle by the radius."""
        z = -polynomial(self.polynomial, radius_px)
        rise = z + radius_px * polynomial(derivative(self.polynomial), radius_px)
        return np.asarray(rise / (radius_px * radius_px + z * z))

    def _rising_limit(self) -> float:
        """Radius at which the slope of the angle falls to `MIN_SLOPE_RATIO` of that on the axis."""
        f, r = Polynomial(self.polynomial), Polynomial((0.0, 1.0))
        flat = (r * f.deriv() - f) * -self.polynomial[0] - MIN_SLOPE_RATIO * (r * r + f * f)
        reach = math.hypot(self.width_px + abs(self.cx_px), self.height_px + abs(self.cy_px))
        return smallest_root(tuple(flat.coef), _MAX_DIAGONALS * reach)
