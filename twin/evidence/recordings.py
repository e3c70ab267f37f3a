"""The pictures of a drive that is in the store: opened anew from its folder, and decoded once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geoloc.arrays import IntArray
from geoloc.errors import GeolocError
from geoloc.rig.rig import Rig
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings, read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes
from twin.drives.frames.find import Pictures, find_pictures
from twin.drives.frames.read import Frame, frames
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.frames.stamps import read_stamps
from twin.errors import DriveError
from twin.evidence.crops import GapKind
from twin.words import WhyNoPicture, gaps

_NEAR_NS = 20_000_000
"""A frame whose stamp is further than this from a pose's epoch is not the one that the pose is of."""


@dataclass(frozen=True, slots=True)
class Lack:
    """Why there are no pictures, or no such picture."""

    kind: GapKind
    why: WhyNoPicture


@dataclass(frozen=True, slots=True)
class Recordings:
    """The pictures of one drive.

    Attributes
    ----------
    pictures : mapping of camera to Pictures
    lack : Lack or None
        Why there are none.
    """

    name: str
    settings: DriveSettings
    folder: DriveFolder | None
    rig: Rig
    pictures: Mapping[str, Pictures]
    lack: Lack | None = None

    def has(self, camera: str, frame: int) -> bool:
        """Whether there may be a picture of a frame."""
        return camera in self.pictures and self.pictures[camera].has(frame)

    def stamps(self, camera: str) -> IntArray | Lack:
        """Epochs of a camera's frames by frame number, as the sightings of the store have them."""
        if self.folder is None:
            return self.lack or Lack(GapKind.FOLDER_GONE, gaps.FolderUnknown(self.name))
        told = ""
        # Without the pictures: where these are fewer than the stamps, the first ones still have their times.
        for pictures in (self.pictures, {}):
            try:
                read = read_stamps(
                    self.folder, self.settings, self.rig, {camera}, pictures, ReadingNotes(None)
                )
            except (DriveError, GeolocError) as error:
                told = told or str(error)
                continue
            stamps = read.epoch_ns[camera]
            return np.where(stamps == NO_STAMP, NO_STAMP, stamps + self.settings.camera_offset_ns)
        return Lack(GapKind.UNREADABLE, gaps.CannotBeRead(told))

    def frame_at(self, stamps: IntArray, epoch_ns: int) -> int | None:
        """Return the number of the frame that was taken at an epoch; None where there is none."""
        if not stamps.size:
            return None
        apart = np.where(stamps == NO_STAMP, np.iinfo(np.int64).max, np.abs(stamps - epoch_ns))
        number = int(np.argmin(apart))
        return number if apart[number] <= _NEAR_NS else None

    def decoded(self, camera: str, numbers: Sequence[int], lacks: list[Lack]) -> Iterator[Frame]:
        """Decode frames in the order of their numbers; why some of them did not come is added to `lacks`."""
        wanted = np.zeros(max(numbers, default=-1) + 1, dtype=np.bool_)
        wanted[list(numbers)] = True
        stamps = np.zeros(wanted.size, dtype=np.int64)
        faults: Counter[str] = Counter()
        try:
            yield from frames(self.pictures[camera], stamps, wanted, faults)
        except DriveError as error:
            lacks.append(Lack(GapKind.UNREADABLE, gaps.CannotBeRead(str(error))))
            return
        for reason, count in sorted(faults.items()):
            if count:
                lost = gaps.FramesLost(count, camera, self.pictures[camera].where, reason)
                lacks.append(Lack(GapKind.FRAME_LOST, lost))


def recordings_of(name: str, folder: str, rig: Rig) -> Recordings:
    """Find the pictures of a drive; nothing is decoded.

    Parameters
    ----------
    name : str
        The drive's.
    folder : str
        That it was ingested from; "" where the store does not know.
    rig : Rig
        As the store keeps it.
    """
    settings = DriveSettings()

    def without(kind: GapKind, why: WhyNoPicture) -> Recordings:
        return Recordings(name, settings, None, rig, {}, Lack(kind, why))

    if not folder:
        return without(GapKind.FOLDER_GONE, gaps.FolderUnknown(name))
    if not Path(folder).is_dir():
        return without(GapKind.FOLDER_GONE, gaps.FolderGone(name, folder))
    try:
        opened = DriveFolder(Path(folder))
        if opened.has(SETTINGS_FILE):
            settings = read_settings(opened.content(SETTINGS_FILE))
        found = find_pictures(opened, settings, rig)
    except (DriveError, GeolocError) as error:
        return without(GapKind.UNREADABLE, gaps.CannotBeRead(str(error)))
    there = {camera: one for camera, one in found.items() if one.where}
    if not there:
        return without(GapKind.NO_PICTURES, gaps.NoRecording(name, folder))
    return Recordings(name, settings, opened, rig, there)
