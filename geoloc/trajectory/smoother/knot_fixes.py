"""Fixes of all antennas side by side, each at the knot that is nearest in time: what the smoother reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu
from geoloc.trajectory.fix_checks import (
    HEADING_SIGMA_DEG,
    MULTIPATH_S,
    VELOCITY_SIGMA_MPS,
    FixNoise,
    noise_of_fixes,
    up_over_plane,
)
from geoloc.trajectory.interpolation import NANOSECONDS, seconds
from geoloc.trajectory.poses import GnssFixes

# Loggers write epochs nanoseconds apart: no car does anything in less.
_SHORTEST_STEP_S = 1e-3

# Of the error of code solutions, what is the same all day: the receiver's own atmosphere model.
_LASTING_SHARE = 0.3

# As how many errors of a drive what is stated of their size counts: receivers and skies differ by half.
_STATED_COUNTS = 4.0

_BY_ANTENNA = (
    "plane_m",
    "height_m",
    "seen",
    "late_s",
    "sigma_m",
    "white_m",
    "slow_m",
    "slow_lasts_s",
    "white_every_s",
    "fix_share_s",
    "up_over_plane",
    "heading_rad",
    "heading_sigma_rad",
    "velocity_mps",
    "velocity_sigma_mps",
)


@dataclass(frozen=True, slots=True, eq=False)
class KnotFixes:
    """Fixes of ``m`` antennas at ``n`` knots.

    Plane coordinates are those of a path that is rolled out knot by knot, each step measured in the east and
    north of where it starts: axes point to true east and true north everywhere, and neighbours are as far
    apart as on the ellipsoid. Only neighbours are ever compared.

    Attributes
    ----------
    t_s, latitude_deg, longitude_deg : float64 (n,)
        Epoch of each knot since the first, and a point near the car then.
    path_m : float64 (n, 2)
        That point in plane coordinates, east and north.
    tied : bool (n - 1,)
        False where a gap of the recording follows the knot.
    plane_m, height_m : float64 (n, m, 2), (n, m)
        The fixes; 0 where an antenna has none.
    seen : bool (n, m)
    late_s : float64 (n, m)
        Epoch of the fix minus that of its knot.
    sigma_m, white_m, slow_m : float64 (n, m)
        Horizontal sigma of the fix, and the parts of it that each antenna has of its own: new at every fix,
        and lasting.
    slow_lasts_s, white_every_s : float64 (n, m)
        How long, and fixes of what time count as one (`fix_checks.FixNoise`).
    fix_share_s : float64 (n, m)
        Time that each fix stands for, from half-way to its antenna's neighbours; gaps do not count.
    up_over_plane : float64 (n, m)
        Vertical sigma of the fix over its horizontal one.
    heading_rad, heading_sigma_rad : float64 (n, m)
        Heading that the receiver itself has, as a yaw, counter-clockwise from east; NaN for none.
    velocity_mps, velocity_sigma_mps : float64 (n, m, 3), (n, m, 2)
        East, north, up; horizontal (an axis) and vertical. NaN for none.
    """

    t_s: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    path_m: FloatArray
    tied: BoolArray
    plane_m: FloatArray
    height_m: FloatArray
    seen: BoolArray
    late_s: FloatArray
    sigma_m: FloatArray
    white_m: FloatArray
    slow_m: FloatArray
    slow_lasts_s: FloatArray
    white_every_s: FloatArray
    fix_share_s: FloatArray
    up_over_plane: FloatArray
    heading_rad: FloatArray
    heading_sigma_rad: FloatArray
    velocity_mps: FloatArray
    velocity_sigma_mps: FloatArray

    def only(self, antenna: int) -> KnotFixes:
        """The same knots with the fixes of one antenna."""
        one = slice(antenna, antenna + 1)
        return replace(self, **{name: getattr(self, name)[:, one] for name in _BY_ANTENNA})

    @property
    def heading_antennas(self) -> IntArray:
        """Numbers of the antennas whose receiver has a heading at any knot."""
        return np.flatnonzero(np.isfinite(self.heading_rad).any(axis=0))

    @property
    def step_s(self) -> FloatArray:
        """Time from each knot to the next ``(n - 1,)``, never 0."""
        return np.maximum(np.diff(self.t_s), _SHORTEST_STEP_S)

    @property
    def share_s(self) -> FloatArray:
        """Time that each knot stands for ``(n,)``, from half-way to its neighbours; gaps do not count."""
        step = np.where(self.tied, self.step_s, 0.0)
        both = np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])
        return np.asarray(np.maximum(0.5 * both, _SHORTEST_STEP_S))

    @property
    def count(self) -> FloatArray:
        """As how many observations each fix counts ``(n, m)``: 1, or less where fixes err alike."""
        return np.minimum(1.0, self.fix_share_s / np.maximum(self.white_every_s, 1e-9))

    @property
    def slow_fades(self) -> FloatArray:
        """What is left at the next knot of what lasts of each antenna's error ``(n - 1, m)``."""
        # Where an antenna has no fix, its error goes on as before.
        last = np.maximum.accumulate(np.where(self.seen, np.arange(len(self.seen))[:, None], 0), axis=0)
        lasts_s = np.where(self.seen.any(axis=0), np.take_along_axis(self.slow_lasts_s, last, axis=0), np.inf)
        lasts_s = np.where(np.take_along_axis(self.seen, last, axis=0), lasts_s, np.inf)
        known = np.minimum(lasts_s[:-1], lasts_s[1:])
        return np.exp(-self.step_s[:, None] / np.where(np.isfinite(known), known, MULTIPATH_S))

    def slow_scale(self, antenna: int, scale: float) -> FloatArray:
        """By how much what lasts is larger (n,) where fixes scatter more than they should by `scale`.

        What lasts for minutes of code solutions does not scatter.
        """
        return np.where(self.white_every_s[:, antenna] > 0.0, 1.0, scale)

    def as_large_as_found(self, slow: FloatArray, slow_variance: FloatArray) -> KnotFixes:
        """Scale the noise of one antenna's code solutions by what a fit found of their slow error.

        Estimates a variance component: squares of what was found over its redundancy, with the stated noise
        counting as `_STATED_COUNTS` errors. Where nothing shows the slow error, that noise stays.

        Parameters
        ----------
        slow, slow_variance : float64 (n, 2)
            The slow error in units of `slow_m`, east and north, and the variance of that.

        Notes
        -----
        Koch (1999), "Parameter estimation and hypothesis testing in linear models", section 3.6.
        """
        if self.seen.shape[1] > 1 or not (self.white_every_s[self.seen] > 0.0).all():
            return self
        # Of each axis there is a new one after twice the correlation time.
        independent = float(self.share_s.sum() / np.median(self.slow_lasts_s[self.seen]))
        shown = float(np.mean(np.maximum(1.0 - slow_variance, 0.0)))
        found = independent * float(np.mean(slow**2)) + _STATED_COUNTS
        factor = np.sqrt(found / (independent * shown + _STATED_COUNTS))
        return replace(
            self, **{name: factor * getattr(self, name) for name in ("sigma_m", "white_m", "slow_m")}
        )

    def with_what_all_share(self, smoothed_m: FloatArray, *, is_height: bool = False) -> FloatArray:
        """One sigma ``(n,)`` of a place: what smoothing leaves ``(n,)``, and what no smoothing shows.

        Of carrier-phase solutions that is what a car's antennas share, atmosphere and base station. Of other
        solutions most fades over minutes, which one antenna's own process says; two antennas share that too.
        Those are never better than what is the same all day, or for two antennas than the fix.
        """
        alone, is_code = self.seen.shape[1] == 1, self.white_every_s > 0.0
        of_phase = np.sqrt(np.maximum(self.sigma_m**2 - self.white_m**2 - self.slow_m**2, 0.0))
        shared = np.where(is_code, (_LASTING_SHARE if alone else 1.0) * self.sigma_m, of_phase)
        shared = shared * (self.up_over_plane if is_height else 1.0)
        left = smoothed_m[:, None]
        whole = np.where(is_code, np.maximum(shared, left), np.hypot(shared, left))
        best, known = np.where(self.seen, whole, np.inf).min(axis=1), self.seen.any(axis=1)
        # Where the car's own sensors bridge a gap, its ends still share what no smoothing shows.
        ends = np.where(self.seen, shared, np.inf).min(axis=1)[known]
        bridged = np.hypot(np.interp(self.t_s, self.t_s[known], ends), smoothed_m)
        return np.asarray(np.where(known, best, bridged))

    @property
    def first(self) -> BoolArray:
        """True at the first knot of each stretch without gaps ``(n,)``."""
        return np.concatenate([[True], ~self.tied])

    def running_mean(self, values: FloatArray, over_s: float) -> FloatArray:
        """Mean ``(n,)`` over so long a time about each knot, within its stretch without gaps."""
        share, t_s = self.share_s, self.t_s
        stretch = np.cumsum(self.first)
        begin, end = np.searchsorted(stretch, stretch), np.searchsorted(stretch, stretch, side="right")
        low = np.maximum(np.searchsorted(t_s, t_s - 0.5 * over_s), begin)
        high = np.minimum(np.searchsorted(t_s, t_s + 0.5 * over_s, side="right"), end)
        weighed, weight = (np.concatenate([[0.0], np.cumsum(one)]) for one in (share * values, share))
        return np.asarray((weighed[high] - weighed[low]) / (weight[high] - weight[low]))

    def geographic(self, plane_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Latitude and longitude of a point near each knot, ``(n, 2)`` in plane coordinates."""
        off = plane_m - self.path_m
        return geographic_from_enu(self.latitude_deg, self.longitude_deg, off[:, 0], off[:, 1])


def knot_fixes(fixes: Sequence[GnssFixes], knot_ns: IntArray, max_gap_s: float) -> KnotFixes:
    """Put each antenna's fixes at their nearest knots; of two at one knot the nearer one stays."""
    rows = np.stack([_nearest(one.epoch_ns, knot_ns) for one in fixes], axis=1)
    seen = rows >= 0
    lead = np.argmax(seen, axis=1)

    def gathered(values: Sequence[NDArray[np.float64]] | Sequence[IntArray]) -> NDArray[np.float64]:
        columns = [np.where(s, v[r], 0) for v, r, s in zip(values, rows.T, seen.T, strict=True)]
        return np.stack(columns, axis=1).astype(np.float64)

    late_ns = [np.where(s, f.epoch_ns[r] - knot_ns, 0) for f, r, s in zip(fixes, rows.T, seen.T, strict=True)]
    lat, lon = (gathered([getattr(f, name) for f in fixes]) for name in ("latitude_deg", "longitude_deg"))
    at = np.arange(knot_ns.size)
    known, t_s = seen.any(axis=1), seconds(knot_ns)
    lat0, lon0 = (np.interp(t_s, t_s[known], axis[at, lead][known]) for axis in (lat, lon))
    path = np.zeros((knot_ns.size, 2))
    path[1:] = np.cumsum(np.stack(enu_offset(lat0[:-1], lon0[:-1], lat0[1:], lon0[1:]), axis=1), axis=0)
    off = [
        enu_offset(lat0, lon0, np.where(s, a, lat0), np.where(s, o, lon0))
        for a, o, s in zip(lat.T, lon.T, seen.T, strict=True)
    ]
    plane = path[:, None, :] + np.stack([np.stack(one, axis=1) for one in off], axis=1)
    noise = [noise_of_fixes(f.quality, f.sigma_horizontal_m) for f in fixes]
    up = [up_over_plane(f.sigma_vertical_m, one.sigma_m) for f, one in zip(fixes, noise, strict=True)]

    def told(name: str, default: float | tuple[float, ...] = np.nan) -> FloatArray:
        columns = [getattr(f, name)[r] for f, r in zip(fixes, rows.T, strict=True)]
        column = np.stack(columns, axis=1)
        column = np.where(np.isfinite(column), column, default)
        return np.where(seen.reshape(seen.shape + (1,) * (column.ndim - 2)), column, np.nan)

    return KnotFixes(
        t_s=t_s,
        latitude_deg=lat0,
        longitude_deg=lon0,
        path_m=path,
        tied=np.diff(knot_ns) <= (max_gap_s + 0.01) * NANOSECONDS,
        plane_m=np.where(seen[:, :, None], plane, 0.0),
        height_m=gathered([f.height_m for f in fixes]),
        seen=seen,
        late_s=np.stack(late_ns, axis=1) / NANOSECONDS,
        fix_share_s=np.stack([_share_s(t_s, one, max_gap_s) for one in seen.T], axis=1),
        **{name: gathered([getattr(one, name) for one in noise]) for name in FixNoise._fields},
        up_over_plane=gathered(up),
        heading_rad=np.radians(90.0 - told("heading_deg")),
        heading_sigma_rad=np.radians(told("heading_sigma_deg", HEADING_SIGMA_DEG)),
        velocity_mps=told("velocity_mps"),
        velocity_sigma_mps=told("velocity_sigma_mps", VELOCITY_SIGMA_MPS),
    )


def _share_s(t_s: FloatArray, seen: BoolArray, max_gap_s: float) -> FloatArray:
    """Time (n,) that each fix of one antenna stands for."""
    share = np.full(t_s.size, _SHORTEST_STEP_S)
    step = np.maximum(np.diff(t_s[seen]), _SHORTEST_STEP_S)
    step = np.where(step <= max_gap_s + 0.01, step, 0.0)
    both = np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])
    share[seen] = np.maximum(0.5 * both, _SHORTEST_STEP_S)
    return share


def _nearest(epoch_ns: IntArray, knot_ns: IntArray) -> IntArray:
    """Which fix belongs to each knot; -1 for none."""
    after = np.clip(np.searchsorted(knot_ns, epoch_ns), 1, knot_ns.size - 1)
    before_nearer = epoch_ns - knot_ns[after - 1] <= knot_ns[after] - epoch_ns
    knot = np.where(before_nearer, after - 1, after)
    away = np.abs(epoch_ns - knot_ns[knot])
    rows = np.full(knot_ns.size, -1)
    order = np.argsort(-away, kind="stable")
    rows[knot[order]] = order
    return rows
