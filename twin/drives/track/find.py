"""Which files say where the car was, and in which format: found by content, not by name."""

from __future__ import annotations

from geoloc.rig.rig import Rig
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.sensor_names import named_in
from twin.drives.track.formats.exif import JPEG_SUFFIXES, holds_pictures_with_positions
from twin.drives.track.formats.recording import Recording
from twin.drives.track.formats.rosbag import ROS2_METADATA
from twin.drives.track.formats.table import POSES, ROS, SUFFIXES, track_format, what_is_wrong
from twin.errors import DriveError

# Files that are never a track, whatever their first bytes: looking into them costs time for nothing.
_NO_TRACK = (".xml", ".toml", ".timestamps", ".h264", ".mp4", ".png", ".pcap", ".gpkg", *JPEG_SUFFIXES)


def damaged_recordings(folder: DriveFolder) -> list[str]:
    """Say of each file that is called a GNSS recording and is none what is wrong with it."""
    recordings = [Recording(folder, name) for name in folder.names(*SUFFIXES)]
    return [what_is_wrong(recording) for recording in recordings if track_format(recording) is None]


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
    files = _pose_files(folder)
    if len(files) > 1:
        raise DriveError(
            f"{' and '.join(files)} both hold poses: name one under [poses] in {SETTINGS_FILE},"
            f' file = "{files[0]}".'
        )
    return files[0] if files else None


def poses_beside(folder: DriveFolder) -> tuple[str, ...]:
    """Say of pose files in a folder with GNSS recordings that they are not used."""
    return tuple(
        f"{file} holds poses and is not used, since the folder has GNSS recordings: to use it instead, write"
        f' [poses] file = "{file}" in {SETTINGS_FILE}.'
        for file in _pose_files(folder)
    )


def _pose_files(folder: DriveFolder) -> list[str]:
    return [n for n in folder.names(".csv", ".txt") if track_format(Recording(folder, n)) is POSES]


def _sniffed_gnss(folder: DriveFolder, rig: Rig) -> dict[str, str]:
    names = [name for name in folder.names() if not name.lower().endswith(_NO_TRACK)]
    formats = {name: track_format(Recording(folder, name)) for name in names}
    recordings = [name for name, its in formats.items() if its is not None and its.fixes is not None]
    if folder.has(ROS2_METADATA) and any(formats[name] is ROS for name in recordings):
        # The drive folder is itself a ROS 2 recording: its parts are one.
        recordings = [".", *(name for name in recordings if formats[name] is not ROS)]
    recordings += [name for name in folder.folders() if folder.has(f"{name}/{ROS2_METADATA}")]
    if not recordings and len(rig.antennas) < 2 and holds_pictures_with_positions(folder):
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
