"""Checks on recorded fixes and poses before a trajectory is made of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import metres_per_degree
from geoloc.errors import TrajectoryError
from geoloc.trajectory.interpolation import NANOSECONDS

MAX_SPEED_MPS = 70.0
"""Faster than this between two fixes, one of them is wrong."""
_SLACK_M = 0.5
"""Noise of a position: between epochs nanoseconds apart, as some loggers write them, it is no speed."""

SIGMA_BY_QUALITY_M = {4: 0.015, 5: 0.3, 2: 0.6, 1: 2.0, 6: 2.0}
"""Horizontal sigma by GGA fix quality: RTK fixed (CPOS states 8 to 14 mm), float, DGNSS, single, dead
reckoning."""
_SIGMA_OTHERWISE_M = 5.0
SIGMA_FLOOR_M = 0.01
"""What receivers state below this is formal: base station and atmosphere are not in it."""
_NAMES = {1: "single", 2: "DGNSS", 4: "RTK fixed", 5: "RTK float", 6: "dead reckoning"}
_FIXED, _FLOAT = 4, 5
# Filters lag by 0.1 to 0.2 s in ordinary receivers, and none is early: mean and sigma of half of a normal
# distribution of 0.15 s.
_FILTER_LAG_S = (0.12, 0.09)
_AS_GOOD_AS_FIXED_M = 0.05
MULTIPATH_S = 10.0
"""Correlation time of reflections as a car moves past them."""
CODE_LASTS_S = 120.0
"""The same of what code solutions err by: the atmosphere, and which satellites are in view."""
VERTICAL_FACTOR = 1.7
"""Vertical sigma of a fix over its horizontal one, where the receiver does not say."""

HEADING_SIGMA_DEG = 0.5
"""Of a receiver's own heading, where it does not say: 0.3° over a metre between antennas."""
VELOCITY_SIGMA_MPS = (0.05, 0.1)
"""Of a velocity from Doppler shifts, where the receiver does not say: a horizontal axis, and the vertical."""

# Most of a fix's error outlasts the passage of a sign and moves everything with the car.
_CHANGING_SHARE, _CHANGING_AT_MOST_M = 0.5, 0.3
CHANGES_WITHIN_S = 2.0
"""How long that lasts which is another one after seconds of a drive."""


class _Positions(Protocol):
    """What fixes and poses have in common."""

    @property
    def epoch_ns(self) -> IntArray: ...
    @property
    def latitude_deg(self) -> FloatArray: ...
    @property
    def longitude_deg(self) -> FloatArray: ...
    @property
    def height_m(self) -> FloatArray: ...


class _Rated(Protocol):
    """What fixes say of how good they are."""

    @property
    def quality(self) -> IntArray: ...
    @property
    def sigma_horizontal_m(self) -> FloatArray: ...


def sigma_of_quality(quality: IntArray) -> FloatArray:
    """Horizontal one sigma, metres, of GGA fix qualities; 5 m for a code that is not in the table."""
    sigma = np.full(quality.shape, _SIGMA_OTHERWISE_M)
    for code, value in SIGMA_BY_QUALITY_M.items():
        sigma[quality == code] = value
    return sigma


def sigma_of_fixes(quality: IntArray, stated_m: FloatArray) -> FloatArray:
    """Horizontal one sigma, metres: as stated, at least 1 cm; that of the quality where it is NaN."""
    stated = np.isfinite(stated_m)
    return np.where(stated, np.maximum(stated_m, SIGMA_FLOOR_M), sigma_of_quality(quality))


def up_over_plane(stated_up_m: FloatArray, horizontal_m: FloatArray) -> FloatArray:
    """Vertical sigma of fixes over their horizontal one: as stated, at least 1.7 cm; 1.7 where it is NaN."""
    stated = np.maximum(stated_up_m, VERTICAL_FACTOR * SIGMA_FLOOR_M) / horizontal_m
    return np.where(np.isfinite(stated), stated, VERTICAL_FACTOR)


class FixNoise(NamedTuple):
    """Noise of fixes, float64 (n,) each.

    Attributes
    ----------
    sigma_m : float64 (n,)
        One sigma a horizontal axis, in all.
    white_m, slow_m : float64 (n,)
        What two antennas of one car do *not* share of it: new at every fix, and lasting.
    slow_lasts_s : float64 (n,)
        Correlation time of what lasts.
    white_every_s : float64 (n,)
        Fixes of this time count as one, since what is new in them is not quite new at each; 0: each counts.
    """

    sigma_m: FloatArray
    white_m: FloatArray
    slow_m: FloatArray
    slow_lasts_s: FloatArray
    white_every_s: FloatArray


def noise_of_fixes(quality: IntArray, stated_m: FloatArray) -> FixNoise:
    """What fixes err by, and how long that lasts.

    Parameters
    ----------
    quality : int64 (n,)
        GGA fix quality.
    stated_m : float64 (n,)
        One sigma a horizontal axis by the receiver, NaN where it does not say.

    Notes
    -----
    A fixed solution is 6 mm of carrier-phase noise and 5 mm of multipath that lasts for seconds; the rest of
    its 15 mm is atmosphere and base station, the same for both antennas. Other solutions err by ambiguities
    and code, each its own: most of it by the atmosphere and the satellites' geometry, which change over
    minutes, and some by reflections that last for seconds.
    """
    sigma = sigma_of_fixes(quality, stated_m)
    fixed = as_good_as_fixed(quality, stated_m)
    return FixNoise(
        sigma,
        0.4 * sigma,
        np.where(fixed, 0.33, 0.9) * sigma,
        np.where(fixed, MULTIPATH_S, CODE_LASTS_S),
        np.where(fixed, 0.0, MULTIPATH_S),
    )


def changing_m(sigma_m: FloatArray, wander_m2ps: float = np.inf) -> FloatArray:
    """That part of what places are off, one sigma, which is another one after seconds of a drive.

    Where velocities bridge the time between places, these come apart no faster than they let them wander:
    a part that lasts for τ does so by 2 σ² / τ.

    Parameters
    ----------
    sigma_m : float64 (n,)
        Of the places.
    wander_m2ps : float
        By how much the variance of a place grows in a second that velocities alone bridge; infinite without.
    """
    by_velocities_m = np.sqrt(0.5 * wander_m2ps * CHANGES_WITHIN_S)
    return np.minimum(np.minimum(_CHANGING_SHARE * sigma_m, _CHANGING_AT_MOST_M), by_velocities_m)


def as_good_as_fixed(quality: IntArray, stated_m: FloatArray) -> BoolArray:
    """Whether each fix is a carrier-phase solution: by its quality, or by what the receiver states."""
    return np.asarray((quality == _FIXED) | (stated_m < _AS_GOOD_AS_FIXED_M))


def lateness_s(fixes: Sequence[_Rated]) -> tuple[float, float]:
    """How late positions are against their epochs, and one sigma of that.

    Receivers without a carrier-phase solution: 0.12 ± 0.09 s, else 0.
    """
    quality = np.concatenate([one.quality for one in fixes])
    stated = np.concatenate([one.sigma_horizontal_m for one in fixes])
    carrier = as_good_as_fixed(quality, stated) | (quality == _FLOAT)
    return (0.0, 0.0) if carrier.mean() >= 0.5 else _FILTER_LAG_S


def check_positions(positions: _Positions, what: str) -> None:
    """Refuse positions that no trajectory can be made of.

    Raises
    ------
    TrajectoryError
        Fewer than two, not in strict time order, NaN, or not on Earth.
    """
    n = positions.epoch_ns.size
    if n < 2:
        raise TrajectoryError(f"{what}: {n} usable positions, a trajectory needs at least 2: record more.")
    backwards = np.diff(positions.epoch_ns) <= 0
    if backwards.any():
        raise TrajectoryError(
            f"{what}: {backwards.sum()} of {n} positions are not later than the one before (first: number "
            f"{int(np.argmax(backwards)) + 1}): sort them by time and drop duplicates."
        )
    bad = ~(np.isfinite(positions.longitude_deg) & np.isfinite(positions.height_m))
    bad |= ~(np.abs(positions.latitude_deg) <= 90.0)
    if bad.any():
        raise TrajectoryError(
            f"{what}: {bad.sum()} of {n} positions are NaN or not on Earth (first: number "
            f"{int(np.argmax(bad))}): drop them before making a trajectory."
        )


def without_jumps(positions: _Positions) -> BoolArray:
    """Mask of the positions that a car can have reached.

    The track is cut where the implied speed exceeds 70 m/s, and the shortest piece is dropped until no cut is
    left: one wild fix goes, however good its neighbours look to it.

    Returns
    -------
    bool (n,)
    """
    east, north = metres_per_degree(positions.latitude_deg)
    t_s = (positions.epoch_ns - positions.epoch_ns[0]) / NANOSECONDS
    keep = np.arange(positions.epoch_ns.size)
    while keep.size > 1:
        step = np.hypot(
            np.diff(positions.longitude_deg[keep]) * east[keep[1:]],
            np.diff(positions.latitude_deg[keep]) * north[keep[1:]],
        )
        cuts = np.flatnonzero(step > MAX_SPEED_MPS * np.diff(t_s[keep]) + _SLACK_M) + 1
        if cuts.size == 0:
            break
        pieces = np.split(keep, cuts)
        shortest = min(piece.size for piece in pieces)
        keep = np.concatenate(_without_pieces_of(pieces, shortest))
    mask = np.zeros(positions.epoch_ns.size, dtype=bool)
    mask[keep] = True
    return mask


def _without_pieces_of(pieces: Sequence[IntArray], size: int) -> list[IntArray]:
    """Drop the first piece of this size, and further ones that do not touch a dropped one."""
    kept: list[IntArray] = []
    previous_dropped = False
    for piece in pieces:
        drop = piece.size == size and not previous_dropped
        if not drop:
            kept.append(piece)
        previous_dropped = drop
    return kept


def common_epochs(epochs_ns: Sequence[IntArray], max_gap_s: float) -> IntArray:
    """Epochs at which several antennas are brought together.

    Those of the antenna with the most fixes, and those of the others where it has gaps: two receivers a few
    milliseconds apart must not make knots a few milliseconds apart.
    """
    base = max(epochs_ns, key=len)
    for other in epochs_ns:
        position = np.searchsorted(base, other)
        before = base[np.maximum(position - 1, 0)]
        after = base[np.minimum(position, base.size - 1)]
        nearest_ns = np.minimum(np.abs(other - before), np.abs(after - other))
        outside = (other < base[0]) | (other > base[-1])
        lonely = outside | (after - before > max_gap_s * NANOSECONDS)
        apart = nearest_ns > 0.5 * np.median(np.diff(base))
        base = np.union1d(base, other[lonely & apart])
    return np.asarray(base, dtype=np.int64)


def quality_counts(quality: IntArray) -> dict[str, int]:
    """Fixes by GGA quality, in words, in the order of the standard's numbers."""
    values, counts = np.unique(quality, return_counts=True)
    return {_NAMES.get(int(q), f"quality {q}"): int(n) for q, n in zip(values, counts, strict=True)}
