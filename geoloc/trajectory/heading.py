"""Heading of the car from GNSS: two antennas, or the course of its track, before anything is smoothed.

Units of this module: seconds, metres and metres a second east and north; lever arms in the rig frame (FLU).
Headings are degrees clockwise from true north, yaws radians counter-clockwise from east.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.earth.geodesy import enu_offset, wrap_deg
from geoloc.trajectory.fix_checks import sigma_of_fixes
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.poses import GnssFixes

MOVING_MPS = 1.0
"""Below this speed a course says nothing about the heading."""
MIN_BASELINE_M = 0.3
"""Antennas closer than this give no heading."""
LIMIT_DEG = 15.0
"""A heading that is less sure than this is none."""

# A course is taken where its sigma is below 20°.
_COURSE_NOISE = 0.35
# A track that goes on in the opposite direction, from where it stopped, is that of a car that reverses.
_REVERSAL_DEG = 120.0
_REVERSAL_WITHIN_M = 3.0

HEADING_OFF_DEG = 5.0
"""A receiver's heading that differs more than this from the course of a whole drive is not the car's."""
# The course at a fix is that of the chord from a second before it to a second after it, where the car drives.
_CHORD_S = 1.0
_LONGEST_CHORD_S = 4.0
_FIX_LASTS_S = 10.0
_FAST_MPS = 3.0
# Enough driving to tell, and how alike the differences must be for their mean to be an angle of mounting.
_TOLD_BY_M = 50.0
_ALIKE = 0.7


def course_over_ground(velocity_mps: FloatArray) -> FloatArray:
    """Direction of travel of velocities ``(n, 2 or 3)``: degrees clockwise from true north, in [0, 360)."""
    return np.degrees(np.arctan2(velocity_mps[..., 0], velocity_mps[..., 1])) % 360.0


def heading_from_baseline(
    east_m: FloatArray, north_m: FloatArray, noise_m: FloatArray, baseline_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Heading of the car from the line between two antennas.

    Parameters
    ----------
    east_m, north_m : float64 (n,)
        From the first antenna to the second; NaN where one is missing.
    noise_m : float64 (n,)
        One sigma of that, an axis.
    baseline_m : float64 (3,)
        Second lever arm minus first, rig frame.

    Returns
    -------
    heading_deg, sigma_deg : float64 (n,)
        The direction in which the baseline is mounted is taken off. NaN where an antenna is missing, where
        sigma exceeds 15°, or where their distance differs from the rig's by more than four sigma and the
        tolerance of `length_tolerance_m`.
    """
    mounted = float(np.hypot(baseline_m[0], baseline_m[1]))
    off = np.abs(np.hypot(east_m, north_m) - mounted)
    sigma = np.degrees(noise_m / mounted)
    usable = (off < np.maximum(length_tolerance_m(mounted), 4.0 * noise_m)) & (sigma < LIMIT_DEG)
    azimuth = np.degrees(np.arctan2(east_m, north_m))
    heading = (azimuth + np.degrees(np.arctan2(baseline_m[1], baseline_m[0]))) % 360.0
    return np.where(usable, heading, np.nan), np.where(usable, sigma, np.nan)


def length_tolerance_m(mounted_m: float) -> float:
    """How far a measured baseline may differ from the mounted one before one of them is wrong."""
    return min(0.25, 0.05 + 0.2 * mounted_m)


def moving(velocity_mps: FloatArray, sigma_mps: FloatArray) -> BoolArray:
    """True where velocities ``(n, 2)`` tell a course, given their sigma an axis ``(n,)``."""
    speed = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
    return np.asarray((speed > MOVING_MPS) & (sigma_mps < _COURSE_NOISE * speed))


def first_yaw(
    t_s: FloatArray,
    place_m: FloatArray,
    velocity_mps: FloatArray,
    sigma_mps: FloatArray,
    baseline_deg: FloatArray,
    turned_rad: FloatArray | None = None,
) -> FloatArray:
    """A yaw to start smoothing from: of the baseline where it is known, else of the course, else between.

    Parameters
    ----------
    t_s : float64 (n,)
    place_m, velocity_mps : float64 (n, 2)
        Of an antenna, east and north.
    sigma_mps : float64 (n,)
        Of a velocity's axis.
    baseline_deg : float64 (n,)
        `heading_from_baseline`, NaN where unknown.
    turned_rad : float64 (n,), optional
        By how much the car has turned since the first knot, as it measured itself: between known yaws it
        turns like that.

    Returns
    -------
    float64 (n,)
        Radians, not wrapped; 0 where the drive says nothing at all.
    """
    line = np.radians(90.0 - baseline_deg)
    seen, driven = np.isfinite(line), moving(velocity_mps, sigma_mps)
    course = np.arctan2(velocity_mps[:, 1], velocity_mps[:, 0])
    course = course + np.pi * _reversed(course, driven, place_m, line)
    yaw = np.where(seen, line, course)
    known = seen | driven
    if not known.any():
        return np.zeros_like(t_s)
    turns = np.zeros_like(t_s) if turned_rad is None else turned_rad
    off = np.unwrap(yaw[known] - turns[known])
    return np.asarray(np.interp(t_s, t_s[known], off)) + turns


def _reversed(
    course_rad: FloatArray, driven: BoolArray, place_m: FloatArray, line_rad: FloatArray
) -> BoolArray:
    """True where the car reverses: by the baseline, else by how the track goes on after each stop.

    Where no baseline ever says so, most of a drive goes ahead.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], driven, [False]]).astype(np.int8)))
    runs = edges.reshape(-1, 2)
    result = np.zeros(driven.size, dtype=bool)
    backwards, told, driven_m = False, False, np.zeros(2)
    for i, (first, end) in enumerate(runs):
        agree = np.cos(course_rad[first:end] - line_rad[first:end])
        if np.isfinite(agree).any():
            backwards, told = bool(np.nanmedian(agree) < 0.0), True
        elif i:
            last = runs[i - 1, 1] - 1
            turn = np.degrees(course_rad[first] - course_rad[last])
            near = np.hypot(*(place_m[first] - place_m[last])) < _REVERSAL_WITHIN_M
            backwards ^= bool(near and abs(wrap_deg(turn)) > _REVERSAL_DEG)
        result[first:end] = backwards
        driven_m[int(backwards)] += np.hypot(*np.diff(place_m[first:end], axis=0).T).sum()
    return result if told or driven_m[1] <= driven_m[0] else ~result


class CourseCheck(NamedTuple):
    """A receiver's headings held against the course of its antenna."""

    driven_m: float
    """How much driving there was to tell by."""
    off_deg: float
    """Course minus heading, in the mean over the way: NaN where little was driven."""
    sigma_deg: float
    alike: float
    """From 0, the differences are any angle, to 1, they are all one angle."""

    @property
    def told(self) -> bool:
        """Whether the car drove enough for a comparison."""
        return self.driven_m >= _TOLD_BY_M

    @property
    def constant(self) -> bool:
        """Whether one angle of mounting explains the differences."""
        return self.told and self.alike >= _ALIKE

    @property
    def contradicts(self) -> bool:
        """Whether the headings are not those of the car."""
        return self.told and (
            not self.constant or abs(self.off_deg) > max(HEADING_OFF_DEG, 3.0 * self.sigma_deg)
        )


def heading_against_course(fixes: GnssFixes) -> CourseCheck:
    """Hold a receiver's headings against its antenna's course.

    Reversing counts against, so that most of a drive must go ahead.

    Parameters
    ----------
    fixes : GnssFixes
        In order of time.
    """
    at = np.flatnonzero(np.isfinite(fixes.heading_deg))
    chord_ns = int(_CHORD_S * NANOSECONDS)
    before = np.searchsorted(fixes.epoch_ns, fixes.epoch_ns[at] - chord_ns)
    after = np.searchsorted(fixes.epoch_ns, fixes.epoch_ns[at] + chord_ns, side="right") - 1
    apart_s = (fixes.epoch_ns[after] - fixes.epoch_ns[before]) / NANOSECONDS
    east, north = enu_offset(
        *(column[rows] for rows in (before, after) for column in (fixes.latitude_deg, fixes.longitude_deg))
    )
    step = np.hypot(east, north)
    sigma = sigma_of_fixes(fixes.quality, fixes.sigma_horizontal_m)
    noise = np.hypot(sigma[before], sigma[after])
    good = (apart_s > 0.0) & (apart_s <= _LONGEST_CHORD_S)
    good &= step > np.maximum(_FAST_MPS * apart_s, 3.0 * noise)
    # Chords overlap: each stands for the way driven since the last heading.
    since_s = np.minimum(np.diff(fixes.epoch_ns[at], prepend=fixes.epoch_ns[at][:1]) / NANOSECONDS, _CHORD_S)
    way = np.where(good, step / np.maximum(apart_s, 1e-9) * since_s, 0.0)
    driven_m = float(way.sum())
    if driven_m < _TOLD_BY_M:
        return CourseCheck(driven_m, np.nan, np.nan, np.nan)
    off = np.arctan2(east, north) - np.radians(fixes.heading_deg[at])
    mean = complex((way * np.exp(1j * off)).sum() / driven_m)
    # Errors of fixes last: as if there were one chord in ten seconds.
    chords = max(1.0, float(since_s[good].sum()) / _FIX_LASTS_S)
    sigma_deg = float(np.degrees(np.median(noise[good] / step[good])) / np.sqrt(chords))
    return CourseCheck(driven_m, float(np.degrees(np.angle(mean))), sigma_deg, abs(mean))
