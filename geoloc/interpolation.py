"""Time series with gaps: brackets, cubic Hermite and local fits, all vectorised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NANOSECONDS = 1e9
_GAP_TOLERANCE_S = 0.01
# Priors that only matter where a window holds too few samples to fix all three terms of a parabola.
_PRIOR_SLOPE = 100.0
_MAX_NEIGHBOURS = 60

_GRS80_A_M = 6_378_137.0
_GRS80_E2 = 0.006_694_380_022_90


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
        return np.asarray((self.span_s > max_gap_s + _GAP_TOLERANCE_S) & (self.right != self.left))


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


def wrap_deg(angle_deg: ArrayLike) -> FloatArray:
    """Angle in [-180, 180)."""
    return (np.asarray(angle_deg, dtype=np.float64) + 180.0) % 360.0 - 180.0


def linear_angle(angle_deg: FloatArray, at: Bracket) -> FloatArray:
    """Interpolate an angle ``(n,)`` along the shorter way; the result is in [0, 360)."""
    a = angle_deg[at.left]
    return np.asarray((a + at.fraction * wrap_deg(angle_deg[at.right] - a)) % 360.0)


def metres_per_degree(latitude_deg: ArrayLike, height_m: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray]:
    """Metres a degree of longitude (east) and of latitude (north) on GRS80.

    The radii of curvature in the prime vertical and in the meridian, times cos(latitude) for the first.
    Exact for slopes; over 100 m the error of a difference is below 1 mm.
    """
    phi = np.radians(np.asarray(latitude_deg, dtype=np.float64))
    w2 = 1.0 - _GRS80_E2 * np.sin(phi) ** 2
    prime_vertical = _GRS80_A_M / np.sqrt(w2)
    meridian = _GRS80_A_M * (1.0 - _GRS80_E2) / w2**1.5
    height = np.asarray(height_m, dtype=np.float64)
    east = np.radians((prime_vertical + height) * np.cos(phi))
    return np.asarray(east), np.asarray(np.radians(meridian + height))


@dataclass(frozen=True, slots=True)
class LocalFit:
    """A parabola through the neighbourhood of each sample.

    Attributes
    ----------
    value, slope, curvature : float64 (n, m)
        At the sample; `curvature` is the second derivative.
    sigma_value, sigma_slope, sigma_curvature : float64 (n,)
        One sigma, from the noise and the number of neighbours.
    misfit : float64 (n,)
        Scatter of the neighbours about the parabola, in units of the noise.
    """

    value: FloatArray
    slope: FloatArray
    curvature: FloatArray
    sigma_value: FloatArray
    sigma_slope: FloatArray
    sigma_curvature: FloatArray
    misfit: FloatArray


def local_parabola(
    t_s: FloatArray,
    value: FloatArray,
    noise: FloatArray,
    scale: FloatArray,
    half_window_s: float,
    curvature_prior: float,
) -> LocalFit:
    """Fit a parabola in time about each sample by weighted least squares (Savitzky-Golay, uneven spacing).

    Parameters
    ----------
    t_s : float64 (n,)
        Increasing.
    value : float64 (n, m)
        m series.
    noise : float64 (n,)
        One sigma of a sample, in scaled units.
    scale : float64 (n, m)
        Scaled units a unit of `value`, e.g. metres a degree.
    half_window_s : float
        Neighbours up to this far away take part.
    curvature_prior : float
        One sigma of the second derivative that is expected beforehand, scaled units a second squared: decides
        where the window holds fewer than three samples.

    Returns
    -------
    LocalFit
        In scaled units; `value` as a correction to the sample itself.
    """
    n, m = value.shape
    normal = np.zeros((n, 3, 3))
    right = np.zeros((n, 3, m))
    square, count = np.zeros(n), np.zeros(n)
    for k in range(-_window_reach(t_s, half_window_s), _window_reach(t_s, half_window_s) + 1):
        i = np.arange(max(0, -k), min(n, n - k))
        dt = t_s[i + k] - t_s[i]
        weight = np.where(np.abs(dt) <= half_window_s, 1.0 / noise[i + k] ** 2, 0.0)
        basis = np.stack([np.ones_like(dt), dt, dt**2], axis=-1)
        dy = (value[i + k] - value[i]) * scale[i]
        normal[i] += weight[:, None, None] * basis[:, :, None] * basis[:, None, :]
        right[i] += weight[:, None, None] * basis[:, :, None] * dy[:, None, :]
        square[i] += weight * np.sum(dy**2, axis=1)
        count[i] += weight > 0
    normal += np.diag([0.0, _PRIOR_SLOPE**-2, (curvature_prior / 2.0) ** -2])
    covariance = np.linalg.inv(normal)
    terms = covariance @ right
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    residual = np.maximum(square - np.sum(terms * right, axis=(1, 2)), 0.0)
    misfit = np.sqrt(residual / (m * np.maximum(count - 3.0, 1.0)))
    return LocalFit(
        terms[:, 0], terms[:, 1], 2 * terms[:, 2], sigma[:, 0], sigma[:, 1], 2 * sigma[:, 2], misfit
    )


def _window_reach(t_s: FloatArray, half_window_s: float) -> int:
    """The largest number of neighbours on one side, capped: 100 Hz needs no more than the nearest 60."""
    ahead = np.searchsorted(t_s, t_s + half_window_s, side="right") - np.arange(t_s.size) - 1
    return int(min(max(int(ahead.max(initial=0)), 1), _MAX_NEIGHBOURS))
