"""What the car measured of its motion, held against where its receivers were: units, signs and clocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import metres_per_degree
from geoloc.trajectory.fix_checks import sigma_of_quality
from geoloc.trajectory.trajectory import GnssFixes
from geoloc.trajectory.vehicle_motion import MotionSeries
from twin.drives.folder.motion_settings import MotionSource, Quantity

_NS_PER_S = 1e9
_HALF_S = 1.0
"""Speeds and courses are those over this time before and after."""
_LONGEST_GAP_S = 1.5
_MOVING_MPS = 3.0
_LEAST_TURN_RAD_S = math.radians(1.5)
_FEWEST = 10
_LAGS_S = np.arange(-2.0, 2.01, 0.05)
_SPEED_OFF, _TURN_OFF = 1.25, 1.6
"""Factors that neither tyres nor noise of fixes make."""
_TOLERANCE = 1.08
_TELLING = 0.7
"""Correlation below which a ratio says nothing."""
_GOOD_M = 0.5
"""One sigma of fixes that show every bend."""
_ALIKE = 0.95
"""Correlation from which it shows by how much stamps are late."""
_LATE_S = 0.3


class Reference(NamedTuple):
    """What the fixes of one antenna say of the car's motion."""

    epoch_ns: IntArray
    speed_mps: FloatArray
    turn_rad_s: FloatArray
    """To the left; NaN where the car is too slow to show it."""
    is_good: bool
    """Whether fixes are good enough to show every bend."""


class _Fit(NamedTuple):
    """The series over what is expected, how alike they are (correlation), and at how many epochs."""

    ratio: float
    alike: float
    n: int


@dataclass(frozen=True, slots=True)
class Check:
    """One series against the fixes.

    Attributes
    ----------
    ratio : float or None
        The series over what the fixes say, with its sign; None where they say too little.
    late_s : float or None
        By how much the series' stamps are late.
    problem : str
        What is wrong and its cure, one clause; "" for nothing.
    """

    ratio: float | None = None
    late_s: float | None = None
    problem: str = ""

    @property
    def warning(self) -> str:
        """What to state of the stamps; "" where they are as good as stated."""
        if self.late_s is None or abs(self.late_s) < _LATE_S:
            return ""
        return f"its stamps seem {self.late_s:+.2f} s late against the fixes: state lag_ms if that is so"


def reference(gnss: Sequence[GnssFixes]) -> Reference:
    """Speed and rate of turn by the antenna with the most fixes; empty where there is none."""
    if not gnss:
        return Reference(np.empty(0, np.int64), np.empty(0), np.empty(0), is_good=False)
    fixes = max(gnss, key=lambda one: len(one.epoch_ns))
    east_m, north_m = metres_per_degree(fixes.latitude_deg)
    x = (fixes.longitude_deg - fixes.longitude_deg[0]) * east_m
    y = (fixes.latitude_deg - fixes.latitude_deg[0]) * north_m
    t = (fixes.epoch_ns - fixes.epoch_ns[0]) / _NS_PER_S
    half = [np.column_stack([np.interp(t + s, t, x), np.interp(t + s, t, y)]) for s in (-_HALF_S, 0, _HALF_S)]
    before, after = half[1] - half[0], half[2] - half[1]
    inside = (t - _HALF_S >= t[0]) & (t + _HALF_S <= t[-1]) & ~_near_gap(t)
    speed = np.hypot(*(half[2] - half[0]).T) / (2 * _HALF_S)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.arctan2(cross, np.sum(before * after, axis=1)) / _HALF_S
    # No car turns faster than a radian a second while it drives: what does is a fix that jumped.
    turn[(speed < _MOVING_MPS) | (np.abs(turn) > 1.0)] = np.nan
    sigma_m = np.where(
        np.isnan(fixes.sigma_horizontal_m), sigma_of_quality(fixes.quality), fixes.sigma_horizontal_m
    )
    is_good = bool(np.median(sigma_m) < _GOOD_M)
    return Reference(fixes.epoch_ns[inside], speed[inside], turn[inside], is_good=is_good)


def check(
    quantity: Quantity,
    series: MotionSeries,
    source: MotionSource,
    known: Reference,
    wheelbase_m: float | None,
    axis: str | None = None,
) -> Check:
    """Hold a series against the fixes.

    Parameters
    ----------
    wheelbase_m : float or None
        Without it the angle of the wheels is not checked.
    axis : str or None
        Which axis of a gyro with three was taken.
    """
    expected = known.speed_mps
    if quantity is Quantity.TURN_RATE:
        expected = known.turn_rad_s
    elif quantity is Quantity.WHEEL_ANGLE:
        if wheelbase_m is None:
            return Check()
        with np.errstate(invalid="ignore", divide="ignore"):
            expected = np.arctan(wheelbase_m * known.turn_rad_s / known.speed_mps)
    use = np.isfinite(expected) & (known.speed_mps > _MOVING_MPS)
    epochs, wanted = known.epoch_ns[use], expected[use]
    fits = [_fit(quantity, epochs, wanted, series, lag_s) for lag_s in _LAGS_S + series.lag_s]
    if max(fit.n for fit in fits) < _FEWEST:  # a drive that hardly moved, or a gap of the fixes
        return Check()
    best = max(range(len(fits)), key=lambda k: abs(fits[k].alike))
    ratio, alike, _ = fits[best]
    # A drive at one speed, or straight on, shows nothing of the clock.
    late_s = float(_LAGS_S[best]) if abs(alike) > _ALIKE and 0 < best < len(fits) - 1 else None
    if quantity is Quantity.SPEED:
        return Check(ratio, late_s, _speed_problem(ratio, source))
    if abs(alike) >= _TELLING and np.abs(wanted).max() >= _LEAST_TURN_RAD_S:
        return Check(ratio, late_s, _turn_problem(quantity, ratio, source, axis))
    if known.is_good and np.std(wanted) > _LEAST_TURN_RAD_S:
        told = f"its {quantity} does not follow the turns of the fixes (correlation {alike:+.2f})"
        return Check(problem=f"{told}: check its name and axis under [{source.table}]")
    return Check()


def _speed_problem(ratio: float, source: MotionSource) -> str:
    if 1 / _SPEED_OFF < ratio < _SPEED_OFF:
        return ""
    told = f"its speed is {ratio:.2f} times that of the fixes"
    for unit, factor in (("km/h", 3.6), ("mph", 1 / 0.44704), ("kn", 3600 / 1852)):
        if 1 / _TOLERANCE < ratio / factor < _TOLERANCE:
            return f'{told}, as km/h, mph and knots are of m/s: give [{source.table}] speed_unit = "{unit}"'
    if 1 / _TOLERANCE < ratio * 3.6 < _TOLERANCE:
        return f'{told}, as m/s are of km/h: give [{source.table}] speed_unit = "m/s"'
    return f"{told}: check the name and unit of the speed under [{source.table}]"


def _turn_problem(quantity: Quantity, ratio: float, source: MotionSource, axis: str | None) -> str:
    what = "rate of turn" if quantity is Quantity.TURN_RATE else "wheel angle"
    told = f"its {what} is {ratio:.2f} times that of the fixes"
    if 1 / _TURN_OFF < ratio < _TURN_OFF:
        return ""
    if 1 / _TURN_OFF < -ratio < _TURN_OFF:
        if axis is not None:
            turned = axis.removeprefix("-") if axis.startswith("-") else f"-{axis}"
            return f'{told}: give [{source.table}] turn_rate_axis = "{turned}"'
        return f'{told}: give [{source.table}] {quantity}_positive = "right"'
    for factor, unit in ((180.0 / math.pi, "deg"), (math.pi / 180.0, "rad")):
        if 1 / _TURN_OFF < abs(ratio) / factor < _TURN_OFF:
            per = "/s" if quantity is Quantity.TURN_RATE else ""
            return f'{told}: give [{source.table}] {quantity}_unit = "{unit}{per}"'
    if quantity is Quantity.WHEEL_ANGLE and 5.0 < abs(ratio) < 30.0:
        return (
            f"{told}, as the angle of a steering wheel is of the front wheels': give [{source.table}]"
            f" steering_ratio, the car's own, about {abs(ratio) * source.steering_ratio:.1f}"
        )
    return f"{told}: check the name, unit and axis of it under [{source.table}]"


def _fit(
    quantity: Quantity, epoch_ns: IntArray, expected: FloatArray, series: MotionSeries, lag_s: float
) -> _Fit:
    """Ratio of the series to what is expected, their correlation, and how many epochs they share."""
    zero = int(series.epoch_ns[0])
    at = (epoch_ns - zero) / _NS_PER_S + lag_s
    there = (series.epoch_ns - zero) / _NS_PER_S
    low, high = np.searchsorted(there, at - _HALF_S), np.searchsorted(there, at + _HALF_S)
    count = high - low
    use = (count > 0) & (at - _HALF_S >= there[0] - 0.5) & (at + _HALF_S <= there[-1] + 0.5)
    n = int(np.count_nonzero(use))
    if n < _FEWEST:
        return _Fit(0.0, 0.0, n)
    total = np.concatenate([[0.0], np.cumsum(series.values)])
    mean = (total[high[use]] - total[low[use]]) / count[use]
    wanted = expected[use]
    spread = float(np.std(mean) * np.std(wanted))
    alike = (
        0.0 if spread < 1e-12 else float(np.mean((mean - mean.mean()) * (wanted - wanted.mean())) / spread)
    )
    if quantity is Quantity.SPEED:
        return _Fit(float(np.median(mean / wanted)), alike, n)
    # Its bias says nothing of the unit.
    size = float(np.std(mean) / np.std(wanted)) if spread > 1e-12 else 0.0
    return _Fit(math.copysign(size, alike), alike, n)


def _near_gap(t: FloatArray) -> BoolArray:
    """Whether a fix lies within the time over which it is compared of a gap."""
    step = np.diff(t)
    wide = np.flatnonzero(step > _LONGEST_GAP_S)
    near = np.zeros(len(t), np.bool_)
    for at in wide.tolist():
        near |= (t > t[at] - _HALF_S) & (t < t[at + 1] + _HALF_S)
    return near
