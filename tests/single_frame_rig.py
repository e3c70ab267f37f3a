"""A car with a wide and a narrow camera, and feet of known position in their pictures."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.cameras.base import CameraModel
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.cameras.pinhole import PinholeCamera
from geoloc.earth.geodesy import (
    enu_offset,
    rotation_from_rpy,
)
from geoloc.locate.records import Located
from geoloc.locate.single_frame import ErrorBudget
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera
from geoloc.trajectory.poses import Poses

LAT0, LON0, HEIGHT = 63.4149, 10.3991, 65.7
WIDE = FThetaCamera(1920, 1208, 951.0, 612.0, theta_from_r=(0.0, 9.9e-4, 2e-9, -1.1e-11))
NARROW = PinholeCamera(1920, 1208, 1870.0, 1868.0, 948.0, 617.0, (-0.31, 0.12, 1e-4, -2e-4))
EXACT = ErrorBudget(*([0.0] * len(fields(ErrorBudget))))


def camera(
    name: str, model: CameraModel, t_m: tuple[float, float, float], rpy_deg: tuple[float, float, float]
) -> RigCamera:
    """Mount a camera by the angles of a rig file: roll, pitch (nose down), yaw (counter-clockwise)."""
    return RigCamera(name, model, rotation_from_rpy(*rpy_deg) @ FLU_R_RDF, np.array(t_m))


RIG = Rig(
    {
        "wide": camera("wide", WIDE, (1.81, 0.04, 1.47), (0.4, 2.6, -1.2)),
        "narrow": camera("narrow", NARROW, (1.78, -0.12, 1.44), (-0.3, 1.9, 0.8)),
        "side": camera("side", WIDE, (1.2, -0.8, 1.05), (1.0, 12.0, -88.0)),
    },
    {},
    "test rig",
)


def poses_of(n: int, **changes: float) -> Poses:
    """The same pose n times."""
    values: dict[str, float] = {
        "latitude_deg": LAT0,
        "longitude_deg": LON0,
        "height_m": HEIGHT,
        "roll_deg": 0.0,
        "pitch_deg": 0.0,
        "heading_deg": 0.0,
        "speed_mps": 0.0,
        "sigma_horizontal_m": 0.0,
        "sigma_vertical_m": 0.0,
        "sigma_roll_deg": 0.0,
        "sigma_pitch_deg": 0.0,
        "sigma_heading_deg": 0.0,
    }
    columns = {name: np.full(n, value) for name, value in (values | changes).items()}
    return Poses(
        epoch_ns=np.arange(n), **columns, valid=np.ones(n, dtype=bool), reason=np.full(n, "", dtype="U40")
    )


def pixels_of(point_rig: FloatArray, one: RigCamera) -> FloatArray:
    """Project points of the rig frame; every one must show."""
    pixel, seen = one.model.pixel_from_camera_point((point_rig - one.rig_t_camera_m) @ one.rig_R_camera)
    assert seen.all()
    return pixel


def feet_in_view(one: RigCamera, n: int, seed: int, near: float = 5.0, far: float = 25.0) -> FloatArray:
    """Draw feet on the plane of the rig that the camera sees."""
    rng = np.random.default_rng(seed)
    axis = one.rig_R_camera[:, 2]
    azimuth = np.arctan2(axis[1], axis[0]) + rng.uniform(-0.35, 0.35, n)
    distance = rng.uniform(near, far, n)
    foot = np.zeros((n, 3))
    foot[:, 0] = one.rig_t_camera_m[0] + distance * np.cos(azimuth)
    foot[:, 1] = one.rig_t_camera_m[1] + distance * np.sin(azimuth)
    return foot


def metres(result: Located) -> FloatArray:
    """East and north of the rig's origin."""
    return np.stack(enu_offset(LAT0, LON0, result.latitude_deg, result.longitude_deg), axis=-1)
