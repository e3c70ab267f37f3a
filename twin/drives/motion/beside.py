"""What a drive folder holds of a car's motion and ``drive.toml`` does not name, or that nobody can read."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSettings, MotionSource
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.formats import comma, driveworks, ros, sbp
from twin.drives.track.formats import gpmf
from twin.drives.track.formats.framedata import is_framedata
from twin.drives.track.formats.recording import Recording
from twin.drives.track.formats.rosbag import recorded_topics
from twin.errors import DriveError

_RAW = re.compile(r"(can|imu|vehicle_?io)\w*\.(bin|can)", re.IGNORECASE)
"""As DriveWorks' recorder calls them: ``can_vehicle0.bin``."""
_OPENPILOT = re.compile(r"([rq]log|raw_log)(\.bz2|\.zst)?", re.IGNORECASE)
_CANDUMP = re.compile(rb"\s*\(\d+\.\d+\) \S+ [0-9A-Fa-f]+#")
_ASC = re.compile(rb"\s*(//[^\n]*\n\s*)*date\s+\w+", re.IGNORECASE)
_TRC = re.compile(rb"\s*;\$FILEVERSION|\s*;#{5,}")
_KINDS = {"can": "a CAN bus", "imu": "an IMU"}
_LOOK_BYTES = 1_000_000
_HELP = "(`twin help drive-folder`)"


class MotionFile(NamedTuple):
    """What a file is, and how it gets into the trajectory.

    Attributes
    ----------
    what : str
    cure : str
        What to do, one clause; "" where it is only of use beside another file.
    is_readable : bool
        Whether twin reads it once ``drive.toml`` names it.
    """

    what: str
    cure: str
    is_readable: bool

    @property
    def kind(self) -> str:
        """In the list of files."""
        return self.what if self.is_readable else f"{self.what}, not read"


_RAW_CURE = (
    "its layout is not public: export it with DriveWorks' ingest_framedata --format=json, record the bus as"
    " ASC, BLF or by candump, or export the signals as a table (CSV)"
)
_FILES: tuple[tuple[Callable[[str, str, bytes], bool], MotionFile], ...] = (
    (
        lambda _name, suffix, head: _is_log(suffix, head),
        MotionFile("log of a CAN bus", 'give file, dbc and speed = "MESSAGE.SIGNAL"', is_readable=True),
    ),
    (
        lambda _name, suffix, _head: suffix == ".dbc",
        MotionFile("what messages of a CAN bus mean (DBC)", "", is_readable=True),
    ),
    (
        lambda _name, suffix, head: head.startswith(b"MDF ") or suffix in (".mf4", ".mdf"),
        MotionFile("measurements (MDF)", "export it as ASC, BLF or CSV", is_readable=False),
    ),
    (
        lambda _name, _suffix, head: is_framedata(head),
        MotionFile(
            "frames of a sensor, DriveWorks JSON",
            "give file, and the names of its signals or turn_rate_axis",
            is_readable=True,
        ),
    ),
    (
        lambda _name, _suffix, head: driveworks.is_egomotion(head),
        MotionFile("egomotion of DriveWorks", "give file", is_readable=True),
    ),
    (
        lambda name, _suffix, _head: _OPENPILOT.fullmatch(name) is not None,
        MotionFile(
            "log of openpilot",
            "export carState and the gyro as a table (CSV), or as the folders of comma2k19",
            is_readable=False,
        ),
    ),
)


def motion_file(name: str, head: bytes) -> MotionFile | None:
    """Say what a file is that may tell how the car moved; None for any other."""
    plain, suffix = PurePosixPath(name).name, PurePosixPath(name).suffix.lower()
    found = next((its for is_it, its in _FILES if is_it(plain, suffix, head)), None)
    if found is None and _RAW.fullmatch(plain):
        return raw_recording(_KINDS.get(plain[:3].casefold(), "a car"))
    return found


def raw_recording(of: str) -> MotionFile:
    """What a raw recording of DriveWorks is."""
    return MotionFile(f"DriveWorks' own recording of {of}", _RAW_CURE, is_readable=False)


def _is_log(suffix: str, head: bytes) -> bool:
    return (
        head.startswith(b"LOGG")
        or (suffix == ".asc" and _ASC.match(head) is not None)
        or (suffix == ".trc" and _TRC.match(head) is not None)
        or (suffix == ".log" and _CANDUMP.match(head) is not None)
    )


def motion_beside(folder: DriveFolder, rig_text: str, settings: MotionSettings) -> list[str]:
    """Say of each file that tells how the car moved, and that is not used, how it could be.

    Parameters
    ----------
    rig_text : str
        The rig file, which names recordings of sensors; "" for none.
    """
    used = {name for source in settings.sources for name in (source.file, source.dbc)}
    raw = _named_by_rig(rig_text)
    sentences = []
    for name in folder.names():
        if name in used:
            continue
        try:
            its = motion_file(name, folder.head(name))
        except DriveError:
            continue
        if its is None and name in raw:
            its = raw_recording(raw[name])
        if its is not None and its.cure:
            sentences.append(_sentence(name, its))
    return sentences + [told for name, told in _recordings(folder) if name not in used]


def _sentence(name: str, its: MotionFile) -> str:
    named = f"under [motion] in {SETTINGS_FILE} {_HELP}"
    if its.is_readable:
        return f"{name} is not used ({its.what}): to use it, {its.cure} {named}."
    return f"{name} cannot be read ({its.what}): {its.cure}, and name that {named}."


def _recordings(folder: DriveFolder) -> Iterator[tuple[str, str]]:
    """Recordings that hold more than where the car was, and folders of comma's logs."""
    for name in [*folder.names(), *folder.folders()]:
        source = MotionSource("motion", name)
        said = []
        try:
            if ros.is_ros(folder, source):
                files = folder.names_in(name, ".mcap", ".db3") if folder.is_folder(name) else [name]
                topics = recorded_topics([folder.root / file for file in files], name)
                of_motion = {topic: kind for topic, kind in topics.items() if kind in ros.TURN_TYPES}
                said = [f"{topic} ({kind.rpartition('/')[2]})" for topic, kind in sorted(of_motion.items())]
            elif comma.is_comma(folder, source):
                said = ["comma log"]
            elif not folder.is_folder(name):
                said = _of_receiver(folder, source)
        except DriveError:
            continue
        if said:
            its = MotionFile(", ".join(said)[:300], f'give file = "{name}"', is_readable=True)
            yield name, _sentence(name, its)


def _of_receiver(folder: DriveFolder, source: MotionSource) -> list[str]:
    """What a receiver or a camera recorded besides where it was, by the beginning of its recording."""
    if sbp.is_sbp(folder, source):
        return sbp.messages_of_motion(folder.head(source.file, _LOOK_BYTES))
    recording = Recording(folder, source.file)
    return ["gyro of the camera"] if gpmf.is_gopro_video(recording) and gpmf.has_gyro(recording) else []


def _named_by_rig(rig_text: str) -> Mapping[str, str]:
    """Recordings of buses and IMUs that a rig file names."""
    try:
        document: Any = json.loads(rig_text) if rig_text else {}
        sensors = document["rig"]["sensors"]
    except (ValueError, RecursionError, KeyError, TypeError):
        return {}
    named = {}
    for sensor in sensors if isinstance(sensors, list) else ():
        entry = sensor if isinstance(sensor, dict) else {}
        protocol, parameter = entry.get("protocol"), entry.get("parameter")
        kind = _KINDS.get(str(protocol).partition(".")[0])
        file = re.search(r"(?:^|,)\s*file=([^,]+)", parameter) if isinstance(parameter, str) else None
        if kind and file:
            named[PurePosixPath(file[1].strip()).name] = kind
    return named
