"""Where cameras sit, as ``drive.toml``, Kalibr, OpenCV and mrcal write it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration_files import kalibr_text, mrcal_text, opencv_text
from geoloc.earth.geodesy import rpy_from_rotation
from geoloc.errors import CalibrationError
from geoloc.rig.edit import with_rotation_correction
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera
from twin.drives.folder.drive_toml import CameraSettings
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder

_DIGITS = 5
"""Of degrees and metres: 0.2 mm at 1 km, and a hundredth of a millimetre."""


def drive_tables(rig: Rig, cameras: Iterable[str], tables: Mapping[str, CameraSettings]) -> str:
    """Write ``[cameras.NAME]`` of a ``drive.toml`` with the poses that a rig has.

    Parameters
    ----------
    rig : Rig
    cameras : iterable of str
        Which of them.
    tables : mapping of camera to CameraSettings
        What the file says now: intrinsics and mask are kept, so that each table can replace the old one.
    """
    lines = []
    for name in cameras:
        camera, before = rig.camera(name), tables.get(name, CameraSettings())
        lines.append(f"[cameras.{name if re.fullmatch(r'[A-Za-z0-9_-]+', name) else json.dumps(name)}]")
        if before.intrinsics is not None:
            lines.append(f"intrinsics = {json.dumps(before.intrinsics, ensure_ascii=False)}")
        angles = rpy_from_rotation(camera.rig_R_camera @ FLU_R_RDF.T)
        lines.append(f"position = {_listed(camera.rig_t_camera_m)}")
        lines.append(f"roll_pitch_yaw = {_listed(angles)}")
        if before.mask is not None:
            lines.append(f"mask = {json.dumps(before.mask, ensure_ascii=False)}")
    return "".join(f"{line}\n" for line in lines)


def write_corrected_rig(
    path: Path, document: Mapping[str, Any], rotations: Mapping[str, FloatArray], source: str
) -> Path:
    """Write a rig file again with ``correction_sensor_R_FLU`` of some cameras; all else stays as it is.

    Parameters
    ----------
    path : Path
    document : mapping
        The rig file that is corrected.
    rotations : mapping of camera to float64 (3, 3)
        Their new ``rig_R_camera``.
    source : str
        The document's name, for messages.

    Raises
    ------
    RefusedError
        If the file cannot be written.
    """
    for name, rotation in rotations.items():
        document = with_rotation_correction(document, name, rotation, source)
    make_folder(path.parent)
    replace_file(path, (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode())
    return path


def kalibr_rig(rig: Rig, cameras: Iterable[str]) -> str | None:
    """Write cameras and poses as Kalibr's camera chain, the rig frame in the place of the IMU's.

    Returns
    -------
    str or None
        Without the cameras whose model Kalibr does not have; None if that leaves none.
    """
    held = [rig.camera(name) for name in cameras if _is_held(rig.camera(name))]
    if not held:
        return None
    names = ", ".join(f"cam{number} is {camera.name}" for number, camera in enumerate(held))
    about = (
        f"# {names}.\n# T_cam_imu is from the rig frame: x forward, y left, z up, from the ground below the"
        " middle of the rear axle.\n"
    )
    return about + kalibr_text([camera.model for camera in held], [_camera_T_rig(c) for c in held])


def opencv_mounted(camera: RigCamera) -> str | None:
    """Write one camera as OpenCV's YAML, with the matrices that bring a point of the rig into its frame.

    Returns
    -------
    str or None
        None for a model that OpenCV does not have.
    """
    try:
        text = opencv_text(camera.model, camera.name)
    except CalibrationError:
        return None
    transform = _camera_T_rig(camera)
    return text + _matrix("camera_R_rig", transform[:3, :3]) + _matrix("camera_t_rig", transform[:3, 3:])


def mrcal_mounted(camera: RigCamera) -> str | None:
    """Write one camera as mrcal's ``.cameramodel``, whose reference frame is the rig's.

    Returns
    -------
    str or None
        None for a model that mrcal does not have.
    """
    note = (
        f"{camera.name}\nThe reference frame is the rig's: x forward, y left, z up, from the ground below the"
        " middle of the rear axle."
    )
    try:
        return mrcal_text(camera.model, _camera_T_rig(camera), note)
    except CalibrationError:
        return None


def _is_held(camera: RigCamera) -> bool:
    try:
        kalibr_text([camera.model])
    except CalibrationError:
        return False
    return True


def _camera_T_rig(camera: RigCamera) -> FloatArray:
    transform = np.eye(4)
    transform[:3, :3] = camera.rig_R_camera.T
    transform[:3, 3] = -camera.rig_R_camera.T @ camera.rig_t_camera_m
    return transform


def _matrix(name: str, matrix: FloatArray) -> str:
    rows, columns = matrix.shape
    numbers = ", ".join(repr(float(number)) for number in matrix.ravel())
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {numbers} ]\n"


def _listed(numbers: Sequence[float] | FloatArray) -> str:
    # Adding zero turns -0.0 into 0.0.
    return f"[{', '.join(str(round(float(number), _DIGITS) + 0.0) for number in numbers)}]"
