"""How good recorded poses are that do not say it: from the track itself.

Three things tell. A pose that jumps from its neighbours, where a car moves smoothly, is noise of that pose
alone: it is smoothed away. A car moves along its heading: how far the track steps aside from its own heading
is an error of either, and how that grows with the time between two poses tells which. And a car climbs as it
pitches. What is the same for the whole drive shows in none of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu, wrap_deg
from geoloc.trajectory.interpolation import seconds
from geoloc.trajectory.poses import PoseTrack

SIGMA_FLOORS = (0.02, 0.03, 0.05, 0.05)
"""Horizontal and vertical place (m), roll and pitch, heading (degrees): no INS in a car is better than that
by itself, whatever its track looks like."""
UNKNOWN = (0.3, 0.5, 0.5, 0.5)
"""The same of a track that is too short, too sparse or too slow to tell: an INS with differential GNSS."""

# Errors of an INS last for seconds to minutes.
_LASTING = 1.5
"""A part of them changes too slowly to be seen in a few seconds."""
_LASTS_S = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
# Heading over place of what INS with and without corrections state: 0.1° and 3 cm, 0.5° and 0.3 m.
_DEG_PER_M = 2.0
_AS_WELL = 0.15
_LAGS_S, _FEWEST_LAGS = (0.5, 1.0, 2.0, 4.0, 8.0), 3
_LEAST_MPS, _MOST_TURN_DEGPS = 3.0, 3.0
_FEWEST = 20
# Poses further apart than this do not show what a car does between them.
_SPARSE_S = 0.6
_HALF_WINDOWS_S = (0.0, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0)
# What a window of half a second takes off the motion itself: the ends of bends, and the body's bounce.
_TAKEN_M, _TAKEN_HEADING_DEG, _TAKEN_TILT_DEG = 0.01, 0.05, 0.12
_MAD = 1.4826


class PoseSigmas(NamedTuple):
    """One sigma of poses: horizontal axis and height (m), roll and pitch, heading (degrees)."""

    horizontal_m: float
    vertical_m: float
    roll_pitch_deg: float
    heading_deg: float


_COLUMNS = ("sigma_horizontal_m", "sigma_vertical_m", "sigma_roll_pitch_deg", "sigma_heading_deg")


def with_estimated_sigmas(track: PoseTrack) -> tuple[PoseTrack, PoseSigmas | None]:
    """Give poses without sigmas those that the track shows, and take off its noise from pose to pose.

    Parameters
    ----------
    track : PoseTrack
        Sigmas are NaN where they are not stated. A column with some takes their median for the others.

    Returns
    -------
    PoseTrack
    PoseSigmas or None
        What was taken, NaN for what the track states; None where it states all.
    """
    stated = {name: getattr(track, name) for name in _COLUMNS}
    unknown = np.array([bool(np.isnan(column).all()) for column in stated.values()])
    track = replace(
        track,
        **{
            name: np.where(np.isnan(column), np.nanmedian(column), column)
            for (name, column), none in zip(stated.items(), unknown, strict=True)
            if not none
        },
    )
    if not unknown.any():
        return track, None
    motion = _Motion.of(track)
    smooth, left = motion.smoothed() if motion.is_dense() else (motion, np.zeros(4))
    found = _lasting(smooth, left) if motion.is_dense() else None
    sigmas = UNKNOWN if found is None else np.maximum(np.hypot(found, left), SIGMA_FLOORS)
    taken = PoseSigmas(*np.where(unknown, sigmas, np.nan).tolist())
    filled = {
        name: np.full(track.epoch_ns.size, sigma)
        for name, sigma, none in zip(_COLUMNS, taken, unknown, strict=True)
        if none
    }
    return replace(smooth.as_track(track) if motion.is_dense() else track, **filled), taken


class _Motion(NamedTuple):
    """Places (n, 3) about the first, east, north and up; roll, pitch and unwrapped heading (n, 3), °."""

    time_s: FloatArray
    place_m: FloatArray
    angle_deg: FloatArray

    @classmethod
    def of(cls, track: PoseTrack) -> _Motion:
        east, north = enu_offset(
            track.latitude_deg[0], track.longitude_deg[0], track.latitude_deg, track.longitude_deg
        )
        turned = np.unwrap(track.heading_deg, period=360.0)
        return cls(
            seconds(track.epoch_ns),
            np.stack([east, north, track.height_m], axis=1),
            np.stack([track.roll_deg, track.pitch_deg, turned], axis=1),
        )

    def as_track(self, like: PoseTrack) -> PoseTrack:
        before = _Motion.of(like)
        east, north, up = (self.place_m - before.place_m).T
        lat, lon = geographic_from_enu(like.latitude_deg, like.longitude_deg, east, north)
        roll, pitch, heading = self.angle_deg.T
        return replace(
            like,
            latitude_deg=lat,
            longitude_deg=lon,
            height_m=like.height_m + up,
            roll_deg=wrap_deg(roll),
            pitch_deg=pitch,
            heading_deg=np.mod(heading, 360.0),
        )

    def is_dense(self) -> bool:
        """Whether neighbouring poses show what a car does between them."""
        return self.time_s.size >= _FEWEST and float(np.median(np.diff(self.time_s))) <= _SPARSE_S

    def smoothed(self) -> tuple[_Motion, FloatArray]:
        """Take off what each pose has for itself, and tell what of it is left (4,)."""
        columns, left = [], []
        taken = (_TAKEN_M,) * 3 + (_TAKEN_TILT_DEG,) * 2 + (_TAKEN_HEADING_DEG,)
        for values, lost in zip((*self.place_m.T, *self.angle_deg.T), taken, strict=True):
            column, sigma = _smoothed(self.time_s, values, lost)
            columns.append(column)
            left.append(sigma)
        east, north, up, roll, pitch, heading = left
        place, angle = np.stack(columns[:3], axis=1), np.stack(columns[3:], axis=1)
        return _Motion(self.time_s, place, angle), np.array([max(east, north), up, max(roll, pitch), heading])


def _smoothed(time_s: FloatArray, values: FloatArray, taken: float) -> tuple[FloatArray, float]:
    """Values (n,) by parabolas through their neighbours, over what noise and motion make the best window."""
    step_s = float(np.median(np.diff(time_s)))
    residual = values - _parabolas(time_s, values, 2)
    # A parabola through five even points leaves 18/35 of the variance of the one in the middle.
    noise = _MAD * float(np.median(np.abs(residual))) / np.sqrt(18.0 / 35.0)

    def left(half: int) -> float:
        # … through many of them 9/4 over their number, of the variance of each.
        white = noise * (np.sqrt(9.0 / (4.0 * (2 * half + 1))) if half > 1 else 1.0)
        return float(np.hypot(white, taken * min((half * step_s / 0.5) ** 3, 1.0) * (half > 1)))

    halves = sorted({round(half_s / step_s) for half_s in _HALF_WINDOWS_S} - {1})
    best = min(halves, key=left)
    return (_parabolas(time_s, values, best) if best else values), left(best)


def _parabolas(time_s: FloatArray, values: FloatArray, half: int) -> FloatArray:
    """Least-squares parabolas through each value and `half` neighbours on either side, at the value (n,)."""
    n = values.size
    first = np.clip(np.arange(n) - half, 0, max(n - 2 * half - 1, 0))
    rows = first[:, None] + np.arange(min(2 * half + 1, n))
    away = time_s[rows] - time_s[:, None]
    # Poses beyond a gap are no neighbours.
    near = np.abs(away) <= 3.0 * half * np.median(np.diff(time_s))
    power = np.stack([np.ones_like(away), away, away**2], axis=2) * near[:, :, None]
    base = values[:, None]
    normal = np.swapaxes(power, 1, 2) @ power + 1e-9 * np.eye(3)
    right = np.swapaxes(power, 1, 2) @ (values[rows] - base)[:, :, None]
    return np.asarray(values + np.linalg.solve(normal, right)[:, 0, 0])


def _lasting(motion: _Motion, left: FloatArray) -> FloatArray | None:
    """Sigmas (4,) of errors that last, from what the track steps aside and climbs against its attitude."""
    aside = _steps(motion)
    if aside is None:
        return None
    side, climb, ahead, time_s = aside
    horizontal, heading = _place_and_angle(side, ahead, time_s, float(left[0]))
    vertical, pitch = _place_and_angle(climb, ahead, time_s, float(left[1]))
    return _LASTING * np.array([horizontal, vertical, pitch, heading])


def _steps(motion: _Motion) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
    """Steps (n,) from pose to pose aside and up against the attitude, and ahead; NaN where a car may slip."""
    step_s, turn_deg = np.diff(motion.time_s), np.diff(motion.angle_deg[:, 2])
    mean = 0.5 * (motion.angle_deg[1:] + motion.angle_deg[:-1])
    heading, pitch = np.radians(mean[:, 2]), np.radians(mean[:, 1])
    east, north, up = np.diff(motion.place_m, axis=0).T
    ahead = east * np.sin(heading) + north * np.cos(heading)
    side = east * np.cos(heading) - north * np.sin(heading)
    climb = up + ahead * np.tan(pitch)
    clear = _moves_straight(motion.time_s, ahead, turn_deg)
    clear &= step_s < 3.0 * np.median(step_s)
    if clear.sum() < _FEWEST:
        return None
    # What is the same all the way is how the poses' frame sits in the car.
    side, climb = (
        np.where(clear, x - ahead * np.median(x[clear]) / np.median(ahead[clear]), np.nan)
        for x in (side, climb)
    )
    return side, climb, ahead, motion.time_s


def _moves_straight(time_s: FloatArray, ahead_m: FloatArray, turn_deg: FloatArray) -> BoolArray:
    """Whether the car drives, and hardly turns, over the second about each step (n,)."""
    half = 0.5
    low = np.searchsorted(time_s, time_s[:-1] - half)
    high = np.minimum(np.searchsorted(time_s, time_s[1:] + half), time_s.size - 1)
    way, turned = (np.concatenate([[0.0], np.cumsum(x)]) for x in (ahead_m, turn_deg))
    span_s = np.maximum(time_s[high] - time_s[low], 1e-9)
    fast = np.abs(way[high] - way[low]) > _LEAST_MPS * span_s
    return np.asarray(fast & (np.abs(turned[high] - turned[low]) < _MOST_TURN_DEGPS * span_s))


def _place_and_angle(
    side_m: FloatArray, ahead_m: FloatArray, time_s: FloatArray, left_m: float
) -> tuple[float, float]:
    """One sigma of the place (m) and of the angle (degrees) that make these steps aside.

    How the drift grows with the lag tells how long errors last; it hardly tells a place that wanders from an
    angle that does, so that these are taken in the proportion of `_DEG_PER_M`.
    """
    lags, drifts, speeds = _drifts(side_m, ahead_m, time_s)
    if lags.size < _FEWEST_LAGS:
        return UNKNOWN[0], UNKNOWN[3]
    # What smoothing left of the noise from pose to pose is in both ends.
    square = np.maximum(drifts**2 - 2.0 * left_m**2, 0.1 * drifts**2)
    fits = []
    for lasts_s in _LASTS_S:
        t, fades = lags / lasts_s, np.exp(-lags / lasts_s)
        angle = np.radians(_DEG_PER_M) * speeds * lasts_s
        shape = np.log(2.0 * (1.0 - fades) + 2.0 * angle**2 * (t - 1.0 + fades))
        fits.append((float(np.var(np.log(square) - shape)), float(np.mean(np.log(square) - shape))))
    # Of all that fit about as well, the one with the largest errors: a few seconds tell little of a minute.
    best = min(misfit for misfit, _ in fits)
    place = float(np.exp(0.5 * max(size for misfit, size in fits if misfit < best + _AS_WELL)))
    return place, _DEG_PER_M * place


def _drifts(
    side_m: FloatArray, ahead_m: FloatArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lags (k,) in seconds, how far the track steps aside over each (m, rms), and the speed (m/s)."""
    way = np.concatenate([[0.0], np.cumsum(ahead_m)])
    drift = np.concatenate([[0.0], np.cumsum(np.nan_to_num(side_m))])
    holes = np.concatenate([[0], np.cumsum(np.isnan(side_m))])
    found = []
    for lag_s in _LAGS_S:
        last = np.searchsorted(time_s, time_s + lag_s)
        first = np.flatnonzero(last < time_s.size)
        last = last[first]
        whole = holes[last] == holes[first]
        if whole.sum() < _FEWEST:
            continue
        moved = np.abs(drift[last] - drift[first])[whole]
        rms = np.sqrt(np.mean(np.minimum(moved, 4.0 * np.median(moved)) ** 2)) + 1e-6
        found.append((lag_s, rms, np.median((way[last] - way[first])[whole]) / lag_s))
    lags, drifts, speeds = np.array(found).reshape(-1, 3).T
    return lags, drifts, speeds
