"""What the models share that map a ray to a plane, distort the plane, and scale it to pixels."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras.base import Columns, PixelRays, inside_image, nan_where_not, on_image
from geoloc.cameras.brown import BrownDistortion, one_to_one


class PlanarCamera(ABC):
    """The methods of `CameraModel` for a ray that meets a plane, which Brown's distortion bends.

    A model says where the plane is met, and by which ray. Points and pixels outside the domain, where the
    distortion is one-to-one, are NaN: those that the formula would fold back into the image too. A point
    inside the domain but off the image has its true pixel, and a false mask.
    """

    __slots__ = ()

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    _brown: BrownDistortion

    @abstractmethod
    def _plane_from_point(self, point: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Plane coordinates ``(..., 2)`` of points; 0 with a false mask for points outside the domain."""

    @abstractmethod
    def _lifted(self, plane: FloatArray, *, slopes: bool) -> tuple[Columns, tuple[Columns, Columns] | None]:
        """Unit rays of plane coordinates ``(..., 2)``, and if asked their derivatives by both."""

    @property
    def horizontal_fov_rad(self) -> float:
        """See `CameraModel`: both angles from the axis together, more than π where it sees behind itself."""
        edges_px = np.array([[-0.5, self.cy_px], [self.width_px - 0.5, self.cy_px]])
        rays = self.camera_ray_from_pixel(edges_px)[0]
        left, right = np.copysign(np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2]), rays[:, 0])
        return float(right - left)

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """See `CameraModel`."""
        plane, inside = self._plane_from_point(np.asarray(point_camera, dtype=np.float64))
        distorted, jacobian = self._brown.distort(plane)
        focal, centre = np.array([self.fx_px, self.fy_px]), np.array([self.cx_px, self.cy_px])
        pixel = nan_where_not(inside & one_to_one(jacobian), centre + focal * distorted)
        return pixel, on_image(pixel, self.width_px, self.height_px)

    def camera_ray_from_pixel(self, pixel_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """See `CameraModel`."""
        pixel = np.asarray(pixel_px, dtype=np.float64)
        focal, centre = np.array([self.fx_px, self.fy_px]), np.array([self.cx_px, self.cy_px])
        plane, inside = self._brown.undistort((pixel - centre) / focal)
        ray = nan_where_not(inside, np.stack(self._lifted(plane, slopes=False)[0], axis=-1))
        return ray, inside & on_image(pixel, self.width_px, self.height_px)

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> PixelRays:
        """See `CameraModel`. How the plane moves a pixel is the inverse Jacobian of the distortion."""
        distorted = np.stack([(u_px - self.cx_px) / self.fx_px, (v_px - self.cy_px) / self.fy_px], axis=-1)
        plane, inside = self._brown.undistort(distorted)
        inside &= inside_image(u_px, v_px, self.width_px, self.height_px)
        ray, by_plane = self._lifted(plane, slopes=slopes)
        if by_plane is None:
            return PixelRays(ray, None, None, inside)
        x_u, y_u, x_v, y_v = self._brown.plane_by_distorted(plane)
        by_u = _moved(by_plane, x_u / self.fx_px, y_u / self.fx_px)
        return PixelRays(ray, by_u, _moved(by_plane, x_v / self.fy_px, y_v / self.fy_px), inside)


def _moved(by_plane: tuple[Columns, Columns], dx: FloatArray, dy: FloatArray) -> Columns:
    """Move of the ray when its plane coordinates move by (dx, dy)."""
    return Columns(*(by_x * dx + by_y * dy for by_x, by_y in zip(*by_plane, strict=True)))
