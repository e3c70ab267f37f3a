"""A simulated car before a yard of tags: what its cameras see, and by how much a calibration missed them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from geoloc.calibration.extrinsics import Extrinsics, TagPicture
from geoloc.cameras import CameraModel
from geoloc.simulation.car import simulated_rig
from geoloc.simulation.pictures.yard import Yard, seen_tags

RIG = simulated_rig()
MODELS: dict[str, CameraModel] = {name: camera.model for name, camera in RIG.cameras.items()}
LEFT, RIGHT, WIDE = "C1_front60Single", "C2_tricam60", "C3_tricam120"


def pictures_of(yard: Yard, seed: int = 1, sigma_px: float = 0.05) -> list[TagPicture]:
    """What every camera on the car sees."""
    rng = np.random.default_rng(seed)
    return [seen_tags(yard, camera, rng, sigma_px=sigma_px) for camera in RIG.cameras.values()]


def off(found: Extrinsics, camera: str) -> NDArray[np.float64]:
    """Rotation (degrees, rig axes) and position (metres) by which a camera was missed."""
    pose, true = found.cameras[camera].rig_T_camera, RIG.cameras[camera]
    turn = Rotation.from_matrix(pose.R @ true.rig_R_camera.T).as_rotvec(degrees=True)
    return np.concatenate([turn, pose.t_m - true.rig_t_camera_m])
