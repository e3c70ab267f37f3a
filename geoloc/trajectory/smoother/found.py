"""What the smoother found of a car's own sensors, for people to read."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.trajectory.motion_readings import MotionReadings, Reading
from geoloc.trajectory.smoother.knot_fixes import KnotFixes
from geoloc.trajectory.smoother.odometry import (
    GYRO_BIAS_SIGMA_RADPS,
    WHEEL_SCALE_SIGMA,
    Unknown,
    WanderingState,
    shows_slip,
    unknown_names,
    wandering_states,
)
from geoloc.trajectory.smoother.plane import SLIP_RAD_PER_MPS2
from geoloc.trajectory.smoother.plane_track import PlaneTrack
from geoloc.trajectory.vehicle_motion import MotionFound, MotionValue

# Without fixes for longer than this, the car's own motion has bridged something.
_BRIDGED_S = 1.0


def motion_found(
    readings: MotionReadings, knots: KnotFixes, track: PlaneTrack, *, turns_show: bool
) -> MotionFound:
    """Read the sensors' unknowns off a fitted track."""
    names, states = unknown_names(readings), wandering_states(readings)
    first_constant = track.constants.size - 2 - len(names)
    first_state = track.state.shape[1] - len(states)

    def constant(which: Unknown, mean: float = 0.0, more: float = 0.0) -> MotionValue | None:
        if which not in names:
            return None
        at = first_constant + names.index(which)
        sigma = float(np.sqrt(track.constants_covariance[at, at]))
        return MotionValue(mean + float(track.constants[at]), float(np.hypot(sigma, more)))

    def state(which: WanderingState, mean: float, unit: float) -> MotionValue | None:
        if which not in states:
            return None
        at = first_state + states.index(which)
        sigma = float(np.sqrt(np.mean(track.covariance[:, at, at])))
        return MotionValue(float(mean + unit * np.mean(track.state[:, at])), float(unit * sigma))

    # A lag looks like a slip of as much over the speed.
    slip_s = 0.0 if shows_slip(readings) else SLIP_RAD_PER_MPS2[1] * float(np.mean(np.abs(track.forward_mps)))
    return MotionFound(
        wheel_scale=state(WanderingState.WHEEL_SCALE, 1.0, WHEEL_SCALE_SIGMA),
        gyro_bias_radps=state(WanderingState.GYRO_BIAS, 0.0, GYRO_BIAS_SIGMA_RADPS),
        gyro_scale=constant(Unknown.GYRO_SCALE, 1.0),
        wheel_lag_s=constant(Unknown.WHEEL_LAG),
        gyro_lag_s=constant(Unknown.GYRO_LAG, more=slip_s),
        steering_offset_rad=constant(Unknown.STEERING_OFFSET),
        speed_sigma_mps=_own(readings.speed),
        turn_rate_sigma_radps=_own(readings.turn_rate),
        wheel_angle_sigma_rad=_own(readings.wheel_angle),
        turns_show=turns_show,
        bridged_s=_bridged_s(knots),
    )


def _own(one: Reading | None) -> float | None:
    return None if one is None else one.estimated


def _bridged_s(knots: KnotFixes) -> float:
    seen = knots.seen.any(axis=1)
    gaps: FloatArray = np.diff(np.concatenate([knots.t_s[:1], knots.t_s[seen], knots.t_s[-1:]]))
    tied = np.concatenate([[0], np.cumsum(~knots.tied)])
    rows = np.concatenate([[0], np.flatnonzero(seen), [knots.t_s.size - 1]])
    whole = np.diff(tied[rows]) == 0
    return float(gaps[whole & (gaps > _BRIDGED_S)].sum())
