"""How far a located point moves for each source of error: analytic Jacobians of ray ∩ ground plane.

A point p of the plane is seen along the ray r from the camera at c. Whatever displaces the end of the ray by
δ leaves the point where the displaced ray meets the plane again: ``p + δ - (δ_z / r_z) r``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.feet import Feet
from geoloc.rig import RigCamera

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Move(NamedTuple):
    """Moves of feet within the rig's plane, metres along its x and y axes."""

    x: FloatArray
    y: FloatArray


class FootMoves:
    """How the feet of one camera move; the methods name what is wrong."""

    def __init__(self, camera: RigCamera, feet: Feet) -> None:
        self._camera, self._feet = camera, feet
        self._height_m = float(camera.rig_t_camera_m[2])

    def _slide(self, x: FloatArray | float, y: FloatArray | float, z: FloatArray | float) -> Move:
        """Bring displaced points back to the plane along their rays."""
        return Move(np.asarray(x - z * self._feet.slope_x), np.asarray(y - z * self._feet.slope_y))

    def by_pixel(self, column: int) -> Move:
        """A pixel of u (0) or v (1)."""
        f = self._feet
        by = f.by_v if column else f.by_u
        if by is None:
            raise ValueError("the feet were made without the slopes of their rays")
        length = self._height_m * np.sqrt(1.0 + f.slope_x * f.slope_x + f.slope_y * f.slope_y)
        return self._slide(length * by.x, length * by.y, length * by.z)

    def by_roll(self) -> Move:
        """A radian of the car's body about the rig's x."""
        return self._slide(0.0, 0.0, self._feet.y_m)

    def by_pitch(self) -> Move:
        """A radian of the car's body about the rig's y."""
        return self._slide(0.0, 0.0, -self._feet.x_m)

    def by_boresight(self, axis: int) -> Move:
        """A radian of the camera in its mount about its own x (pitch), y (yaw) or z (roll)."""
        f, down = self._feet, -self._height_m
        rx, ry, rz = self._camera.rig_R_camera[:, axis].tolist()
        # The axis times the way from the camera to the foot, (slope_x, slope_y, 1) · -height.
        return self._slide(
            down * (ry - rz * f.slope_y),
            down * (rz * f.slope_x - rx),
            down * (rx * f.slope_y - ry * f.slope_x),
        )

    def by_camera_height(self) -> Move:
        """A metre that the camera sits higher."""
        return self._slide(0.0, 0.0, 1.0)

    def by_ground_height(self) -> Move:
        """A metre that the foot stands above the plane; its own rise comes on top."""
        return Move(self._feet.slope_x, self._feet.slope_y)

    def reach_m(self) -> FloatArray:
        """Rise of the foot a radian that the road between car and foot climbs."""
        return np.asarray(np.sqrt(self._feet.x_m**2 + self._feet.y_m**2))
