"""The simulated car: three forward f-theta cameras and two antennas on the roof.

Numbers of the same kind as those of NTNU's car, and nobody's calibration: chosen here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.earth.geodesy import rotation_from_rpy
from geoloc.rig.rig import Antenna, Rig, RigCamera
from geoloc.simulation.noise import DrawnErrors

FLU_FROM_RDF: FloatArray = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
MASK_SIZE = (302, 480)

CAMERAS: dict[str, tuple[FThetaCamera, tuple[float, float, float], tuple[float, float, float]]] = {
    "C1_front60Single": (
        FThetaCamera(1920, 1208, 941.3, 618.7, theta_from_r=(0.0, 5.31e-4, 1.2e-8, -1.1e-11, 2.2e-15)),
        (0.9, 2.6, 1.1),
        (1.79, 0.18, 1.47),
    ),
    "C2_tricam60": (
        FThetaCamera(1920, 1208, 972.6, 597.2, theta_from_r=(0.0, 5.34e-4, 1.0e-8, -1.2e-11, 2.6e-15)),
        (-0.7, 2.3, -1.4),
        (1.83, -0.09, 1.42),
    ),
    "C3_tricam120": (
        FThetaCamera(1920, 1208, 955.8, 611.4, theta_from_r=(0.0, 1.04e-3, 2.1e-8, 1.3e-11, -4.0e-15)),
        (0.4, 2.9, 0.6),
        (1.82, -0.02, 1.44),
    ),
}
"""Camera → intrinsics, roll-pitch-yaw in degrees, position in the rig frame in metres. Fields of view of 60,
60 and 118 degrees, behind the windshield and pitched down as such cameras are mounted."""

ANTENNAS: dict[str, tuple[tuple[float, float, float], str]] = {
    "gnss50:vehicle": ((0.62, 0.55, 1.56), "gnss50_vehicle.bin"),
    "gnss52:vehicle": ((0.60, -0.56, 1.55), "gnss52_vehicle.bin"),
}
"""Antenna → lever arm in metres and recording: left and right on the roof, 1.11 m apart."""


def simulated_rig() -> Rig:
    """Return the rig as its calibration file states it."""
    cameras = {}
    for name, (model, rpy_deg, position_m) in CAMERAS.items():
        cameras[name] = RigCamera(
            name=name,
            model=model,
            rig_R_camera=rotation_from_rpy(*rpy_deg) @ FLU_FROM_RDF,
            rig_t_camera_m=np.array(position_m),
            video=f"{name}.h264",
            timestamps=f"{name}.h264.timestamps",
            ego_mask=_bonnet() if name == "C3_tricam120" else None,
        )
    antennas = {
        name: Antenna(name=name, rig_t_antenna_m=np.array(arm_m), file=file)
        for name, (arm_m, file) in ANTENNAS.items()
    }
    return Rig(cameras=cameras, antennas=antennas, source="simulated rig")


def true_camera(camera: RigCamera, drawn: DrawnErrors) -> RigCamera:
    """Return the camera as it truly sits on the car, with the errors of this drive.

    Raises
    ------
    TypeError
        If the camera is not an f-theta camera.
    """
    from scipy.spatial.transform import Rotation

    model = camera.model
    if not isinstance(model, FThetaCamera) or model.theta_from_r is None:
        raise TypeError(f"{camera.name}: only f-theta cameras with theta_from_r are simulated")
    shift, scale = drawn.principal_point_px[camera.name], 1.0 + drawn.focal_relative[camera.name]
    turn = Rotation.from_rotvec(drawn.boresight_deg[camera.name], degrees=True).as_matrix()
    return replace(
        camera,
        model=replace(
            model,
            cx_px=model.cx_px + float(shift[0]),
            cy_px=model.cy_px + float(shift[1]),
            theta_from_r=tuple(k / scale**power for power, k in enumerate(model.theta_from_r)),
        ),
        rig_R_camera=turn @ camera.rig_R_camera,
        rig_t_camera_m=camera.rig_t_camera_m + drawn.camera_position_m[camera.name],
    )


def _bonnet() -> NDArray[np.bool_]:
    """Mask of the car's own bonnet at the bottom of the wide camera's image."""
    height, width = MASK_SIZE
    row, column = np.mgrid[0:height, 0:width]
    across = (column - width / 2) / (width / 2)
    return np.asarray(row > height * (0.9 + 0.08 * across**2))
