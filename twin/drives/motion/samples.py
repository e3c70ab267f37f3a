"""Samples of one quantity as a recording holds them, and what makes them one series in SI units."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.trajectory.vehicle_motion import MotionSeries
from twin.drives.epochs import longest_increasing
from twin.drives.folder.motion_settings import MotionSource, Quantity
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.errors import DriveError

_NS_PER_S = 1e9
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
_RATES = {f"{unit}/s": factor for unit, factor in _ANGLES.items()}
_SPEEDS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704, "kn": 1852.0 / 3600.0}
_TURNS = {"rad/s": 1.0, "rpm": 2.0 * math.pi / 60.0}
TICK = "tick"
UNITS: Mapping[Quantity, tuple[str, ...]] = {
    Quantity.SPEED: (*_SPEEDS, *_TURNS, TICK),
    Quantity.TURN_RATE: tuple(_RATES),
    Quantity.WHEEL_ANGLE: tuple(_ANGLES),
}
_SPELLINGS = {
    "mps": "m/s",
    "kph": "km/h",
    "kmh": "km/h",
    "kmph": "km/h",
    "mi/h": "mph",
    "knots": "kn",
    "kt": "kn",
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "radian": "rad",
    "°/s": "deg/s",
    "deg/sec": "deg/s",
    "degree/s": "deg/s",
    "degrees/s": "deg/s",
    "dps": "deg/s",
    "rad/sec": "rad/s",
    "1/min": "rpm",
    "ticks": TICK,
}
"""As files spell units, without spaces and in small letters."""
_LONGEST_BETWEEN_S = 0.5
"""Samples of another wheel that are further apart than this say nothing of the time between."""
_FASTEST_TICKS_MPS = 100.0
_MOST = 1000.0
"""In SI units, beyond what a wrong unit makes of what a car does."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What one column, signal or topic holds.

    Attributes
    ----------
    stamp_ns : int64 (n,)
        UTC, by the clock of who stamped them, in the order of the recording.
    values : float64 (n,), or (n, 3) of a gyro with three axes
        In `unit`; NaN where there is none.
    unit : str
        As the recording states it; "" where it does not.
    axis : str or None
        Which axis of three points up by the format's own definition; None where it defines none.
    sigma : float64 (n,) or None
        One sigma in `unit`; NaN where the recording does not say.
    stamp_sigma_s : float
        One sigma of what all stamps are off because of how their epochs were found.
    of_receiver : bool
        Whether the stamps are a GNSS receiver's, and not those of the host's clock.
    """

    stamp_ns: IntArray
    values: FloatArray
    unit: str = ""
    axis: str | None = None
    sigma: FloatArray | None = None
    of_receiver: bool = False
    stamp_sigma_s: float = 0.0


@dataclass(frozen=True, slots=True)
class MotionRead:
    """What a reader hands on: samples by quantity, in the order of the names that were asked for.

    Attributes
    ----------
    samples : mapping of Quantity to sequence of Samples
    warnings : tuple of str
    faults : Counter
        What was left out, by reason.
    """

    samples: Mapping[Quantity, Sequence[Samples]]
    warnings: tuple[str, ...] = ()
    faults: Counter[str] = field(default_factory=Counter)


def plain_unit(unit: str) -> str:
    """Spell a unit as `UNITS` does: ``KPH`` is ``km/h``."""
    plain = "".join(unit.split()).casefold()
    return _SPELLINGS.get(plain, plain)


def unit_of(quantity: Quantity, samples: Samples, source: MotionSource) -> str:
    """Unit of samples: what ``drive.toml`` states, else what the recording does.

    Raises
    ------
    DriveError
        If neither does, or it is no unit of such a quantity.
    """
    stated = source.of(quantity).unit
    unit = plain_unit(stated or samples.unit)
    if unit in UNITS[quantity]:
        return unit
    wanted = " or ".join(f'"{one}"' for one in UNITS[quantity])
    what = f"[{source.table}] {quantity}_unit"
    if not unit:
        raise DriveError(f"{source.file} does not state the unit of its {quantity}: give {what} = {wanted}.")
    raise DriveError(
        f"{SETTINGS_FILE if stated else source.file} gives the {quantity} of {source.file} in"
        f" {(stated or samples.unit)!r:.40}, which is none of its units: give {what} = {wanted}."
    )


def series(
    quantity: Quantity,
    parts: Sequence[Samples],
    source: MotionSource,
    wheel_radius_m: float | None,
    faults: Counter[str],
) -> MotionSeries:
    """Bring samples of one quantity into SI units, the rig's axes and the order of time.

    Parameters
    ----------
    parts : sequence of Samples
        At least one; of several the mean counts, at the stamps of the first.
    wheel_radius_m : float or None
        The rig's, where the source states none.
    faults : Counter
        What is left out is counted in it.

    Raises
    ------
    DriveError
        If a unit, an axis or a measure of the wheel is missing, or nothing is left.
    """
    converted = [_converted(quantity, part, source, wheel_radius_m) for part in parts]
    ordered = [_ordered(part, faults) for part in converted]
    first, *others = ordered
    values, sigma = first.values, _sigma(first)
    if others:
        around = [_at(first.stamp_ns, other) for other in others]
        values = np.mean([values, *around], axis=0)
        sigma = np.full(len(values), np.nan)
    known = np.isfinite(values)
    faults["no value of another wheel near it"] += int(np.count_nonzero(~known))
    if not known.any():
        raise DriveError(
            f"{source.file} holds no usable {quantity}: check the names under [{source.table}] in"
            f" {SETTINGS_FILE}."
        )
    stated = source.of(quantity).sigma
    if stated is not None:
        stated_si = stated if quantity is Quantity.SPEED else math.radians(stated)
        sigma = np.full(len(values), stated_si)
    return MotionSeries(
        epoch_ns=first.stamp_ns[known],
        values=values[known],
        sigma=sigma[known],
        lag_s=source.lag_s,
        lag_sigma_s=max(source.lag_sigma_s, first.stamp_sigma_s),
    )


def _converted(
    quantity: Quantity, part: Samples, source: MotionSource, wheel_radius_m: float | None
) -> Samples:
    """Values in SI units, to the left positive, one a sample."""
    unit = unit_of(quantity, part, source)
    flipped = 1.0
    if part.values.ndim > 1:
        part = _about_up(part, source)
    elif quantity is not Quantity.SPEED and not source.of(quantity).positive_left:
        flipped = -1.0
    if unit == TICK:
        return _from_ticks(part, source)
    factor = _factor(quantity, unit, source, wheel_radius_m) * flipped
    sigma = None if part.sigma is None else part.sigma * abs(factor)
    return replace(part, values=part.values * factor, sigma=sigma)


def _factor(quantity: Quantity, unit: str, source: MotionSource, wheel_radius_m: float | None) -> float:
    if quantity is Quantity.TURN_RATE:
        return _RATES[unit]
    if quantity is Quantity.WHEEL_ANGLE:
        return _ANGLES[unit] / source.steering_ratio
    if unit in _SPEEDS:
        return _SPEEDS[unit]
    radius_m = source.wheel_radius_m or wheel_radius_m
    if radius_m is None:
        raise DriveError(
            f"{source.file} gives the speed in {unit} of a wheel, and the rig file states no radius: give"
            f" [{source.table}] wheel_radius_m, 0.32 for most cars."
        )
    return _TURNS[unit] * radius_m


def _about_up(part: Samples, source: MotionSource) -> Samples:
    axis = axis_of(part, source)
    column = part.values[:, "xyz".index(axis[-1])]
    return replace(part, values=-column if axis.startswith("-") else column)


def axis_of(part: Samples, source: MotionSource) -> str:
    """Which axis of a gyro points up in the car.

    Raises
    ------
    DriveError
        If neither ``drive.toml`` nor the format says.
    """
    axis = source.turn_rate_axis or part.axis
    if axis is None:
        raise DriveError(
            f"{source.file} gives rates about the axes of its own sensor: say which of them points up in the"
            f' car, [{source.table}] turn_rate_axis = "z", or "-z" where z points down.'
        )
    return axis


def _from_ticks(part: Samples, source: MotionSource) -> Samples:
    """Speeds between the counts of a wheel; a step that no wheel makes is a counter that began anew."""
    if source.metres_per_tick is None:
        raise DriveError(
            f"{source.file} counts the ticks of a wheel: give [{source.table}] metres_per_tick, the wheel's"
            " circumference over its ticks a turn."
        )
    step_s = np.diff(part.stamp_ns) / _NS_PER_S
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.diff(part.values) * source.metres_per_tick / step_s
    speed[(step_s <= 0) | ~(np.abs(speed) <= _FASTEST_TICKS_MPS)] = np.nan
    between_ns = part.stamp_ns[:-1] + np.diff(part.stamp_ns) // 2
    return replace(part, stamp_ns=between_ns, values=speed, sigma=None)


def _ordered(part: Samples, faults: Counter[str]) -> Samples:
    """Samples that have a value, in order of time."""
    known = np.isfinite(part.values)
    sane = known & (np.abs(np.where(known, part.values, 0.0)) < _MOST)
    faults["what no car does, in any unit"] += int(np.count_nonzero(known & ~sane))
    faults["not a number"] += int(np.count_nonzero(~known))
    stamp_ns, values = part.stamp_ns[sane], part.values[sane]
    sigma = None if part.sigma is None else part.sigma[sane]
    keep = longest_increasing(stamp_ns)
    faults["stamp not after the sample before"] += int(np.count_nonzero(~keep))
    return replace(
        part, stamp_ns=stamp_ns[keep], values=values[keep], sigma=None if sigma is None else sigma[keep]
    )


def _sigma(part: Samples) -> FloatArray:
    return np.full(len(part.values), np.nan) if part.sigma is None else part.sigma


def _at(stamp_ns: IntArray, other: Samples) -> FloatArray:
    """Values of another wheel at these stamps; NaN where it has none near."""
    if len(other.stamp_ns) < 2:
        return np.full(len(stamp_ns), np.nan)
    zero = int(other.stamp_ns[0])
    at, there = (stamp_ns - zero) / _NS_PER_S, (other.stamp_ns - zero) / _NS_PER_S
    after = np.clip(np.searchsorted(there, at), 1, len(there) - 1)
    near = (there[after] - there[after - 1] <= _LONGEST_BETWEEN_S) & (at >= there[0] - 0.1)
    values = np.interp(at, there, other.values)
    values[~near | (at > there[-1] + 0.1)] = np.nan
    return values
