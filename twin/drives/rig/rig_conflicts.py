"""Poses that stand twice, in ``drive.toml`` and in a rig file or twice in that: which of them counts."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from geoloc.errors import CalibrationError
from geoloc.rig.poses import angle_deg, idle_corrections, pose_differences
from geoloc.rig.rig import Rig, RigCamera, looks_like_rig, rig_from_document
from twin.drives.folder.drive_toml import SETTINGS_FILE, CameraSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.rig.driveworks import LARGEST_RIG_BYTES
from twin.errors import DriveError

_SAME_DEG, _SAME_M = 1e-3, 1e-4
"""Below what a corrected rig file is written for."""


def pose_conflicts(
    rig: Rig, document: Mapping[str, Any], source: str, cameras: Mapping[str, CameraSettings]
) -> list[str]:
    """Say of each camera whose pose ``drive.toml`` gives that a rig file has another one.

    ``calibrate extrinsics`` and ``calibrate verify --apply`` write rig files: beside a table ``[cameras]``
    their result would be passed over without a word.

    Parameters
    ----------
    rig : Rig
        As the drive is read.
    document : mapping
        The rig file.
    source : str
        Its name.
    cameras : mapping of name to CameraSettings
        Of ``drive.toml``.

    Returns
    -------
    list of str
        One sentence a camera; none of a rig file that cannot be read.
    """
    try:
        other = rig_from_document(document, source)
    except CalibrationError:
        return []
    posed = [name for name, camera in cameras.items() if camera.position_m and name in other.cameras]
    sentences = []
    for name in posed:
        turned_deg, moved_m = _apart(rig.cameras[name], other.cameras[name])
        if turned_deg > _SAME_DEG or moved_m > _SAME_M:
            sentences.append(
                f"position and roll_pitch_yaw under [cameras.{name}] in {SETTINGS_FILE} count, not those of"
                f" {source}, which differ by {turned_deg:.2f}° and {moved_m:.3f} m: if {source} is the newer,"
                " delete both keys."
            )
    return sentences


def two_poses(document: Mapping[str, Any], source: str, *, settled: bool) -> list[str]:
    """Say where a rig file gives sensors a calibrated pose and another nominal one, or corrections of none.

    Parameters
    ----------
    document : mapping
        The rig file, which can be read.
    source : str
        Its name.
    settled : bool
        Whether ``drive.toml`` says which of the two counts: then there is nothing to say of them.

    Returns
    -------
    list of str
        At most one sentence of each kind.
    """
    sentences = []
    differences = [] if settled else pose_differences(document, source)
    if differences:
        apart = ", ".join(
            f"{d.sensor} by {d.turned_deg:.2f}° and {100.0 * d.moved_m:.1f} cm" for d in differences
        )
        keys = " or ".join(dict.fromkeys(d.counts for d in differences))
        sentences.append(
            f"{source} gives two poses, of which the calibrated one counts ({keys}), not the drawing"
            f' (nominalSensor2Rig). They differ: {apart}. rig_pose = "nominal" in {SETTINGS_FILE} takes the'
            ' drawing, rig_pose = "calibrated" ends this warning.'
        )
    idle = idle_corrections(document, source)
    if idle:
        sentences.append(
            f"{source} corrects {', '.join(idle)} (correction_sensor_R_FLU or correction_rig_T) without the"
            " nominalSensor2Rig that a correction belongs to, so that it is not applied: turn sensor2Rig"
            " itself, or give the nominal pose."
        )
    return sentences


def unused_rigs(folder: DriveFolder) -> dict[str, Mapping[str, Any]]:
    """Rig files of a folder whose ``drive.toml`` says all of every camera, by name; broken ones left out."""
    rigs: dict[str, Mapping[str, Any]] = {}
    for name in folder.names(".json"):
        try:
            head = folder.head(name, LARGEST_RIG_BYTES + 1)
            readable = b'"rig"' in head and len(head) <= LARGEST_RIG_BYTES
            document: Any = json.loads(head) if readable else None
        except (DriveError, ValueError, RecursionError):
            continue
        if looks_like_rig(document):
            rigs[name] = document
    return rigs


def _apart(one: RigCamera, other: RigCamera) -> tuple[float, float]:
    """Angle in degrees and distance in metres between two poses."""
    moved_m = float(np.linalg.norm(one.rig_t_camera_m - other.rig_t_camera_m))
    return angle_deg(one.rig_R_camera, other.rig_R_camera), moved_m
