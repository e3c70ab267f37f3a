"""Where to start smoothing where there are no fixes: a car's own measurements, added up."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.trajectory.interpolation import tangents
from geoloc.trajectory.motion_readings import MotionReadings
from geoloc.trajectory.smoother.knot_fixes import KnotFixes
from geoloc.trajectory.smoother.odometry import steered_radps
from geoloc.trajectory.smoother.state import ACCELERATION, POSITION, VELOCITY, forward_axis


def turned_rad(knots: KnotFixes, readings: MotionReadings) -> FloatArray | None:
    """By how much the car has turned at each knot ``(n,)`` since the first; None if nothing says so."""
    if readings.turn_rate is not None:
        turned = readings.turn_rate.integral(knots.t_s + readings.turn_rate.lag_s)
        return np.asarray(turned - turned[0])
    if readings.wheel_angle is None or readings.speed is None:
        return None
    angle = readings.wheel_angle.at(knots.t_s + readings.wheel_angle.lag_s)
    rate = steered_radps(readings, angle, readings.speed.at(knots.t_s + readings.speed.lag_s))
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * knots.step_s)])


def reckoned(
    knots: KnotFixes, readings: MotionReadings, yaw_rad: FloatArray, state: FloatArray
) -> FloatArray:
    """State with place, velocity and acceleration by dead reckoning where no antenna has a fix.

    Parameters
    ----------
    knots : KnotFixes
    readings : MotionReadings
    yaw_rad : float64 (n,)
    state : float64 (n, d)
        From the fixes; what lies between two of them closes on both.
    """
    seen = knots.seen.any(axis=1)
    if seen.all() or readings.speed is None:
        return state
    way_m = np.diff(readings.speed.integral(knots.t_s + readings.speed.lag_s))
    steps = way_m[:, None] * forward_axis(0.5 * (yaw_rad[1:] + yaw_rad[:-1]))
    place = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    off = (state[:, POSITION] - place)[seen]
    place += np.stack([np.interp(knots.t_s, knots.t_s[seen], axis) for axis in off.T], axis=1)
    velocity = readings.speed.at(knots.t_s + readings.speed.lag_s)[:, None] * forward_axis(yaw_rad)
    result = state.copy()
    for part, values in (
        (POSITION, place),
        (VELOCITY, velocity),
        (ACCELERATION, tangents(knots.t_s, velocity)),
    ):
        result[~seen, part] = values[~seen]
    return result
