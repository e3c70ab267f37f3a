"""From the tracks of antennas to poses of the rig's origin on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.errors import TrajectoryError
from geoloc.fixes import sigma_of_quality
from geoloc.geodesy import enu_offset, geographic_from_enu, rotation_enu_from_rig
from geoloc.heading import (
    MIN_BASELINE_M,
    MOVING_MPS,
    VERTICAL_FACTOR,
    AntennaTrack,
    antenna_track,
    fused_heading,
    heading_from_baseline,
    heading_from_course,
    held,
    length_tolerance_m,
    pitch_from_climb,
    resampled,
    smoothed_heading,
    tilt_with_baseline,
)
from geoloc.interpolation import metres_per_degree, seconds, tangents, wrap_deg
from geoloc.poses import GnssFixes, Poses

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STANDING = "standing still with one antenna: no heading"
STANDING_PAIR = "standing still without a usable pair of antennas: no heading"
DROWNED = "no heading: the course is lost in the noise of the fixes"
_ROLL_SIGMA_DEG = 1.0
# Of a car that never moved: roads climb by about 4 %.
_PITCH_SIGMA_DEG = 2.5
# Fixes good enough to tell wrong lever arms from bad reception.
_CHECK_SIGMA_M = 0.05
_MIN_COURSE_STEP_M = 0.1


class _Angle(NamedTuple):
    deg: FloatArray
    sigma: FloatArray


class _Pair(NamedTuple):
    """Two antennas far enough apart to give a heading."""

    first: int
    second: int
    baseline_m: FloatArray


def rig_poses(
    knot_ns: IntArray, names: Sequence[str], tracks: Sequence[AntennaTrack], levers: Sequence[FloatArray]
) -> Poses:
    """Attitude and position of the rig's origin at each knot.

    Parameters
    ----------
    knot_ns : int64 (n,)
    names, tracks, levers : sequences of equal length
        Antennas, their tracks *at the knots*, and lever arms (3,) in the rig frame.

    Returns
    -------
    Poses
        Rows without a heading are NaN: the lever arm cannot be taken off.

    Raises
    ------
    TrajectoryError
        If the antennas stand elsewhere than the lever arms say, or swapped.
    """
    t_s = seconds(knot_ns)
    pair = _longest_baseline(levers)
    lat, lon, _, _ = _mean_antenna(tracks)
    east, north = metres_per_degree(lat)
    place = ((lon - lon[0]) * east, (lat - lat[0]) * north)
    heading = _heading(t_s, names, tracks, levers, pair)
    heading = _Angle(*held(t_s, *place, *heading))
    pitch, roll = _tilt(t_s, place, tracks, pair)
    origins = _origins(tracks, levers, heading, pitch, roll)
    known = np.isfinite(heading.deg) & np.isfinite(origins[0])

    def masked(value: FloatArray) -> FloatArray:
        return np.where(known, value, np.nan)

    lat, lon, height, sigma_h, sigma_v = (masked(value) for value in origins)
    return Poses(
        epoch_ns=knot_ns,
        latitude_deg=lat,
        longitude_deg=lon,
        height_m=height,
        roll_deg=masked(roll.deg),
        pitch_deg=masked(pitch.deg),
        heading_deg=masked(heading.deg),
        speed_mps=masked(_speed(t_s, origins, known)),
        sigma_horizontal_m=sigma_h,
        sigma_vertical_m=sigma_v,
        sigma_roll_pitch_deg=masked(np.maximum(pitch.sigma, roll.sigma)),
        sigma_heading_deg=masked(heading.sigma),
        valid=known,
        reason=np.where(known, "", _reasons(tracks, pair)),
    )


def raw_poses(fixes: Sequence[GnssFixes], levers: Sequence[FloatArray], max_gap_s: float) -> Poses:
    """What the first antenna said, fix by fix, for the paper's method: no lever arm, nothing smoothed.

    Heading is that of two antennas where the rig gives their lever arms, else the course from the fix before
    to the fix after. Where these are less than 0.1 m apart the last heading stays.
    """
    first = fixes[0]
    sigma = sigma_of_quality(first.quality)
    track = antenna_track(first.epoch_ns, first.latitude_deg, first.longitude_deg, first.height_m, sigma)
    heading, speed = _neighbour_course(first, sigma)
    pair = _longest_baseline(levers)
    if pair is not None:
        ends = []
        for one in (fixes[pair.first], fixes[pair.second]):
            own = antenna_track(
                one.epoch_ns, one.latitude_deg, one.longitude_deg, one.height_m, sigma_of_quality(one.quality)
            )
            ends.append(resampled(own, one.epoch_ns, first.epoch_ns, max_gap_s))
        line, line_sigma, _ = heading_from_baseline(ends[0], ends[1], pair.baseline_m)
        seen = np.isfinite(line)
        heading = _Angle(np.where(seen, line, heading.deg), np.where(seen, line_sigma, heading.sigma))
    known = np.isfinite(heading.deg)
    level = np.zeros_like(sigma)
    return Poses(
        epoch_ns=first.epoch_ns,
        latitude_deg=track.latitude_deg,
        longitude_deg=track.longitude_deg,
        height_m=track.height_m,
        roll_deg=level,
        pitch_deg=level,
        heading_deg=heading.deg,
        speed_mps=speed,
        sigma_horizontal_m=sigma,
        sigma_vertical_m=VERTICAL_FACTOR * sigma,
        sigma_roll_pitch_deg=np.full_like(sigma, _PITCH_SIGMA_DEG),
        sigma_heading_deg=heading.sigma,
        valid=known,
        reason=np.where(known, "", STANDING),
    )


def _reasons(tracks: Sequence[AntennaTrack], pair: _Pair | None) -> NDArray[np.str_]:
    """Why there is no heading, knot by knot, where there is none."""
    speed = np.max(np.stack([np.nan_to_num(track.speed_mps) for track in tracks]), axis=0)
    return np.where(speed > MOVING_MPS, DROWNED, STANDING if pair is None else STANDING_PAIR)


def _neighbour_course(one: GnssFixes, sigma_m: FloatArray) -> tuple[_Angle, FloatArray]:
    """Course from the fix before to the fix after, and the speed between them."""
    n = one.epoch_ns.size
    before, after = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 1, n - 1)
    east, north = enu_offset(
        one.latitude_deg[before], one.longitude_deg[before], one.latitude_deg[after], one.longitude_deg[after]
    )
    step = np.hypot(east, north)
    speed = step / ((one.epoch_ns[after] - one.epoch_ns[before]) / 1e9)
    moved = step >= _MIN_COURSE_STEP_M
    last = np.maximum.accumulate(np.where(moved, np.arange(n), -1))
    there = last >= 0
    course = np.degrees(np.arctan2(east, north))[last] % 360.0
    with np.errstate(divide="ignore"):
        noise = np.degrees(np.hypot(sigma_m[before], sigma_m[after]) / step)[last]
    return _Angle(np.where(there, course, np.nan), np.where(there, noise, np.nan)), speed


def _longest_baseline(levers: Sequence[FloatArray]) -> _Pair | None:
    best: _Pair | None = None
    longest = MIN_BASELINE_M - 1e-6
    for i in range(len(levers)):
        for j in range(i + 1, len(levers)):
            baseline = levers[j] - levers[i]
            length = float(np.hypot(baseline[0], baseline[1]))
            if length >= longest:
                best, longest = _Pair(i, j, baseline), length
    return best


def _heading(
    t_s: FloatArray,
    names: Sequence[str],
    tracks: Sequence[AntennaTrack],
    levers: Sequence[FloatArray],
    pair: _Pair | None,
) -> _Angle:
    course = _mean_course(tracks, levers, reverse=False)
    if pair is None:
        return course
    first, second = tracks[pair.first], tracks[pair.second]
    line, sigma, length = heading_from_baseline(first, second, pair.baseline_m)
    who = f"{names[pair.first]} and {names[pair.second]}"
    _check_distance(first, second, length, pair.baseline_m, who)
    line = smoothed_heading(t_s, line, sigma)
    _check_direction(t_s, line, course.deg, first.speed_mps, who)
    reverse = _mean_course(tracks, levers, reverse=True)
    return _Angle(*fused_heading(line, sigma, course.deg, reverse.deg, course.sigma))


def _mean_course(tracks: Sequence[AntennaTrack], levers: Sequence[FloatArray], *, reverse: bool) -> _Angle:
    """Weigh the courses of all antennas; they share their errors, so that the mean is no surer than each."""
    courses = [
        _Angle(*heading_from_course(track, lever, reverse=reverse))
        for track, lever in zip(tracks, levers, strict=True)
    ]
    weights = np.stack([np.where(np.isfinite(c.deg), c.sigma**-2.0, 0.0) for c in courses])
    angles = np.radians(np.stack([np.where(np.isfinite(c.deg), c.deg, 0.0) for c in courses]))
    east, north = (weights * np.sin(angles)).sum(axis=0), (weights * np.cos(angles)).sum(axis=0)
    total = weights.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.sqrt(weights).sum(axis=0) / total
    known = total > 0
    heading = np.degrees(np.arctan2(east, north)) % 360.0
    return _Angle(np.where(known, heading, np.nan), np.where(known, sigma, np.nan))


def _check_distance(
    first: AntennaTrack, second: AntennaTrack, length_m: FloatArray, baseline_m: FloatArray, who: str
) -> None:
    mounted = float(np.hypot(baseline_m[0], baseline_m[1]))
    good = np.hypot(first.sigma_m, second.sigma_m) < _CHECK_SIGMA_M
    if not good.any():
        return
    measured = float(np.median(length_m[good]))
    if abs(measured - mounted) > length_tolerance_m(mounted):
        raise TrajectoryError(
            f"Antennas {who} are {measured:.2f} m apart in the recording but {mounted:.2f} m by their lever "
            "arms: correct the lever arms."
        )


def _check_direction(
    t_s: FloatArray, line_deg: FloatArray, course_deg: FloatArray, speed_mps: FloatArray, who: str
) -> None:
    both = np.isfinite(line_deg) & np.isfinite(course_deg)
    metres = np.where(both, speed_mps * np.gradient(t_s), 0.0)
    off = np.abs(wrap_deg(course_deg - line_deg))
    backwards, driven = float(metres[both & (off > 90.0)].sum()), float(metres[both].sum())
    sideways = float(metres[both & (off > 30.0) & (off < 150.0)].sum())
    if driven > 50.0 and max(backwards, sideways) > 0.5 * driven:
        raise TrajectoryError(
            f"Antennas {who} show the car driving {'backwards' if backwards > sideways else 'sideways'} for "
            f"most of the drive: their lever arms or their recordings are swapped."
        )


def _tilt(
    t_s: FloatArray,
    place: tuple[FloatArray, FloatArray],
    tracks: Sequence[AntennaTrack],
    pair: _Pair | None,
) -> tuple[_Angle, _Angle]:
    """Pitch from the climb of the surest antenna, held through standstill; roll 0 unless a pair shows it."""
    climbs = [pitch_from_climb(track) for track in tracks]
    sigmas = np.stack([np.where(np.isfinite(c[1]), c[1], np.inf) for c in climbs])
    best = np.argmin(sigmas, axis=0)
    rows = np.arange(t_s.size)
    climb = np.stack([c[0] for c in climbs])[best, rows]
    deg, sigma = held(t_s, *place, climb, np.stack([c[1] for c in climbs])[best, rows])
    unknown = ~(sigma < _PITCH_SIGMA_DEG)
    pitch = _Angle(np.where(unknown, 0.0, deg), np.where(unknown, _PITCH_SIGMA_DEG, sigma))
    roll = _Angle(np.zeros(t_s.size), np.full(t_s.size, _ROLL_SIGMA_DEG))
    if pair is None:
        return pitch, roll
    updated = tilt_with_baseline(pitch, roll, tracks[pair.first], tracks[pair.second], pair.baseline_m)
    return _Angle(*updated[0]), _Angle(*updated[1])


def _mean_antenna(tracks: Sequence[AntennaTrack]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Mean position of the antennas that have one, weighed by their sigmas; also the mean's sigma.

    The antennas of a car share atmosphere and base station: the mean is no surer than they are.
    """
    weights = np.stack([np.where(t.known, np.nan_to_num(t.sigma_m, nan=1.0) ** -2.0, 0.0) for t in tracks])
    total = weights.sum(axis=0)
    total = np.where(total > 0, total, np.nan)

    def mean(values: Sequence[FloatArray]) -> FloatArray:
        return np.asarray((weights * np.nan_to_num(np.stack(values))).sum(axis=0) / total)

    return (
        mean([t.latitude_deg for t in tracks]),
        mean([t.longitude_deg for t in tracks]),
        mean([t.height_m for t in tracks]),
        mean([t.sigma_m for t in tracks]),
    )


def _origins(
    tracks: Sequence[AntennaTrack], levers: Sequence[FloatArray], heading: _Angle, pitch: _Angle, roll: _Angle
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Latitude, longitude, height of the rig's origin, and horizontal and vertical sigma."""
    enu_R_rig = rotation_enu_from_rig(heading.deg, pitch.deg, roll.deg)
    moved = []
    for track, lever in zip(tracks, levers, strict=True):
        offset = enu_R_rig @ lever
        lat, lon = geographic_from_enu(track.latitude_deg, track.longitude_deg, -offset[:, 0], -offset[:, 1])
        # Without a lever arm the attitude plays no part, not even an unknown one.
        if not lever.any():
            lat, lon, offset = track.latitude_deg, track.longitude_deg, np.zeros_like(offset)
        moved.append(
            replace(track, latitude_deg=lat, longitude_deg=lon, height_m=track.height_m - offset[:, 2])
        )
    lat, lon, height, sigma = _mean_antenna(moved)
    lever = np.mean(np.stack(levers), axis=0)
    arm = float(np.hypot(lever[0], lever[1]))
    tilt_sigma = np.radians(np.maximum(pitch.sigma, roll.sigma))
    horizontal = np.sqrt(
        sigma**2 + (float(lever[2]) * tilt_sigma) ** 2 + (arm * np.radians(heading.sigma)) ** 2
    )
    return lat, lon, height, horizontal, np.hypot(VERTICAL_FACTOR * sigma, arm * tilt_sigma)


def _speed(t_s: FloatArray, origins: Sequence[FloatArray], known: NDArray[np.bool_]) -> FloatArray:
    lat, lon, height = (value[known] for value in origins[:3])
    east, north = metres_per_degree(lat, height)
    speed = np.full(t_s.size, np.nan)
    if known.any():
        speed[known] = np.hypot(tangents(t_s[known], lon) * east, tangents(t_s[known], lat) * north)
    return speed
