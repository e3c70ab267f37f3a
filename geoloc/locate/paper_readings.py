"""How the paper's method is read where its text leaves a choice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.locate.feet import Feet
from geoloc.rig.rig import RigCamera


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
    """

    distance: Distance = Distance.REAR_AXLE
    fov_deg: Mapping[str, float] = field(default_factory=dict)

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
