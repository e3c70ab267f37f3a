"""What every file of a folder is, by its content."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import PurePosixPath

from geoloc.calibration_files import CALIBRATION_KINDS, calibration_kind
from geoloc.rig.rig import looks_like_rig
from twin.drives.annotations.find import annotation_folders
from twin.drives.annotations.formats.json_values import parse_json
from twin.drives.annotations.formats.table import FORMATS, JSON, format_of, suffix_of
from twin.drives.annotations.formats.yolo import NAME_FILES
from twin.drives.annotations.labels import LABELS_FILE
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.files import DriveFolder
from twin.drives.frames.images import IMAGE_SUFFIXES
from twin.drives.frames.stamp_files import names_images
from twin.drives.motion.beside import motion_file
from twin.drives.track.formats.recording import Recording
from twin.drives.track.formats.rosbag import ROS2_METADATA
from twin.drives.track.formats.table import track_format
from twin.errors import DriveError

UNKNOWN = "not recognised"
AS_STATED = f"read as {SETTINGS_FILE} says"
EMPTY = "empty"
_NAMED = {SETTINGS_FILE: "settings of the drive", LABELS_FILE: "what labels mean"}
_VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv", ".avi", ".webm", ".h264", ".264", ".h265", ".265", ".hevc", ".ts")
_BY_SUFFIX = (
    dict.fromkeys(IMAGE_SUFFIXES, "image")
    | dict.fromkeys(_VIDEO_SUFFIXES, "video")
    | dict.fromkeys((".zip", ".7z", ".rar", ".tar", ".gz", ".tgz"), "archive, not opened")
)
_STAMPS = re.compile(rb"\s*(?:frame\s*,\s*time_ns|time_ns\s*,\s*frame|\d{1,9}\s+\d{13,19}\s*$)", re.MULTILINE)
_MOST_JSON_BYTES = 50_000_000
"""Larger JSON is told by its size alone: parsing it to say what it is would take its tenfold in memory."""
_GROUPED = ("image", *(f"annotations, {one.name}" for one in FORMATS if one.is_one_image))
"""Kinds of which tools write one file for each picture: one line for all of a folder."""


@dataclass(frozen=True, slots=True)
class FileSeen:
    """One file, or all files of one kind in one folder where tools write thousands.

    Attributes
    ----------
    name : str
        Relative to the drive folder.
    count : int
        Files that this line stands for.
    size_bytes : int
    kind : str
        In words; `UNKNOWN` where nothing here reads it, `AS_STATED` where only the settings say what it is.
    used : bool
        Whether the drive was read from it.
    """

    name: str
    count: int
    size_bytes: int
    kind: str
    used: bool


def recognised(folder: DriveFolder, named: Collection[str] = ()) -> tuple[FileSeen, ...]:
    """Tell what every file is, of the folder and of the folders in it, by name.

    What cannot be read is listed as such: nothing is raised.

    Parameters
    ----------
    named : collection of str
        Files of which the names are read: the drive was read from these as well.
    """
    files: list[FileSeen] = []
    used = folder.entered() | set(named)
    for inside in ("", *(f"{name}/" for name in annotation_folders(folder))):
        try:
            names = folder.names_in(inside) if inside else folder.names()
        except DriveError:
            continue
        groups: dict[tuple[str, str], list[str]] = {}
        for name in names:
            kind = kind_of(folder, name)
            if kind == UNKNOWN and name in used:
                kind = AS_STATED
            suffix = PurePosixPath(name).suffix.lower()
            groups.setdefault((kind, suffix if kind in _GROUPED else name), []).append(name)
        for (kind, suffix), members in groups.items():
            shown = members[0] if len(members) == 1 else f"{inside}*{suffix}"
            size = sum(_size(folder, name) for name in members)
            files.append(FileSeen(shown, len(members), size, kind, any(name in used for name in members)))
    return tuple(sorted(files, key=lambda file: (file.name.count("/"), file.name)))


def kind_of(folder: DriveFolder, name: str) -> str:
    """Kind of one file in words."""
    if name in _NAMED:
        return _NAMED[name]
    suffix = PurePosixPath(name).suffix.lower()
    try:
        if not _size(folder, name):
            return EMPTY
        if suffix in _BY_SUFFIX:
            return _BY_SUFFIX[suffix]
        head = folder.head(name)
        suffix = suffix_of(name, head)
        track = None if suffix == JSON and calibration_kind(head) else track_format(Recording(folder, name))
        its = track or motion_file(name, head)
        if its is not None:
            return its.kind
        return _json_kind(folder, name, head) if suffix == JSON else _text_kind(name, suffix, head)
    except DriveError as error:
        return f"unreadable: {error}"


def _json_kind(folder: DriveFolder, name: str, head: bytes) -> str:
    calibration = calibration_kind(head)
    if calibration is not None:
        return _calibration(calibration)
    if _size(folder, name) > _MOST_JSON_BYTES:
        return "JSON, too large to look into"
    try:
        document = parse_json(folder.peek(name), name)
    except DriveError:
        return "damaged JSON"
    return "DriveWorks rig" if looks_like_rig(document) else _annotations(JSON, document)


def _text_kind(name: str, suffix: str, head: bytes) -> str:
    calibration = calibration_kind(head)
    if calibration is not None:
        return _calibration(calibration)
    if _STAMPS.match(head) or names_images(head):
        return "frame times"
    if PurePosixPath(name).name == ROS2_METADATA:
        return "parts of a ROS 2 recording"
    if name.lower().endswith(NAME_FILES):
        return "names of classes"
    return "detector (ONNX)" if suffix == ".onnx" else _annotations(suffix, head)


def _annotations(suffix: str, beginning: object) -> str:
    its = format_of(suffix, beginning)
    return UNKNOWN if its is None else f"annotations, {its.name}"


def _calibration(kind: str) -> str:
    name = CALIBRATION_KINDS[kind]
    return name if kind == "driveworks" else f"calibration, {name}"


def _size(folder: DriveFolder, name: str) -> int:
    try:
        with folder.open(name) as file:
            return file.seek(0, 2)
    except (DriveError, OSError):
        return 0
