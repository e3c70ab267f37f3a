"""How good positions are against known truth: error statistics, coverage and consistency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from geoloc.arrays import FloatArray

RANGE_EDGES_M = (0.0, 8.0, 12.0, 16.0, 22.0, 30.0, float("inf"))


@dataclass(frozen=True, slots=True)
class ErrorStats:
    """Statistics of horizontal errors, metres; NaN where `n` is 0.

    Attributes
    ----------
    n : int
        Finite errors; NaN ones are left out.
    mean, median, p95, max, rmse : float
        `p95` interpolates linearly between order statistics.
    """

    n: int
    mean: float
    median: float
    p95: float
    max: float
    rmse: float


@dataclass(frozen=True, slots=True)
class RangeStats:
    """Errors of objects whose range is in ``[from_m, to_m)``."""

    from_m: float
    to_m: float
    stats: ErrorStats


def error_stats(errors_m: ArrayLike) -> ErrorStats:
    """Summarise horizontal errors, metres, of any shape."""
    errors = np.asarray(errors_m, dtype=np.float64).ravel()
    errors = errors[np.isfinite(errors)]
    if errors.size == 0:
        return ErrorStats(0, *([float("nan")] * 5))
    return ErrorStats(
        n=errors.size,
        mean=float(errors.mean()),
        median=float(np.median(errors)),
        p95=cep(errors, 0.95),
        max=float(errors.max()),
        rmse=float(np.sqrt(np.mean(errors**2))),
    )


def cep(errors_m: ArrayLike, probability: float = 0.5) -> float:
    """Circular error probable: the radius that holds this share of the errors; CEP95 with 0.95.

    NaN errors are left out; NaN if none is left.
    """
    errors = np.asarray(errors_m, dtype=np.float64).ravel()
    errors = errors[np.isfinite(errors)]
    return float(np.quantile(errors, probability)) if errors.size else float("nan")


def nees(error_m: ArrayLike, covariance_m2: ArrayLike) -> FloatArray:
    """Normalised estimation error squared: ``dᵀ C⁻¹ d``, 2 on average where covariances are honest.

    Parameters
    ----------
    error_m : array_like (..., 2)
        East and north, in the axes of the covariance.
    covariance_m2 : array_like (..., 2, 2)

    Returns
    -------
    float64 (...)
        NaN where the error or the covariance is NaN, or the covariance is not positive definite.

    Notes
    -----
    Bar-Shalom, Li and Kirubarajan (2001), "Estimation with Applications to Tracking and Navigation", 5.4.
    """
    d = np.asarray(error_m, dtype=np.float64)
    c = np.asarray(covariance_m2, dtype=np.float64)
    a, b, e = c[..., 0, 0], (c[..., 0, 1] + c[..., 1, 0]) / 2.0, c[..., 1, 1]
    determinant = a * e - b * b
    with np.errstate(invalid="ignore", divide="ignore"):
        value = (e * d[..., 0] ** 2 - 2.0 * b * d[..., 0] * d[..., 1] + a * d[..., 1] ** 2) / determinant
        proper = (determinant > 0) & (a > 0)
    return np.where(proper, value, np.nan)


def ellipse_coverage(error_m: ArrayLike, covariance_m2: ArrayLike, probability: float = 0.95) -> float:
    """Share of the errors inside their own error ellipse; near `probability` where covariances are honest.

    Parameters
    ----------
    error_m : array_like (n, 2)
    covariance_m2 : array_like (n, 2, 2)
    probability : float
        That the ellipse is drawn for: its squared radius is ``-2 ln(1 - p)``, the quantile of χ² with two
        degrees of freedom.

    Returns
    -------
    float
        NaN if no row is finite.
    """
    value = nees(error_m, covariance_m2)
    value = value[np.isfinite(value)]
    if value.size == 0:
        return float("nan")
    return float(np.mean(value <= -2.0 * np.log1p(-probability)))


def stats_by_range(
    errors_m: ArrayLike, ranges_m: ArrayLike, edges: Sequence[float] = RANGE_EDGES_M
) -> tuple[RangeStats, ...]:
    """Summarise errors by the range to the object; classes are ``[from, to)``, empty ones have n = 0."""
    errors = np.asarray(errors_m, dtype=np.float64).ravel()
    ranges = np.asarray(ranges_m, dtype=np.float64).ravel()
    return tuple(
        RangeStats(low, high, error_stats(errors[(ranges >= low) & (ranges < high)]))
        for low, high in pairwise(edges)
    )
