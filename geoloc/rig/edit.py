"""A rig file with something of one camera replaced, and everything else as it was.

These work on the parsed document, so that keys which this package does not know stay where they are.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import rpy_from_rotation
from geoloc.errors import CalibrationError
from geoloc.rig.poses import (
    CALIBRATED,
    FLU_R_RDF,
    NOMINAL,
    POSE_KEYS,
    ROTATION_CORRECTION,
    PoseKind,
    SensorPose,
    sensor_pose,
)
from geoloc.rig.rig import looks_like_rig, no_rig
from geoloc.rig.sensor_entry import SensorEntry


def with_extrinsics(
    document: Mapping[str, Any],
    camera: str,
    rig_R_camera: FloatArray,
    rig_t_camera_m: FloatArray,
    source: str,
) -> dict[str, Any]:
    """Give a camera of a rig document another pose.

    Other forms of its pose and its corrections are taken out: they would contradict the new one.

    Parameters
    ----------
    document : mapping
        A parsed DriveWorks rig file; it is not changed.
    camera : str
    rig_R_camera : float64 (3, 3)
        Camera axes RDF, rig axes FLU.
    rig_t_camera_m : float64 (3,)
    source : str
        What to call the document in messages.

    Raises
    ------
    CalibrationError
        If the document is no rig, or has no such camera.
    """
    changed, sensor = _copied(document, camera, source)
    for key in POSE_KEYS:
        sensor.pop(key, None)
    sensor[NOMINAL[0]] = {
        "roll-pitch-yaw": rpy_from_rotation(rig_R_camera @ FLU_R_RDF.T),
        "t": np.asarray(rig_t_camera_m).tolist(),
    }
    return changed


def with_rotation_correction(
    document: Mapping[str, Any], camera: str, rig_R_camera: FloatArray, source: str
) -> dict[str, Any]:
    """Turn a camera of a rig document, its place kept, so that its rotation becomes `rig_R_camera`.

    Where its nominal pose counts it is turned by ``correction_sensor_R_FLU``: DriveWorks turns by ``R_nominal
    R_correction``, and the correction written here replaces one that was there. Where its calibrated pose
    counts, which no correction belongs to, that is turned itself, in the form that it has; the nominal one
    stays as it was.

    Parameters
    ----------
    document, camera, rig_R_camera, source
        As for `with_extrinsics`.

    Raises
    ------
    CalibrationError
        If the document is no rig, has no such camera, or gives it no pose.
    """
    changed, sensor = _copied(document, camera, source)
    entry = SensorEntry.of(sensor, 0, source)
    if sensor_pose(entry).kind is PoseKind.NOMINAL:
        sensor.pop(ROTATION_CORRECTION, None)
        correction = sensor_pose(entry).rig_R_flu.T @ rig_R_camera @ FLU_R_RDF.T
        sensor[ROTATION_CORRECTION] = {"roll-pitch-yaw": rpy_from_rotation(correction)}
    else:
        _turn(sensor, sensor_pose(entry), rig_R_camera)
    return changed


def _turn(sensor: dict[str, Any], pose: SensorPose, rig_R_camera: FloatArray) -> None:
    """Give a calibrated pose another rotation; another form of it would contradict it."""
    from scipy.spatial.transform import Rotation

    for key in CALIBRATED:
        if key != pose.key:
            sensor.pop(key, None)
    rotation = rig_R_camera @ FLU_R_RDF.T if pose.key.endswith("_FLU") else rig_R_camera
    transform = sensor[pose.key]
    if "roll-pitch-yaw" in transform:
        transform["roll-pitch-yaw"] = rpy_from_rotation(rotation)
    else:
        transform["quaternion"] = Rotation.from_matrix(rotation).as_quat().tolist()


def with_unknown_poses(document: Mapping[str, Any]) -> dict[str, Any]:
    """Give cameras of a rig document that have no pose the one that stands for an unknown one: all zeros.

    Parameters
    ----------
    document : mapping
        A parsed DriveWorks rig file; it is not changed. What is no rig comes back as it is.
    """
    changed: dict[str, Any] = copy.deepcopy(dict(document))
    if not looks_like_rig(changed):
        return changed
    for sensor in changed["rig"]["sensors"]:
        if not isinstance(sensor, dict):
            continue
        is_camera = str(sensor.get("protocol")).strip().lower().startswith("camera")
        if is_camera and all(sensor.get(key) is None for key in (*NOMINAL, *CALIBRATED)):
            sensor[NOMINAL[0]] = {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [0.0, 0.0, 0.0]}
    return changed


def _copied(document: Mapping[str, Any], camera: str, source: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """A deep copy of the document, and the camera's entry in it."""
    if not looks_like_rig(document):
        raise no_rig(source)
    changed: dict[str, Any] = copy.deepcopy(dict(document))
    sensors = changed["rig"]["sensors"]
    for sensor in sensors:
        if isinstance(sensor, dict) and str(sensor.get("name", "")).strip() == camera:
            return changed, sensor
    names = ", ".join(str(s.get("name")) for s in sensors if isinstance(s, dict))
    raise CalibrationError(f"{source} has no sensor {camera} (its sensors: {names}): spell it alike.")
