"""What fixes and velocities of a consumer receiver tell at best of a car's place, if their noise is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from simulated_receiver import ConsumerErrors, ConsumerSpec

from geoloc.arrays import FloatArray

STEP_S = 8.0
"""Errors that last for 10 s and more are looked at so often."""
MEDIAN_OF_SIGMA = float(np.sqrt(2.0 * np.log(2.0)))
"""Median length of an error, over its sigma an axis."""
# What `geoloc` takes a code solution to be off by: what lasts for two minutes, and reflections.
_TYPICAL_M, _TYPICAL_S = (1.8, 0.8), (120.0, 10.0)
_REFLECTED_S = 10.0


class Best(NamedTuple):
    """The best linear estimate of where the car is: its error east and north, and the covariance of that."""

    error_m: FloatArray
    covariance_m2: FloatArray


NOTHING = Best(np.full(2, np.nan), np.full((2, 2), np.nan))


def best_linear(errors: ConsumerErrors, spec: ConsumerSpec, at_s: float, ahead_mps: FloatArray) -> Best:
    """Estimate where the car is at a time by the fixes and velocities of its whole journey.

    With the covariance of this very drive's noise (Gauss and Markov's theorem): no estimator that is linear
    in them is better in the mean. How late receivers are in the mean is known, but not how late this one is:
    on a straight road nothing tells. Lever arm and camera are exact here.

    Parameters
    ----------
    ahead_mps : float64 (2,)
        The car's velocity then, east and north.
    """
    if errors.reckoned_m is None or spec.velocity_mps is None:
        return NOTHING
    time_s = errors.time_s
    now = int(np.argmin(np.abs(time_s - at_s)))
    # Fixes brought to that time by the velocities: what they say of the place then, each with its error.
    said_m = errors.fixes_m - errors.reckoned_m + errors.reckoned_m[now]
    step = ((time_s - time_s[0]) / STEP_S).astype(np.int64)
    count = np.bincount(step)
    mean_s = np.bincount(step, time_s) / count
    mean_m = np.stack([np.bincount(step, axis) / count for axis in said_m.T], axis=1)
    drawn = errors.axis_m, errors.lasts_s
    inverse = np.linalg.inv(_covariance(mean_s - time_s[now], spec, drawn, spec.white_m**2 / count))
    weight = inverse.sum(axis=0)
    mean_late_s, late_sigma_s = spec.late
    later_m = (errors.late_s - mean_late_s) * ahead_mps
    late_m2 = late_sigma_s**2 * np.outer(ahead_mps, ahead_mps)
    return Best(weight @ mean_m / weight.sum() + later_m, np.eye(2) / weight.sum() + late_m2)


def together(best: Sequence[Best]) -> Best:
    """Put the best estimates of several drives together."""
    if not all(np.isfinite(one.error_m).all() for one in best):
        return NOTHING
    weights = np.linalg.inv(np.array([one.covariance_m2 for one in best]))
    pull = (weights @ np.array([one.error_m for one in best])[:, :, None]).sum(axis=0)[:, 0]
    covariance = np.linalg.inv(weights.sum(axis=0))
    return Best(covariance @ pull, covariance)


def floor_m(
    spec: ConsumerSpec, minutes: float, drives: int, speed_mps: float, draws: int = 60
) -> tuple[float, float, float]:
    """Expected median error of so many drives half-way through journeys, if all but the receivers were exact.

    By their tracks alone, if the noise of each drive were known; the same with each drive's own lateness,
    which nothing tells on a straight road; and that if all are taken alike, with the usual noise.
    """
    rng = np.random.default_rng(90_000)
    since_s = np.arange(0.0, 60.0 * minutes, STEP_S) - 30.0 * minutes
    typical_m2 = sum(
        size_m**2 * np.exp(-np.abs(since_s[:, None] - since_s) / lasts_s)
        for size_m, lasts_s in zip(_TYPICAL_M, _TYPICAL_S, strict=True)
    )
    weight = np.linalg.inv(typical_m2 + _wandered(since_s, spec)).sum(axis=0)
    weight /= weight.sum()
    information, alike_m2 = [], []
    for _ in range(draws):
        drawn = rng.uniform(*spec.error_m) / np.sqrt(2.0), rng.uniform(*spec.lasts_s)
        covariance = _covariance(since_s, spec, drawn, np.full(since_s.size, spec.white_m**2))
        information.append(np.linalg.inv(covariance).sum())
        alike_m2.append(weight @ covariance @ weight)
    variances = np.array([1.0 / np.mean(information), np.mean(alike_m2)]) / drives
    late_m2 = (spec.late[1] * speed_mps) ** 2 / drives
    known, late, alike = np.sqrt([variances[0], *(variances + 0.5 * late_m2)]).tolist()
    return MEDIAN_OF_SIGMA * known, MEDIAN_OF_SIGMA * late, MEDIAN_OF_SIGMA * alike


def _covariance(
    since_s: FloatArray, spec: ConsumerSpec, drawn: tuple[float, float], white_m2: FloatArray
) -> FloatArray:
    """Covariance of what fixes say of the place at time 0, an axis."""
    axis_m, lasts_s = drawn
    apart_s = np.abs(since_s[:, None] - since_s)
    reflected_m2 = spec.multipath_share**2 * axis_m**2
    fixes_m2 = (axis_m**2 - reflected_m2) * np.exp(-apart_s / lasts_s)
    fixes_m2 += reflected_m2 * np.exp(-apart_s / _REFLECTED_S) + np.diag(white_m2)
    return np.asarray(fixes_m2 + _wandered(since_s, spec))


def _wandered(since_s: FloatArray, spec: ConsumerSpec) -> FloatArray:
    """Covariance of how far velocities whose errors last for a second lead away from time 0."""
    same_side = np.sign(since_s[:, None]) * np.sign(since_s) > 0
    away_s = np.where(same_side, np.minimum(np.abs(since_s[:, None]), np.abs(since_s)), 0.0)
    return np.asarray(2.0 * (spec.velocity_mps or 0.0) ** 2 * away_s)
