"""A drive folder, looked at: every file, every sensor on one clock, and what ``ingest-drive`` would say.

Nothing here refuses: each part of the folder is read by the very readers of :mod:`twin.drives`, and what they
refuse becomes a sentence of the report.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from geoloc.arrays import IntArray
from geoloc.errors import GeolocError
from geoloc.rig.rig import Rig
from geoloc.trajectory.trajectory import trajectory_from_gnss, trajectory_from_poses
from twin.drives.annotations.gather import AnnotationsRead, epochs_of
from twin.drives.annotations.read import read_annotations
from twin.drives.drive import Drive
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings, read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, Progress, ReadingNotes, Skipped
from twin.drives.frames.find import Pictures, find_pictures
from twin.drives.frames.sizes import size_contradictions
from twin.drives.frames.stamps import read_stamps
from twin.drives.inspection.recognise import FileSeen, recognised
from twin.drives.inspection.sensors import (
    SensorSpan,
    annotations_span,
    frames_span,
    gnss_span,
    motion_span,
    poses_span,
)
from twin.drives.motion.beside import motion_beside
from twin.drives.motion.read import MotionSeen, read_motion
from twin.drives.plausibility import check_enough_read, check_track
from twin.drives.read import read_drive
from twin.drives.rig.rig_files import rig_of_folder
from twin.drives.track.pose_sigmas import pose_sigma_doubts
from twin.drives.track.read import Track, read_track
from twin.errors import TwinError

_Read = TypeVar("_Read")


@dataclass(frozen=True, slots=True)
class CameraSeen:
    """One camera of the rig, in words.

    `horizontal_fov_deg` is None where an edge of the image lies outside the model's domain; `problem` says
    why a camera cannot be used, "" if it can.
    """

    name: str
    model: str
    size_px: tuple[int, int] | None
    horizontal_fov_deg: float | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Inspection:
    """What a folder holds.

    Attributes
    ----------
    path, name : str
    ready : bool
        Whether ``ingest-drive`` would read it.
    refusals : tuple of str
        What it would refuse, one sentence for each part; empty if it would not.
    files : tuple of FileSeen
        Every file, what it is and whether the drive was read from it.
    cameras : tuple of CameraSeen
    antennas : mapping of name to lever arm (x, y, z), metres
    sensors : tuple of SensorSpan
        In the order GNSS or poses, the car's own motion, then frames and annotations camera by camera.
    warnings : tuple of str
        What reading told, and what is missing for a full result.
    skipped : tuple of Skipped
    settings : mapping of str to str
        What ``drive.toml``, or its absence, settles.
    """

    path: str
    name: str
    ready: bool
    refusals: tuple[str, ...]
    files: tuple[FileSeen, ...]
    cameras: tuple[CameraSeen, ...]
    antennas: Mapping[str, tuple[float, float, float]]
    sensors: tuple[SensorSpan, ...]
    warnings: tuple[str, ...]
    skipped: tuple[Skipped, ...]
    settings: Mapping[str, str]

    def as_json(self) -> dict[str, Any]:
        """Give the report as one document; epochs are nanoseconds since 1970, UTC."""
        plain = ("path", "name", "ready", "refusals", "warnings", "antennas", "settings")
        lists = ("files", "cameras")
        document: dict[str, Any] = {name: getattr(self, name) for name in plain}
        document |= {name: [asdict(one) for one in getattr(self, name)] for name in lists}
        document["skipped"] = [skipped.as_row() for skipped in self.skipped]
        return document | {"sensors": [sensor.as_json() for sensor in self.sensors]}


@dataclass(slots=True)
class _Parts:
    """The refusals of what could not be read."""

    refusals: list[str] = field(default_factory=list)

    def tried(self, read: Callable[[], _Read]) -> _Read | None:
        """Result of a reader, or None with its refusal noted."""
        try:
            return read()
        except (TwinError, GeolocError) as error:
            self.note(str(error))
            return None

    def note(self, refusal: str) -> None:
        """Remember a refusal once."""
        if refusal not in self.refusals:
            self.refusals.append(refusal)


def inspect_drive(path: Path | str, *, progress: Progress | None = None) -> Inspection:
    """Look at a drive folder.

    Parameters
    ----------
    path : Path or str
        Any folder.
    progress : callable, optional
        Called with one sentence a step.

    Raises
    ------
    DriveError
        If `path` is not a folder that can be listed: anything in it is reported, not raised.
    """
    path = Path(path)
    folder, parts = DriveFolder(path), _Parts()
    notes = ReadingNotes(progress)
    stated = parts.tried(lambda: _settings(folder))
    settings = stated or DriveSettings()
    # What the folder lacks beside a drive.toml that cannot be read is what that file may say.
    rest = parts if stated else _Parts()
    read = rest.tried(lambda: rig_of_folder(folder, settings, notes))
    rig = None if read is None else read[0]
    # Without a rig the recordings still say when they were made.
    track = rest.tried(lambda: read_track(folder, settings, rig or Rig({}, {}, "the rig"), notes))
    rig_text = "" if read is None else read[1]
    motion = _motion(folder, settings, rig_text, track, notes, rest)
    annotated: AnnotationsRead | None = None
    pictures: Mapping[str, Pictures] = {}
    stamps: dict[str, tuple[IntArray, str]] = {}
    if rig is not None:
        known = rig
        pictures = rest.tried(lambda: find_pictures(folder, settings, known)) or {}
        image_frames = {camera: of.frame_of() for camera, of in pictures.items() if of.images}
        annotated = rest.tried(
            lambda: read_annotations(folder, settings, known, notes, image_frames=image_frames)
        )
        stamps = _stamps(folder, settings, known, annotated, pictures, notes, rest)
        # Of annotated cameras reading the drive says it, as far as it matters for what was annotated.
        to_annotate = set(pictures) - set(annotated.cameras if annotated else ())
        notes.warn(DriveDoubt.PICTURES, *size_contradictions(pictures, to_annotate, known))
    if not parts.refusals:
        parts.tried(lambda: _tell_of_track(read_drive(path), notes))
    missing = _missing(stated, rig, annotated, stamps)
    missing += motion_beside(folder, rig_text, settings.motion)
    notes.say("looking at every file")
    return Inspection(
        path=str(path),
        name=settings.name or path.resolve().name,
        ready=not parts.refusals,
        refusals=tuple(parts.refusals),
        files=recognised(folder, _images_of_times(pictures, stamps)),
        cameras=_cameras(rig),
        antennas=_antennas(rig if track is None else track.rig),
        sensors=_sensors(settings, track, motion, annotated, stamps),
        warnings=tuple(dict.fromkeys((*map(str, notes.warnings), *missing))),
        skipped=tuple(dict.fromkeys(notes.skipped)),
        settings=_settled(folder, settings),
    )


def _tell_of_track(drive: Drive, notes: ReadingNotes) -> None:
    """Tell what reading the whole drive tells, and check its track up to the trajectory made of it."""
    notes.skipped.extend(drive.skipped)
    notes.warnings.extend((*drive.warnings, *check_track(drive)))
    check_enough_read(drive)
    if drive.clock is not None and "time_ms" not in drive.errors:
        notes.warn(
            DriveDoubt.CLOCK, f"{drive.clock.sentence()}: state [errors] time_ms if it is better known."
        )
    if drive.poses is not None:
        notes.warnings.extend(pose_sigma_doubts(trajectory_from_poses(drive.poses).estimated))
        return
    notes.say("building the trajectory, as ingest-drive would")
    arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    dropped = trajectory_from_gnss(drive.gnss, arms, motion=drive.motion).dropped
    notes.skipped.extend(Skipped("GNSS fixes", drive.name, count, reason) for count, reason in dropped)


def _motion(
    folder: DriveFolder,
    settings: DriveSettings,
    rig_text: str,
    track: Track | None,
    notes: ReadingNotes,
    parts: _Parts,
) -> tuple[MotionSeen, ...]:
    """What the car measured of its own motion, as far as it can be read."""
    if track is None:
        return ()
    gnss = track.gnss
    read = parts.tried(lambda: read_motion(folder, settings.motion, rig_text, gnss, notes))
    return () if read is None else read.seen


def _settings(folder: DriveFolder) -> DriveSettings:
    return read_settings(folder.content(SETTINGS_FILE)) if folder.has(SETTINGS_FILE) else DriveSettings()


def _images_of_times(
    pictures: Mapping[str, Pictures], stamps: Mapping[str, tuple[IntArray, str]]
) -> set[str]:
    """Images whose own names or tags say when they were taken."""
    by_themselves = (
        of for camera, of in pictures.items() if camera in stamps and stamps[camera][1] == of.where
    )
    return {image for of in by_themselves for image in of.images or ()}


def _once(progress: Progress | None) -> Progress | None:
    """Leave out what was said before: each camera is tried alone, and reads what drive.toml names besides."""
    told: set[str] = set()

    def say(text: str) -> None:
        if progress is not None and text not in told:
            told.add(text)
            progress(text)

    return say


def _stamps(
    folder: DriveFolder,
    settings: DriveSettings,
    rig: Rig,
    annotated: AnnotationsRead | None,
    pictures: Mapping[str, Pictures],
    notes: ReadingNotes,
    parts: _Parts,
) -> dict[str, tuple[IntArray, str]]:
    """Stamps of every camera that has some; only those of annotated cameras can be missed."""
    needed = {*(annotated.cameras if annotated else ()), *settings.timestamps}
    stamps = {}
    progress = _once(notes.progress)
    for camera in sorted({*rig.cameras, *needed}):
        of_camera = ReadingNotes(progress)
        trial = parts if camera in needed else _Parts()
        read = trial.tried(lambda c=camera, n=of_camera: read_stamps(folder, settings, rig, {c}, pictures, n))  # type: ignore[misc]
        if read is not None and camera in read[0]:
            stamps[camera] = (read[0][camera], read[1][camera])
            notes.warnings += of_camera.warnings
            notes.skipped += of_camera.skipped
    return stamps


def _cameras(rig: Rig | None) -> tuple[CameraSeen, ...]:
    if rig is None:
        return ()
    cameras = []
    for camera in rig.cameras.values():
        fov = math.degrees(camera.model.horizontal_fov_rad)
        size = (camera.model.width_px, camera.model.height_px)
        cameras.append(CameraSeen(camera.name, camera.model.model, size, fov if math.isfinite(fov) else None))
    cameras += [CameraSeen(name, "", None, None, reason) for name, reason in rig.unsupported.items()]
    return tuple(cameras)


def _antennas(rig: Rig | None) -> dict[str, tuple[float, float, float]]:
    if rig is None:
        return {}
    arms = {name: antenna.rig_t_antenna_m.tolist() for name, antenna in rig.antennas.items()}
    return {name: (x, y, z) for name, (x, y, z) in arms.items()}


def _sensors(
    settings: DriveSettings,
    track: Track | None,
    motion: tuple[MotionSeen, ...],
    annotated: AnnotationsRead | None,
    stamps: Mapping[str, tuple[IntArray, str]],
) -> tuple[SensorSpan, ...]:
    spans: list[SensorSpan | None] = []
    if track is not None:
        files = settings.gnss or {}
        for fixes in track.gnss:
            file = files.get(fixes.antenna) or track.rig.antennas[fixes.antenna].file or ""
            spans.append(gnss_span(fixes, file))
        if track.poses is not None:
            spans.append(poses_span(track.poses, settings.poses or ""))
    spans += map(motion_span, motion)
    for camera, (epoch_ns, file) in stamps.items():
        spans.append(frames_span(camera, epoch_ns, file))
        annotations = None if annotated is None else annotated.annotations
        if annotations is not None and np.any(annotations.camera == camera):
            epochs = epochs_of(annotations, {camera: epoch_ns})[annotations.camera == camera]
            spans.append(annotations_span(camera, epochs, ""))
    return tuple(span for span in spans if span is not None)


def _missing(
    settings: DriveSettings | None,
    rig: Rig | None,
    annotated: AnnotationsRead | None,
    stamps: Mapping[str, tuple[IntArray, str]],
) -> list[str]:
    """What the drive can do without, and what that costs; settings that cannot be read lack nothing."""
    sentences = []
    without = [name for name in (rig.cameras if rig else ()) if name not in stamps]
    if without:
        sentences.append(
            f"No frame times for {', '.join(without)}: pictures of these cameras cannot be used."
        )
    annotates = annotated is not None and len(annotated.annotations.frame) > 0
    if annotates and settings is not None and not settings.annotations_complete:
        sentences.append(
            f"{SETTINGS_FILE} does not say annotations_complete = true, so this drive cannot show that a sign"
            " is missing."
        )
    return sentences


def _settled(folder: DriveFolder, settings: DriveSettings) -> dict[str, str]:
    """What holds for this drive, and whether the drive says so itself."""
    readout = settings.rolling_shutter_ms
    return {
        "settings": SETTINGS_FILE if folder.has(SETTINGS_FILE) else f"no {SETTINGS_FILE}: a DriveWorks trip",
        "datum": settings.datum,
        "annotations complete": "yes" if settings.annotations_complete else "not said",
        "camera clock": f"{settings.camera_offset_ns / 1e6:+g} ms",
        "rolling shutter": "not said: estimated" if readout is None else f"{readout:g} ms",
    }
