"""Series of a car's own sensors on the clock of a drive: integrals, noise, and where there are samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.errors import TrajectoryError
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.vehicle_motion import MotionSeries, VehicleMotion

SPEED, TURN, ANGLE = "The speed of the wheels", "The turn rate", "The steering angle"
"""What messages call the series."""
SPARSEST_S = 2.0
"""Samples further apart than this say nothing of what lies between them."""
LONGEST_BRIDGE_S = 120.0
"""So long a car's motion is followed without a fix, at most: two kilometres of tunnel at 60 km/h."""
# Knots where there are no fixes: nothing that a car does is shorter.
_STEP_S = 0.2
# What shows as one step of a counter, not as rounding of a conversion.
_LEAST_STEP = 1e-6
_LONGEST_HELD_S = 2.0
# The lag is found only later, and is another by less than this.
_LAG_MARGIN_S = 0.5
_MAD = 1.4826
# A parabola through five even points leaves 18/35 of the variance of the one in the middle.
_PARABOLA = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
_LEFT = np.sqrt(18.0 / 35.0)


@dataclass(frozen=True, eq=False)
class Reading:
    """One series, with seconds since a drive's first knot.

    Attributes
    ----------
    t_s, values : float64 (n,)
    sigma : float64 (n,)
        One sigma of each value's own noise: as stated, else as the series shows it.
    every_s : float
        How long a value's noise lasts: a sample's time, or that for which values are held.
    lag_s, lag_sigma_s : float
        How much later than the measurement the stamps are, as stated.
    estimated : float or None
        That sigma where none was stated.
    """

    t_s: FloatArray
    values: FloatArray
    sigma: FloatArray
    every_s: float
    lag_s: float
    lag_sigma_s: float
    estimated: float | None

    @classmethod
    def of(cls, series: MotionSeries, first_ns: int, what: str) -> Reading:
        """Put a series on the clock that begins at `first_ns`.

        Raises
        ------
        TrajectoryError
            Too short, not in order of time, or not finite.
        """
        _check(series, what)
        t_s = (series.epoch_ns - first_ns) / NANOSECONDS
        stated = series.sigma[np.isfinite(series.sigma)]
        own = None if stated.size else _noise(series.values)
        fill = float(np.median(stated)) if own is None else own
        sigma = np.where(np.isfinite(series.sigma), series.sigma, fill)
        every_s = _held_s(t_s, series.values)
        return cls(t_s, series.values, sigma, every_s, series.lag_s, series.lag_sigma_s, own)

    def at(self, t_s: FloatArray) -> FloatArray:
        """Value at times of measurement ``(k,)``; beyond its ends the last one."""
        return np.asarray(np.interp(t_s, self.t_s, self.values))

    def integral(self, t_s: FloatArray) -> FloatArray:
        """Integral from the first sample to times ``(k,)``, straight lines between the samples."""
        at = np.clip(t_s, self.t_s[0], self.t_s[-1])
        i = np.clip(np.searchsorted(self.t_s, at, side="right") - 1, 0, self.t_s.size - 2)
        since_s = at - self.t_s[i]
        return np.asarray(self._sums[i] + since_s * (self.values[i] + 0.5 * self._slopes[i] * since_s))

    def variance(self, t_s: FloatArray) -> FloatArray:
        """Variance ``(k - 1,)`` that the noise of its samples gives the integral between times ``(k,)``."""
        return np.asarray(np.diff(np.interp(t_s, self.t_s, self._variances)))

    def covers(self, begin_s: FloatArray, end_s: FloatArray) -> BoolArray:
        """Whether there are samples all the way between times ``(k,)``."""
        first = np.searchsorted(self.t_s, begin_s, side="right") - 1
        last = np.searchsorted(self.t_s, end_s, side="left")
        inside = (first >= 0) & (last < self.t_s.size)
        first, last = np.maximum(first, 0), np.minimum(last, self.t_s.size - 1)
        return np.asarray(inside & (self._holes[last] == self._holes[first]))

    @cached_property
    def _sums(self) -> FloatArray:
        return _sums(np.diff(self.t_s), self.values)

    @cached_property
    def _slopes(self) -> FloatArray:
        return np.asarray(np.diff(self.values) / np.diff(self.t_s))

    @cached_property
    def _variances(self) -> FloatArray:
        return _sums(np.diff(self.t_s), self.sigma**2 * self.every_s)

    @cached_property
    def _holes(self) -> IntArray:
        return np.concatenate([[0], np.cumsum(np.diff(self.t_s) > SPARSEST_S)])


@dataclass(frozen=True, slots=True, eq=False)
class MotionReadings:
    """What a car measured of its own motion, as `Reading`; None for what it did not.

    Attributes
    ----------
    speed, turn_rate, wheel_angle : Reading or None
        m/s, rad/s, rad.
    wheelbase_m : float or None
    """

    speed: Reading | None
    turn_rate: Reading | None
    wheel_angle: Reading | None
    wheelbase_m: float | None

    @classmethod
    def of(cls, motion: VehicleMotion, first_ns: int) -> MotionReadings:
        """Put all series on the clock that begins at `first_ns`; errors as `Reading.of`."""
        one = {
            name: None if series is None else Reading.of(series, first_ns, what)
            for name, series, what in (
                ("speed", motion.speed, SPEED),
                ("turn_rate", motion.turn_rate, TURN),
                ("wheel_angle", motion.wheel_angle, ANGLE),
            )
        }
        return cls(**one, wheelbase_m=motion.wheelbase_m)

    @property
    def unsigned(self) -> bool:
        """Whether the speed is never negative, so that it does not say which way the car goes."""
        return self.speed is not None and float(self.speed.values.min()) > -0.1

    def follows(self, begin_s: FloatArray, end_s: FloatArray) -> BoolArray:
        """Whether way and turning are both measured between times ``(k,)``, so that no fix is needed."""
        turning = self.turn_rate or self.wheel_angle
        if self.speed is None or turning is None:
            return np.zeros(begin_s.shape, dtype=bool)
        parts = [
            one.covers(begin_s + one.lag_s - _LAG_MARGIN_S, end_s + one.lag_s + _LAG_MARGIN_S)
            for one in (self.speed, turning)
        ]
        return np.asarray(parts[0] & parts[1])


def followed_epochs(knot_ns: IntArray, motion: VehicleMotion) -> IntArray:
    """Knots of a drive: those of its fixes, and more where only the car's motion tells how it went.

    Between fixes, before the first and after the last, `_STEP_S` apart; nothing where the motion has a hole,
    or where the next fix is more than `LONGEST_BRIDGE_S` away.

    Parameters
    ----------
    knot_ns : int64 (n,)
        Epochs of fixes.
    motion : VehicleMotion
    """
    readings = MotionReadings.of(motion, int(knot_ns[0]))
    t_s = (knot_ns - knot_ns[0]) / NANOSECONDS
    reach = int(LONGEST_BRIDGE_S / _STEP_S)
    more = [_within(t_s, readings)]
    for end_s, way in ((t_s[0], -1.0), (t_s[-1], 1.0)):
        steps = end_s + way * _STEP_S * np.arange(reach + 1)
        ahead = readings.follows(*((steps[1:], steps[:-1]) if way < 0 else (steps[:-1], steps[1:])))
        more.append(steps[1:][np.logical_and.accumulate(ahead)])
    added = knot_ns[0] + np.round(np.concatenate(more) * NANOSECONDS).astype(np.int64)
    return np.asarray(np.union1d(knot_ns, added), dtype=np.int64)


def _within(t_s: FloatArray, readings: MotionReadings) -> FloatArray:
    """Times between fixes that are further apart than `_STEP_S`, where the motion is known."""
    gap_s = np.diff(t_s)
    wide = (gap_s > 1.5 * _STEP_S) & (gap_s <= LONGEST_BRIDGE_S) & readings.follows(t_s[:-1], t_s[1:])
    return np.concatenate(
        [np.empty(0)]
        + [
            t_s[i] + gap_s[i] * np.arange(1, count) / count
            for i in np.flatnonzero(wide)
            for count in [int(np.ceil(gap_s[i] / _STEP_S - 1e-6))]
        ]
    )


def _check(series: MotionSeries, what: str) -> None:
    n = series.epoch_ns.size
    if n < 2:
        raise TrajectoryError(f"{what}: {n} samples, at least 2 are needed: leave that series out.")
    late = np.diff(series.epoch_ns) <= 0
    if late.any():
        raise TrajectoryError(
            f"{what}: {int(late.sum())} of {n} samples are not later than the one before (first: number "
            f"{int(np.argmax(late)) + 1}): sort them by time and drop duplicates."
        )
    bad = ~np.isfinite(series.values)
    if bad.any():
        raise TrajectoryError(
            f"{what}: {int(bad.sum())} of {n} samples are no finite numbers (first: number "
            f"{int(np.argmax(bad)) + 1}): drop them."
        )


def _noise(values: FloatArray) -> float:
    """One sigma of what each sample has for itself: off a parabola through its neighbours, by rounding."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > _LEAST_STEP]
    rounding = float(steps.min()) / np.sqrt(12.0) if steps.size else 0.0
    if values.size < _PARABOLA.size:
        return rounding
    off = values[2:-2] - np.convolve(values, _PARABOLA, mode="valid")
    # Of a car that stands nothing shows.
    off = off[off != 0.0] if (off != 0.0).any() else off
    return float(np.hypot(_MAD * np.median(np.abs(off)) / _LEFT, rounding))


def _held_s(t_s: FloatArray, values: FloatArray) -> float:
    """For how long a value stays, where it is not 0."""
    step_s = np.diff(t_s)
    driven = (values[1:] != 0.0) | (values[:-1] != 0.0)
    changes = int((np.diff(values) != 0.0).sum())
    held_s = float(step_s[driven].sum()) / max(changes, 1)
    return min(max(float(np.median(step_s)), held_s), _LONGEST_HELD_S)


def _sums(step_s: FloatArray, values: FloatArray) -> FloatArray:
    """Integral of values from the first to each."""
    return np.concatenate([[0.0], np.cumsum(0.5 * step_s * (values[1:] + values[:-1]))])
