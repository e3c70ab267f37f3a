"""When each frame of the annotated cameras was taken."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from geoloc.arrays import IntArray
from geoloc.rig.rig import Rig
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, ReadingNotes
from twin.drives.frames.clocks import StatedClock
from twin.drives.frames.find import Pictures
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.frames.times import FrameTimes, times_from_file, times_of_pictures
from twin.drives.rig.driveworks import find_timestamps
from twin.drives.rig.rig_files import check_camera
from twin.errors import DriveError


class Stamps(NamedTuple):
    """Stamps of cameras.

    Attributes
    ----------
    epoch_ns : dict of camera to int64 (frames,)
        `NO_STAMP` where a frame has none.
    file : dict of camera to str
        The file that says so.
    clock : dict of camera to StatedClock
        Of those whose stamps are less well known than those of a triggered camera.
    """

    epoch_ns: dict[str, IntArray]
    file: dict[str, str]
    clock: dict[str, StatedClock]


def read_stamps(
    folder: DriveFolder,
    settings: DriveSettings,
    rig: Rig,
    cameras: set[str],
    pictures: Mapping[str, Pictures],
    notes: ReadingNotes,
) -> Stamps:
    """Frame stamps of the given cameras, and of those for which ``drive.toml`` names them.

    A file of stamps comes first; without one, the times that the pictures carry.

    Returns
    -------
    Stamps

    Raises
    ------
    DriveError
        If a camera has no times, or more or fewer than pictures.
    """
    stamps, files, clocks = {}, {}, {}
    for table, names in (("[timestamps]", settings.timestamps), ("[frames]", settings.frames or ())):
        for camera in names:
            check_camera(rig, camera, table)
    for camera in sorted({*cameras, *settings.timestamps}):
        times = _of_camera(folder, settings, rig, camera, pictures.get(camera))
        stamps[camera], files[camera] = times.epoch_ns, times.where
        if times.clock is not None:
            clocks[camera] = times.clock
        notes.skipped += times.skipped
        notes.warn(DriveDoubt.CLOCK, *times.warnings)
        n_stamped = np.count_nonzero(times.epoch_ns != NO_STAMP)
        notes.say(f"Time stamps {times.where}: {n_stamped} frames.")
    return Stamps(stamps, files, clocks)


def _of_camera(
    folder: DriveFolder, settings: DriveSettings, rig: Rig, camera: str, pictures: Pictures | None
) -> FrameTimes:
    file = settings.timestamps.get(camera) or find_timestamps(folder, rig.camera(camera))
    if file is not None:
        return times_from_file(folder.content(file), file, pictures, by_number=settings.frames_by_number)
    if pictures is not None:
        return times_of_pictures(pictures)
    wanted = rig.camera(camera).timestamps or f"{camera}.timestamps"
    raise DriveError(
        f"{wanted} is not in {folder.root}, so the annotated frames of {camera} have no time: add the"
        f" file, or name it under [timestamps], or pictures that carry times under [frames], in"
        f" {SETTINGS_FILE}."
    )
