"""The pose between the knots of a trajectory, for millions of epochs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import wrap_deg
from geoloc.trajectory.interpolation import GAP_TOLERANCE_S, NANOSECONDS, seconds, tangents
from geoloc.trajectory.poses import Poses

# Jerk of ordinary driving, for the error of a cubic between knots: J h³ / 24 in the middle.
_JERK_MPS3 = 1.0
# Angular acceleration of ordinary driving, for the error of a line between headings: a h² / 8 in the middle.
_YAW_ACCELERATION_DEGPS2 = 4.0

_CUBIC = ("latitude_deg", "longitude_deg", "height_m")
_LINEAR = (
    "roll_deg",
    "pitch_deg",
    "heading_deg",
    "speed_mps",
    "sigma_horizontal_m",
    "sigma_vertical_m",
    "sigma_roll_deg",
    "sigma_pitch_deg",
    "sigma_heading_deg",
)

# Rows that are worked on at a time: their temporaries stay in the processor's cache.
_BLOCK = 32768


class PoseCurves(NamedTuple):
    """Polynomials in the fraction u of each interval between two knots, for every column of `Poses`.

    Positions are cubics (Hermite, with the slopes of `interpolation.tangents`), everything else lines; angles
    turn the shorter way. The last knot has an interval of its own, in which nothing changes.
    """

    epoch_ns: IntArray
    span_ns: FloatArray
    coefficients: dict[str, tuple[FloatArray, ...]]
    """Ascending, each (n,)."""
    position_sigma_m: FloatArray
    """What the cubic may be off, times u (1 - u)."""
    heading_sigma_deg: FloatArray
    """What the line may be off, times u (1 - u)."""
    at_knot: BoolArray
    """Knots that have a pose."""
    between: BoolArray
    """Intervals that have poses: both knots are valid and no gap lies between."""

    def at(self, epoch_ns: IntArray) -> tuple[dict[str, FloatArray], BoolArray]:
        """Give the columns of `Poses` at each epoch, and where they are valid; elsewhere undefined."""
        n = epoch_ns.size
        valid = np.empty(n, dtype=bool)
        columns = {name: np.empty(n) for name in self.coefficients}
        # Clipped, so that no difference overflows: a missing stamp is int64's minimum.
        asked = np.clip(epoch_ns, self.epoch_ns[0] - 1, self.epoch_ns[-1] + 1)
        with np.errstate(invalid="ignore", over="ignore"):
            for start in range(0, n, _BLOCK):
                rows = slice(start, start + _BLOCK)
                left, since = self._interval(asked[rows])
                u = since / np.take(self.span_ns, left)
                valid[rows] = self._valid(left, since, u)
                self._evaluate({name: column[rows] for name, column in columns.items()}, left, u)
        return columns, valid

    def _interval(self, epoch_ns: IntArray) -> tuple[IntArray, IntArray]:
        """Knot before or at each epoch (the first one for those before it), and the time since."""
        # Only among the knots that this block of epochs can fall between: epochs mostly come in order.
        ends = np.searchsorted(self.epoch_ns, [epoch_ns.min(), epoch_ns.max()], side="right")
        low, high = max(int(ends[0]) - 1, 0), int(ends[1])
        left = np.searchsorted(self.epoch_ns[low:high], epoch_ns, side="right")
        left += low - 1
        np.maximum(left, 0, out=left)
        return left, epoch_ns - np.take(self.epoch_ns, left)

    def _valid(self, left: IntArray, since: IntArray, u: FloatArray) -> BoolArray:
        if self.between[:-1].all() and u.min() >= 0.0 and left.max() < self.between.size - 1:
            return np.ones(left.size, dtype=bool)
        return np.asarray((self.between[left] & (since > 0)) | (self.at_knot[left] & (since == 0)))

    def _evaluate(self, columns: dict[str, FloatArray], left: IntArray, u: FloatArray) -> None:
        """Write each column by Horner's scheme."""
        scratch = np.empty(u.size)
        for name, column in columns.items():
            _horner(self.coefficients[name], left, u, column, scratch)
        heading = columns["heading_deg"]
        heading -= 360.0 * np.floor(heading * (1.0 / 360.0))
        if "sigma_heading_deg" not in columns:
            return
        middle = u * (1.0 - u)
        for name, bend in (
            ("sigma_horizontal_m", self.position_sigma_m),
            ("sigma_heading_deg", self.heading_sigma_deg),
        ):
            value, extra = columns[name], np.take(bend, left, out=scratch, mode="clip")
            extra *= middle
            extra *= extra
            value *= value
            value += extra
            np.sqrt(value, out=value)


def _horner(
    coefficients: tuple[FloatArray, ...],
    left: IntArray,
    u: FloatArray,
    value: FloatArray,
    scratch: FloatArray,
) -> None:
    """Write polynomials at u into `value`; `scratch` holds one term."""
    *lower, highest = coefficients
    # With "clip", which the indices never need, NumPy writes into `out` without a buffer.
    np.take(highest, left, out=value, mode="clip")
    for coefficient in reversed(lower):
        value *= u
        value += np.take(coefficient, left, out=scratch, mode="clip")


def pose_curves(knots: Poses, max_gap_s: float) -> PoseCurves:
    """Work out the polynomials; between knots further apart than `max_gap_s` there is no pose."""
    span_ns = np.append(np.diff(knots.epoch_ns).astype(np.float64), 1.0)
    span_s = span_ns / NANOSECONDS
    near = span_s <= max_gap_s + GAP_TOLERANCE_S
    coefficients = {name: _cubic(knots, name, span_s) for name in _CUBIC}
    coefficients |= {name: _line(knots, name) for name in _LINEAR}
    return PoseCurves(
        epoch_ns=knots.epoch_ns,
        span_ns=span_ns,
        coefficients=coefficients,
        position_sigma_m=_JERK_MPS3 * span_s**3 / 6.0,
        heading_sigma_deg=_YAW_ACCELERATION_DEGPS2 * span_s**2 / 2.0,
        at_knot=knots.valid,
        between=near & knots.valid & np.append(knots.valid[1:], False),
    )


def _line(knots: Poses, name: str) -> tuple[FloatArray, ...]:
    value: FloatArray = getattr(knots, name)
    return value, _step(value, angle=name.endswith("_deg") and not name.startswith("sigma"))


def _step(value: FloatArray, *, angle: bool = False) -> FloatArray:
    """Change to the next knot; 0 where that has no value, so that it plays no part at the knot itself."""
    step = np.append(np.diff(value), 0.0)
    return np.nan_to_num(wrap_deg(step) if angle else step, nan=0.0)


def _cubic(knots: Poses, name: str, span_s: FloatArray) -> tuple[FloatArray, ...]:
    value: FloatArray = getattr(knots, name)
    slope = np.zeros_like(value)
    slope[knots.valid] = tangents(seconds(knots.epoch_ns)[knots.valid], value[knots.valid])
    step, out, into = _step(value), slope * span_s, np.append(slope[1:], 0.0) * span_s
    return value, out, 3.0 * step - 2.0 * out - into, out + into - 2.0 * step
