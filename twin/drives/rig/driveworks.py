"""What a DriveWorks trip does not say by name is found by content.

A trip of the NTNU car is a flat folder: a rig file (JSON, whatever its name), ``<camera>.h264`` with
``<camera>.h264.timestamps``, ``gnss*_vehicle.bin`` (NMEA text), and beside them the annotators' CVAT exports.
"""

from __future__ import annotations

import json
from typing import Any

from geoloc.rig.rig import RigCamera, looks_like_rig
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.sensor_names import named_in, plain
from twin.errors import DriveError

LARGEST_RIG_BYTES = 50_000_000
"""No rig file comes near it; larger JSON files are something else and are not opened."""

_VIDEOS = (".mp4", ".mov", ".mkv", ".avi", ".ts")


def find_rig(folder: DriveFolder) -> str:
    """Name of the folder's rig file, found by content.

    Raises
    ------
    DriveError
        If there is none, or if two differ.
    """
    rigs: dict[str, Any] = {}
    broken = []
    for name in folder.names(".json"):
        if len(folder.head(name, LARGEST_RIG_BYTES + 1)) > LARGEST_RIG_BYTES:
            continue
        try:
            document = json.loads(folder.peek(name).decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            broken.append(f"{name} is not JSON ({error})")
            continue
        if looks_like_rig(document):
            rigs[name] = document
    if not rigs:
        raise DriveError(_no_drive(folder, broken))
    first, *others = rigs
    for other in others:
        if rigs[other] != rigs[first]:
            raise DriveError(
                f"{first} and {other} are two different rigs: name the right one in {SETTINGS_FILE},"
                f' rig = "{first}".'
            )
    return first


def _no_drive(folder: DriveFolder, broken: list[str]) -> str:
    names = folder.names()
    shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    reason = f" ({'; '.join(broken)})" if broken else ""
    videos = [name for name in names if name.casefold().endswith(_VIDEOS)]
    if videos and not folder.has(SETTINGS_FILE):
        return (
            f"{folder.root} has no {SETTINGS_FILE} and no rig file{reason}, but the video {videos[0]}: twin"
            f" init {folder.root} writes {SETTINGS_FILE} for a dashcam, an action camera or a telephone with"
            " a GNSS track. For a car with a rig, add its rig file (`twin help drive-folder`)."
        )
    return (
        f"{folder.root} holds no drive: looked for {SETTINGS_FILE} that names a rig, and for a DriveWorks rig"
        f" file (*.json with rig.sensors){reason}; found {shown or 'no files'}. Add the rig file of the car,"
        f" or give every camera intrinsics, position and roll_pitch_yaw under [cameras] in {SETTINGS_FILE}"
        " (`twin help drive-folder`)."
    )


def find_timestamps(folder: DriveFolder, camera: RigCamera) -> str | None:
    """File of a camera's frame stamps: as the rig names it, else ``<camera>*.timestamps``; None if absent.

    Raises
    ------
    DriveError
        If several files could be meant.
    """
    named = folder.found(camera.timestamps)
    if named:
        return named
    candidates = [name for name in folder.names(".timestamps") if plain(name).startswith(plain(camera.name))]
    # C1 begins C10 as well: the whole name must be there.
    candidates = [name for name in candidates if named_in(name, [camera.name])]
    if len(candidates) > 1:
        raise DriveError(
            f"{' and '.join(candidates)} could both hold the time stamps of {camera.name}: name one under"
            f" [timestamps] in {SETTINGS_FILE}."
        )
    return candidates[0] if candidates else None
