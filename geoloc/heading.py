"""Heading and tilt of the car from GNSS: two antennas, the course of its track, or held while it stands.

Units of this module: time in seconds, velocities in m/s east, north, up, headings in degrees clockwise from
true north, lever arms in metres in the rig frame (FLU).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geoloc.geodesy import enu_offset
from geoloc.interpolation import (
    bracket,
    hermite,
    linear,
    local_parabola,
    metres_per_degree,
    seconds,
    tangents,
    wrap_deg,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

MOVING_MPS = 1.0
"""Below this speed a course says nothing about the heading."""
MIN_BASELINE_M = 0.3
"""Antennas closer than this give no heading."""
VERTICAL_FACTOR = 1.7
"""Vertical sigma of a fix over its horizontal one."""

_SLOWEST_MPS = 0.01
_HALF_WINDOW_S = 0.5
_ACCELERATION_MPS2 = 3.0
_YAW_ACCELERATION_DEGPS2 = 30.0
# A parabola over ± W seconds misses a jerk J by J W² / 8 in its slope; 1 m/s³ is that of entering a bend.
_JERK_MPS3 = 1.0
# Rear cornering compliance of a passenger car is about 3° per g: the rear axle drifts that much in a bend.
_COMPLIANCE_DEG_PER_MPS2 = 0.3
_COURSE_FLOOR_DEG = 0.1
# Curvature of the path: one sigma is a radius of 10 m, which only matters where the car creeps.
_CURVATURE_PER_M = 0.1
# A standing car does not turn; a creeping one turns by about 2° a metre (radius 30 m).
_HOLD_DEG_PER_S = 0.05
_HOLD_DEG_PER_M = 2.0
_HOLD_LIMIT_DEG = 15.0
_SLOPE_FLOOR_DEG = 0.3


@dataclass(frozen=True, slots=True)
class AntennaTrack:
    """One antenna at some epochs; rows are NaN where it has no fix nearby.

    Attributes
    ----------
    latitude_deg, longitude_deg, height_m, sigma_m : float64 (n,)
        The fix itself (not smoothed) and its horizontal sigma.
    velocity_mps : float64 (n, 3)
        East, north, up, smoothed over about a second.
    curvature_per_m : float64 (n,)
        Of the path, counter-clockwise; 0 where it stands.
    sigma_velocity_mps, sigma_acceleration_mps2 : float64 (n,)
        A horizontal axis.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    sigma_m: FloatArray
    velocity_mps: FloatArray
    curvature_per_m: FloatArray
    sigma_velocity_mps: FloatArray
    sigma_acceleration_mps2: FloatArray

    @property
    def known(self) -> BoolArray:
        """True where the antenna has a position."""
        return np.isfinite(self.latitude_deg)

    @property
    def speed_mps(self) -> FloatArray:
        """Horizontal speed."""
        return np.hypot(self.velocity_mps[:, 0], self.velocity_mps[:, 1])


def antenna_track(
    epoch_ns: IntArray,
    latitude_deg: FloatArray,
    longitude_deg: FloatArray,
    height_m: FloatArray,
    sigma_m: FloatArray,
) -> AntennaTrack:
    """Velocity and curvature of one antenna at its own fixes, from parabolas over about a second.

    The sigma of the velocity follows from that of the fixes or, where larger, from the scatter about the
    parabola (a jump between float and fixed solutions makes the course uncertain), and from what a parabola
    cannot follow.
    """
    east, north = metres_per_degree(latitude_deg, height_m)
    scale = np.stack([east, north], axis=1)
    plane = np.stack([longitude_deg, latitude_deg], axis=1)
    t_s = seconds(epoch_ns)
    window = max(_HALF_WINDOW_S, 1.05 * float(np.median(np.diff(t_s))))
    fit = local_parabola(t_s, plane, sigma_m, scale, window, _ACCELERATION_MPS2)
    up = local_parabola(
        t_s, height_m[:, None], VERTICAL_FACTOR * sigma_m, np.ones((t_s.size, 1)), window, _ACCELERATION_MPS2
    )
    worse = np.maximum(fit.misfit, 1.0)
    missed = _JERK_MPS3 * window**2 / 8.0
    (ve, vn), (ae, an) = fit.slope.T, fit.curvature.T
    speed = np.hypot(ve, vn)
    curvature = (ve * an - vn * ae) / np.maximum(speed, _SLOWEST_MPS) ** 3
    return AntennaTrack(
        latitude_deg,
        longitude_deg,
        height_m,
        sigma_m,
        np.stack([ve, vn, up.slope[:, 0]], axis=1),
        np.where(speed > MOVING_MPS, curvature, 0.0),
        np.hypot(fit.sigma_slope * worse, missed),
        fit.sigma_curvature * worse,
    )


def resampled(track: AntennaTrack, epoch_ns: IntArray, at_ns: IntArray, max_gap_s: float) -> AntennaTrack:
    """Bring a track from its own epochs to others; NaN outside it and inside its gaps."""
    at = bracket(epoch_ns, at_ns)
    known = at.inside() & ~at.in_gap(max_gap_s)
    t_s = seconds(epoch_ns)

    def smooth(value: FloatArray) -> FloatArray:
        return np.where(known, hermite(value, tangents(t_s, value), at), np.nan)

    def straight(value: FloatArray) -> FloatArray:
        return np.where(known, linear(value, at), np.nan)

    return AntennaTrack(
        smooth(track.latitude_deg),
        smooth(track.longitude_deg),
        smooth(track.height_m),
        straight(track.sigma_m),
        np.stack([straight(v) for v in track.velocity_mps.T], axis=1),
        straight(track.curvature_per_m),
        straight(track.sigma_velocity_mps),
        straight(track.sigma_acceleration_mps2),
    )


def course_over_ground(velocity_mps: FloatArray) -> FloatArray:
    """Direction of travel of velocities ``(n, 2 or 3)``: degrees clockwise from true north, in [0, 360)."""
    return np.degrees(np.arctan2(velocity_mps[..., 0], velocity_mps[..., 1])) % 360.0


def heading_from_course(
    track: AntennaTrack, lever_arm_m: FloatArray, *, reverse: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Heading from the course of one antenna.

    The rear axle does not slip sideways, but an antenna ahead of it swings out in a bend: by asin(x κ) for a
    lever arm x and a path of curvature κ (1.9° for 1 m and a radius of 30 m), which is removed.

    Parameters
    ----------
    track : AntennaTrack
    lever_arm_m : float64 (3,)
    reverse : bool
        Take it that the car reverses. A course alone cannot tell.

    Returns
    -------
    heading_deg, sigma_deg : float64 (n,)
        NaN where the antenna is slower than 1 m/s.
    """
    speed = track.speed_mps
    divisor = np.maximum(speed, _SLOWEST_MPS)
    course_sigma = track.sigma_velocity_mps / divisor
    curvature_sigma = track.sigma_acceleration_mps2 / divisor**2
    # Curvature from noisy accelerations of a creeping car is worth little: weigh it against roads.
    gain = _CURVATURE_PER_M**2 / (_CURVATURE_PER_M**2 + curvature_sigma**2)
    swing = np.arcsin(np.clip(lever_arm_m[0] * gain * track.curvature_per_m, -0.9, 0.9))
    swing_sigma = abs(float(lever_arm_m[0])) * np.sqrt(gain) * curvature_sigma
    drift = _COMPLIANCE_DEG_PER_MPS2 * np.abs(track.curvature_per_m) * speed**2
    sigma = np.sqrt(
        np.degrees(course_sigma) ** 2 + np.degrees(swing_sigma) ** 2 + drift**2 + _COURSE_FLOOR_DEG**2
    )
    course = course_over_ground(track.velocity_mps)
    heading = course + 180.0 - np.degrees(swing) if reverse else course + np.degrees(swing)
    moving = (speed > MOVING_MPS) & (course_sigma < 1.0)
    return np.where(moving, heading % 360.0, np.nan), np.where(moving, sigma, np.nan)


def heading_from_baseline(
    first: AntennaTrack, second: AntennaTrack, baseline_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Heading and elevation of the line from one antenna to another.

    Parameters
    ----------
    first, second : AntennaTrack
        At common epochs.
    baseline_m : float64 (3,)
        Second lever arm minus first, rig frame.

    Returns
    -------
    heading_deg, sigma_deg : float64 (n,)
        Of the *car*: the direction in which the baseline is mounted is taken off. NaN where one of the
        antennas is missing, or their distance differs from the rig's by more than four sigma and the
        tolerance of `length_tolerance_m`.
    length_m : float64 (n,)
        Measured horizontal distance.
    """
    east, north = enu_offset(
        first.latitude_deg, first.longitude_deg, second.latitude_deg, second.longitude_deg
    )
    length = np.hypot(east, north)
    noise = np.hypot(first.sigma_m, second.sigma_m)
    mounted = float(np.hypot(baseline_m[0], baseline_m[1]))
    plausible = np.abs(length - mounted) < np.maximum(length_tolerance_m(mounted), 4.0 * noise)
    azimuth = np.degrees(np.arctan2(east, north))
    heading = (azimuth + np.degrees(np.arctan2(baseline_m[1], baseline_m[0]))) % 360.0
    sigma = np.degrees(noise / mounted)
    usable = plausible & (sigma < _HOLD_LIMIT_DEG)
    return np.where(usable, heading, np.nan), np.where(usable, sigma, np.nan), length


def length_tolerance_m(mounted_m: float) -> float:
    """How far a measured baseline may differ from the mounted one before one of them is wrong."""
    return min(0.25, 0.05 + 0.2 * mounted_m)


def smoothed_heading(t_s: FloatArray, heading_deg: FloatArray, sigma_deg: FloatArray) -> FloatArray:
    """Smooth the known headings over about a second.

    Their sigma stays as it is: errors of an antenna among reflections outlast the window.
    """
    known = np.isfinite(heading_deg)
    if known.sum() < 3:
        return heading_deg
    unwrapped = np.degrees(np.unwrap(np.radians(heading_deg[known])))[:, None]
    fit = local_parabola(
        t_s[known],
        unwrapped,
        sigma_deg[known],
        np.ones_like(unwrapped),
        _HALF_WINDOW_S,
        _YAW_ACCELERATION_DEGPS2,
    )
    result = heading_deg.copy()
    result[known] = (unwrapped + fit.value)[:, 0] % 360.0
    return result


def fused_heading(
    baseline_deg: FloatArray,
    baseline_sigma: FloatArray,
    course_deg: FloatArray,
    reverse_deg: FloatArray,
    course_sigma: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Weigh the headings of baseline and course by their sigmas; one alone stands for itself.

    `reverse_deg` is the heading from the course if the car reverses: taken where the baseline says so.
    """
    difference = wrap_deg(course_deg - baseline_deg)
    difference = np.where(np.abs(difference) > 90.0, wrap_deg(reverse_deg - baseline_deg), difference)
    weight_b, weight_c = baseline_sigma**-2, course_sigma**-2
    both = np.isfinite(difference)
    heading = np.where(both, baseline_deg + difference * weight_c / (weight_b + weight_c), baseline_deg)
    sigma = np.where(both, 1.0 / np.sqrt(weight_b + weight_c), baseline_sigma)
    alone = ~np.isfinite(baseline_deg)
    return np.where(alone, course_deg, heading % 360.0), np.where(alone, course_sigma, sigma)


def held(
    t_s: FloatArray,
    east_m: FloatArray,
    north_m: FloatArray,
    angle_deg: FloatArray,
    sigma_deg: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Carry an angle through epochs where it is unknown: from the last known one, or back from the next.

    The sigma grows by 0.05° a second and by 2° a metre of displacement; beyond 15° the angle stays NaN.
    """
    n = t_s.size
    known = np.isfinite(angle_deg)
    if not known.any() or known.all():
        return angle_deg, sigma_deg
    index = np.arange(n)
    last = np.maximum.accumulate(np.where(known, index, -1))
    following = np.minimum.accumulate(np.where(known, index, n)[::-1])[::-1]
    best_angle, best_sigma = angle_deg.copy(), np.where(known, sigma_deg, np.inf)
    for source in (last, following):
        there = (source >= 0) & (source < n)
        j = np.where(there, source, 0)
        moved = np.hypot(east_m - east_m[j], north_m - north_m[j])
        grown = np.sqrt(
            sigma_deg[j] ** 2 + (_HOLD_DEG_PER_S * (t_s - t_s[j])) ** 2 + (_HOLD_DEG_PER_M * moved) ** 2
        )
        better = there & ~known & (grown < np.minimum(best_sigma, _HOLD_LIMIT_DEG))
        best_angle = np.where(better, angle_deg[j], best_angle)
        best_sigma = np.where(better, grown, best_sigma)
    return best_angle, np.where(np.isfinite(best_angle), best_sigma, np.nan)


def pitch_from_climb(track: AntennaTrack) -> tuple[FloatArray, FloatArray]:
    """Pitch of the road (positive nose down) from the heights along the track; NaN below 1 m/s."""
    speed = track.speed_mps
    noise = np.degrees(VERTICAL_FACTOR * track.sigma_velocity_mps / np.maximum(speed, _SLOWEST_MPS))
    moving = (speed > MOVING_MPS) & (noise < _HOLD_LIMIT_DEG)
    pitch = -np.degrees(np.arctan2(track.velocity_mps[:, 2], speed))
    return np.where(moving, pitch, np.nan), np.where(moving, np.hypot(noise, _SLOPE_FLOOR_DEG), np.nan)


def tilt_with_baseline(
    pitch: tuple[FloatArray, FloatArray],
    roll: tuple[FloatArray, FloatArray],
    first: AntennaTrack,
    second: AntennaTrack,
    baseline_m: FloatArray,
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Correct pitch and roll by the height difference of two antennas (a scalar Kalman update).

    Only the tilt *along* the baseline is observed, ``roll b_y - pitch b_x``: a crosswise pair shows roll, a
    lengthwise pair pitch. With 1 m and RTK the sigma is 2°, so that the prior keeps most of its say.

    Parameters
    ----------
    pitch, roll : pair of float64 (n,)
        Angle and sigma, degrees.

    Returns
    -------
    pitch, roll : pair of float64 (n,)
        Unchanged where an antenna is missing.
    """
    (pitch_deg, pitch_sigma), (roll_deg, roll_sigma) = pitch, roll
    length = float(np.hypot(baseline_m[0], baseline_m[1]))
    bx, by = baseline_m[0] / length, baseline_m[1] / length
    rise = second.height_m - first.height_m - baseline_m[2]
    noise = np.degrees(VERTICAL_FACTOR * np.hypot(first.sigma_m, second.sigma_m) / length)
    innovation = np.degrees(np.arctan2(rise, length)) - (roll_deg * by - pitch_deg * bx)
    variance = (bx * pitch_sigma) ** 2 + (by * roll_sigma) ** 2 + noise**2
    # A rise that neither prior nor noise explains is a bad height, not a tilt.
    usable = np.isfinite(innovation) & (innovation**2 < 16.0 * variance)
    gain_pitch = np.where(usable, -bx * pitch_sigma**2 / variance, 0.0)
    gain_roll = np.where(usable, by * roll_sigma**2 / variance, 0.0)
    step = np.where(usable, innovation, 0.0)
    return (
        (pitch_deg + gain_pitch * step, pitch_sigma * np.sqrt(1.0 + bx * gain_pitch)),
        (roll_deg + gain_roll * step, roll_sigma * np.sqrt(1.0 - by * gain_roll)),
    )
