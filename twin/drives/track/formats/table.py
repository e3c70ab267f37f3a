"""Every format that says where the car was: what it is called, how it is recognised and how it is read.

A new format is a module beside this one and a line in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import PurePosixPath
from typing import NamedTuple

from twin.drives.folder.drive_toml import DriveSettings
from twin.drives.track.fixes import FixesRead, PosesRead
from twin.drives.track.formats import (
    exif,
    framedata,
    gpmf,
    gpsd,
    gpx,
    nmea,
    poses_csv,
    rosbag,
    sbp,
    sbp_messages,
)
from twin.drives.track.formats.recording import Recording

ReadFixes = Callable[[Recording, str, DriveSettings], FixesRead]
ReadPoses = Callable[[Recording, DriveSettings], PosesRead]


class TrackFormat(NamedTuple):
    """One format.

    Attributes
    ----------
    name : str
        In a sentence about a file: "is no SBP".
    kind : str
        What inspection says of its files.
    is_it : callable
        Whether a recording is of this format.
    fixes : callable or None
        Reads the fixes of the antenna that is named; None for full poses, which are of no antenna.
    poses : callable or None
        Reads full poses; None where a recording cannot say how the car lay.
    suffixes : tuple of str
        Names that promise this format.
    asked_for : str
        In the list of what a drive may be recorded in; "" where it is not a GNSS recording.
    states_quality : bool
        Whether it says how good its fixes are.
    """

    name: str
    kind: str
    is_it: Callable[[Recording], bool]
    fixes: ReadFixes | None
    poses: ReadPoses | None = None
    suffixes: tuple[str, ...] = ()
    asked_for: str = ""
    states_quality: bool = True


def _begins(looks_like: Callable[[bytes], bool]) -> Callable[[Recording], bool]:
    """Recognise a file by its first bytes."""
    return lambda recording: not recording.is_folder and looks_like(recording.head)


def _whole(read: Callable[[bytes, str, str], FixesRead]) -> ReadFixes:
    """Read a file in one piece."""
    return lambda recording, antenna, _: read(recording.content(), antenna, recording.where)


def _sbp_poses(recording: Recording, _settings: DriveSettings) -> PosesRead:
    return sbp.read_sbp_poses(recording.content(), recording.where)


def _csv_poses(recording: Recording, settings: DriveSettings) -> PosesRead:
    return poses_csv.read_poses(recording.content(), recording.where, pitch_nose_up=settings.pitch_nose_up)


ROS = TrackFormat(
    "ROS",
    "ROS recording",
    rosbag.is_ros_recording,
    rosbag.fixes_of_recording,
    rosbag.poses_of_recording,
    rosbag.SUFFIXES,
    "a ROS recording with NavSatFix",
)
EXIF = TrackFormat(
    "EXIF",
    "images with EXIF positions",
    exif.is_folder_of_pictures,
    exif.fixes_of_recording,
    asked_for="pictures with EXIF positions",
    states_quality=False,
)
SBP = TrackFormat(
    "SBP",
    "GNSS, SwiftNav SBP",
    _begins(sbp_messages.looks_like_sbp),
    _whole(sbp.read_sbp),
    _sbp_poses,
    (".sbp",),
    "SwiftNav SBP",
)
GPX = TrackFormat(
    "GPX",
    "GNSS, GPX",
    _begins(gpx.looks_like_gpx),
    _whole(gpx.read_gpx),
    suffixes=(".gpx",),
    asked_for="GPX",
    states_quality=False,
)
POSES = TrackFormat("poses.csv", "full poses", _begins(poses_csv.looks_like_poses), None, _csv_poses)
NMEA = TrackFormat(
    "NMEA",
    "GNSS, NMEA 0183",
    _begins(nmea.looks_like_nmea),
    _whole(nmea.read_nmea),
    suffixes=(".nmea",),
    asked_for="NMEA",
)
GOPRO = TrackFormat(
    "GoPro",
    "video with GNSS, GoPro",
    gpmf.is_gopro_video,
    gpmf.fixes_of_video,
    asked_for="a GoPro video with its own GPS",
)
DRIVEWORKS = TrackFormat(
    "DriveWorks JSON",
    "GNSS, DriveWorks JSON",
    _begins(framedata.is_gps_framedata),
    _whole(framedata.read_gps),
    asked_for="DriveWorks' JSON of a GPS",
    states_quality=False,
)
GPSD = TrackFormat(
    "gpsd",
    "GNSS, reports of gpsd",
    _begins(gpsd.looks_like_gpsd),
    _whole(gpsd.read_gpsd),
    asked_for="gpsd's JSON",
)
FORMATS = (ROS, GOPRO, EXIF, POSES, DRIVEWORKS, GPSD, GPX, SBP, NMEA)
"""The first that knows a recording as its own reads it."""
_ASKED_FOR = [one.asked_for for one in reversed(FORMATS) if one.asked_for]
NAMES = f"{', '.join(_ASKED_FOR[:-1])} or {_ASKED_FOR[-1]}"
"""For people."""
SUFFIXES = tuple(suffix for one in FORMATS for suffix in one.suffixes)
"""Of files that promise to say where the car was."""


def track_format(recording: Recording) -> TrackFormat | None:
    """Return the format of a file or folder; None if it is none of the table, or absent."""
    if not recording.is_folder and not recording.folder.has(recording.name):
        return None
    return next((one for one in FORMATS if one.is_it(recording)), None)


def what_is_wrong(recording: Recording) -> str:
    """Say that a file of no format is not what its suffix promises; "" where that promises nothing."""
    suffix = PurePosixPath(recording.name).suffix.lower()
    promised = next((one.name for one in FORMATS if suffix in one.suffixes), "")
    if not promised:
        return ""
    begins = recording.head[:20].decode("latin-1").strip()
    what = f"is no {promised} (it begins {begins!r})" if recording.head.strip() else "is empty"
    return f"{recording.name} {what}: record or export the {promised} file of this drive again."
