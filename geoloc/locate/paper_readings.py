"""How the paper's method is read where its text leaves a choice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_enu
from geoloc.locate.feet import Feet
from geoloc.rig.rig import RigCamera
from geoloc.trajectory.poses import Poses


class Distance(StrEnum):
    """What the paper's d may be: all three end where the true ray meets the rig's ground plane."""

    REAR_AXLE = "rear-axle"
    """Horizontal, from the rig's origin below the rear axle."""
    CAMERA = "camera"
    """Horizontal, from the camera."""
    RAY = "ray"
    """Along the ray, from the camera."""


@dataclass(frozen=True, slots=True)
class PaperReadings:
    """Readings of `locate_paper`.

    Attributes
    ----------
    distance : Distance
    fov_deg : mapping camera → float
        Horizontal field of view, in place of the calibrated lens's.
    lever_arm_m : (float, float)
        Forward and left from the rig's origin to the antenna, to be taken off each fix; (0, 0) to start from
        the antenna.
    """

    distance: Distance = Distance.REAR_AXLE
    fov_deg: Mapping[str, float] = field(default_factory=dict)
    lever_arm_m: tuple[float, float] = (0.0, 0.0)

    def start_deg(self, nearest: Poses) -> tuple[FloatArray, FloatArray]:
        """Give φ₁ and λ₁ of equations 2 and 3, latitude and longitude, at each fix."""
        ahead_m, left_m = self.lever_arm_m
        if ahead_m == left_m == 0.0:
            return nearest.latitude_deg, nearest.longitude_deg
        heading = np.radians(nearest.heading_deg)
        east = left_m * np.cos(heading) - ahead_m * np.sin(heading)
        north = -left_m * np.sin(heading) - ahead_m * np.cos(heading)
        return geographic_from_enu(nearest.latitude_deg, nearest.longitude_deg, east, north)

    def distance_m(self, camera: RigCamera, feet: Feet) -> FloatArray:
        """Give the d of each foot of one camera, metres."""
        if self.distance is Distance.REAR_AXLE:
            return np.hypot(feet.x_m, feet.y_m)
        if self.distance is Distance.CAMERA:
            return feet.range_m
        return np.hypot(feet.range_m, float(camera.rig_t_camera_m[2]))

    def fov_rad(self, camera: RigCamera) -> float:
        """Give the FOV of equation 1; NaN where neither a number nor the lens model tells it."""
        stated = self.fov_deg.get(camera.name)
        return camera.model.horizontal_fov_rad if stated is None else float(np.radians(stated))
