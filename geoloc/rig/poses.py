"""Which pose of a sensor counts, where a rig file gives it several.

DriveWorks keeps two. ``nominalSensor2Rig`` is "a static reference transformation from factory calibration
and/or mechanical drawings"; ``sensor2Rig`` is where the sensor was found to be, "which can change over time"
(NVIDIA DriveWorks, ``Rig.h``, ``dwRig_getNominalSensorToRigTransformation``). The corrections,
``correction_sensor_R_FLU`` and ``correction_rig_T``, are applied to the nominal pose and to no other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.errors import CalibrationError
from geoloc.rig.sensor_entry import SensorEntry

FLU_R_RDF: Final = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Turns camera axes (x right, y down, z forward) into body axes (x forward, y left, z up)."""
FLU_R_RDF.setflags(write=False)

CALIBRATED: Final = ("sensor2Rig_FLU", "sensor2Rig")
NOMINAL: Final = ("nominalSensor2Rig_FLU", "nominalSensor2Rig")
ROTATION_CORRECTION: Final = "correction_sensor_R_FLU"
POSITION_CORRECTION: Final = "correction_rig_T"
POSE_KEYS: Final = (*NOMINAL, *CALIBRATED, ROTATION_CORRECTION, POSITION_CORRECTION)
"""All keys of a sensor that say where it sits."""

_SAME_DEG, _SAME_M = 1e-3, 1e-4
_NOWHERE = [0.0, 0.0, 0.0]
_UNTURNED = (_NOWHERE, [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, -1.0])


class PoseKind(StrEnum):
    """Which of a rig file's two poses of a sensor."""

    CALIBRATED = "calibrated"
    NOMINAL = "nominal"


@dataclass(frozen=True, slots=True)
class SensorPose:
    """Where a sensor sits, corrections included.

    Attributes
    ----------
    key : str
        Of the rig file, that gives it.
    rig_R_flu : float64 (3, 3)
        Turns the sensor's axes, renamed to forward-left-up, into the rig's.
    rig_t_sensor_m : float64 (3,)
    """

    key: str
    rig_R_flu: FloatArray
    rig_t_sensor_m: FloatArray

    @property
    def kind(self) -> PoseKind:
        """Whether it was calibrated or drawn."""
        return PoseKind.CALIBRATED if self.key in CALIBRATED else PoseKind.NOMINAL


@dataclass(frozen=True, slots=True)
class PoseDifference:
    """Two poses of one sensor in a rig file that say different things.

    Attributes
    ----------
    sensor : str
    counts, other : str
        Keys of the pose that counts and of the one that does not.
    turned_deg : float
        Angle between them; 0 of an antenna, which has no direction.
    moved_m : float
        Distance between them.
    """

    sensor: str
    counts: str
    other: str
    turned_deg: float
    moved_m: float


def sensor_pose(entry: SensorEntry) -> SensorPose:
    """Pose of a sensor: the calibrated one, or the nominal one with its corrections where there is no other.

    A calibrated pose without turn or place stands for none where there is a nominal one: nothing sits at the
    rig's origin, and rig tools write it before anything was calibrated.

    Raises
    ------
    CalibrationError
        If there is none, or the one that counts is malformed.
    """
    calibrated, nominal = _given(entry, CALIBRATED), _given(entry, NOMINAL)
    unset = calibrated is not None and nominal is not None and _is_unset(entry.sensor[calibrated])
    if calibrated is not None and not unset:
        return _pose(entry, calibrated)
    if nominal is not None:
        return _pose(entry, nominal)
    raise entry.error(
        NOMINAL[0],
        'is missing: add {"roll-pitch-yaw": [roll, pitch, yaw] in degrees, "t": [x, y, z] in metres}.',
    )


def pose_differences(document: Mapping[str, Any], source: str) -> list[PoseDifference]:
    """Compare the calibrated and the nominal pose of each camera and antenna of a rig document.

    Parameters
    ----------
    document : mapping
        A rig that `geoloc.rig.rig.rig_from_document` has read.
    source : str

    Returns
    -------
    list of PoseDifference
        Those that differ by more than 0.001 degrees or 0.1 mm. Sensors of which one is malformed are passed
        over: reading refuses them, unless the pose does not count or the camera is none that is known.
    """
    found = []
    for entry in _placed_entries(document, source):
        key = _given(entry, NOMINAL)
        try:
            counts = sensor_pose(entry)
            if counts.kind is PoseKind.NOMINAL or key is None:
                continue
            other = _pose(entry, key)
        except CalibrationError:
            continue
        turned_deg = angle_deg(counts.rig_R_flu, other.rig_R_flu) if entry.kind == "camera" else 0.0
        moved_m = math.dist(counts.rig_t_sensor_m, other.rig_t_sensor_m)
        if turned_deg > _SAME_DEG or moved_m > _SAME_M:
            found.append(PoseDifference(entry.name, counts.key, other.key, turned_deg, moved_m))
    return found


def idle_corrections(document: Mapping[str, Any], source: str) -> list[str]:
    """Name the cameras and antennas of a rig document whose corrections have no nominal pose to correct."""
    return [
        entry.name
        for entry in _placed_entries(document, source)
        if _given(entry, NOMINAL) is None and any(map(entry.sensor.get, POSE_KEYS[-2:]))
    ]


def with_pose_kind(document: Mapping[str, Any], kind: PoseKind) -> Mapping[str, Any]:
    """Let one kind of pose count in a rig document, wherever a sensor has both.

    Parameters
    ----------
    document : mapping
        A parsed rig file; it is not changed.
    kind : PoseKind

    Returns
    -------
    mapping
        Without the calibrated poses of sensors that have a nominal one, for `PoseKind.NOMINAL`. The document
        itself where nothing is to be done.
    """
    if kind is PoseKind.CALIBRATED:
        return document
    sensors = document["rig"]["sensors"]
    if not any(map(_has_both, sensors)):
        return document
    drawn = [
        {key: sensor[key] for key in sensor if key not in CALIBRATED} if _has_both(sensor) else sensor
        for sensor in sensors
    ]
    return {**document, "rig": {**document["rig"], "sensors": drawn}}


def angle_deg(one: FloatArray, other: FloatArray) -> float:
    """Angle in degrees between two rotations ``(3, 3)``."""
    cosine = (float(np.trace(one.T @ other)) - 1.0) / 2.0
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


def _pose(entry: SensorEntry, key: str) -> SensorPose:
    transform = entry.sensor[key]
    rotation = entry.rotation(key, transform)
    if entry.kind == "camera" and not key.endswith("_FLU"):
        rotation = rotation @ FLU_R_RDF.T
    position = entry.vector(f"{key}.t", transform.get("t"), 3)
    if key in NOMINAL:
        correction, shift = (entry.sensor.get(k) for k in (ROTATION_CORRECTION, POSITION_CORRECTION))
        if correction is not None:
            rotation = rotation @ entry.rotation(ROTATION_CORRECTION, correction)
        if shift is not None:
            position = position + entry.vector(POSITION_CORRECTION, shift, 3)
    return SensorPose(key, rotation, position)


def _given(entry: SensorEntry, keys: tuple[str, ...]) -> str | None:
    """The first of these poses that the sensor has."""
    return next((key for key in keys if isinstance(entry.sensor.get(key), Mapping)), None)


def _has_both(sensor: object) -> bool:
    return isinstance(sensor, Mapping) and all(
        any(isinstance(sensor.get(key), Mapping) for key in keys) for keys in (CALIBRATED, NOMINAL)
    )


def _is_unset(transform: Mapping[str, Any]) -> bool:
    rotation = transform.get("roll-pitch-yaw", transform.get("quaternion"))
    return transform.get("t") == _NOWHERE and rotation in _UNTURNED


def _placed_entries(document: Mapping[str, Any], source: str) -> list[SensorEntry]:
    """Cameras and antennas that have a pose."""
    entries = (SensorEntry.of(s, index, source) for index, s in enumerate(document["rig"]["sensors"]))
    return [
        entry
        for entry in entries
        if entry.kind in ("camera", "gps") and _given(entry, (*CALIBRATED, *NOMINAL)) is not None
    ]
