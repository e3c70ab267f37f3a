"""What the car measured of its own motion, from every source that ``drive.toml`` names, beside its track."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from geoloc.arrays import IntArray
from geoloc.rig.vehicle import Vehicle, vehicle_of_document
from geoloc.trajectory.trajectory import GnssFixes
from geoloc.trajectory.vehicle_motion import MotionSeries, VehicleMotion
from twin.drives.epochs import usual_shift, utc_text
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSettings, MotionSource, Quantity
from twin.drives.folder.notes import DriveDoubt, ReadingNotes
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.against_track import Check, Reference, check, reference
from twin.drives.motion.clocks import HOST_SIGMA_S, host_offset
from twin.drives.motion.formats.table import motion_format
from twin.drives.motion.samples import Samples, axis_of, series, unit_of
from twin.drives.track.fixes import counted
from twin.drives.track.read import Track
from twin.errors import DriveError


@dataclass(frozen=True, slots=True)
class MotionSeen:
    """One series, for people.

    Attributes
    ----------
    quantity : Quantity
    file : str
    unit : str
        As it was read, before it became SI.
    series : MotionSeries
    check : Check
        Against the fixes.
    """

    quantity: Quantity
    file: str
    unit: str
    series: MotionSeries
    check: Check

    def told(self) -> str:
        """Say how it fits the fixes; "" where they show nothing."""
        words = [self.unit]
        if self.check.ratio is not None:
            words.append(f"{self.check.ratio:.3f} of the fixes'")
        if self.check.late_s is not None:
            words.append(f"{self.check.late_s + self.series.lag_s:+.2f} s late")
        return ", ".join(words)


@dataclass(frozen=True, slots=True)
class MotionOfDrive:
    """What was read: for the trajectory, and for people."""

    motion: VehicleMotion | None = None
    seen: tuple[MotionSeen, ...] = ()


@dataclass(slots=True)
class _Reading:
    """What the readers of all sources share."""

    folder: DriveFolder
    settings: MotionSettings
    vehicle: Vehicle
    known: Reference
    span_ns: tuple[int, int]
    host_offset_ns: int
    notes: ReadingNotes
    seen: dict[Quantity, MotionSeen] = field(default_factory=dict)
    moved: bool = False
    """Whether anything was moved by the host's offset."""

    @property
    def wheelbase_m(self) -> float | None:
        """As ``drive.toml`` states it, else the rig's."""
        return self.settings.wheelbase_m or self.vehicle.wheelbase_m


def read_motion(
    folder: DriveFolder,
    settings: MotionSettings,
    rig_text: str,
    gnss: tuple[GnssFixes, ...],
    notes: ReadingNotes,
) -> MotionOfDrive:
    """Read every source of ``[motion]``; nothing is looked for that is not named.

    Parameters
    ----------
    rig_text : str
        The rig file, whose vehicle has a wheelbase and wheels; "" for none.
    gnss : tuple of GnssFixes
        Of the drive: units, signs and clocks are held against them.

    Raises
    ------
    DriveError
        If a source cannot be read, lies outside the fixes, states no unit, or contradicts the fixes.
    """
    if not settings.sources:
        return MotionOfDrive()
    if not gnss:
        notes.warn(
            DriveDoubt.TRACK,
            f"[motion] of {SETTINGS_FILE} is not used: the drive has full poses, which say all of it.",
        )
        return MotionOfDrive()
    span_ns = min(int(f.epoch_ns[0]) for f in gnss), max(int(f.epoch_ns[-1]) for f in gnss)
    offset_ns, sentence = host_offset(gnss)
    reading = _Reading(folder, settings, _vehicle(rig_text), reference(gnss), span_ns, offset_ns, notes)
    for source in settings.sources:
        _read_source(reading, source)
    if reading.moved:
        notes.warn(DriveDoubt.CLOCK, sentence)
    seen = reading.seen
    if Quantity.WHEEL_ANGLE in seen and reading.wheelbase_m is None:
        raise DriveError(
            f"{seen[Quantity.WHEEL_ANGLE].file} holds the angle of the front wheels, and the rig file states"
            f" no wheelbase: give [motion] wheelbase_m in {SETTINGS_FILE}, rear axle to front axle."
        )
    found: Mapping[str, MotionSeries] = {quantity: one.series for quantity, one in seen.items()}
    motion = VehicleMotion(**found, wheelbase_m=reading.wheelbase_m)
    return MotionOfDrive(motion, tuple(seen.values()))


def with_motion(
    folder: DriveFolder, settings: MotionSettings, rig_text: str, track: Track, notes: ReadingNotes
) -> Track:
    """Return a track with what the car measured of its own motion; raises as `read_motion`."""
    return replace(track, motion=read_motion(folder, settings, rig_text, track.gnss, notes).motion)


def _vehicle(rig_text: str) -> Vehicle:
    """What the rig file says of the car; nothing of one that was refused before."""
    document = json.loads(rig_text) if rig_text else {}
    return vehicle_of_document(document) or Vehicle()


def _read_source(reading: _Reading, source: MotionSource) -> None:
    its = motion_format(reading.folder, source)
    read = its.read(reading.folder, source)
    faults = Counter(read.faults)
    for quantity, parts in read.samples.items():
        if quantity in reading.seen:
            raise DriveError(
                f"{reading.seen[quantity].file} and {source.file} both give the {quantity}: name it under one"
                f" table of [motion] in {SETTINGS_FILE}."
            )
        hosts = not all(part.of_receiver for part in parts)
        reading.seen[quantity] = _seen(reading, source, quantity, parts, faults, hosts=hosts)
    late = [warning for quantity in read.samples if (warning := reading.seen[quantity].check.warning)]
    reading.notes.warn(DriveDoubt.CLOCK, *(f"{source.file}: {warning}." for warning in late[:1]))
    reading.notes.warn(DriveDoubt.TRACK, *read.warnings)
    reading.notes.skipped += counted("samples of motion", source.file, faults)


def _seen(
    reading: _Reading,
    source: MotionSource,
    quantity: Quantity,
    parts: Sequence[Samples],
    faults: Counter[str],
    *,
    hosts: bool,
) -> MotionSeen:
    stamped = series(quantity, parts, source, reading.vehicle.wheel_radius_m, faults)
    axis = axis_of(parts[0], source) if parts[0].values.ndim > 1 else None
    tried = [
        (one, check(quantity, one, source, reading.known, reading.wheelbase_m, axis))
        for one in _on_utc(stamped, reading, hosts=hosts)
        if _overlaps(one.epoch_ns, reading.span_ns)
    ]
    if not tried:
        raise _outside(stamped.epoch_ns, reading.span_ns, source)
    one, checked = next((pair for pair in tried if not pair[1].problem), tried[0])
    if checked.problem:
        raise DriveError(f"{source.file} contradicts the fixes: {checked.problem}.")
    reading.moved |= one is not stamped
    seen = MotionSeen(quantity, source.file, unit_of(quantity, parts[0], source), one, checked)
    rate_hz = 1e9 / float(np.median(np.diff(one.epoch_ns))) if len(one.epoch_ns) > 1 else np.nan
    reading.notes.say(
        f"Motion {source.file}: {quantity}, {len(one.epoch_ns):,} at {rate_hz:.1f} Hz, {seen.told()}."
    )
    return seen


def _on_utc(stamped: MotionSeries, reading: _Reading, *, hosts: bool) -> list[MotionSeries]:
    """A series as it may be meant: by a host's clock that its fixes show to be off, or as stamped."""
    if not hosts or not reading.host_offset_ns:
        return [stamped]
    epoch_ns = stamped.epoch_ns - reading.host_offset_ns
    moved = replace(stamped, epoch_ns=epoch_ns, lag_sigma_s=max(stamped.lag_sigma_s, HOST_SIGMA_S))
    # Another computer may have recorded it, whose clock was right.
    return [moved, stamped]


def _overlaps(epoch_ns: IntArray, span_ns: tuple[int, int]) -> bool:
    return bool(epoch_ns[0] <= span_ns[1] and epoch_ns[-1] >= span_ns[0])


def _outside(epoch_ns: IntArray, span_ns: tuple[int, int], source: MotionSource) -> DriveError:
    """What was measured wholly before or after the fixes."""
    first, last = int(epoch_ns[0]), int(epoch_ns[-1])
    _, mistake = usual_shift((first, last), span_ns)
    told = "Correct the times, or name the recording of this drive"
    if mistake:
        told = f"They would fit if one clock is off by {mistake}"
    return DriveError(
        f"{source.file} ({utc_text(first)} to {utc_text(last)}) lies outside the fixes"
        f" ({utc_text(span_ns[0])} to {utc_text(span_ns[1])}). {told}: see time_unit, time_zero and"
        f" utc_offset_hours under [{source.table}]."
    )
