"""How far a located point moves for each source of error: analytic Jacobians of ray ∩ ground plane.

A point p of the plane is seen along the ray r from the camera at c. Whatever displaces the end of the ray by
δ leaves the point where the displaced ray meets the plane again: ``p + δ - (δ_z / r_z) r``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_AXES = np.eye(3)


@dataclass(frozen=True, slots=True)
class Hits:
    """Rays and where they meet the ground, rig frame (FLU), metres. Rows without a hit are NaN.

    Attributes
    ----------
    point_m, ray : float64 (n, 3)
        Foot on the plane; unit ray.
    ray_by_pixel : float64 (n, 3, 2)
        Derivative of the ray by u and v.
    camera_m : float64 (n, 3)
        The camera's position.
    rig_R_camera : float64 (n, 3, 3)
    """

    point_m: FloatArray
    ray: FloatArray
    ray_by_pixel: FloatArray
    camera_m: FloatArray
    rig_R_camera: FloatArray

    @property
    def range_m(self) -> FloatArray:
        """Horizontal distance from the camera to the foot."""
        d = self.point_m - self.camera_m
        return np.asarray(np.hypot(d[:, 0], d[:, 1]))

    @property
    def ray_length_m(self) -> FloatArray:
        """Distance along the ray."""
        return np.asarray(np.linalg.norm(self.point_m - self.camera_m, axis=1))

    def slide(self, displacement_m: FloatArray) -> FloatArray:
        """Bring displaced points back to the plane along their rays."""
        return np.asarray(
            displacement_m - (displacement_m[:, 2] / self.ray[:, 2])[:, None] * self.ray,
        )

    def by_pixel(self, column: int) -> FloatArray:
        """Move of the foot a pixel of u (0) or v (1): float64 (n, 3)."""
        return self.slide(self.ray_length_m[:, None] * self.ray_by_pixel[:, :, column])

    def by_body(self, axis: int) -> FloatArray:
        """Move a radian of the car's body about the rig's x (roll), y (pitch) or z (yaw)."""
        return self.slide(np.cross(_AXES[axis], self.point_m))

    def by_boresight(self, axis: int) -> FloatArray:
        """Move a radian of the camera in its mount about its own x (pitch), y (yaw) or z (roll)."""
        return self.slide(np.cross(self.rig_R_camera[:, :, axis], self.point_m - self.camera_m))

    def by_camera_height(self) -> FloatArray:
        """Move a metre that the camera sits higher."""
        return self.slide(np.broadcast_to(_AXES[2], self.point_m.shape))

    def by_ground_height(self) -> FloatArray:
        """Move a metre that the foot stands above the plane; its own rise is in the third component."""
        return np.asarray(self.ray / self.ray[:, 2:3])

    def by_ground_slope(self) -> FloatArray:
        """Move a radian that the road between car and foot climbs."""
        reach = np.hypot(self.point_m[:, 0], self.point_m[:, 1])
        return np.asarray(reach[:, None] * self.by_ground_height())


def ray_by_pixel(
    ray: FloatArray,
    forward: tuple[FloatArray, BoolArray],
    backward: tuple[FloatArray, BoolArray],
    step_px: float,
) -> FloatArray:
    """Derivative of rays by one pixel coordinate, from the rays a step before and after.

    Central where the camera model reaches both ways, one-sided at the edge of its domain.
    """
    (ahead, ahead_known), (behind, behind_known) = forward, backward
    upper = np.where(ahead_known[:, None], ahead, ray)
    lower = np.where(behind_known[:, None], behind, ray)
    steps = step_px * (ahead_known.astype(np.float64) + behind_known.astype(np.float64))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((upper - lower) / steps[:, None])
