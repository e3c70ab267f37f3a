"""Radial functions: where a polynomial rises, and its inverse there to machine precision.

A lens maps the angle of a ray to a radius in the image by a function that must rise. Calibrated polynomials
rise only up to some point; beyond it they fold back, and an inverse found there is a wrong answer that looks
right. So each model first asks `rising_limit` for its domain, then inverts inside it alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from geoloc.arrays import FloatArray

MIN_SLOPE_RATIO = 1e-3
"""A function counts as rising while its slope is above this part of its slope at zero: where it is flatter,
rounding errors grow a thousandfold through the inverse, and no lens is built to work there."""

_MAX_ITERATIONS = 100
_TABLE = 257
"""Points of the table from which an inverse starts: two or three steps of Newton's method are left."""


def polynomial(coefficients: Sequence[float], x: FloatArray) -> FloatArray:
    """Horner's scheme; coefficients in ascending order."""
    if len(coefficients) < 2:
        return np.full_like(x, coefficients[0] if coefficients else 0.0)
    value = np.asarray(x * coefficients[-1])
    for coefficient in reversed(coefficients[1:-1]):
        value += coefficient
        value *= x
    return value if coefficients[0] == 0.0 else value + coefficients[0]


def derivative(coefficients: Sequence[float]) -> tuple[float, ...]:
    """Coefficients of the derivative, in ascending order."""
    return tuple(i * coefficient for i, coefficient in enumerate(coefficients))[1:]


def real_roots(coefficients: Sequence[float], upper: float) -> list[float]:
    """Real roots in (0, upper) at which a polynomial (ascending coefficients) changes sign, in order.

    Between two neighbouring roots of its derivative a polynomial has one root at most, which bisection finds
    whatever the scale of the coefficients. The eigenvalues of a companion matrix do not: high powers of
    pixels span so many orders of magnitude that the smallest roots, which matter here, are lost.
    """
    if len(coefficients) < 2:
        return []
    knots = [0.0, *real_roots(derivative(coefficients), upper), upper]
    roots = (_bisect(coefficients, low, high) for low, high in pairwise(knots))
    return [root for root in roots if root is not None]


def _bisect(coefficients: Sequence[float], low: float, high: float) -> float | None:
    """The root in (low, high], where the polynomial is monotonic; None if its ends have the same sign."""
    at_low, at_high = _value(coefficients, low), _value(coefficients, high)
    if at_low == 0.0 or at_high == 0.0 or (at_low > 0.0) == (at_high > 0.0):
        return high if at_high == 0.0 and at_low != 0.0 else None
    for _ in range(_MAX_ITERATIONS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if (_value(coefficients, middle) > 0.0) == (at_low > 0.0):
            low = middle
        else:
            high = middle
    return low


def _value(coefficients: Sequence[float], x: float) -> float:
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * x + float(coefficient)
    return value


def smallest_root(coefficients: Sequence[float], upper: float) -> float:
    """Smallest of `real_roots`, or `upper`."""
    return min(real_roots(coefficients, upper), default=upper)


def rising_limit(coefficients: Sequence[float], upper: float) -> float:
    """Where the polynomial, rising at zero, stops rising (`MIN_SLOPE_RATIO`), at most `upper`.

    Its domain is [0, limit]. 0 if it does not rise at zero.
    """
    slope = derivative(coefficients)
    if not slope or slope[0] <= 0.0:
        return 0.0
    return smallest_root(((1.0 - MIN_SLOPE_RATIO) * slope[0], *slope[1:]), upper)


def reach(coefficients: Sequence[float], y: float, upper: float) -> float:
    """Smallest positive x at which the polynomial is y, or `upper` if it is not reached before."""
    return smallest_root((coefficients[0] - y, *coefficients[1:]), upper)


def invert_rising(
    function: Callable[[FloatArray], FloatArray],
    slope: Callable[[FloatArray], FloatArray],
    y: FloatArray,
    upper: float,
) -> FloatArray:
    """Solve ``function(x) = y`` for x in [0, upper], where the function rises.

    Newton's method that falls back to bisection whenever a step leaves the bracket (rtsafe of Press et al.,
    "Numerical Recipes", section 9.4), on all elements at once. `upper` must be finite.

    Parameters
    ----------
    y : float64 (...)

    Returns
    -------
    float64 (...)
        NaN where y is NaN or outside [function(0), function(upper)].
    """
    bounds = function(np.array([0.0, upper]))
    inside = (y >= bounds[0]) & (y <= bounds[1])
    target = np.where(inside, y, bounds[0])
    low, high = np.zeros_like(target), np.full_like(target, upper)
    table = np.linspace(0.0, upper, _TABLE)
    x = np.asarray(np.interp(target, function(table), table))
    for _ in range(_MAX_ITERATIONS):
        residual = function(x) - target
        low, high = np.where(residual < 0.0, x, low), np.where(residual > 0.0, x, high)
        newton = x - residual / slope(x)
        following = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        following = np.where(residual == 0.0, x, following)
        converged = (np.abs(following - x) <= 4.0 * np.spacing(upper)).all()
        x = following
        if converged:
            break
    return np.where(inside, x, np.nan)


def invert_rising_polynomial(coefficients: Sequence[float], y: FloatArray, upper: float) -> FloatArray:
    """Solve ``polynomial(x) = y`` for x in [0, upper], as `invert_rising`."""
    slope = derivative(coefficients)
    return invert_rising(lambda x: polynomial(coefficients, x), lambda x: polynomial(slope, x), y, upper)
