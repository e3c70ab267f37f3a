"""The rig that a calibration of extrinsics begins with: whatever a drive may have, or intrinsics alone.

How a camera sits on the car is what is to be found, so a file need not say it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from geoloc.calibration.extrinsics import Pose
from geoloc.calibration_files import HEAD_BYTES, calibration_kind, json_document, read_cameras
from geoloc.rig.edit import with_unknown_poses
from geoloc.rig.rig import Rig, rig_from_document
from twin.calibrate.camera_files import new_rig_document
from twin.drives.folder.drive_toml import SETTINGS_FILE, CameraSettings, DriveSettings, read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes
from twin.drives.rig.driveworks import find_rig
from twin.drives.rig.rig_files import rig_of_folder
from twin.errors import FileError

_NOWHERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class GivenRig:
    """Cameras, and what is roughly known of where they sit.

    Attributes
    ----------
    document : mapping
        A DriveWorks rig file of all of them, into which the poses found are written.
    rig : Rig
    nominal : mapping of camera to Pose
        Of those whose place is roughly known: not of those at the rig's origin, which no camera is at.
    tables : mapping of camera to CameraSettings
        What ``[cameras]`` of a ``drive.toml`` says; empty without one.
    drive : Path or None
        The drive folder that the rig is of.
    warnings : tuple of str
    """

    document: Mapping[str, Any]
    rig: Rig
    nominal: Mapping[str, Pose]
    tables: Mapping[str, CameraSettings]
    drive: Path | None
    warnings: tuple[str, ...]


def read_given_rig(path: Path | str) -> GivenRig:
    """Read the cameras to be calibrated.

    Parameters
    ----------
    path : Path or str
        A DriveWorks rig file, whose cameras need no pose; a drive folder, or its ``drive.toml``; or any
        calibration file of intrinsics (Kalibr, OpenCV, OCamCalib, OpenSfM, mrcal).

    Raises
    ------
    FileError, DriveError, CalibrationError
        If it cannot be read, or is nothing of that.
    """
    path = Path(path)
    if path.is_dir() or path.name == SETTINGS_FILE:
        return _of_folder(path if path.is_dir() else path.parent)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileError(
            f"The rig {path} cannot be read ({error.strerror}): give a rig file, a calibration file or a"
            " drive folder."
        ) from error
    if calibration_kind(content[:HEAD_BYTES]) == "driveworks":
        document = with_unknown_poses(json_document(content, path.name))
    else:
        cameras = read_cameras(content, path.name)
        document = new_rig_document({name: camera.model for name, camera in cameras.items()})
    return _given(document, path.name)


def _given(
    document: Mapping[str, Any],
    source: str,
    tables: Mapping[str, CameraSettings] | None = None,
    drive: Path | None = None,
    warnings: tuple[str, ...] = (),
) -> GivenRig:
    rig = rig_from_document(document, source)
    nominal = {
        name: Pose(camera.rig_R_camera, camera.rig_t_camera_m)
        for name, camera in rig.cameras.items()
        if camera.is_placed
    }
    return GivenRig(document, rig, nominal, tables or {}, drive, warnings)


def _of_folder(root: Path) -> GivenRig:
    folder, notes = DriveFolder(root), ReadingNotes()
    named = folder.has(SETTINGS_FILE)
    settings = read_settings(folder.content(SETTINGS_FILE)) if named else DriveSettings()
    rig, text = rig_of_folder(folder, _placed(folder, settings), notes)
    document = json.loads(text.removeprefix("\ufeff"))
    return _given(document, rig.source, settings.cameras, root, tuple(map(str, notes.warnings)))


def _placed(folder: DriveFolder, settings: DriveSettings) -> DriveSettings:
    """Settings in which cameras that no rig file has sit at the rig's origin unless they say where."""
    if settings.cameras and all(c.position_m and c.intrinsics for c in settings.cameras.values()):
        return settings
    rig_file = settings.rig or _rig_file(folder)
    known = _sensors(folder, rig_file) if rig_file is not None else set()
    cameras = {
        name: replace(camera, position_m=_NOWHERE)
        if camera.position_m is None and camera.intrinsics is not None and name not in known
        else camera
        for name, camera in settings.cameras.items()
    }
    return replace(settings, cameras=cameras, rig=rig_file)


def _rig_file(folder: DriveFolder) -> str | None:
    """The folder's rig file, if it has one."""
    kinds = {calibration_kind(folder.head(name, HEAD_BYTES)) for name in folder.names(".json")}
    return find_rig(folder) if "driveworks" in kinds else None


def _sensors(folder: DriveFolder, rig_file: str) -> set[str]:
    rig = rig_from_document(json_document(folder.peek(rig_file), rig_file), rig_file)
    return {*rig.cameras, *rig.antennas, *rig.unsupported}
