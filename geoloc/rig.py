"""The rig: cameras, antennas and where they sit on the car."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geoloc.cameras.base import CameraModel

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RigCamera:
    """One camera on the car.

    Attributes
    ----------
    name : str
    model : CameraModel
    rig_R_camera : float64 (3, 3)
        Turns camera axes (RDF) into rig axes (FLU), corrections included.
    rig_t_camera_m : float64 (3,)
        The camera's position in the rig frame.
    video, timestamps : str or None
        File names of the recording, from ``parameter``.
    ego_mask : bool (h, w) or None
        True on pixels that show the car itself, at the mask's own resolution.
    """

    name: str
    model: CameraModel
    rig_R_camera: FloatArray
    rig_t_camera_m: FloatArray
    video: str | None = None
    timestamps: str | None = None
    ego_mask: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True)
class Antenna:
    """One GNSS antenna: its lever arm in the rig frame (FLU, metres) and its recording."""

    name: str
    rig_t_antenna_m: FloatArray
    file: str | None = None


@dataclass(frozen=True, slots=True)
class Rig:
    """All sensors of one car.

    Rig frame: ISO 8855 FLU (x forward, y left, z up), origin on the ground below the middle of the rear axle.
    """

    cameras: Mapping[str, RigCamera]
    antennas: Mapping[str, Antenna]
    source: str
