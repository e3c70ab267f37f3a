"""A drive folder → :class:`~twin.drives.drive.Drive`: the door of :mod:`twin.drives`.

Two layouts, one reader. ``drive.toml`` says where things are (the generic folder); what it does not say, or a
folder without it, is searched as a DriveWorks trip (:mod:`twin.drives.rig.driveworks`).

A ``drive.toml`` with every key::

    name = "E6 Okstad northbound"   # default: the folder's name
    rig = "rig.json"                # DriveWorks rig file, and/or [cameras]
    annotations_complete = true     # every sign in view was annotated (default false)
    datum = "EUREF89"               # or "ITRF2014", "ITRF2020"
    camera_offset_ms = 0.0          # added to the frame stamps
    first_frame = 0                 # number of the first frame in a CSV and in names of images; or 1
    pitch_positive = "nose_down"    # of the pose file; "nose_up" as most INS write it
    [cameras.front]                 # any calibration file
    intrinsics = "camchain.yaml#cam0"
    position = [1.8, 0.0, 1.4]
    roll_pitch_yaw = [0.0, 2.5, 0.0]
    mask = "mask.png"               # black on the car itself
    [gnss]                          # either GNSS recordings, by antenna …
    files = {"gnss50:vehicle" = "gnss50.nmea"}
    lever_arms = {"gnss50:vehicle" = [1.1, 0.5, 1.6]}   # overrides the rig's
    topics = {"gnss50:vehicle" = "/fix"}                # of ROS recordings with several
    sigma_m = 0.02                  # of fixes whose recording states none
    [poses]                         # … or full poses
    file = "poses.csv"
    lever_arm = [0.9, 0.0, 1.2]     # of the point whose poses they are (default: the rig's origin)
    topics = {position = "/fix", attitude = "/imu"}     # of ROS recordings with several
    [motion]                        # what the car measured of its own motion
    file = "can.csv"
    time = "t"
    time_unit = "s"
    speed = "v_kmh"
    speed_unit = "km/h"
    [timestamps]                    # by camera
    C3_tricam120 = "C3.timestamps"
    [frames]                        # by camera: a video, or a folder of images
    C3_tricam120 = "C3.mp4"
    [annotations]                   # by camera: a file, a folder, or a list of them
    C3_tricam120 = "C3.xml"
    [errors]                        # one sigma of any term of the error budget
    boresight_deg = 0.1
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geoloc.arrays import IntArray
from geoloc.rig.rig import Rig
from twin.drives.annotations.frame_numbers import first_frame_warnings
from twin.drives.annotations.gather import AnnotationsRead, stamped
from twin.drives.annotations.key_frames import drawn_on_ground, key_frames
from twin.drives.annotations.read import label_files, read_annotations
from twin.drives.detection.read import read_detections
from twin.drives.drive import Drive
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings, read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, Progress, ReadingNotes
from twin.drives.frames.clocks import StatedClock, of_host, worst
from twin.drives.frames.find import Pictures, find_pictures
from twin.drives.frames.sizes import check_picture_sizes
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.frames.stamps import Stamps, read_stamps
from twin.drives.motion.read import with_motion
from twin.drives.plausibility import check_span
from twin.drives.rig.rig_files import rig_of_folder
from twin.drives.track.read import Track, read_track

if TYPE_CHECKING:
    from twin.drives.detection.run import DetectorOptions


def read_drive(
    path: Path | str,
    *,
    detector: DetectorOptions | None = None,
    labels: Path | None = None,
    cameras: Collection[str] = (),
    progress: Progress | None = None,
) -> Drive:
    """Read and check a recorded drive.

    Parameters
    ----------
    path : Path or str
        The folder: a DriveWorks trip, or any folder with a ``drive.toml`` (see the module's text).
    detector : DetectorOptions, optional
        Find the signs by a network in the pictures of all cameras; annotations are then left unread.
    labels : Path, optional
        What labels mean (:mod:`twin.drives.annotations.labels`), instead of the folder's own ``labels.toml``.
    cameras : collection of str
        Whose frames get time stamps, annotated or not; those that the rig does not have are left out.
    progress : callable, optional
        Called with one sentence a step.

    Returns
    -------
    Drive
        Complete and consistent: every annotation has a camera of the rig and a time stamp. What was left out
        is counted in ``skipped``; what a user should know is in ``warnings``.

    Raises
    ------
    DriveError
        If a file is missing, unreadable, contradicts another, or leads out of the folder: one sentence that
        names the file and the cure.
    """
    path = Path(path)
    folder = DriveFolder(path)
    notes = ReadingNotes(progress)
    named = folder.has(SETTINGS_FILE)
    settings = read_settings(folder.content(SETTINGS_FILE)) if named else DriveSettings()
    rig, rig_text = rig_of_folder(folder, settings, notes)
    track = read_track(folder, settings, rig, notes)
    track = with_motion(folder, settings.motion, rig_text, track, notes)
    pictures = find_pictures(folder, settings, track.rig)
    if detector is None:
        seen = _annotated(folder, settings, track, pictures, notes, labels, cameras)
    else:
        seen = _detected(folder, settings, track, pictures, notes, labels, detector)
    annotated, (stamps, stamp_files, clocks) = seen.annotated, seen.stamps
    in_view, unstamped = stamped(annotated.annotations, stamps, stamp_files)
    notes.skipped += unstamped
    offset_ns = settings.camera_offset_ns
    notes.warn(DriveDoubt.CLOCK, *check_span(in_view, stamps, stamp_files, offset_ns, track))
    on_ground = drawn_on_ground(annotated.on_ground, stamps, stamp_files, notes)
    of_ground = {row.camera for row in on_ground}
    notes.warn(DriveDoubt.RIG, *_unplaced(track.rig, sorted({*in_view.camera.tolist(), *of_ground})))
    annotations, interpolated = key_frames(in_view, notes)
    return Drive(
        drive_id=folder.drive_id(),
        content_sha256=folder.content_sha256(),
        annotations_sha256=folder.content_sha256(seen.files - label_files(labels)),
        name=settings.name or path.resolve().name,
        path=str(path),
        rig=track.rig,
        rig_document=rig_text,
        gnss=track.gnss,
        poses=track.poses,
        frame_epoch_ns=stamps,
        annotations=annotations,
        annotations_complete=(
            settings.annotations_complete if detector is None else settings.detections_complete
        ),
        datum=settings.datum,
        camera_offset_ns=settings.camera_offset_ns,
        rolling_shutter_ms=settings.rolling_shutter_ms,
        pole_radius_m=settings.pole_radius_m,
        warnings=tuple(notes.warnings),
        skipped=tuple(notes.skipped),
        pictures=pictures,
        other_objects=annotated.other_objects,
        interpolated=interpolated,
        errors=settings.errors,
        clock=_clock({*annotations.camera.tolist(), *of_ground}, stamps, clocks, track),
        on_ground=on_ground,
        motion=track.motion,
    )


class _Seen(NamedTuple):
    """What is to be seen in which frames, and when these were taken."""

    annotated: AnnotationsRead
    files: frozenset[str]
    stamps: Stamps


def _annotated(
    folder: DriveFolder,
    settings: DriveSettings,
    track: Track,
    pictures: Mapping[str, Pictures],
    notes: ReadingNotes,
    labels: Path | None,
    cameras: Collection[str],
) -> _Seen:
    """Read what people annotated, and the stamps of the cameras that they annotated."""
    before = folder.entered()
    image_frames = {camera: of.frame_of() for camera, of in pictures.items() if of.images}
    annotated = read_annotations(folder, settings, track.rig, notes, labels=labels, image_frames=image_frames)
    files = folder.entered() - before
    timed = {
        *annotated.cameras,
        *(settings.annotations or ()),
        *(track.rig.cameras.keys() & set(cameras)),
    }
    stamps = read_stamps(folder, settings, track.rig, timed, pictures, notes)
    check_picture_sizes(pictures, annotated.unsized, track.rig)
    if settings.first_frame is None:
        told = first_frame_warnings(annotated.annotations, annotated.numbered, stamps.epoch_ns, stamps.file)
        notes.warn(DriveDoubt.ANNOTATIONS, *told)
    return _Seen(annotated, files, stamps)


def _detected(
    folder: DriveFolder,
    settings: DriveSettings,
    track: Track,
    pictures: Mapping[str, Pictures],
    notes: ReadingNotes,
    labels: Path | None,
    detector: DetectorOptions,
) -> _Seen:
    """Let a network find what is to be seen in the pictures of all cameras."""
    stamps = read_stamps(folder, settings, track.rig, set(pictures), pictures, notes)
    before = folder.entered()
    annotated = read_detections(
        folder, settings, track, pictures, stamps.epoch_ns, detector, notes, labels=labels
    )
    return _Seen(annotated, folder.entered() - before, stamps)


def _clock(
    cameras: Collection[str],
    stamps: Mapping[str, IntArray],
    clocks: Mapping[str, StatedClock],
    track: Track,
) -> StatedClock | None:
    """The annotated cameras' clock that is known least against the track."""
    # Frames that have poses of their very epochs are of one clock with them, whatever it shows.
    epochs = np.empty(0, dtype=np.int64) if track.poses is None else track.poses.epoch_ns
    of_cameras = [
        clocks[camera]
        for camera in sorted(cameras)
        if camera in clocks and not np.isin(stamps[camera][stamps[camera] != NO_STAMP], epochs).all()
    ]
    return worst([*of_cameras, of_host(track.gnss)])


def _unplaced(rig: Rig, cameras: list[str]) -> list[str]:
    """Say that cameras have intrinsics and no place yet, as ``calibrate intrinsics`` leaves them."""
    names = ", ".join(name for name in cameras if not rig.cameras[name].is_placed)
    sentence = (
        f"{names}: at the rig's origin by {rig.source}, on the road below the rear axle, so every position is"
        " wrong: find where it sits with twin calibrate extrinsics, or measure it."
    )
    return [sentence] if names else []
