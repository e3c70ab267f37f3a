"""What the models share in which the angle from the axis depends on the radius in the image alone."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras.base import Columns, PixelRays, inside_image, nan_where_not, on_image, sin_cos

_TINY = float(np.finfo(np.float64).tiny)


class RadialCamera(ABC):
    """The methods of `CameraModel` for a ray and a pixel that are at the same azimuth.

    With ``r`` the radius in pixels before the linear terms and ``θ`` the angle between the ray and the
    optical axis::

        ray (RDF)        = (sin θ · x/r, sin θ · y/r, cos θ)
        [u - cx, v - cy] = [[c, d], [e, 1]] @ [x, y]

    A model says how θ and r follow from each other, up to `r_max_px` and `theta_max_rad`. Beyond them pixels
    and rays are NaN. A point inside them but off the image has its true pixel, and a false mask.
    """

    __slots__ = ()

    width_px: int
    height_px: int
    cx_px: float
    cy_px: float
    r_max_px: float
    theta_max_rad: float

    @property
    @abstractmethod
    def _linear(self) -> LinearTerms: ...

    @abstractmethod
    def _theta_from_radius(self, radius_px: FloatArray) -> FloatArray: ...

    @abstractmethod
    def _theta_slope(self, radius_px: FloatArray, theta_rad: FloatArray) -> FloatArray:
        """Derivative of the angle by the radius, at a pair of both."""

    @abstractmethod
    def _radius_from_theta(self, theta_rad: FloatArray) -> FloatArray: ...

    @property
    def horizontal_fov_rad(self) -> float:
        """See `CameraModel`; more than π for a fisheye that sees behind itself."""
        edges_px = np.array([-0.5 - self.cx_px, self.width_px - 0.5 - self.cx_px])
        radius = np.hypot(*self._linear.plane_from_offset(edges_px, np.zeros(2)))
        if (radius > self.r_max_px).any():
            return math.nan
        left, right = np.sign(edges_px) * self._theta_from_radius(radius)
        return float(right - left)

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """See `CameraModel`."""
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
        """See `CameraModel`."""
        pixel = np.asarray(pixel_px, dtype=np.float64)
        pixel = np.where(np.isfinite(pixel), pixel, np.nan)
        x, y = self._linear.plane_from_offset(pixel[..., 0] - self.cx_px, pixel[..., 1] - self.cy_px)
        radius = np.hypot(x, y)
        inside = radius <= self.r_max_px
        theta = self._theta_from_radius(np.where(inside, radius, 0.0))
        stretch = np.sin(theta) / np.where(radius > 0.0, radius, 1.0)
        ray = nan_where_not(inside, np.stack([stretch * x, stretch * y, np.cos(theta)], axis=-1))
        return ray, inside & on_image(pixel, self.width_px, self.height_px)

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> PixelRays:
        """See `CameraModel`.

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
            return PixelRays(ray, None, None, inside)
        slope = self._theta_slope(radius, theta)
        m, down = (slope * cos - k) / square, -k * slope
        by_x = Columns(k + m * x * x, cross := m * x * y, down * x)
        by_y = Columns(cross, k + m * y * y, down * y)
        return PixelRays(ray, *self._linear.by_pixel(by_x, by_y), inside)


_SINGULAR = 1e-6


class LinearTerms(NamedTuple):
    """``[u - cx, v - cy] = [[c, d], [e, 1]] @ [x, y]``: column first, as NVIDIA DriveWorks has it.

    OCamCalib puts the row first: ``geoloc.calibration_files.ocamcalib`` converts.
    """

    c: float
    d: float
    e: float

    @property
    def identity(self) -> bool:
        """Whether they change nothing."""
        return self == (1.0, 0.0, 0.0)

    @property
    def determinant(self) -> float:
        """Of the matrix."""
        return self.c - self.d * self.e

    @property
    def singular(self) -> bool:
        """Whether the matrix has no usable inverse."""
        return not abs(self.determinant) >= _SINGULAR

    def offset_from_plane(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels from the principal point of points in the plane."""
        return self.c * x + self.d * y, self.e * x + y

    def plane_from_offset(self, du_px: FloatArray, dv_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points in the plane of pixels from the principal point."""
        if self.identity:
            return du_px, dv_px
        det = self.determinant
        return (du_px - self.d * dv_px) / det, (self.c * dv_px - self.e * du_px) / det

    def by_pixel(self, by_x: Columns, by_y: Columns) -> tuple[Columns, Columns]:
        """Derivatives by u and v from those by x and y."""
        if self.identity:
            return by_x, by_y
        det = self.determinant
        pairs = list(zip(by_x, by_y, strict=True))
        by_u = Columns(*((x - self.e * y) / det for x, y in pairs))
        by_v = Columns(*((self.c * y - self.d * x) / det for x, y in pairs))
        return by_u, by_v
