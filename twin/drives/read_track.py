"""The rig of a drive folder and where the car was: fixes of its antennas, or full poses."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from geoloc.errors import CalibrationError
from geoloc.rig import Antenna, Rig, rig_from_document, rig_with_lever_arms, without_template_masks
from geoloc.trajectory import GnssFixes, PoseTrack
from twin.drives.driveworks import find_gnss, find_rig
from twin.drives.folder import DriveFolder
from twin.drives.nmea import fix_rate_hz, read_nmea
from twin.drives.notes import ReadingNotes
from twin.drives.poses_csv import read_poses
from twin.drives.settings import SETTINGS_FILE, DriveSettings
from twin.errors import DriveError


@dataclass(frozen=True, slots=True)
class Track:
    """Where the car was: fixes or poses, and the rig with the antennas that they belong to."""

    rig: Rig
    gnss: tuple[GnssFixes, ...]
    poses: PoseTrack | None

    def span_ns(self) -> tuple[int, int]:
        """First and last epoch at which anything was recorded."""
        epochs = [self.poses.epoch_ns] if self.poses is not None else [f.epoch_ns for f in self.gnss]
        return min(int(e[0]) for e in epochs), max(int(e[-1]) for e in epochs)


def read_rig_file(folder: DriveFolder, settings: DriveSettings, notes: ReadingNotes) -> tuple[Rig, str]:
    """Read the drive's rig.

    Returns
    -------
    Rig
        Without car masks that are a template.
    str
        The file's text, kept for provenance.

    Raises
    ------
    DriveError
        If there is no rig file, or it cannot be used.
    """
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


def read_track(folder: DriveFolder, settings: DriveSettings, rig: Rig, notes: ReadingNotes) -> Track:
    """Read where the car was: the pose file that ``drive.toml`` names, else the GNSS recordings.

    Raises
    ------
    DriveError
        If there is neither, or nothing in them can be used.
    """
    if settings.poses:
        read = read_poses(
            folder.content(settings.poses, track=True), settings.poses, pitch_nose_up=settings.pitch_nose_up
        )
        notes.warnings += read.warnings
        notes.skipped += read.skipped
        notes.say(f"Poses {settings.poses}: {len(read.track.epoch_ns)}.")
        return Track(rig, (), read.track)
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
    return Track(rig, gnss, None)


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


def _read_gnss(folder: DriveFolder, files: Mapping[str, str], notes: ReadingNotes) -> tuple[GnssFixes, ...]:
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


def _warn_of_zero_lever_arms(rig: Rig, gnss: tuple[GnssFixes, ...], notes: ReadingNotes) -> None:
    zero = [f.antenna for f in gnss if not np.any(rig.antennas[f.antenna].rig_t_antenna_m)]
    if zero:
        notes.warnings.append(
            f"The lever arms of {', '.join(zero)} are all zero, so the fixes are taken as the rig's origin"
            f" (the ground below the rear axle): give [gnss] lever_arms in {SETTINGS_FILE}."
        )
