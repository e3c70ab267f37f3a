"""Many sightings of one object → one position: inverse-covariance weighting that honours shared errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu
from geoloc.locate.accuracy import nees
from geoloc.locate.records import Located

SIGMAS_95 = 2.4477468306808166
"""Half axis of the 95 % ellipse of a two-dimensional normal, in sigmas: √(-2 ln 0.05)."""
# χ² with two degrees of freedom, 99.9 %.
_GATE = -2.0 * np.log(0.001)
_MAX_ROUNDS = 10
# (0.1 mm)²: keeps weights finite where every source of error was set to zero.
_FLOOR_M2 = 1e-8
_NODES = 720
_RATIOS = 1025
_STEPS = 6
# From 2.2 the sixth changes only the last digit.
# Rows that are worked on at a time: their temporaries stay in the processor's cache.
_BLOCK = 4096


@dataclass(frozen=True, slots=True)
class Combined:
    """Positions of objects, one row a group, in increasing order of `group`.

    Attributes
    ----------
    group : int64 (g,)
    latitude_deg, longitude_deg, height_m : float64 (g,)
        NaN where no sighting of the group was located.
    covariance_m2 : float64 (g, 2, 2)
        East and true north.
    n_used, n_rejected : int64 (g,)
        Sightings that took part, and gross outliers. Sightings that were not located are in neither.
    range_min_m : float64 (g,)
        Of those that took part.
    used : bool (n,)
        Which sightings took part.
    """

    group: IntArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    covariance_m2: FloatArray
    n_used: IntArray
    n_rejected: IntArray
    range_min_m: FloatArray
    used: BoolArray


def combine(located: Located, group: ArrayLike) -> Combined:
    """Combine the sightings of each object.

    Each sighting weighs as the inverse W of its total covariance. The covariance of the result keeps random
    and systematic parts apart: random ones average out, one sigma of a systematic source moves all sightings
    together, so that with ``G_i = (Σ W)⁻¹ W_i``::

        C = Σ G_i R_i G_iᵀ + (Σ G_i S_i) (Σ G_i S_i)ᵀ

    Gross outliers are left out: first those beyond the 99.9 % ellipse about the weighted median, then about
    the mean of the rest until nothing changes. The best half of a group always stays.

    Parameters
    ----------
    located : Located (n,)
    group : array_like of int (n,)
        Which object a sighting belongs to; negative: none.

    Returns
    -------
    Combined
    """
    label = np.asarray(group, dtype=np.int64)
    names = np.unique(label[label >= 0])
    rows = np.flatnonzero(located.valid & (label >= 0))
    rows = rows[np.argsort(label[rows], kind="stable")]
    index = np.searchsorted(names, label[rows])
    g = names.size
    east, north, anchor = _local(located, rows, index, g)
    plane = np.stack([east, north], axis=1)
    covariance = located.covariance_m2[rows] + _FLOOR_M2 * np.eye(2)
    weight = _inverse(covariance)
    inlier = _inliers(plane, covariance, weight, index, g)
    mean, inverse = _weighted_mean(plane, weight, index, g, inlier)
    lat, lon = geographic_from_enu(anchor[:, 0], anchor[:, 1], mean[:, 0], mean[:, 1])
    trace = (weight[:, 0, 0] + weight[:, 1, 1]) * inlier
    used = np.zeros(label.size, dtype=bool)
    used[rows] = inlier
    nearest = np.full(g, np.inf)
    starts = np.flatnonzero(np.diff(index[inlier], prepend=-1))
    if starts.size:
        nearest[index[inlier][starts]] = np.minimum.reduceat(located.range_m[rows[inlier]], starts)
    n_used = np.bincount(index[inlier], minlength=g)
    with np.errstate(invalid="ignore"):
        height = _sums(trace * located.height_m[rows], index, g) / _sums(trace, index, g)
    return Combined(
        group=names,
        latitude_deg=lat,
        longitude_deg=lon,
        height_m=height,
        covariance_m2=_covariance(located, rows[inlier], weight[inlier], index[inlier], inverse),
        n_used=n_used,
        n_rejected=np.bincount(index, minlength=g) - n_used,
        range_min_m=np.where(n_used > 0, nearest, np.nan),
        used=used,
    )


def ellipse(covariance_m2: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Axes of the one-sigma ellipse.

    Parameters
    ----------
    covariance_m2 : array_like (..., 2, 2)
        East, north.

    Returns
    -------
    sigma_major_m, sigma_minor_m : float64 (...)
    azimuth_deg : float64 (...)
        Of the major axis, clockwise from north, in [0, 180). A circle has 0.
    """
    c = np.asarray(covariance_m2, dtype=np.float64)
    a, b, d = c[..., 0, 0], (c[..., 0, 1] + c[..., 1, 0]) / 2.0, c[..., 1, 1]
    centre, radius = (a + d) / 2.0, np.hypot((a - d) / 2.0, b)
    azimuth = np.degrees(np.arctan2(2.0 * b, d - a)) / 2.0 % 180.0
    # -1e-17 % 180 is 180.0 in floating point.
    azimuth = np.where(azimuth >= 180.0, 0.0, azimuth)
    return np.sqrt(centre + radius), np.sqrt(np.maximum(centre - radius, 0.0)), azimuth


def ring95_m(covariance_m2: ArrayLike, count: int) -> FloatArray:
    """Corners of the 95 % ellipse about a position, anticlockwise.

    Parameters
    ----------
    covariance_m2 : array_like (..., 2, 2)
        East, north.
    count : int

    Returns
    -------
    float64 (..., count, 2)
        East and north of the position; the first is not repeated.
    """
    major, minor, azimuth_deg = (axis[..., None] for axis in ellipse(covariance_m2))
    azimuth, turn = np.radians(azimuth_deg), np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    along, across = SIGMAS_95 * major * np.cos(turn), SIGMAS_95 * minor * np.sin(turn)
    east = along * np.sin(azimuth) - across * np.cos(azimuth)
    north = along * np.cos(azimuth) + across * np.sin(azimuth)
    return np.stack([east, north], axis=-1)


def cep95_m(covariance_m2: ArrayLike) -> FloatArray:
    """Radius of the circle about the estimate that holds the truth with 95 % probability.

    Parameters
    ----------
    covariance_m2 : array_like (..., 2, 2)

    Returns
    -------
    float64 (...)
        2.4477 σ for a circle, 1.9600 σ for a line.

    Notes
    -----
    With σ₁, σ₂ the axes, ``P(R) = 1 - (1/2π) ∫ exp(-R² / 2(σ₁² cos² ψ + σ₂² sin² ψ)) dψ``, solved for R/σ₁ on
    a grid of σ₂/σ₁ and interpolated: relative error below 1e-6.
    """
    major, minor, _ = ellipse(covariance_m2)
    ratio, factor = _cep95_table()
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(major > 0, minor / major, 0.0)
    return np.asarray(major * np.interp(share, ratio, factor))


@cache
def _cep95_table() -> tuple[FloatArray, FloatArray]:
    """R/σ₁ for ratios σ₂/σ₁ from 0 to 1, by Newton's method."""
    ratio = np.linspace(0.0, 1.0, _RATIOS)
    # Midpoints: no node falls on ψ = 90°, where a ratio of 0 divides by 0.
    psi = (np.arange(_NODES) + 0.5) * (np.pi / 2.0 / _NODES)
    falling = -0.5 / (np.cos(psi) ** 2 + (ratio[:, None] * np.sin(psi)) ** 2)
    radius = np.full(_RATIOS, 2.2)
    for _ in range(_STEPS):
        outside = np.exp(radius[:, None] ** 2 * falling)
        slope = 2.0 * radius * np.mean(falling * outside, axis=1)
        radius = radius - (np.mean(outside, axis=1) - 0.05) / slope
    return ratio, radius


def _sums(values: FloatArray, index: IntArray, g: int) -> FloatArray:
    """Sum rows ``(k, ...)`` by group → ``(g, ...)``; `index` does not decrease."""
    total = np.zeros((g, *values.shape[1:]))
    if index.size:
        start = np.flatnonzero(np.diff(index, prepend=-1))
        total[index[start]] = np.add.reduceat(values, start, axis=0)
    return total


def _local(
    located: Located, rows: IntArray, index: IntArray, g: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """East and north of each row from its group's first row, and those anchors (g, 2)."""
    anchor = np.full((g, 2), np.nan)
    lat, lon = located.latitude_deg[rows], located.longitude_deg[rows]
    first = np.flatnonzero(np.diff(index, prepend=-1))
    anchor[index[first]] = np.stack([lat[first], lon[first]], axis=1)
    east, north = enu_offset(anchor[index, 0], anchor[index, 1], lat, lon)
    return east, north, anchor


def _weighted_mean(
    plane: FloatArray, weight: FloatArray, index: IntArray, g: int, inlier: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Mean of the inliers (g, 2), NaN for an empty group, and the inverse of their summed weights."""
    own, w, p = index[inlier], weight[inlier], plane[inlier]
    total = _sums(w, own, g)
    total[np.bincount(own, minlength=g) == 0] = np.nan
    inverse = _inverse(total)
    pull = np.stack([w[:, k, 0] * p[:, 0] + w[:, k, 1] * p[:, 1] for k in (0, 1)], axis=1)
    return (inverse @ _sums(pull, own, g)[:, :, None])[:, :, 0], inverse


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverses of symmetric 2 x 2 matrices (..., 2, 2), NaN for NaN: ten times faster than LAPACK's."""
    a, b, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-b, a], axis=-1)], axis=-2)
    return np.asarray(adjugate / (a * d - b * b)[..., None, None])


def _covariance(
    located: Located, rows: IntArray, weight: FloatArray, index: IntArray, inverse: FloatArray
) -> FloatArray:
    """Covariance of the groups' means from the rows that take part: `inverse` is (Σ W)⁻¹, NaN if empty.

    That factor is the same for a whole group, so that only ``W R W`` and ``W S`` are summed row by row.
    """
    g = inverse.shape[0]
    random = np.zeros((g, 2, 2))
    shared = np.zeros((g, 2, located.systematic_m.shape[2]))
    for start in range(0, rows.size, _BLOCK):
        part = slice(start, start + _BLOCK)
        w, own = weight[part], index[part]
        first = np.flatnonzero(np.diff(own, prepend=-1))
        both = (
            _times(w, _times(located.random_m2[rows[part]], w)),
            _times(w, located.systematic_m[rows[part]]),
        )
        for total, values in zip((random, shared), both, strict=True):
            total[own[first]] += np.add.reduceat(values, first, axis=0)
    shared = inverse @ shared
    return np.asarray(inverse @ random @ inverse + shared @ np.swapaxes(shared, 1, 2))


def _times(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a @ b`` of many 2 x 2 and 2 x k matrices, as two products that NumPy does for all rows at once."""
    return np.asarray(a[:, :, :1] * b[:, :1] + a[:, :, 1:] * b[:, 1:])


def _inliers(
    plane: FloatArray, covariance: FloatArray, weight: FloatArray, index: IntArray, g: int
) -> BoolArray:
    """Find the rows that are no gross outliers."""
    centre = np.stack(
        [_weighted_median(plane[:, axis], weight[:, axis, axis], index, g) for axis in (0, 1)], axis=1
    )
    inlier = np.zeros(index.size, dtype=bool)
    for _ in range(_MAX_ROUNDS):
        distance = nees(plane - centre[index], covariance)
        previous, inlier = inlier, distance <= _GATE
        # Where nothing is beyond the gate the best half is in anyway.
        torn = np.flatnonzero((np.bincount(index[~inlier], minlength=g) > 0)[index])
        inlier[torn] |= _best_half(distance[torn], index[torn], g)
        if np.array_equal(previous, inlier):
            break
        centre, _ = _weighted_mean(plane, weight, index, g, inlier)
    return inlier


def _best_half(distance: FloatArray, index: IntArray, g: int) -> BoolArray:
    """Mark the half of each group (rounded up) with the smallest distances."""
    order = np.lexsort((distance, index))
    size = np.bincount(index, minlength=g)
    start = np.cumsum(size) - size
    rank = np.arange(index.size) - start[index[order]]
    best = np.zeros(index.size, dtype=bool)
    best[order] = rank < (size[index[order]] + 1) // 2
    return best


def _weighted_median(value: FloatArray, weight: FloatArray, index: IntArray, g: int) -> FloatArray:
    """Lower weighted median of each group; NaN for an empty one."""
    order = np.lexsort((value, index))
    cumulative = np.cumsum(weight[order])
    total = _sums(weight, index, g)
    before = np.cumsum(total) - total
    reached = cumulative - before[index[order]] >= 0.5 * total[index[order]] * (1.0 - 1e-9)
    median = np.full(g, np.nan)
    # Backwards, so that the first row that reaches half the weight is written last.
    hit = order[reached][::-1]
    median[index[hit]] = value[hit]
    return median
