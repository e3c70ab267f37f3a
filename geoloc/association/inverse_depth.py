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
    axes = np.stack([seen.ray, *_across(seen.ray, seen.up)], axis=1)
    rho = np.clip(seen.inverse_m, MIN_INVERSE_M, MAX_INVERSE_M)
    zero = np.zeros_like(rho)
    covariance = np.zeros((rho.size, 3, 3))
    diagonal = np.arange(3)
    covariance[:, diagonal, diagonal] = np.stack([variance, variance, seen.sigma_inverse_m**2], axis=1)
    return Points(seen.centre_m, axes, np.stack([zero, zero, rho], axis=1), covariance)


def innovations(seen: Bearings, points: Points) -> Innovations:
    """Compare sightings and points, row by row."""
    delta = points.anchor_m - seen.centre_m
    a, b, rho = points.state.T[:, :, None]
    q = points.axes[:, 0] + a * points.axes[:, 1] + b * points.axes[:, 2] + rho * delta
    norm = np.sqrt(np.einsum("ij,ij->i", q, q))
    f0 = q / norm[:, None]
    f = np.stack(_across(f0, seen.up), axis=1)
    cosine = np.einsum("ij,ij->i", f0, seen.ray)
    ahead = cosine > _MIN_COSINE
    z = np.einsum("nij,nj->ni", f, seen.ray) / np.where(ahead, cosine, 1.0)[:, None]
    columns = np.stack([points.axes[:, 1], points.axes[:, 2], delta], axis=2)
    H = f @ columns / norm[:, None, None]
    noise = seen.sigma_rad**2 + (seen.sigma_m * rho[:, 0] / norm) ** 2
    return Innovations(z, H, noise, ahead)


def updated(points: Points, found: Innovations) -> Points:
    """One Kalman step for each point with its sighting."""
    P, H = points.covariance, found.H
    PH = P @ np.swapaxes(H, 1, 2)
    S = H @ PH + found.noise[:, None, None] * np.eye(2)
    gain = PH @ np.linalg.inv(S)
    state = points.state + np.einsum("nij,nj->ni", gain, found.z)
    state[:, 2] = np.clip(state[:, 2], MIN_INVERSE_M, MAX_INVERSE_M)
    return replace(points, state=state, covariance=np.asarray(P - gain @ H @ P))


def fit_points(seen: Bearings, group: IntArray, size: int) -> Points:
    """Triangulate every group of sightings, robustly, all groups at once.

    Parameters
    ----------
    seen : Bearings (n,)
    group : int64 (n,)
        0 … size - 1, each with at least one sighting; negative: none.

    Returns
    -------
    Points (size,)
        Anchored at the foot that stands nearest, or the first face.
    """
    rows = np.flatnonzero(group >= 0)
    seen, group = seen.take(rows), group[rows]
    nearest = np.lexsort((np.arange(group.size), -seen.inverse_m, group))
    anchor = nearest[np.flatnonzero(np.diff(group[nearest], prepend=-1))]
    points = first_points(seen.take(anchor))
    prior_mean, prior_weight = points.state[:, 2].copy(), 1.0 / points.covariance[:, 2, 2]
    for i in range(_ROUNDS):
        found = innovations(seen, points.take(group))
        d2 = np.einsum("ij,ij->i", found.z, found.z) / found.noise
        weight = found.ahead / found.noise
        if i >= _PLAIN_ROUNDS:
            weight /= 1.0 + d2 / _ROBUST_D2
        A = _sums(weight[:, None, None] * np.swapaxes(found.H, 1, 2) @ found.H, group, size)
        g = _sums(weight[:, None] * np.einsum("nji,nj->ni", found.H, found.z), group, size)
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


class Triangulation:
    """Points of groups of the same sightings; the last ones are kept, as steps in turn ask for the same."""

    def __init__(self, seen: Bearings) -> None:
        self._seen = seen
        self._group: IntArray | None = None
        self._points = first_points(seen.take(slice(0)))

    def points(self, group: IntArray) -> Points:
        """Points of groups 0, 1, … (n,), each with at least one sighting; negative: none."""
        if self._group is None or not np.array_equal(group, self._group):
            self._group = group.copy()
            self._points = fit_points(self._seen, group, int(group.max(initial=-1)) + 1)
        return self._points


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


def _across(direction: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors across a direction: level to the right, and upwards."""
    right = np.stack(
        [
            direction[:, 1] * up[:, 2] - direction[:, 2] * up[:, 1],
            direction[:, 2] * up[:, 0] - direction[:, 0] * up[:, 2],
            direction[:, 0] * up[:, 1] - direction[:, 1] * up[:, 0],
        ],
        axis=1,
    )
    right /= np.maximum(np.sqrt(np.einsum("ij,ij->i", right, right)), 1e-9)[:, None]
    x, y, z = right.T
    u, v, w = direction.T
    return right, np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


def _sums(values: FloatArray, group: IntArray, size: int) -> FloatArray:
    """Sum rows (n, ...) by group → (size, ...)."""
    flat = values.reshape(group.size, -1)
    columns = [np.bincount(group, weights=column, minlength=size) for column in flat.T]
    return np.stack(columns, axis=1).reshape(size, *values.shape[1:]).astype(np.float64)
