"""What a car measured of its own motion, held against its fixes before both are fitted together.

A scale of the wheels that is 1 % off, or a bias of the gyro, is found by the smoother. Another unit, another
sign or another clock is not: such series are named and refused.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.errors import TrajectoryError
from geoloc.trajectory.heading import moving
from geoloc.trajectory.motion_readings import ANGLE, SPEED, TURN, MotionReadings, Reading
from geoloc.trajectory.smoother.knot_fixes import KnotFixes
from geoloc.trajectory.smoother.odometry import steered_radps
from geoloc.trajectory.smoother.plane_track import PlaneTrack

_DEGREES = float(np.degrees(1.0))
_RATIO = 15.0 * _DEGREES
# Factor → what it looks like, and what to do.
_OF_SPEED = {
    3.6: "it is in km/h: give it in m/s (divide by 3.6)",
    2.237: "it is in miles an hour: give it in m/s (divide by 2.237)",
    1.944: "it is in knots: give it in m/s (divide by 1.944)",
    1 / 3.6: "it was in m/s already when it was divided by 3.6: leave that out",
    -1.0: "ahead is negative in it: turn its sign",
    -3.6: "it is in km/h, and ahead is negative in it: divide it by -3.6",
}
_OF_TURN = {
    -1.0: "to the right is positive in it: turn its sign (to the left, seen from above, is positive)",
    _DEGREES: "it is in degrees a second: give it in rad/s (divide by 57.3)",
    -_DEGREES: "it is in degrees a second, and to the right is positive in it: divide it by -57.3",
    1 / _DEGREES: "it was in rad/s already when it was divided by 57.3: leave that out",
}
_OF_ANGLE = {
    -1.0: "to the right is positive in it: turn its sign (to the left is positive)",
    _DEGREES: "it is in degrees: give it in rad (divide by 57.3)",
    -_DEGREES: "it is in degrees, and to the right is positive in it: divide it by -57.3",
    15.0: "it is that of the steering wheel: divide it by the steering ratio",
    -15.0: "it is that of the steering wheel, to the right positive: divide it by minus the steering ratio",
    _RATIO: "it is that of the steering wheel, in degrees: divide it by 57.3 and by the steering ratio",
    -_RATIO: "it is that of the steering wheel, in degrees, to the right positive: divide it by -57.3 "
    "and by the steering ratio",
}
_ALIKE = 1.35
"""A ratio of steering differs from car to car; units differ by more."""
# A factor in these limits is a scale, which the smoother finds.
_SCALE_OF_SPEED, _SCALE_OF_TURN, _SCALE_OF_ANGLE = (0.8, 1.25), (0.7, 1.4), (0.5, 2.0)
_FAST_MPS, _FEWEST = 3.0, 20
_ROLLS_MPS = 0.05
# Twice what tyres hold on dry asphalt, and what a step of a coarse log may hide.
_BRAKES_MPS2, _SHORTEST_S = 20.0, 0.1
_MEAN_OVER_S, _CHORD_S = 1.0, 2.0
# Clocks that differ by more than this are not looked for: the series may be of another drive.
_SEARCH_S, _SEARCH_STEP_S = 5.0, 0.2
_ONLY_SO_MANY = 300
_FOLLOWS = 0.8
# Turning is told where it is so much larger than the noise of the course.
_TURNS_SHOW = 3.0


class _Sample(NamedTuple):
    """The car's motion by its fixes: speed at some knots, and turns between others."""

    t_s: FloatArray
    speed_mps: FloatArray
    begin_s: FloatArray
    end_s: FloatArray
    turn_rad: FloatArray
    turn_sigma_rad: float


def check_readings(readings: MotionReadings, knots: KnotFixes, best: PlaneTrack) -> bool:
    """Refuse series that are in another unit, of another sign, or by another clock.

    Where a drive does not turn, or does not move, that does not show.

    Parameters
    ----------
    readings : MotionReadings
    knots : KnotFixes
    best : PlaneTrack
        The track of an antenna as a point.

    Returns
    -------
    bool
        Whether the drive turned enough for the sign and unit of turns to show.

    Raises
    ------
    TrajectoryError
    """
    for one, what in (
        (readings.speed, SPEED),
        (readings.turn_rate, TURN),
        (readings.wheel_angle, ANGLE),
    ):
        if one is not None:
            _check_times(one, knots, what)
    if readings.speed is not None:
        _check_dropouts(readings.speed, knots)
    sample = _sample(knots, best)
    if readings.speed is not None and sample.t_s.size >= _FEWEST:
        _check_speed(readings.speed, sample)
    if sample.turn_rad.size < _FEWEST or sample.turn_rad.std() < _TURNS_SHOW * sample.turn_sigma_rad:
        return False
    if readings.turn_rate is not None:
        _check_turns(readings.turn_rate, sample, TURN, _OF_TURN, _SCALE_OF_TURN)
    if readings.wheel_angle is not None and readings.speed is not None:
        steered = _steered(readings, readings.wheel_angle, readings.speed)
        _check_turns(steered, sample, ANGLE, _OF_ANGLE, _SCALE_OF_ANGLE)
    return True


def _check_times(one: Reading, knots: KnotFixes, what: str) -> None:
    begin_s, end_s = one.t_s[0] - one.lag_s, one.t_s[-1] - one.lag_s
    seen = knots.t_s[knots.seen.any(axis=1)]
    if begin_s > seen[-1] or end_s < seen[0]:
        first_s, last_s, end_of_fixes_s = (x - seen[0] for x in (begin_s, end_s, seen[-1]))
        raise TrajectoryError(
            f"{what}: its samples lie from {first_s:.0f} to {last_s:.0f} s after the first fix, and the last "
            f"fix {end_of_fixes_s:.0f} s after it: give it stamps of the fixes' clock (UTC), or leave it out."
        )


def _check_dropouts(one: Reading, knots: KnotFixes) -> None:
    """Refuse speeds that fall to 0 at once in a gap: a sensor that is lost writes 0, and that holds the car.

    Where there are fixes, these say otherwise and the wheels lose their weight.
    """
    step_s = np.diff(one.t_s)
    fell = (np.abs(one.values[:-1]) > _FAST_MPS) & (np.abs(one.values[1:]) < _ROLLS_MPS)
    fell &= np.abs(np.diff(one.values)) > _BRAKES_MPS2 * np.maximum(step_s, _SHORTEST_S)
    known_s = knots.t_s[knots.seen.any(axis=1)]
    at_s = one.t_s[1:] - one.lag_s
    near = np.clip(np.searchsorted(known_s, at_s), 1, known_s.size - 1)
    fell &= np.minimum(np.abs(at_s - known_s[near - 1]), np.abs(at_s - known_s[near])) > _MEAN_OVER_S
    if fell.any():
        at = int(np.flatnonzero(fell)[0])
        after_s = one.t_s[at + 1] - one.lag_s - knots.t_s[0]
        raise TrajectoryError(
            f"{SPEED} falls from {abs(one.values[at]):.1f} m/s to 0 within {step_s[at]:.2f} s where there are"
            f" no fixes, {after_s:.0f} s after the first one: no car stops like that, and a lost sensor"
            " writes 0. Take these rows out."
        )


def _sample(knots: KnotFixes, best: PlaneTrack) -> _Sample:
    speed = np.hypot(*best.velocity_mps.T)
    known = knots.seen.any(axis=1) & moving(best.velocity_mps, 3.0 * best.velocity_sigma_mps)
    known &= speed > _FAST_MPS
    rows = np.flatnonzero(known)
    rows = rows[:: max(1, -(-rows.size // _ONLY_SO_MANY))]
    course = np.arctan2(best.velocity_mps[:, 1], best.velocity_mps[:, 0])
    last = np.searchsorted(knots.t_s, knots.t_s[rows] + _CHORD_S)
    inside = last < knots.t_s.size
    first, last = rows[inside], last[inside]
    lost = np.concatenate([[0], np.cumsum(~known)])
    whole = (lost[last + 1] == lost[first]) & (knots.t_s[last] - knots.t_s[first] < 2.0 * _CHORD_S)
    first, last = first[whole], last[whole]
    turn = (course[last] - course[first] + np.pi) % (2.0 * np.pi) - np.pi
    noise = np.sqrt(2.0) * best.velocity_sigma_mps[first] / speed[first]
    return _Sample(
        knots.t_s[rows],
        speed[rows],
        knots.t_s[first],
        knots.t_s[last],
        turn,
        float(np.median(noise)) if noise.size else 0.0,
    )


def _check_speed(one: Reading, sample: _Sample) -> None:
    def mean(late_s: float) -> tuple[FloatArray, BoolArray]:
        begin, end = (sample.t_s + one.lag_s + late_s + side * 0.5 * _MEAN_OVER_S for side in (-1.0, 1.0))
        return (one.integral(end) - one.integral(begin)) / _MEAN_OVER_S, one.covers(begin, end)

    here, covered = mean(0.0)
    if covered.sum() < _FEWEST:
        return
    rolls = covered & (np.abs(here) > _ROLLS_MPS)
    if rolls.sum() < _FEWEST:
        raise TrajectoryError(
            f"{SPEED} stays 0 where the antennas move: leave it out, or give the right series."
        )
    # Where they do not roll a ferry may carry the car.
    factor = float(np.median(here[rolls] / sample.speed_mps[rolls]))
    _check_factor(factor, SPEED, "that of the antennas", _OF_SPEED, _SCALE_OF_SPEED)

    def misfit(late_s: float) -> float:
        there, known = mean(late_s)
        off = there / factor - sample.speed_mps
        return float(np.sqrt(np.mean(off[known] ** 2))) if known.sum() >= _FEWEST else np.inf

    _check_clock(one, SPEED, misfit, float(sample.speed_mps.std()))


def _check_turns(
    one: Reading,
    sample: _Sample,
    what: str,
    table: dict[float, str],
    limits: tuple[float, float],
) -> None:
    span_s = sample.end_s - sample.begin_s

    def fitted(late_s: float) -> tuple[float, float, float]:
        """Factor, correlation, and misfit as a turn."""
        begin, end = sample.begin_s + one.lag_s + late_s, sample.end_s + one.lag_s + late_s
        known = one.covers(begin, end)
        if known.sum() < _FEWEST:
            return np.nan, 0.0, np.inf
        turn, rate = sample.turn_rad[known], (one.integral(end) - one.integral(begin))[known]
        design = np.stack([turn, span_s[known]], axis=1)
        keep = np.ones(turn.size, dtype=bool)
        for _ in range(2):
            factor, bias = np.linalg.lstsq(design[keep], rate[keep])[0].tolist()
            off = np.abs(rate - design @ [factor, bias])
            keep = off <= 4.0 * np.median(off) + 1e-12
        alike = float(np.corrcoef(turn[keep], rate[keep])[0, 1]) if rate[keep].std() > 0.0 else 0.0
        return factor, alike, float(off[keep].std()) / max(abs(factor), 1e-9)

    factor, alike, _ = fitted(0.0)
    if not np.isfinite(factor):
        return
    if abs(alike) > _FOLLOWS:
        _check_factor(factor, what, "what the course turns by", table, limits)
    _check_clock(one, what, lambda late_s: fitted(late_s)[2], float(sample.turn_rad.std()))
    if abs(alike) <= _FOLLOWS:
        raise TrajectoryError(
            f"{what} does not follow the turns of the course (correlation {alike:.2f}): it is of "
            "another axis, of another quantity or of another drive. Give that about the vertical axis, or "
            "leave it out."
        )


def _check_factor(
    factor: float, what: str, than: str, table: dict[float, str], limits: tuple[float, float]
) -> None:
    if limits[0] <= factor <= limits[1]:
        return
    looks = min(table, key=lambda one: abs(np.log(one / factor)) if one * factor > 0 else np.inf)
    near = looks * factor > 0 and abs(np.log(looks / factor)) < np.log(_ALIKE)
    cure = table[looks] if near else "give it in the unit that it should have"
    raise TrajectoryError(f"{what} is {factor:.3g} times {than}: {cure}.")


def _check_clock(one: Reading, what: str, misfit: Callable[[float], float], spread: float) -> None:
    away = np.arange(-_SEARCH_S, _SEARCH_S + 1e-9, _SEARCH_STEP_S)
    misfits = np.array([misfit(float(late_s)) for late_s in away])
    likely = np.abs(away) <= 3.0 * one.lag_sigma_s + _SEARCH_STEP_S
    best = int(np.argmin(misfits))
    if likely[best] or not np.isfinite(misfits[best]):
        return
    if misfits[best] < 0.5 * misfits[likely].min() and misfits[best] < 0.3 * spread:
        late_s = one.lag_s + float(away[best])
        raise TrajectoryError(
            f"{what} is {abs(late_s):.1f} s {'late' if late_s > 0 else 'early'} against the fixes, and "
            f"stated to be late by {one.lag_s:.2f} ± {one.lag_sigma_s:.2f} s: state a lag of {late_s:.1f} s, "
            "or give it stamps of the fixes' clock (UTC)."
        )


def _steered(readings: MotionReadings, angle: Reading, speed: Reading) -> Reading:
    """Yaw rate that the steering angle makes, at its own samples."""
    forward = speed.at(angle.t_s - angle.lag_s + speed.lag_s)
    rate = steered_radps(readings, angle.values, forward)
    return Reading(angle.t_s, rate, angle.sigma, angle.every_s, angle.lag_s, angle.lag_sigma_s, None)
