"""Points seen along bearings, in homogeneous inverse-depth form.

A point is ``anchor + (m + a e₁ + b e₂) / ρ``: seen from its anchor in the direction m + a e₁ + b e₂, at the
inverse depth ρ. Its direction from any other camera at c, ``m + a e₁ + b e₂ + ρ (anchor - c)``, is linear in
(a, b, ρ), so that a filter works from the first sighting on, and infinity is nothing special.

Civera, Davison and Montiel (2008), "Inverse depth parametrization for monocular SLAM",
doi:10.1109/TRO.2008.2003276; here with the directions as a plane instead of two angles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.association.bearings import Bearings

MIN_INVERSE_M, MAX_INVERSE_M = 1.0 / 400.0, 1.5
_ROUNDS = 25
_PLAIN_ROUNDS = 6
# The upper triangle of a matrix (3, 3), and the whole of it from that.
_PAIRS = np.triu_indices(3)
_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
# Vector products: +1 and -1 for even and odd orders of the axes.
_CROSS = np.zeros((3, 3, 3))
_CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]], _CROSS[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = 1.0, -1.0
# Cauchy weights: a residual of 3 sigma counts half.
_ROBUST_D2 = 9.0
# A ray more than 78° off the predicted direction does not see the point.
_MIN_COSINE = 0.2


@dataclass(frozen=True, slots=True)
class Points:
    """Points in inverse-depth form.

    Attributes
    ----------
    anchor_m : float64 (k, 3)
    axes : float64 (k, 3, 3)
        Rows m, e₁, e₂.
    state : float64 (k, 3)
        a, b, ρ.
    covariance : float64 (k, 3, 3)
        Of the state.
    """

    anchor_m: FloatArray
    axes: FloatArray
    state: FloatArray
    covariance: FloatArray

    def take(self, rows: IntArray | BoolArray) -> Points:
        """Those points alone."""
        return Points(*(getattr(self, name)[rows] for name in self.__slots__))

    @property
    def place_m(self) -> FloatArray:
        """Where the points are, (k, 3)."""
        return np.asarray(self.anchor_m + self._direction / self.state[:, 2:3])

    @property
    def place_covariance_m2(self) -> FloatArray:
        """Covariance of `place_m`, (k, 3, 3)."""
        rho = self.state[:, 2:3]
        columns = [self.axes[:, 1] / rho, self.axes[:, 2] / rho, -self._direction / rho**2]
        by_state = np.stack(columns, axis=2)
        return np.asarray(by_state @ self.covariance @ np.swapaxes(by_state, 1, 2))

    @property
    def vague(self) -> BoolArray:
        """Whether the depth is hardly known: its sigma more than a fifth of it."""
        return np.asarray(np.sqrt(self.covariance[:, 2, 2]) > 0.2 * self.state[:, 2])

    @property
    def _direction(self) -> FloatArray:
        a, b = self.state[:, 0:1], self.state[:, 1:2]
        return np.asarray(self.axes[:, 0] + a * self.axes[:, 1] + b * self.axes[:, 2])


class Innovations(NamedTuple):
    """How sightings differ from where points should appear, radians in the tangent plane.

    Attributes
    ----------
    z : float64 (k, 2)
        Across and up.
    H : float64 (k, 2, 3)
        Derivative of the predicted direction by the state.
    noise : float64 (k,)
        Variance of the sighting, each axis.
    ahead : bool (k,)
        False where the point does not lie before the camera near the ray; `z` means nothing there.
    """

    z: FloatArray
    H: FloatArray
    noise: FloatArray
    ahead: BoolArray

    def take(self, rows: IntArray) -> Innovations:
        """Those rows alone."""
        return Innovations(self.z[rows], self.H[rows], self.noise[rows], self.ahead[rows])

    def distance2(self, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squared Mahalanobis distance, and the log of the determinant of its covariance, (k,)."""
        S = self.H @ covariance @ np.swapaxes(self.H, 1, 2)
        p, q, r = S[:, 0, 0] + self.noise, S[:, 0, 1], S[:, 1, 1] + self.noise
        determinant = p * r - q * q
        x, y = self.z[:, 0], self.z[:, 1]
        d2 = (r * x * x - 2.0 * q * x * y + p * y * y) / determinant
        return np.where(self.ahead, d2, np.inf), np.log(determinant)


def first_points(seen: Bearings) -> Points:
    """Points of single sightings, with the depth that one picture tells."""
    variance = seen.sigma_rad**2
    axes = np.concatenate([seen.ray[:, None], _across(seen.ray, seen.up)], axis=1)
    rho = np.clip(seen.inverse_m, MIN_INVERSE_M, MAX_INVERSE_M)
    zero = np.zeros_like(rho)
    covariance = np.zeros((rho.size, 3, 3))
    diagonal = np.arange(3)
    covariance[:, diagonal, diagonal] = np.stack([variance, variance, seen.sigma_inverse_m**2], axis=1)
    return Points(seen.centre_m, axes, np.stack([zero, zero, rho], axis=1), covariance)


def innovations(seen: Bearings, rows: IntArray, points: Points, which: IntArray) -> Innovations:
    """Compare sightings and points, row by row: the sightings `rows` (k,) with the points `which` (k,)."""
    axes, state, up, ray = points.axes[which], points.state[which], seen.up[rows], seen.ray[rows]
    moves = np.empty_like(axes)
    moves[:, :2] = axes[:, 1:]
    np.subtract(points.anchor_m[which], seen.centre_m[rows], out=moves[:, 2])
    q = axes[:, 0] + (state[:, None, :] @ moves)[:, 0]
    norm = np.sqrt(np.einsum("ij,ij->i", q, q))
    f0 = q / norm[:, None]
    f = _across(f0, up)
    cosine = np.einsum("ij,ij->i", f0, ray)
    ahead = cosine > _MIN_COSINE
    z = (f @ ray[:, :, None])[:, :, 0] / np.where(ahead, cosine, 1.0)[:, None]
    H = f @ np.swapaxes(moves, 1, 2) / norm[:, None, None]
    noise = seen.sigma_rad[rows] ** 2 + (seen.sigma_m[rows] * state[:, 2] / norm) ** 2
    return Innovations(z, H, noise, ahead)


def update(points: Points, which: IntArray, found: Innovations) -> None:
    """One Kalman step for each of the points `which`, with its sighting, in place."""
    P, H = points.covariance[which], found.H
    PH = P @ np.swapaxes(H, 1, 2)
    S = H @ PH
    S[:, [0, 1], [0, 1]] += found.noise[:, None]
    gain = PH @ np.linalg.inv(S)
    state = points.state[which] + (gain @ found.z[:, :, None])[:, :, 0]
    state[:, 2] = np.clip(state[:, 2], MIN_INVERSE_M, MAX_INVERSE_M)
    points.state[which], points.covariance[which] = state, P - gain @ (H @ P)


def fit_points(seen: Bearings, group: IntArray) -> Points:
    """Triangulate every group of sightings, robustly, all groups at once.

    Parameters
    ----------
    seen : Bearings (n,)
    group : int64 (n,)
        0, 1, …, each with at least one sighting; negative: none.

    Returns
    -------
    Points (k,)
        Anchored at the foot that stands nearest, or the first face.
    """
    rows = np.argsort(group, kind="stable")[np.count_nonzero(group < 0) :]
    seen, group = seen.take(rows), group[rows]
    nearest = np.lexsort((np.arange(group.size), -seen.inverse_m, group))
    points = first_points(seen.take(nearest[np.flatnonzero(np.diff(group, prepend=-1))]))
    prior_mean, prior_weight = points.state[:, 2].copy(), 1.0 / points.covariance[:, 2, 2]
    sights = _sights(seen, points.take(group))
    for i in range(_ROUNDS):
        A, g = _equations(sights, points.state[group], group, is_plain=i < _PLAIN_ROUNDS)
        A[:, 2, 2] += prior_weight
        # Where all sightings look away there is no equation: the direction keeps to its anchor's, loosely.
        A[:, [0, 1], [0, 1]] += 1.0
        g[:, 2] += prior_weight * (prior_mean - points.state[:, 2])
        step = np.linalg.solve(A, g[:, :, None])[:, :, 0]
        step[:, :2] = np.clip(step[:, :2], -0.5, 0.5)
        state = points.state + step
        # Depth at most halves or doubles in a step.
        low, high = points.state[:, 2] / 2.0, points.state[:, 2] * 2.0
        state[:, 2] = np.clip(np.clip(state[:, 2], low, high), MIN_INVERSE_M, MAX_INVERSE_M)
        points = replace(points, state=state, covariance=np.asarray(np.linalg.inv(A), dtype=np.float64))
        if i > _PLAIN_ROUNDS and np.abs(step).max(initial=0.0) < 1e-5:
            break
    return points


class _Sights(NamedTuple):
    """What of sightings and their groups' points stays while points are fitted; columns are sightings.

    Attributes
    ----------
    ray, middle : float64 (3, n)
        The ray; the axis m of the point.
    moves : float64 (3, 3, n)
        How the direction to the point moves with its state: e₁, e₂, and from the camera to the anchor.
    along : float64 (3, n)
        The ray's part along each of these.
    products : float64 (6, n)
        Products of these with one another, in the order of `_PAIRS`.
    angle2, place2 : float64 (n,)
        Variance of the direction and of the camera's position.
    """

    ray: FloatArray
    middle: FloatArray
    moves: FloatArray
    along: FloatArray
    products: FloatArray
    angle2: FloatArray
    place2: FloatArray


def _sights(seen: Bearings, points: Points) -> _Sights:
    """Pair sightings with their groups' points."""
    middle, across, upwards = np.ascontiguousarray(points.axes.transpose(1, 2, 0))
    moves = np.stack([across, upwards, (points.anchor_m - seen.centre_m).T])
    ray = np.ascontiguousarray(seen.ray.T)
    first, second = _PAIRS
    return _Sights(
        ray,
        middle,
        moves,
        (moves * ray).sum(axis=1),
        (moves[first] * moves[second]).sum(axis=1),
        seen.sigma_rad**2,
        seen.sigma_m**2,
    )


def _equations(
    sights: _Sights, state: FloatArray, group: IntArray, is_plain: bool
) -> tuple[FloatArray, FloatArray]:
    """Normal equations (k, 3, 3), (k, 3) of the groups at the state (n, 3) of each sighting's group.

    What `innovations` says in two axes across the predicted direction f, without these axes: ``H`` is the
    part of `moves` across f over the distance, ``z`` that of the ray over its part along f.
    """
    a, b, rho = np.ascontiguousarray(state.T)
    direction = sights.middle + a * sights.moves[0] + b * sights.moves[1] + rho * sights.moves[2]
    norm2 = (direction**2).sum(axis=0)
    norm = np.sqrt(norm2)
    f = direction / norm
    cosine = (f * sights.ray).sum(axis=0)
    ahead = cosine > _MIN_COSINE
    cosine = np.where(ahead, cosine, 1.0)
    noise = sights.angle2 + sights.place2 * rho**2 / norm2
    weight = ahead / noise
    if not is_plain:
        off = sights.ray - cosine * f
        weight /= 1.0 + (off**2).sum(axis=0) / (cosine**2 * noise * _ROBUST_D2)
    by_f = (sights.moves * f).sum(axis=1)
    first, second = _PAIRS
    sums = np.empty((9, group.size))
    np.multiply(sights.products - by_f[first] * by_f[second], weight / norm2, out=sums[:6])
    np.multiply(sights.along - cosine * by_f, weight / (cosine * norm), out=sums[6:])
    begins = np.flatnonzero(np.diff(group, prepend=-1))
    found = np.add.reduceat(sums, begins, axis=1).T
    return found[:, _SYMMETRIC], found[:, 6:].copy()


class Triangulation:
    """Points of groups of the same sightings; all are kept, as steps in turn ask for the same."""

    def __init__(self, seen: Bearings) -> None:
        self._seen = seen
        self._points: dict[bytes, Points] = {}

    def points(self, group: IntArray) -> Points:
        """Points of groups 0, 1, … (n,), each with at least one sighting; negative: none."""
        key = group.tobytes()
        if key not in self._points:
            self._points[key] = fit_points(self._seen, group)
        return self._points[key]


def in_axes_of(points: Points, others: Points, place_sigma_m: float) -> tuple[FloatArray, FloatArray]:
    """Express the place of each of `others` in the state of each of `points`.

    Returns
    -------
    state : float64 (k, 3)
        NaN where it lies behind the anchor.
    covariance : float64 (k, 3, 3)
        With `place_sigma_m` added in space.
    """
    covariance = others.place_covariance_m2 + place_sigma_m**2 * np.eye(3)
    local = np.einsum("nij,nj->ni", points.axes, others.place_m - points.anchor_m)
    depth = np.where(local[:, 0] > 0.1, local[:, 0], np.nan)[:, None]
    a, b = local[:, 1:2] / depth, local[:, 2:3] / depth
    m, e1, e2 = np.moveaxis(points.axes, 1, 0)
    by_place = np.stack([(e1 - a * m) / depth, (e2 - b * m) / depth, -m / depth**2], axis=1)
    state = np.concatenate([a, b, 1.0 / depth], axis=1)
    return state, by_place @ covariance @ np.swapaxes(by_place, 1, 2)


def mahalanobis2(difference: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squared Mahalanobis distances of (k, d) by (k, d, d); infinite where the difference is NaN."""
    known = np.isfinite(difference).all(axis=1)
    d2 = np.full(known.size, np.inf)
    part = difference[known]
    solved = np.linalg.solve(covariance[known], part[:, :, None])[:, :, 0]
    d2[known] = np.einsum("ij,ij->i", part, solved)
    return d2


def _across(direction: FloatArray, up: FloatArray) -> FloatArray:
    """Unit vectors across a direction (n, 2, 3): level to the right, and upwards."""
    across = np.empty((len(direction), 2, 3))
    right = np.einsum("ijk,nj,nk->ni", _CROSS, direction, up)
    right /= np.maximum(np.sqrt(np.einsum("ij,ij->i", right, right)), 1e-9)[:, None]
    across[:, 0] = right
    np.einsum("ijk,nj,nk->ni", _CROSS, right, direction, out=across[:, 1])
    return across
