"""A drive folder, opened for annotation: its pictures, when they were taken, and where the car was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geoloc.arrays import IntArray
from geoloc.errors import GeolocError
from geoloc.rig.rig import Rig
from geoloc.trajectory.trajectory import Trajectory
from twin.annotate.files import file_name, is_own_file
from twin.drives.annotations.gather import only
from twin.drives.annotations.read import read_annotations
from twin.drives.drive import Annotations
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings, read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import Progress, ReadingNotes
from twin.drives.frames.find import Pictures, find_pictures
from twin.drives.frames.sizes import size_contradictions
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.frames.stamps import read_stamps
from twin.drives.frames.times import video_index
from twin.drives.motion.read import with_motion
from twin.drives.rig.rig_files import rig_of_folder
from twin.drives.track.read import read_track
from twin.errors import DriveError
from twin.ingest.locate import trajectory_of


@dataclass(frozen=True, slots=True)
class Recording:
    """What there is to annotate.

    Attributes
    ----------
    name : str
    root : Path
    rig : Rig
    pictures : mapping of camera to Pictures
        Of the cameras that can be annotated.
    frames : mapping of camera to int64 (k,)
        Numbers of the frames that have a picture.
    epoch_ns : mapping of camera to int64 (k,)
        When these were exposed; `NO_STAMP` where nobody knows. A camera without stamps is absent.
    trajectory : Trajectory or None
        None where the track cannot be read: then nothing is proposed.
    foreign : Annotations
        What other tools marked; it is shown, and stays as it is.
    is_complete : bool
        Whether the drive states that every sign in view is annotated.
    notices : tuple of str
        What the person should know, a sentence each.
    """

    name: str
    root: Path
    rig: Rig
    pictures: Mapping[str, Pictures]
    frames: Mapping[str, IntArray]
    epoch_ns: Mapping[str, IntArray]
    trajectory: Trajectory | None
    foreign: Annotations
    is_complete: bool
    notices: tuple[str, ...]


def open_recording(
    path: Path | str, *, cameras: Sequence[str] | None = None, progress: Progress | None = None
) -> Recording:
    """Open a drive folder.

    Parameters
    ----------
    cameras : sequence of str, optional
        Only these.

    What one camera lacks, or the whole drive but its pictures, is told in `notices`, and the rest goes on.

    Raises
    ------
    DriveError
        There is no rig, no picture of any of its cameras, or annotations of the folder are damaged.
    """
    folder = DriveFolder(Path(path))
    notes = ReadingNotes(progress)
    settings = read_settings(folder.content(SETTINGS_FILE)) if folder.has(SETTINGS_FILE) else DriveSettings()
    rig, rig_text = rig_of_folder(folder, settings, notes)
    told: list[str] = []
    trajectory: Trajectory | None = None
    try:
        track = read_track(folder, settings, rig, notes)
        track = with_motion(folder, settings.motion, rig_text, track, notes)
        rig, trajectory = track.rig, trajectory_of(track)
    except (DriveError, GeolocError) as error:
        told.append(f"{error} Until then no place is proposed: every picture has to be clicked.")
    for camera in cameras or ():
        rig.camera(camera)
    found = {
        camera: one
        for camera, one in find_pictures(folder, settings, rig).items()
        if one.where and camera in rig.cameras and (not cameras or camera in cameras)
    }
    pictures, frames, epochs = {}, {}, {}
    for camera, one in found.items():
        try:
            numbers, stamps = _frames_of(folder, settings, rig, one, told)
        except (DriveError, GeolocError) as error:
            told.append(f"{camera} cannot be annotated: {error}")
            continue
        pictures[camera], frames[camera] = one, numbers
        if stamps is not None:
            epochs[camera] = stamps
    if not pictures:
        raise DriveError(
            f"{folder.root} has no pictures to annotate: add a video named after its camera, or name pictures"
            f" under [frames] in {SETTINGS_FILE}.{''.join(f' {one}' for one in told)}"
        )
    return Recording(
        name=settings.name or Path(path).resolve().name,
        root=Path(path),
        rig=rig,
        pictures=pictures,
        frames=frames,
        epoch_ns=epochs,
        trajectory=trajectory,
        foreign=_foreign(folder, settings, rig, found, notes),
        is_complete=settings.annotations_complete,
        notices=(*told, *_not_read(settings, pictures)),
    )


def _frames_of(
    folder: DriveFolder, settings: DriveSettings, rig: Rig, pictures: Pictures, told: list[str]
) -> tuple[IntArray, IntArray | None]:
    """Numbers of the frames with a picture, and their epochs."""
    camera = pictures.camera
    for contradiction in size_contradictions({camera: pictures}, [camera], rig):
        raise DriveError(contradiction)
    n_frames = len(pictures.images) if pictures.images is not None else video_index(pictures).n_frames
    numbers = np.array([k for k in range(n_frames) if pictures.has(k)], dtype=np.int64)
    first: str = ""
    # Without the pictures: where these are fewer than the stamps, the first ones still have their times.
    for beside in ({camera: pictures}, {}):
        try:
            read = read_stamps(folder, settings, rig, {camera}, beside, ReadingNotes(None)).epoch_ns[camera]
        except (DriveError, GeolocError) as error:
            first = first or str(error)
            continue
        if first:
            told.append(f"{first} The first {min(n_frames, read.size):,} are shown with their stamps.")
        numbers = numbers[numbers < read.size]
        stamps = read[numbers]
        return numbers, np.where(stamps == NO_STAMP, NO_STAMP, stamps + settings.camera_offset_ns)
    told.append(f"{first} Until then no place is proposed in the pictures of {camera}.")
    return numbers, None


def _foreign(
    folder: DriveFolder,
    settings: DriveSettings,
    rig: Rig,
    pictures: Mapping[str, Pictures],
    notes: ReadingNotes,
) -> Annotations:
    images = {camera: of.frame_of() for camera, of in pictures.items() if of.images}
    rows = read_annotations(folder, settings, rig, notes, image_frames=images).annotations
    own = np.array([is_own_file(name) for name in rows.file.tolist()], dtype=np.bool_)
    return only(rows, ~own)


def _not_read(settings: DriveSettings, pictures: Mapping[str, Pictures]) -> list[str]:
    """Say which of the page's files ``drive.toml`` leaves out."""
    if settings.annotations is None:
        return []
    lacking = [
        (camera, file_name(camera))
        for camera in pictures
        if file_name(camera) not in settings.annotations.get(camera, ())
    ]
    return [
        f"{SETTINGS_FILE} names the annotations of this drive, and {name} is not among them, so ingest-drive"
        f" will not read it: add it under [annotations] {camera}."
        for camera, name in lacking
    ]
