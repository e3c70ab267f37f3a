"""The rig of a drive folder and where the car was: fixes of its antennas, or full poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoloc.errors import CalibrationError
from geoloc.rig.rig import Antenna, Rig, rig_with_lever_arms
from geoloc.trajectory.fix_checks import VERTICAL_FACTOR, sigma_of_quality
from geoloc.trajectory.trajectory import GnssFixes, PoseTrack
from geoloc.trajectory.vehicle_motion import VehicleMotion
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, ReadingNotes
from twin.drives.track.attitudes import moved_to_rig_origin
from twin.drives.track.find import damaged_recordings, find_gnss, find_poses, poses_beside
from twin.drives.track.fixes import FixesRead, fix_rate_hz, headings_and_velocities
from twin.drives.track.formats.nmea import read_nmea
from twin.drives.track.formats.recording import Recording
from twin.drives.track.formats.table import NAMES, POSES, track_format, what_is_wrong
from twin.drives.track.receiver_headings import headings_of_the_car
from twin.errors import DriveError

_LONGEST_MISSING_S, _LARGEST_MISSING = 5.0, 0.05
"""An antenna that misses no more of the drive's beginning or end than this is not told of."""


@dataclass(frozen=True, slots=True)
class Track:
    """Where the car was: fixes or poses, the rig with the antennas they belong to, and its own motion."""

    rig: Rig
    gnss: tuple[GnssFixes, ...]
    poses: PoseTrack | None
    motion: VehicleMotion | None = None

    def span_ns(self) -> tuple[int, int]:
        """First and last epoch at which anything was recorded."""
        epochs = [self.poses.epoch_ns] if self.poses is not None else [f.epoch_ns for f in self.gnss]
        return min(int(e[0]) for e in epochs), max(int(e[-1]) for e in epochs)


def read_track(folder: DriveFolder, settings: DriveSettings, rig: Rig, notes: ReadingNotes) -> Track:
    """Read where the car was: the pose file that ``drive.toml`` names, else the GNSS recordings.

    Raises
    ------
    DriveError
        If there is neither, or nothing in them can be used.
    """
    files: Mapping[str, str] = settings.gnss or {}
    poses = settings.poses
    if not files and poses is None:
        files, absent = find_gnss(folder, rig)
        notes.warn(DriveDoubt.TRACK, *absent)
        if files:
            notes.warn(DriveDoubt.TRACK, *poses_beside(folder))
        else:
            poses = find_poses(folder)
    if poses is not None:
        return Track(rig, (), _read_poses(folder, poses, settings, notes))
    if not files:
        damaged = damaged_recordings(folder)
        names = ", ".join(a.file for a in rig.antennas.values() if a.file)
        wanted = f"{rig.source} names {names}" if names else NAMES
        raise DriveError(
            f"{folder.root} holds no GNSS recording ({wanted}) and no poses: add it, or name it under [gnss]"
            f" or [poses] in {SETTINGS_FILE}.{''.join(f' {one}' for one in damaged)}"
        )
    rig = rig_with_antennas(rig, files, settings)
    gnss = _read_gnss(folder, files, settings, notes)
    _warn_of_zero_lever_arms(rig, gnss, notes)
    return Track(rig, gnss, None)


def _read_poses(folder: DriveFolder, name: str, settings: DriveSettings, notes: ReadingNotes) -> PoseTrack:
    """Poses of the rig's origin."""
    recording = Recording(folder, name)
    its = track_format(recording) or POSES  # whose reader says what is wrong
    if its.poses is None:
        raise DriveError(
            f"{name} is {its.name}, which says where an antenna was but not how the car lay: name it under"
            f" [gnss] files in {SETTINGS_FILE} instead of [poses]."
        )
    read = its.poses(recording, settings)
    notes.warn(DriveDoubt.TRACK, *read.warnings)
    notes.skipped += read.skipped
    notes.say(f"Poses {name}: {len(read.track.epoch_ns)}.")
    track = _with_stated_sigmas(read.track, settings.pose_sigmas)
    if settings.pose_lever_arm_m is not None:
        return moved_to_rig_origin(track, settings.pose_lever_arm_m)
    if its.fixes is not None:  # recorded by a receiver, whose point is not the rig's
        notes.warn(
            DriveDoubt.TRACK,
            f"The positions of {name} are taken as the rig's origin (the ground below the rear axle): give"
            f" [poses] lever_arm in {SETTINGS_FILE}, where the INS's point sits in the car.",
        )
    return track


def _with_stated_sigmas(track: PoseTrack, stated: Mapping[str, float]) -> PoseTrack:
    """Give poses without a sigma that of ``drive.toml``; its height's follows from its place's."""
    horizontal = stated.get("sigma_m", np.nan)
    sigmas = {
        "sigma_horizontal_m": horizontal,
        "sigma_vertical_m": stated.get("sigma_height_m", VERTICAL_FACTOR * horizontal),
        "sigma_roll_pitch_deg": stated.get("sigma_roll_pitch_deg", np.nan),
        "sigma_heading_deg": stated.get("sigma_heading_deg", np.nan),
    }
    columns = {name: getattr(track, name) for name in sigmas}
    return replace(
        track, **{name: np.where(np.isnan(own), sigmas[name], own) for name, own in columns.items()}
    )


def rig_with_antennas(rig: Rig, files: Mapping[str, str], settings: DriveSettings) -> Rig:
    """Give the rig the lever arms of ``drive.toml``, and the antennas that only ``drive.toml`` knows.

    Parameters
    ----------
    files : mapping of antenna to file
        The recordings.

    Raises
    ------
    DriveError
        If ``drive.toml`` names an antenna that there is not.
    """
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


def _read_gnss(
    folder: DriveFolder, files: Mapping[str, str], settings: DriveSettings, notes: ReadingNotes
) -> tuple[GnssFixes, ...]:
    """Fixes of every antenna.

    One that the rig names, or that was found, and that recorded nothing usable costs a warning while another
    did; one that ``drive.toml`` names is refused.
    """
    for antenna in settings.gnss_topics:
        if antenna not in files:
            raise DriveError(
                f"{SETTINGS_FILE} names a topic of the antenna {antenna}, but the recordings are those of"
                f" {', '.join(files)}: spell it alike, or give it a file."
            )
    gnss, failures = [], []
    for antenna, file in sorted(files.items()):
        if not folder.is_folder(file):
            folder.open(file).close()  # one that is named and absent is refused, whatever the others recorded
        try:
            read = _weighted(_read_antenna(folder, file, antenna, settings), folder, file, settings)
        except DriveError as error:
            if antenna in (settings.gnss or {}):
                raise  # what drive.toml names is meant
            failures.append(error)
            continue
        fixes, heading_warnings = headings_of_the_car(read.fixes, file, settings)
        gnss.append(fixes)
        notes.warn(DriveDoubt.TRACK, *read.warnings, *heading_warnings)
        notes.skipped += read.skipped
        more = "".join(f", {part}" for part in headings_and_velocities(fixes))
        notes.say(f"GNSS {file}: {len(fixes.epoch_ns)} fixes at {fix_rate_hz(fixes):.1f} Hz{more}.")
    if not gnss:
        raise failures[0]
    notes.warn(
        DriveDoubt.TRACK, *(f"The drive is read without one antenna: {failure}" for failure in failures)
    )
    notes.warn(DriveDoubt.TRACK, *_cut_short(gnss, files))
    return tuple(gnss)


def _cut_short(gnss: Sequence[GnssFixes], files: Mapping[str, str]) -> list[str]:
    """Tell of antennas that began later than others, or stopped before them."""
    first, last = min(int(f.epoch_ns[0]) for f in gnss), max(int(f.epoch_ns[-1]) for f in gnss)
    warnings = []
    for fixes in gnss:
        late_s, early_s = (fixes.epoch_ns[0] - first) / 1e9, (last - fixes.epoch_ns[-1]) / 1e9
        if max(late_s, early_s) <= max(_LONGEST_MISSING_S, _LARGEST_MISSING * (last - first) / 1e9):
            continue
        how = f"stops {early_s:.1f} s before" if early_s >= late_s else f"begins {late_s:.1f} s after"
        warnings.append(
            f"{files[fixes.antenna]} {how} another antenna's recording ({len(fixes.epoch_ns):,} fixes):"
            " without it the heading is that of the course alone. Give the whole recording if there is one."
        )
    return warnings


def _weighted(read: FixesRead, folder: DriveFolder, file: str, settings: DriveSettings) -> FixesRead:
    """Give fixes without a sigma of their own that of ``drive.toml``, or say what they are taken for.

    Formats that state a quality (NMEA, SBP, ROS) say more than nothing: only the others are told of.
    """
    fixes, sigma_m = read.fixes, settings.gnss_sigma_m
    unsaid = np.isnan(fixes.sigma_horizontal_m)
    if sigma_m is not None:
        stated = np.where(unsaid, sigma_m, fixes.sigma_horizontal_m)
        return replace(read, fixes=replace(fixes, sigma_horizontal_m=stated))
    its = track_format(Recording(folder, file))
    if its is None or its.states_quality or not unsaid.any():
        return read
    low, high = (float(f(sigma_of_quality(fixes.quality[unsaid]))) for f in (np.min, np.max))
    taken = f"{high:g} m" if low == high else f"{low:g} to {high:g} m"
    warning = (
        f"The fixes of {file} are taken as good to {taken} (one sigma), as the file does not say: give"
        f" [gnss] sigma_m in {SETTINGS_FILE} if they are better, 0.02 for RTK."
    )
    return replace(read, warnings=(*read.warnings, warning))


def _read_antenna(folder: DriveFolder, file: str, antenna: str, settings: DriveSettings) -> FixesRead:
    recording = Recording(folder, file)
    its = track_format(recording)
    if its is None:
        try:
            return read_nmea(recording.content(), antenna, file)  # its first sentence may stand far down
        except DriveError as error:
            not_as_named = what_is_wrong(recording)
            raise DriveError(not_as_named or f"{error} It looks like none of {NAMES}.") from error
    if its.fixes is None:
        raise DriveError(f"{file} holds full poses: name it under [poses] in {SETTINGS_FILE}.")
    return its.fixes(recording, antenna, settings)


def _warn_of_zero_lever_arms(rig: Rig, gnss: tuple[GnssFixes, ...], notes: ReadingNotes) -> None:
    zero = [f.antenna for f in gnss if not np.any(rig.antennas[f.antenna].rig_t_antenna_m)]
    if zero:
        notes.warn(
            DriveDoubt.TRACK,
            f"The lever arms of {', '.join(zero)} are all zero, so the fixes are taken as the rig's origin"
            f" (the ground below the rear axle): give [gnss] lever_arms in {SETTINGS_FILE}.",
        )
