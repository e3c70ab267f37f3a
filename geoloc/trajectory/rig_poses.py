"""From the fixes of antennas to poses of the rig's origin on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.geodesy import enu_offset, rotation_enu_from_rig, wrap_deg
from geoloc.errors import TrajectoryError
from geoloc.reasons import Reason
from geoloc.trajectory.fix_checks import HEADING_SIGMA_DEG, VERTICAL_FACTOR, sigma_of_quality
from geoloc.trajectory.heading import (
    LIMIT_DEG,
    MIN_BASELINE_M,
    MOVING_MPS,
    course_over_ground,
    first_yaw,
    heading_from_baseline,
    length_tolerance_m,
    moving,
)
from geoloc.trajectory.interpolation import bracket, hermite, linear, seconds, tangents
from geoloc.trajectory.motion_checks import check_readings
from geoloc.trajectory.motion_readings import MotionReadings
from geoloc.trajectory.poses import GnssFixes, Poses
from geoloc.trajectory.smoother.found import motion_found
from geoloc.trajectory.smoother.knot_fixes import KnotFixes, knot_fixes
from geoloc.trajectory.smoother.plane import (
    AXLE_KNOWN_M,
)
from geoloc.trajectory.smoother.plane_track import PlaneTrack
from geoloc.trajectory.smoother.reckoning import reckoned, turned_rad
from geoloc.trajectory.smoother.state import OWN
from geoloc.trajectory.smoother.tilt import TiltTrack, smoothed_tilt
from geoloc.trajectory.track_and_tilt import LEVER_SIGMA_M, CarOfDrive, of_one_antenna, track_and_tilt
from geoloc.trajectory.vehicle_motion import MotionFound, VehicleMotion

# Found from the drive itself: only a start.
_FOUND_LEVER_SIGMA_M = 0.3
# Where antennas of unknown place sit ahead of the rear axle: in the middle of a roof.
_ROOF_M = (0.7, 0.5)
# Rear wheels do not point exactly along the car, and a body turns a little on its springs.
_HEADING_FLOOR_DEG = 0.05
# Between a car's body and the road that it stands on: springs, and what lies below one wheel.
_PITCH_FLOOR_DEG = 0.15
_ROLL_FLOOR_DEG = 0.3
_ROLL_SIGMA_DEG = 1.0
# Of a car that never moved: roads climb by about 4 %.
_PITCH_SIGMA_DEG = 2.5
# Fixes good enough to tell wrong lever arms from bad reception.
_CHECK_SIGMA_M = 0.05
_MIN_COURSE_STEP_M = 0.1
_FAST_MPS = 3.0
# Lever arms lean with a tilt that is only known after the first pass.
_ITERATIONS = (8, 4)


class _Angle(NamedTuple):
    deg: FloatArray
    sigma: FloatArray


class _Pair(NamedTuple):
    """Two antennas far enough apart to give a heading."""

    first: int
    second: int
    baseline_m: FloatArray


class Fitted(NamedTuple):
    """What was fitted to the fixes of a drive.

    Attributes
    ----------
    knots : KnotFixes
    car : CarOfDrive
        Its lever arms are found from the drive if none was given.
    track : PlaneTrack
    tilt : TiltTrack
    pair : bool
        Whether two antennas give a heading.
    motion : MotionFound or None
        What was found of the car's own sensors.
    """

    knots: KnotFixes
    car: CarOfDrive
    track: PlaneTrack
    tilt: TiltTrack
    pair: bool
    motion: MotionFound | None = None


def fitted(
    fixes: Sequence[GnssFixes],
    levers: Sequence[FloatArray],
    knot_ns: IntArray,
    max_gap_s: float,
    motion: VehicleMotion | None = None,
) -> Fitted:
    """Fit track and tilt of the rig to all fixes of a drive.

    Parameters
    ----------
    fixes, levers : sequences of equal length
        Fixes of each antenna, and lever arms (3,) in the rig frame.
    knot_ns : int64 (n,)
    max_gap_s : float
        Nothing but a heading of a car that stood is carried over longer gaps between knots.
    motion : VehicleMotion, optional

    Raises
    ------
    TrajectoryError
        If the antennas stand elsewhere than the lever arms say, or swapped.
    """
    knots = knot_fixes(fixes, knot_ns, max_gap_s)
    alone = [of_one_antenna(knots, i) for i in range(len(fixes))]
    arms, arm_sigma, axle_m = np.stack(levers), LEVER_SIGMA_M, AXLE_KNOWN_M
    if len(fixes) > 1 and not arms.any():
        arms, arm_sigma, axle_m = _found_levers(alone), _FOUND_LEVER_SIGMA_M, _ROOF_M
    pair = _longest_baseline(arms)
    line = np.full(knot_ns.size, np.nan)
    if pair is not None:
        who = f"{fixes[pair.first].antenna} and {fixes[pair.second].antenna}"
        line = _checked_baseline(knots, alone, pair, who)
    for antenna in knots.heading_antennas:
        told = 90.0 - np.degrees(knots.heading_rad[:, antenna])
        line = np.where(np.isfinite(line), line, told)
    readings = None if motion is None else MotionReadings.of(motion, int(knot_ns[0]))
    turns_show = readings is not None and check_readings(readings, knots, _surest(alone))
    track = _start(knots, alone, arms, line, readings)
    car = CarOfDrive(arms, arm_sigma, axle_m, readings)
    drift = car.drift_mps(knots, alone)
    tilt = smoothed_tilt(knots, arms, LEVER_SIGMA_M, track.forward_mps, track.lateral_mps2)
    for iterations in _ITERATIONS:
        track, tilt = track_and_tilt(knots, car, drift, track, tilt, iterations)
        if iterations == _ITERATIONS[0]:
            knots = knots.as_large_as_found(*track.slow_error)
    found = None if readings is None else motion_found(readings, knots, track, turns_show=turns_show)
    return Fitted(knots, car, track, tilt, pair is not None, found)


def raw_poses(fixes: Sequence[GnssFixes], levers: Sequence[FloatArray], max_gap_s: float) -> Poses:
    """What the first antenna said, fix by fix, for the paper's method: no lever arm, nothing smoothed.

    Heading is that of two antennas where the rig gives their lever arms, else that which the receiver has
    of antennas of its own, else the course from the fix before to the fix after. Where these are less than
    0.1 m apart the last heading stays.
    """
    first = fixes[0]
    sigma = sigma_of_quality(first.quality)
    heading, speed = _heading_of_one(first, sigma, max_gap_s)
    pair = _longest_baseline(np.stack(levers))
    if pair is not None:
        ends = [_positions_at(fixes[i], first.epoch_ns, max_gap_s) for i in (pair.first, pair.second)]
        east, north = enu_offset(*ends[0][:2], *ends[1][:2])
        line, line_sigma = heading_from_baseline(
            east, north, np.hypot(ends[0][2], ends[1][2]), pair.baseline_m
        )
        seen = np.isfinite(line)
        heading = _Angle(np.where(seen, line, heading.deg), np.where(seen, line_sigma, heading.sigma))
    known = np.isfinite(heading.deg)
    level = np.zeros_like(sigma)
    return Poses(
        epoch_ns=first.epoch_ns,
        latitude_deg=first.latitude_deg,
        longitude_deg=first.longitude_deg,
        height_m=first.height_m,
        roll_deg=level,
        pitch_deg=level,
        heading_deg=heading.deg,
        speed_mps=speed,
        sigma_horizontal_m=sigma,
        sigma_vertical_m=VERTICAL_FACTOR * sigma,
        sigma_roll_deg=np.full_like(sigma, _ROLL_SIGMA_DEG),
        sigma_pitch_deg=np.full_like(sigma, _PITCH_SIGMA_DEG),
        sigma_heading_deg=heading.sigma,
        valid=known,
        reason=np.where(known, "", Reason.STANDING),
    )


def _between(alone: Sequence[PlaneTrack], first: int, second: int) -> tuple[FloatArray, FloatArray]:
    """From one antenna to another, east and north ``(n, 2)``, and one sigma of that."""
    noise = np.hypot(alone[first].position_sigma_m, alone[second].position_sigma_m)
    return alone[second].position_m - alone[first].position_m, noise


def _found_levers(alone: Sequence[PlaneTrack]) -> FloatArray:
    """Lever arms ``(m, 3)`` about the antennas' mean, from how they lie to the course; 0 if nobody drove."""
    best = _surest(alone)
    course = np.arctan2(best.velocity_mps[:, 1], best.velocity_mps[:, 0])
    away = np.stack([_between(alone, 0, i)[0] for i in range(len(alone))], axis=1)
    noise = np.max([_between(alone, 0, i)[1] for i in range(1, len(alone))], axis=0)
    fast = moving(best.velocity_mps, best.velocity_sigma_mps) & (noise < _CHECK_SIGMA_M)
    fast &= np.hypot(*best.velocity_mps.T) > _FAST_MPS
    arms = np.zeros((len(alone), 3))
    if fast.any():
        turn = course[fast, None]
        ahead = away[fast, :, 0] * np.cos(turn) + away[fast, :, 1] * np.sin(turn)
        left = away[fast, :, 1] * np.cos(turn) - away[fast, :, 0] * np.sin(turn)
        arms[:, 0], arms[:, 1] = np.median(ahead, axis=0), np.median(left, axis=0)
    return np.asarray(arms - arms.mean(axis=0))


def _surest(alone: Sequence[PlaneTrack]) -> PlaneTrack:
    """At each knot the antenna whose velocity is known best."""
    best = np.argmin([one.velocity_sigma_mps for one in alone], axis=0)
    rows = np.arange(best.size)
    state, covariance = (
        np.stack([getattr(one, name) for one in alone])[best, rows] for name in ("state", "covariance")
    )
    return PlaneTrack(state, covariance, alone[0].constants, alone[0].constants_covariance, alone[0].weight)


def _checked_baseline(knots: KnotFixes, alone: Sequence[PlaneTrack], pair: _Pair, who: str) -> FloatArray:
    """Heading of the car by its baseline, knot by knot, NaN where unknown."""
    line, noise = _between(alone, pair.first, pair.second)
    ends = [pair.first, pair.second]
    good = knots.seen[:, ends].all(axis=1) & (np.hypot(*knots.sigma_m[:, ends].T) < _CHECK_SIGMA_M)
    mounted = float(np.hypot(pair.baseline_m[0], pair.baseline_m[1]))
    if good.any():
        measured = float(np.median(np.hypot(*line[good].T)))
        if abs(measured - mounted) > length_tolerance_m(mounted):
            raise TrajectoryError(
                f"Antennas {who} are {measured:.2f} m apart in the recording but {mounted:.2f} m by their "
                "lever arms: correct the lever arms."
            )
    heading, _ = heading_from_baseline(line[:, 0], line[:, 1], noise, pair.baseline_m)
    _check_direction(knots, heading, alone[pair.first], who)
    return heading


def _check_direction(knots: KnotFixes, line_deg: FloatArray, track: PlaneTrack, who: str) -> None:
    both = np.isfinite(line_deg) & moving(track.velocity_mps, track.velocity_sigma_mps)
    metres = np.where(both, np.hypot(*track.velocity_mps.T) * knots.share_s, 0.0)
    off = np.abs(wrap_deg(course_over_ground(track.velocity_mps) - np.where(both, line_deg, 0.0)))
    backwards, driven = float(metres[off > 90.0].sum()), float(metres.sum())
    sideways = float(metres[(off > 30.0) & (off < 150.0)].sum())
    if driven > 50.0 and max(backwards, sideways) > 0.5 * driven:
        raise TrajectoryError(
            f"Antennas {who} show the car driving {'backwards' if backwards > sideways else 'sideways'} for "
            f"most of the drive: their lever arms or their recordings are swapped."
        )


def _start(
    knots: KnotFixes,
    alone: Sequence[PlaneTrack],
    arms_m: FloatArray,
    line_deg: FloatArray,
    readings: MotionReadings | None,
) -> PlaneTrack:
    """Where to start smoothing: antennas on their own, lever arms taken off with a first heading."""
    n = knots.t_s.size
    best = _surest(alone)
    turns = None if readings is None else turned_rad(knots, readings)
    yaw = first_yaw(knots.t_s, best.position_m, best.velocity_mps, best.velocity_sigma_mps, line_deg, turns)
    turn = rotation_enu_from_rig(90.0 - np.degrees(yaw), 0.0, 0.0)[:, :2]
    near = np.stack([one.position_m - turn @ arm for one, arm in zip(alone, arms_m, strict=True)], axis=1)
    trust = np.stack([one.position_sigma_m**-2.0 for one in alone], axis=1)[:, :, None]
    state = np.zeros((n, OWN))
    state[:, :2] = (trust * near).sum(axis=1) / trust.sum(axis=1)
    state[:, 2:6] = best.state[:, 2:]
    state[:, 6] = yaw
    state[:, 7] = np.clip(tangents(knots.t_s, yaw), -1.0, 1.0)
    if readings is not None:
        state = reckoned(knots, readings, yaw, state)
    weight = np.concatenate([one.weight for one in alone], axis=1)
    return PlaneTrack(state, np.zeros(0), np.zeros(0), np.zeros(0), weight)


def rig_poses(knot_ns: IntArray, fit: Fitted) -> Poses:
    """Attitude and position of the rig's origin at each knot.

    Rows without a heading are NaN: the lever arm cannot be taken off.
    """
    knots, car, track, tilt, pair, _ = fit
    still = Reason.STANDING_PAIR if pair else Reason.STANDING
    lat, lon = knots.geographic(track.position_m)
    speed = np.hypot(track.velocity_mps[:, 0], track.velocity_mps[:, 1])
    heading_sigma = np.hypot(np.degrees(track.yaw_sigma_rad), _HEADING_FLOOR_DEG)
    known = heading_sigma < LIMIT_DEG
    pitch_sigma = np.hypot(tilt.pitch_sigma_deg, _PITCH_FLOOR_DEG)
    roll_sigma = np.hypot(tilt.roll_sigma_deg, _ROLL_FLOOR_DEG)
    plane_sigma = knots.with_what_all_share(track.position_sigma_m)
    up_sigma = knots.with_what_all_share(tilt.height_sigma_m, is_height=True)
    _, aside_m, above_m = car.arms_m.mean(axis=0)
    lean = lean_m(float(above_m), roll_sigma, pitch_sigma)
    columns = {
        "latitude_deg": lat,
        "longitude_deg": lon,
        "height_m": tilt.height_m,
        "roll_deg": tilt.roll_deg,
        "pitch_deg": tilt.pitch_deg,
        "heading_deg": (90.0 - np.degrees(track.yaw_rad)) % 360.0,
        "speed_mps": speed,
        "sigma_horizontal_m": np.hypot(plane_sigma, lean),
        "sigma_vertical_m": np.hypot(up_sigma, lean_up_m(float(aside_m), roll_sigma)),
        "sigma_roll_deg": roll_sigma,
        "sigma_pitch_deg": pitch_sigma,
        "sigma_heading_deg": heading_sigma,
    }
    return Poses(
        epoch_ns=knot_ns,
        **{name: np.where(known, value, np.nan) for name, value in columns.items()},
        valid=known,
        reason=np.where(known, "", np.where(speed > MOVING_MPS, Reason.COURSE_IN_NOISE, still)),
    )


def lean_m(height_m: float, roll_sigma_deg: FloatArray, pitch_sigma_deg: FloatArray) -> FloatArray:
    """One sigma a horizontal axis that a tilt, known so well, leaves below an antenna of this height."""
    return np.asarray(abs(height_m) * np.radians(np.hypot(pitch_sigma_deg, roll_sigma_deg)) / np.sqrt(2.0))


def lean_up_m(aside_m: float, roll_sigma_deg: FloatArray) -> FloatArray:
    """One sigma of a height that a roll, known so well, leaves below an antenna so far aside."""
    return np.asarray(abs(aside_m) * np.radians(roll_sigma_deg))


def _heading_of_one(one: GnssFixes, sigma_m: FloatArray, max_gap_s: float) -> tuple[_Angle, FloatArray]:
    """Heading that the receiver has, else the course of the fixes before and after; and the speed there."""
    course, speed = _neighbour_course(one, sigma_m)
    told = _told_heading(one, max_gap_s)
    heading, sigma = (
        np.where(np.isfinite(told.deg), own, neighbours) for own, neighbours in zip(told, course, strict=True)
    )
    last = np.maximum.accumulate(np.where(np.isfinite(heading), np.arange(heading.size), -1))
    return _Angle(*(np.where(last >= 0, value[last], np.nan) for value in (heading, sigma))), speed


def _neighbour_course(one: GnssFixes, sigma_m: FloatArray) -> tuple[_Angle, FloatArray]:
    """Course from the fix before to the fix after, NaN where nothing moved; and the speed between them."""
    n = one.epoch_ns.size
    before, after = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 1, n - 1)
    east, north = enu_offset(
        one.latitude_deg[before], one.longitude_deg[before], one.latitude_deg[after], one.longitude_deg[after]
    )
    step = np.hypot(east, north)
    speed = step / ((one.epoch_ns[after] - one.epoch_ns[before]) / 1e9)
    moved = step >= _MIN_COURSE_STEP_M
    course = np.degrees(np.arctan2(east, north)) % 360.0
    with np.errstate(divide="ignore"):
        noise = np.degrees(np.hypot(sigma_m[before], sigma_m[after]) / step)
    return _Angle(np.where(moved, course, np.nan), np.where(moved, noise, np.nan)), speed


def _told_heading(one: GnssFixes, max_gap_s: float) -> _Angle:
    """The receiver's own heading at each fix, between its headings by the shorter way; NaN in their gaps."""
    told = np.flatnonzero(np.isfinite(one.heading_deg))
    deg, sigma = np.full((2, one.epoch_ns.size), np.nan)
    stated = one.heading_sigma_deg[told]
    own = _Angle(one.heading_deg[told] % 360.0, np.where(np.isfinite(stated), stated, HEADING_SIGMA_DEG))
    if told.size > 1:
        at = bracket(one.epoch_ns[told], one.epoch_ns)
        known = at.inside() & ~at.in_gap(max_gap_s)
        deg[known] = (linear(np.unwrap(own.deg, period=360.0), at) % 360.0)[known]
        sigma[known] = linear(own.sigma, at)[known]
    deg[told], sigma[told] = own
    return _Angle(deg, sigma)


def _positions_at(
    one: GnssFixes, at_ns: IntArray, max_gap_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Latitude, longitude and sigma of an antenna at other epochs; NaN outside its fixes and in its gaps."""
    at = bracket(one.epoch_ns, at_ns)
    known = at.inside() & ~at.in_gap(max_gap_s)
    t_s = seconds(one.epoch_ns)
    curves = [hermite(value, tangents(t_s, value), at) for value in (one.latitude_deg, one.longitude_deg)]
    curves.append(linear(sigma_of_quality(one.quality), at))
    lat, lon, sigma = (np.where(known, value, np.nan) for value in curves)
    return lat, lon, sigma


def _longest_baseline(arms_m: FloatArray) -> _Pair | None:
    best: _Pair | None = None
    longest = MIN_BASELINE_M - 1e-6
    for i in range(len(arms_m)):
        for j in range(i + 1, len(arms_m)):
            baseline = arms_m[j] - arms_m[i]
            length = float(np.hypot(baseline[0], baseline[1]))
            if length >= longest:
                best, longest = _Pair(i, j, baseline), length
    return best
