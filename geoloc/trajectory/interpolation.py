"""Time series with gaps: brackets, slopes and cubic Hermite, all vectorised."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray

NANOSECONDS = 1e9
GAP_TOLERANCE_S = 0.01


class Bracket(NamedTuple):
    """Where asked epochs fall among samples."""

    left: IntArray
    right: IntArray
    """Equal to `left` where the epoch is that of a sample: its neighbour then plays no part."""
    fraction: FloatArray
    span_s: FloatArray
    """Between the samples `left` and ``left + 1``."""
    before_s: FloatArray
    """Seconds before the first sample; 0 elsewhere."""
    after_s: FloatArray
    """Seconds after the last sample; 0 elsewhere."""

    def inside(self) -> BoolArray:
        """True where the epoch is not outside the samples."""
        return np.asarray((self.before_s == 0) & (self.after_s == 0))

    def in_gap(self, max_gap_s: float) -> BoolArray:
        """True strictly between two samples that are more than `max_gap_s` apart."""
        return np.asarray((self.span_s > max_gap_s + GAP_TOLERANCE_S) & (self.right != self.left))


def bracket(sample_ns: IntArray, epoch_ns: IntArray) -> Bracket:
    """Find the samples on both sides of each epoch.

    Parameters
    ----------
    sample_ns : int64 (n,)
        Strictly increasing, n >= 2.
    epoch_ns : int64 (m,)
    """
    left = np.clip(np.searchsorted(sample_ns, epoch_ns, side="right") - 1, 0, sample_ns.size - 2)
    span_s = (sample_ns[left + 1] - sample_ns[left]) / NANOSECONDS
    since = (epoch_ns - sample_ns[left]) / NANOSECONDS
    fraction = np.clip(since / span_s, 0.0, 1.0)
    on_last = fraction == 1.0
    left = np.where(on_last, left + 1, left)
    fraction = np.where(on_last, 0.0, fraction)
    right = np.where(fraction > 0, left + 1, left)
    before = np.where(epoch_ns < sample_ns[0], apart_s(sample_ns[:1], epoch_ns), 0.0)
    after = np.where(epoch_ns > sample_ns[-1], apart_s(epoch_ns, sample_ns[-1:]), 0.0)
    return Bracket(left, right, fraction, span_s, before, after)


def apart_s(a_ns: IntArray, b_ns: IntArray) -> FloatArray:
    """Seconds between epochs, never 0 for different ones, and safe for stamps such as int64's minimum.

    As floats: to 0.3 µs, for messages and limits only.
    """
    difference = np.abs(a_ns.astype(np.float64) - b_ns.astype(np.float64)) / NANOSECONDS
    return np.where(a_ns == b_ns, 0.0, np.maximum(difference, 1.0 / NANOSECONDS))


def seconds(epoch_ns: IntArray) -> FloatArray:
    """Seconds since the first epoch: subtracted as integers, so that nothing is lost."""
    return np.asarray((epoch_ns - epoch_ns[0]) / NANOSECONDS, dtype=np.float64)


def tangents(t_s: FloatArray, value: FloatArray) -> FloatArray:
    """Slopes of the parabola through each sample and its neighbours, uneven spacing allowed.

    Parameters
    ----------
    t_s : float64 (n,)
        Strictly increasing.
    value : float64 (n, ...)

    Returns
    -------
    float64 (n, ...)
        Second-order accurate. Where one neighbour is far (a gap) the near one decides. One sample alone has
        slope 0.
    """
    if t_s.size < 2:
        return np.zeros_like(value)
    h = np.diff(t_s).reshape((-1,) + (1,) * (value.ndim - 1))
    slope = np.diff(value, axis=0) / h
    if t_s.size == 2:
        return np.concatenate([slope, slope])
    inner = (h[1:] * slope[:-1] + h[:-1] * slope[1:]) / (h[1:] + h[:-1])
    first = ((2 * h[0] + h[1]) * slope[0] - h[0] * slope[1]) / (h[0] + h[1])
    last = ((2 * h[-1] + h[-2]) * slope[-1] - h[-1] * slope[-2]) / (h[-1] + h[-2])
    return np.concatenate([first[None], inner, last[None]])


def hermite(value: FloatArray, tangent: FloatArray, at: Bracket) -> FloatArray:
    """Cubic Hermite interpolation of ``value (n,)`` with slopes ``tangent (n,)``."""
    u, h = at.fraction, at.span_s
    a, b = value[at.left], value[at.right]
    # a + … keeps the precision of coordinates: what is added is small.
    curve = u * u * (3 - 2 * u) * (b - a)
    return np.asarray(
        a + curve + h * u * (1 - u) * ((1 - u) * tangent[at.left] - u * tangent[at.right]),
    )


def linear(value: FloatArray, at: Bracket) -> FloatArray:
    """Linear interpolation of ``value (n,)``."""
    a = value[at.left]
    return np.asarray(a + at.fraction * (value[at.right] - a))
