"""Which files say where the car was, and in which format: found by content, not by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from geoloc.rig.rig import Rig
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.sensor_names import named_in
from twin.drives.frames.images import HEAD_BYTES
from twin.drives.track.formats.exif import has_exif_position, looks_like_jpeg
from twin.drives.track.formats.gpx import looks_like_gpx
from twin.drives.track.formats.nmea import looks_like_nmea
from twin.drives.track.formats.poses_csv import looks_like_poses
from twin.drives.track.formats.rosbag import SUFFIXES, looks_like_rosbag
from twin.drives.track.formats.sbp_messages import looks_like_sbp
from twin.errors import DriveError

NMEA, SBP, GPX, ROS, EXIF, POSES = "NMEA", "SBP", "GPX", "ROS", "EXIF", "poses.csv"
FORMATS = "NMEA, SwiftNav SBP, GPX, a ROS recording with NavSatFix, or pictures with EXIF positions"

ROS2_METADATA = "metadata.yaml"
JPEG_SUFFIXES = (".jpg", ".jpeg")
_ROS2_SUFFIXES = (".mcap", ".db3")

_SUFFIX_OF = {".gpx": GPX, ".nmea": NMEA, ".sbp": SBP, ".bag": ROS, ".mcap": ROS, ".db3": ROS}

# Files that are never a track, whatever their first bytes: looking into them costs time for nothing.
_NO_TRACK = (".xml", ".toml", ".timestamps", ".h264", ".mp4", ".png", ".pcap", ".gpkg", *JPEG_SUFFIXES)


def track_format(folder: DriveFolder, name: str) -> str | None:
    """Format of a file or folder that may say where the car was; None where it is none that is known."""
    if folder.is_folder(name):
        if folder.has(f"{name}/{ROS2_METADATA}"):
            return ROS
        return EXIF if folder.names_in(name, *JPEG_SUFFIXES) else None
    if not folder.has(name):
        return None
    head = folder.head(name)
    if looks_like_rosbag(head):
        return ROS if name.lower().endswith(SUFFIXES) else None
    tests = {SBP: looks_like_sbp, GPX: looks_like_gpx, POSES: looks_like_poses, NMEA: looks_like_nmea}
    return next((kind for kind, looks_like in tests.items() if looks_like(head)), None)


def what_is_wrong(content: bytes, name: str) -> str:
    """Say that a file is not the GNSS recording that its suffix promises; "" where that promises none.

    Parameters
    ----------
    content : bytes
        Of a file that is in none of the formats; its beginning will do.
    name : str
    """
    kind = _SUFFIX_OF.get(PurePosixPath(name).suffix.lower())
    if kind is None:
        return ""
    what = (
        f"is no {kind} (it begins {content[:20].decode('latin-1').strip()!r})"
        if content.strip()
        else "is empty"
    )
    return f"{name} {what}: record or export the {kind} file of this drive again."


def damaged_recordings(folder: DriveFolder) -> list[str]:
    """Say of each file that is called a GNSS recording and is none what is wrong with it."""
    names = [name for name in folder.names(*_SUFFIX_OF) if track_format(folder, name) is None]
    return [what_is_wrong(folder.head(name), name) for name in names]


def recording_files(folder: DriveFolder, name: str) -> list[str]:
    """Files of a ROS recording: of a ROS 2 folder those of its parts, in order.

    Raises
    ------
    DriveError
        If it is a folder without any.
    """
    if not folder.is_folder(name):
        return [name]
    files = folder.names_in(name, *_ROS2_SUFFIXES)
    if not files:
        raise DriveError(
            f"{name} is a ROS 2 recording without .mcap or .db3 files: unpack those that are compressed"
            " (zstd -d), or add them."
        )
    return sorted(files, key=lambda file: (len(file), file))  # part 10 comes after part 9


def find_gnss(folder: DriveFolder, rig: Rig) -> tuple[dict[str, str], list[str]]:
    """Find the GNSS recording of each antenna: as the rig names it, else what looks like one.

    Returns
    -------
    files : dict of antenna name to file name
        Empty if there is none. An antenna that the rig does not know is named after its file.
    warnings : list of str
        One sentence for each recording that the rig names and the folder lacks.

    Raises
    ------
    DriveError
        If it is not clear which antenna a recording belongs to.
    """
    files: dict[str, str] = {}
    absent: dict[str, str] = {}
    for antenna in rig.antennas.values():
        found = folder.found(antenna.file)
        if found:
            files[antenna.name] = found
        elif antenna.file:
            absent[antenna.name] = antenna.file
    if not files:
        files = _sniffed_gnss(folder, rig)
    warnings = [
        f"{rig.source} names {file} as the recording of {antenna}, but it is not in the folder: the drive is"
        " read without it."
        for antenna, file in absent.items()
        if files and antenna not in files
    ]
    return files, warnings


def find_poses(folder: DriveFolder) -> str | None:
    """Name of the folder's only pose file; None if there is none.

    Raises
    ------
    DriveError
        If there are several.
    """
    files = [name for name in folder.names(".csv", ".txt") if looks_like_poses(folder.head(name))]
    if len(files) > 1:
        raise DriveError(
            f"{' and '.join(files)} both hold poses: name one under [poses] in {SETTINGS_FILE},"
            f' file = "{files[0]}".'
        )
    return files[0] if files else None


def _sniffed_gnss(folder: DriveFolder, rig: Rig) -> dict[str, str]:
    names = [name for name in folder.names() if not name.lower().endswith(_NO_TRACK)]
    formats: Mapping[str, str | None] = {name: track_format(folder, name) for name in names}
    recordings = [name for name, kind in formats.items() if kind not in (None, POSES)]
    if folder.has(ROS2_METADATA) and any(formats[name] == ROS for name in recordings):
        # The drive folder is itself a ROS 2 recording: its parts are one.
        recordings = [".", *(name for name in recordings if formats[name] != ROS)]
    recordings += [name for name in folder.folders() if folder.has(f"{name}/{ROS2_METADATA}")]
    if not recordings and len(rig.antennas) < 2 and _has_pictures_with_positions(folder):
        recordings = ["."]
    if not rig.antennas:
        return {"gnss" if name == "." else name.rpartition(".")[0] or name: name for name in recordings}
    if len(rig.antennas) == 1 and len(recordings) == 1:
        return {next(iter(rig.antennas)): recordings[0]}
    files: dict[str, str] = {}
    for name in recordings:
        antennas = named_in(name, rig.antennas)
        if len(antennas) != 1 or antennas[0] in files:
            raise DriveError(
                f"{name} is a GNSS recording, but not which antenna's: write"
                f' [gnss] files = {{"<antenna>" = "{name}"}} in {SETTINGS_FILE}; the antennas of {rig.source}'
                f" are {', '.join(rig.antennas)}."
            )
        files[antennas[0]] = name
    return files


def _has_pictures_with_positions(folder: DriveFolder) -> bool:
    heads = (folder.head(name, HEAD_BYTES) for name in folder.names(*JPEG_SUFFIXES)[:3])
    return any(looks_like_jpeg(head) and has_exif_position(head) for head in heads)
