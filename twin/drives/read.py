"""A drive folder → :class:`~twin.drives.drive.Drive`: the door of :mod:`twin.drives`.

Two layouts, one reader. ``drive.toml`` says where things are (the generic folder); what it does not say, or a
folder without it, is searched as a DriveWorks trip (:mod:`twin.drives.driveworks`).

A ``drive.toml`` with every key::

    name = "E6 Okstad northbound"   # default: the folder's name
    rig = "rig.json"                # DriveWorks rig file
    annotations_complete = true     # every sign in view was annotated (default false)
    datum = "EUREF89"               # or "ITRF2014", "ITRF2020"
    camera_offset_ms = 0.0          # added to the frame stamps
    pitch_positive = "nose_down"    # of the pose file; "nose_up" as most INS write it
    [gnss]                          # either GNSS recordings, by antenna …
    files = {"gnss50:vehicle" = "gnss50.nmea"}
    lever_arms = {"gnss50:vehicle" = [1.1, 0.5, 1.6]}   # overrides the rig's
    [poses]                         # … or full poses
    file = "poses.csv"
    [timestamps]                    # by camera
    C3_tricam120 = "C3.timestamps"
    [annotations]                   # by camera: a file, or a list of files
    C3_tricam120 = "C3.xml"
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geoloc.errors import CalibrationError
from geoloc.rig import Antenna, Rig, rig_from_document, rig_with_lever_arms, without_template_masks
from geoloc.trajectory import GnssFixes, PoseTrack
from twin.drives.annotated import AnnotationsRead, epochs_of, gather, stamped
from twin.drives.clock import utc_text
from twin.drives.cvat import read_cvat
from twin.drives.drive import Annotations, Drive, IntArray, Skipped
from twin.drives.driveworks import find_annotations, find_gnss, find_rig, find_timestamps
from twin.drives.folder import DriveFolder
from twin.drives.nmea import fix_rate_hz, read_nmea
from twin.drives.poses_csv import read_poses
from twin.drives.settings import SETTINGS_FILE, DriveSettings, read_settings
from twin.drives.timestamps import NO_STAMP, read_timestamps
from twin.errors import DriveError

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class _Track:
    """Where the car was: fixes or poses, and the rig with the antennas that they belong to."""

    rig: Rig
    gnss: tuple[GnssFixes, ...]
    poses: PoseTrack | None

    def span_ns(self) -> tuple[int, int]:
        epochs = [self.poses.epoch_ns] if self.poses is not None else [f.epoch_ns for f in self.gnss]
        return min(int(e[0]) for e in epochs), max(int(e[-1]) for e in epochs)


@dataclass(slots=True)
class _Notes:
    """What is told while reading, and what stays with the drive."""

    progress: Progress | None
    warnings: list[str]
    skipped: list[Skipped]

    def say(self, text: str) -> None:
        if self.progress is not None:
            self.progress(text)


def read_drive(path: Path | str, *, progress: Progress | None = None) -> Drive:
    """Read and check a recorded drive.

    Parameters
    ----------
    path : Path or str
        The folder: a DriveWorks trip, or any folder with a ``drive.toml`` (see the module's text).
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
    notes = _Notes(progress, [], [])
    named = folder.has(SETTINGS_FILE)
    settings = read_settings(folder.content(SETTINGS_FILE)) if named else DriveSettings()
    rig, rig_text = _read_rig(folder, settings, notes)
    track = _read_track(folder, settings, rig, notes)
    found = _read_annotations(folder, settings, track.rig, notes)
    stamps, stamp_files = _read_stamps(folder, settings, track.rig, found, notes)
    annotations, unstamped = stamped(found.annotations, stamps, stamp_files)
    notes.skipped += unstamped
    _check_span(annotations, stamps, settings.camera_offset_ns, track, notes)
    return Drive(
        drive_id=folder.drive_id(),
        content_sha256=folder.content_sha256(),
        name=settings.name or path.resolve().name,
        path=str(path),
        rig=track.rig,
        rig_document=rig_text,
        gnss=track.gnss,
        poses=track.poses,
        frame_epoch_ns=stamps,
        annotations=annotations,
        annotations_complete=settings.annotations_complete,
        datum=settings.datum,
        camera_offset_ns=settings.camera_offset_ns,
        rolling_shutter_ms=settings.rolling_shutter_ms,
        pole_radius_m=settings.pole_radius_m,
        warnings=tuple(notes.warnings),
        skipped=tuple(notes.skipped),
    )


def _read_rig(folder: DriveFolder, settings: DriveSettings, notes: _Notes) -> tuple[Rig, str]:
    name = settings.rig or find_rig(folder)
    try:
        text = folder.content(name).decode("utf-8-sig")
        rig = rig_from_document(json.loads(text), name)
    except (ValueError, RecursionError) as error:
        raise DriveError(f"{name} is not JSON ({error}): export the rig file again.") from error
    except CalibrationError as error:
        raise DriveError(str(error)) from error
    rig, shared = without_template_masks(rig)
    if shared:
        notes.warnings.append(
            f"{name}: {', '.join(shared)} share one car mask bit for bit, which cannot be what each of them"
            " sees of the car: the mask is not used."
        )
    notes.say(f"Rig {name}: {len(rig.cameras)} cameras, {len(rig.antennas)} antennas.")
    return rig, text


def _read_track(folder: DriveFolder, settings: DriveSettings, rig: Rig, notes: _Notes) -> _Track:
    if settings.poses:
        read = read_poses(
            folder.content(settings.poses, track=True), settings.poses, pitch_nose_up=settings.pitch_nose_up
        )
        notes.warnings += read.warnings
        notes.skipped += read.skipped
        notes.say(f"Poses {settings.poses}: {len(read.track.epoch_ns)}.")
        return _Track(rig, (), read.track)
    files: Mapping[str, str]
    if settings.gnss is not None:
        files = settings.gnss
    else:
        files, absent = find_gnss(folder, rig)
        notes.warnings += absent
    if not files:
        names = ", ".join(a.file for a in rig.antennas.values() if a.file)
        wanted = f"{rig.source} names {names}" if names else "NMEA text with GGA sentences"
        raise DriveError(
            f"{folder.root} holds no GNSS recording ({wanted}) and no poses: add it, or name it under [gnss]"
            f" or [poses] in {SETTINGS_FILE}."
        )
    rig = _with_antennas(rig, files, settings)
    gnss = _read_gnss(folder, files, notes)
    _warn_of_zero_lever_arms(rig, gnss, notes)
    return _Track(rig, gnss, None)


def _with_antennas(rig: Rig, files: Mapping[str, str], settings: DriveSettings) -> Rig:
    """Give the rig the lever arms of ``drive.toml``, and the antennas that only ``drive.toml`` knows."""
    arms = settings.lever_arms_m
    unknown = [name for name in (*files, *arms) if name not in rig.antennas]
    for name in unknown:
        if name not in files or (rig.antennas and name not in arms):
            raise DriveError(
                f"{SETTINGS_FILE} names the antenna {name}, but the antennas of {rig.source} are"
                f" {', '.join(rig.antennas) or 'none'} and those of [gnss] files are"
                f" {', '.join(settings.gnss or ()) or 'none'}: spell it alike, or give it both a file and a"
                " lever arm."
            )
    added = {name: Antenna(name, np.zeros(3), files[name]) for name in unknown}
    rig = replace(rig, antennas={**rig.antennas, **added})
    try:
        return rig_with_lever_arms(rig, arms)
    except CalibrationError as error:
        raise DriveError(f"{SETTINGS_FILE}: {error}") from error


def _read_gnss(folder: DriveFolder, files: Mapping[str, str], notes: _Notes) -> tuple[GnssFixes, ...]:
    """Fixes of every antenna; one that recorded nothing usable costs a warning while another did."""
    gnss, failures = [], []
    for antenna, file in sorted(files.items()):
        content = folder.content(file, track=True)
        try:
            read = read_nmea(content, antenna, file)
        except DriveError as error:
            failures.append(error)
            continue
        gnss.append(read.fixes)
        notes.warnings += read.warnings
        notes.skipped += read.skipped
        notes.say(f"GNSS {file}: {len(read.fixes.epoch_ns)} fixes at {fix_rate_hz(read.fixes):.1f} Hz.")
    if not gnss:
        raise failures[0]
    notes.warnings += [f"The drive is read without one antenna: {failure}" for failure in failures]
    return tuple(gnss)


def _warn_of_zero_lever_arms(rig: Rig, gnss: tuple[GnssFixes, ...], notes: _Notes) -> None:
    zero = [f.antenna for f in gnss if not np.any(rig.antennas[f.antenna].rig_t_antenna_m)]
    if zero:
        notes.warnings.append(
            f"The lever arms of {', '.join(zero)} are all zero, so the fixes are taken as the rig's origin"
            f" (the ground below the rear axle): give [gnss] lever_arms in {SETTINGS_FILE}."
        )


def _read_annotations(
    folder: DriveFolder, settings: DriveSettings, rig: Rig, notes: _Notes
) -> AnnotationsRead:
    if settings.annotations is None:
        wanted: list[tuple[str, str | None]] = [(name, None) for name in find_annotations(folder)]
    else:
        wanted = [(name, camera) for camera, names in settings.annotations.items() for name in names]
        for camera in settings.annotations:
            _check_camera(rig, camera, "[annotations]")
    files = [(read_cvat(folder.content(name), name), camera) for name, camera in wanted]
    found = gather(files, rig)
    notes.skipped += found.skipped
    if not files:
        notes.warnings.append(
            f"{folder.root.name} holds no annotations (CVAT XML 1.1), so the drive has a track but no"
            " sightings."
        )
    elif not len(found.annotations.frame):
        names = ", ".join(name for name, _ in wanted)
        notes.warnings.append(
            f"{names}: not one point or box that can be used, so the drive has no sightings."
        )
    notes.say(f"Annotations: {len(found.annotations.frame)} in {len(files)} files.")
    return found


def _check_camera(rig: Rig, camera: str, table: str) -> None:
    try:
        rig.camera(camera)
    except CalibrationError as error:
        raise DriveError(f"{table} in {SETTINGS_FILE} names the camera {camera}: {error}") from error


def _read_stamps(
    folder: DriveFolder, settings: DriveSettings, rig: Rig, found: AnnotationsRead, notes: _Notes
) -> tuple[dict[str, IntArray], dict[str, str]]:
    """Frame stamps of the annotated cameras, and of those for which ``drive.toml`` names them."""
    stamps, files = {}, {}
    for camera in settings.timestamps:
        _check_camera(rig, camera, "[timestamps]")
    for camera in sorted({*found.cameras, *settings.timestamps, *(settings.annotations or ())}):
        file = settings.timestamps.get(camera) or find_timestamps(folder, rig.camera(camera))
        if file is None:
            wanted = rig.camera(camera).timestamps or f"{camera}.timestamps"
            raise DriveError(
                f"{wanted} is not in {folder.root}, so the annotated frames of {camera} have no time: add the"
                f" file, or name it under [timestamps] in {SETTINGS_FILE}."
            )
        stamps[camera], skipped = read_timestamps(folder.content(file), file)
        files[camera] = file
        notes.skipped += skipped
        notes.say(f"Time stamps {file}: {np.count_nonzero(stamps[camera] != NO_STAMP)} frames.")
    return stamps, files


def _check_span(
    annotations: Annotations,
    stamps: Mapping[str, IntArray],
    offset_ns: int,
    track: _Track,
    notes: _Notes,
) -> None:
    """Refuse a drive whose frames all lie outside the track; warn where some do."""
    if not len(annotations.frame):
        return
    epoch_ns = np.concatenate(
        [
            epochs_of(annotations, stamps, camera)[annotations.camera == camera]
            for camera in np.unique(annotations.camera).tolist()
        ]
    )
    epoch_ns = epoch_ns + offset_ns
    first, last = track.span_ns()
    outside = int(np.count_nonzero((epoch_ns < first) | (epoch_ns > last)))
    what = "poses" if track.poses is not None else "GNSS fixes"
    spans = (
        f"from {utc_text(int(epoch_ns.min()))} to {utc_text(int(epoch_ns.max()))}, the {what} from"
        f" {utc_text(first)} to {utc_text(last)}"
    )
    if outside == len(epoch_ns):
        raise DriveError(
            f"Every annotated frame lies outside the {what}: the frames are {spans}. Bring files of one drive"
            f" together, or correct the clocks with camera_offset_ms in {SETTINGS_FILE}."
        )
    if outside:
        notes.warnings.append(
            f"{outside} of {len(epoch_ns)} annotations lie outside the {what} and cannot be located: the"
            f" annotated frames are {spans}."
        )
