"""The pinhole camera with Brown's lens distortion, as OpenCV writes it."""

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

# No lens of this kind sees farther from its axis; the bound keeps every radius finite.
_MAX_ANGLE_DEG = 89.0


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
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()
    r_max: float = field(init=False, repr=False, compare=False)
    _brown: BrownDistortion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        object.__setattr__(self, "distortion", tuple(float(coefficient) for coefficient in self.distortion))
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion)
        check_parameters("pinhole", self.width_px, self.height_px, numbers)
        check_focal_lengths("pinhole", self.fx_px, self.fy_px)
        brown = BrownDistortion(self.distortion, math.tan(math.radians(_MAX_ANGLE_DEG)))
        object.__setattr__(self, "_brown", brown)
        object.__setattr__(self, "r_max", brown.r_max)

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
        ray = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
        ray = nan_where_not(inside, ray / np.linalg.norm(ray, axis=-1, keepdims=True))
        return ray, inside & on_image(pixel, self.width_px, self.height_px)

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> Rays:
        """Give the rays of `camera_ray_from_pixel` by component, with their derivatives by pixel if asked.

        The ray ``(x, y, 1) / n`` moves by ``(dx, dy, 0) / n`` less its part along itself; (dx, dy) a pixel is
        the inverse Jacobian of the distortion.
        """
        distorted = np.stack([(u_px - self.cx_px) / self.fx_px, (v_px - self.cy_px) / self.fy_px], axis=-1)
        plane, inside = self._brown.undistort(distorted)
        inside &= inside_image(u_px, v_px, self.width_px, self.height_px)
        x, y = plane[..., 0], plane[..., 1]
        forward = 1.0 / np.sqrt(1.0 + x * x + y * y)
        ray = Columns(x * forward, y * forward, forward)
        if not slopes:
            return Rays(ray, None, None, inside)
        x_u, y_u, x_v, y_v = self._brown.plane_by_distorted(plane)
        by_u, by_v = (x_u / self.fx_px, y_u / self.fx_px), (x_v / self.fy_px, y_v / self.fy_px)
        return Rays(ray, _turned(ray, *by_u), _turned(ray, *by_v), inside)


def _turned(ray: Columns, dx: FloatArray, dy: FloatArray) -> Columns:
    """Move of the unit ray when its plane coordinates move by (dx, dy)."""
    along = ray.x * dx + ray.y * dy
    return Columns(ray.z * (dx - along * ray.x), ray.z * (dy - along * ray.y), -ray.z * along * ray.z)
