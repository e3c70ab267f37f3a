"""Omnidirectional cameras behind one or two spheres: Mei, double sphere and extended unified."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from geoloc.cameras.base import (
    BoolArray,
    Columns,
    FloatArray,
    Rays,
    check_focal_lengths,
    check_parameters,
    inside_image,
    nan_where_not,
    on_image,
)
from geoloc.cameras.brown import BrownDistortion, one_to_one
from geoloc.cameras.monotonic import MIN_SLOPE_RATIO
from geoloc.errors import CalibrationError

# Where the plane is a tangent, 89° for ξ = 0; the bound keeps every radius finite.
_WIDEST = math.tan(math.radians(89.0))
_THETA_STEPS = 3_601
# Radii up to here come back from the closed form of the inverse as the angle that they came from.
_SAME_ANGLE_RAD = 1e-6
# Keeps roots real beyond the domain, where what comes out is not used.
_LEAST_SQUARE = 1e-12


@dataclass(frozen=True, slots=True)
class OmniCamera:
    """Intrinsics of Mei (Kalibr's ``omni``), of the double sphere (``ds``) and extended unified (``eucm``).

    With ``w = Z + ξ`` and ``d = sqrt(β (X² + Y²) + w²)``, the point (X, Y, Z) at distance 1 is seen in the
    plane at ``(X, Y) / (α d + (1 - α) w)``, which is then distorted as by Brown, scaled by the focal lengths
    and moved to the principal point.

    ======================  =============  ======  ======
    model                   ξ              α       β
    ======================  =============  ======  ======
    Mei, ``omni``           0 or more      0       1
    double sphere, ``ds``   more than -1   0 to 1  1
    ``eucm``                0              0 to 1  over 0
    ======================  =============  ======  ======

    All zero, with β = 1, is the pinhole camera. The domain is the part of the plane over which the radius
    rises with the angle and the distortion is one-to-one.

    Attributes
    ----------
    width_px, height_px : int
    xi : float
    fx_px, fy_px : float
        Focal lengths: of the plane; on the axis a radian is ``f / (1 + ξ)`` pixels.
    cx_px, cy_px : float
        Principal point; (0, 0) is the centre of the first pixel.
    distortion : tuple of float
        As in `PinholeCamera`.
    alpha, beta : float
    theta_max_rad : float
        Angle from the axis at which the domain ends, distortion aside. Derived.

    Raises
    ------
    CalibrationError
        If a number is not finite or outside its range, a focal length or the image is not positive, or
        `distortion` is of another length.

    Notes
    -----
    Mei and Rives (2007), doi:10.1109/ROBOT.2007.364084; Usenko, Demmel and Cremers (2018),
    doi:10.1109/3DV.2018.00069; Khomutenko, Garcia and Martinet (2016), doi:10.1109/LRA.2015.2502921.
    """

    width_px: int
    height_px: int
    xi: float
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()
    alpha: float = 0.0
    beta: float = 1.0
    theta_max_rad: float = field(init=False, repr=False, compare=False)
    _brown: BrownDistortion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        object.__setattr__(self, "distortion", tuple(float(coefficient) for coefficient in self.distortion))
        shape = (self.xi, self.alpha, self.beta)
        numbers = (*shape, self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion)
        check_parameters("omni", self.width_px, self.height_px, numbers)
        check_focal_lengths("omni", self.fx_px, self.fy_px)
        if not (self.xi > -1.0 and 0.0 <= self.alpha <= 1.0 and self.beta > 0.0):
            raise CalibrationError(
                f"an omni camera with xi {self.xi:g}, alpha {self.alpha:g} and beta {self.beta:g} is none: xi"
                " must be over -1, alpha from 0 to 1, beta over 0"
            )
        theta_max_rad, r_max = self._limits()
        object.__setattr__(self, "theta_max_rad", theta_max_rad)
        object.__setattr__(self, "_brown", BrownDistortion(self.distortion, r_max))

    @property
    def model(self) -> str:
        """``omni``."""
        return "omni"

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle between the rays of the left and right image edge in the row of the principal point.

        More than π for a lens that sees behind itself. NaN if an edge is outside the domain.
        """
        edges_px = np.array([[-0.5, self.cy_px], [self.width_px - 0.5, self.cy_px]])
        rays = self.camera_ray_from_pixel(edges_px)[0]
        left, right = np.copysign(np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2]), rays[:, 0])
        return float(right - left)

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project points ``(..., 3)`` (RDF, any length) to pixels ``(..., 2)`` with a mask ``(...)``.

        NaN outside the domain; the mask is true inside it where the pixel is on the image.
        """
        point = np.asarray(point_camera, dtype=np.float64)
        length = np.linalg.norm(point, axis=-1)
        inside = np.isfinite(length) & (length > 0.0)
        x, y, z = (
            np.where(inside, point[..., i], z) / np.where(inside, length, 1.0)
            for i, z in enumerate((0, 0, 1))
        )
        across = np.hypot(x, y)
        inside &= np.arctan2(across, z) <= self.theta_max_rad
        depth = np.where(inside, self._depth(across, z), 1.0)
        inside &= across <= self._brown.r_max * depth
        plane = np.where(inside[..., np.newaxis], np.stack([x / depth, y / depth], axis=-1), 0.0)
        distorted, jacobian = self._brown.distort(plane)
        inside &= one_to_one(jacobian)
        focal, centre = np.array([self.fx_px, self.fy_px]), np.array([self.cx_px, self.cy_px])
        pixel = nan_where_not(inside, centre + focal * distorted)
        return pixel, on_image(pixel, self.width_px, self.height_px)

    def camera_ray_from_pixel(self, pixel_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Unit rays ``(..., 3)`` (RDF) of pixels ``(..., 2)`` with a mask ``(...)``.

        NaN outside the domain; the mask is true inside it where the pixel is on the image.
        """
        pixel = np.asarray(pixel_px, dtype=np.float64)
        focal, centre = np.array([self.fx_px, self.fy_px]), np.array([self.cx_px, self.cy_px])
        plane, inside = self._brown.undistort((pixel - centre) / focal)
        ray = nan_where_not(inside, np.stack(self._lifted(plane)[0], axis=-1))
        return ray, inside & on_image(pixel, self.width_px, self.height_px)

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> Rays:
        """Give the rays of `camera_ray_from_pixel` by component, with their derivatives by pixel if asked.

        The ray is ``s (x, y, m) - (0, 0, ξ)``, where s and m depend on r² = x² + y² alone; (dx, dy) a pixel
        is the inverse Jacobian of the distortion.
        """
        distorted = np.stack([(u_px - self.cx_px) / self.fx_px, (v_px - self.cy_px) / self.fy_px], axis=-1)
        plane, inside = self._brown.undistort(distorted)
        inside &= inside_image(u_px, v_px, self.width_px, self.height_px)
        ray, s, s_slope, z_slope = self._lifted(plane)
        if not slopes:
            return Rays(ray, None, None, inside)
        x, y = plane[..., 0], plane[..., 1]

        def moved(dx: FloatArray, dy: FloatArray) -> Columns:
            square = 2.0 * (x * dx + y * dy)
            ds = s_slope * square
            return Columns(s * dx + x * ds, s * dy + y * ds, z_slope * square)

        x_u, y_u, x_v, y_v = self._brown.plane_by_distorted(plane)
        by_u = moved(x_u / self.fx_px, y_u / self.fx_px)
        return Rays(ray, by_u, moved(x_v / self.fy_px, y_v / self.fy_px), inside)

    def _depth(self, across: FloatArray, z: FloatArray) -> FloatArray:
        """What the plane divides by, at a unit ray's distance from the axis and along it."""
        w = z + self.xi
        return np.asarray(self.alpha * np.sqrt(self.beta * across * across + w * w) + (1.0 - self.alpha) * w)

    def _limits(self) -> tuple[float, float]:
        """Angle and radius up to which the plane's radius rises and the inverse is the inverse."""
        theta = np.linspace(0.0, math.pi, _THETA_STEPS)
        across, z = np.sin(theta), np.cos(theta)
        depth = self._depth(across, z)
        seen = across <= _WIDEST * depth
        radius = np.where(seen, across, 0.0) / np.where(seen, depth, 1.0)
        ray = self._lifted(np.stack([radius, np.zeros_like(radius)], axis=-1))[0]
        seen &= np.abs(np.arctan2(ray.x, ray.z) - theta) <= _SAME_ANGLE_RAD
        steepness = np.gradient(radius, theta[1])
        seen &= steepness >= MIN_SLOPE_RATIO * steepness[0]
        last = int(np.argmin(seen)) - 1 if not seen.all() else _THETA_STEPS - 1
        if last < 1:
            raise CalibrationError("the omni camera sees nothing beside its axis: check xi, alpha and beta")
        return float(theta[last]), float(radius[last])

    def _lifted(self, plane: FloatArray) -> tuple[Columns, FloatArray, FloatArray, FloatArray]:
        """Unit rays of plane coordinates ``(..., 2)``, the factor s of `rays`, slopes of s and z by r²."""
        x, y = plane[..., 0], plane[..., 1]
        square = x * x + y * y
        a, b = self.alpha, self.beta
        # The plane's point is at depth m before the second sphere, …
        bent = (1.0 - 2.0 * a) * b
        root = np.sqrt(np.maximum(1.0 + bent * square, _LEAST_SQUARE))
        under = a * root + 1.0 - a
        m = (1.0 - b * a * a * square) / under
        m_slope = (-b * a * a - 0.5 * m * a * bent / root) / under
        # … and s times as far on the first.
        bent = 1.0 - self.xi * self.xi
        root = np.sqrt(np.maximum(m * m + bent * square, _LEAST_SQUARE))
        under = m * m + square
        s = (m * self.xi + root) / under
        root_slope = (m * m_slope + 0.5 * bent) / root
        s_slope = (m_slope * self.xi + root_slope - s * (2.0 * m * m_slope + 1.0)) / under
        return Columns(s * x, s * y, s * m - self.xi), s, s_slope, s_slope * m + s * m_slope
