"""Ground beside the road that departs from the car's own plane as an adjustment takes it to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.noise import gauss_markov, stream

_STEP_S = 0.02
_CHORD_M = 12.0
# 0.1°: what a paver lays.
_FLATTEST = 0.0017
# A road that crosses itself does so on two levels: a pole belongs to the one that it was put beside.
_ALONG_M = 100.0


@dataclass(frozen=True, slots=True)
class GroundBeside:
    """Where feet stand over the plane on which the car stood nearest to them: one sigma of each.

    Attributes
    ----------
    height_m : float
        Of each foot, and of all feet of a drive together.
    slope : float
        Rise ahead of the car, a metre; no more than the road changes over 12 m.
    verge_slope : float
        Rise to the side, a metre, of each foot.
    fall : float
        Rise to each side, a metre, for the drive, and for `fall_lasts_s` of driving; no more than the car
        leans, but `level` at least.
    level : float
    fall_lasts_s : float
    """

    height_m: float = 0.05
    slope: float = 0.007
    verge_slope: float = 0.01
    fall: float = 0.03
    level: float = 0.005
    fall_lasts_s: float = 15.0


def feet_beside_m(
    spec: GroundBeside, motion: TrueMotion, station_m: FloatArray, plan_m: FloatArray, seed: int
) -> FloatArray:
    """Feet ``(n, 3)`` of poles at stations ``(n,)`` and places ``(n, 2)``, in the road's frame."""
    time_s = np.arange(0.0, motion.spec.duration_s, _STEP_S)
    body = motion.at(time_s, bounces=False)
    nearest = _nearest(motion.station_m(time_s), body.position_m[:, :2], station_m, plan_m)
    falls = np.clip(np.abs(body.enu_R_rig[:, 2, 1]), spec.level, spec.fall)
    lasting = float(np.sqrt(np.mean(falls**2)))
    at, order = time_s[nearest], np.argsort(nearest, kind="stable")
    origin, axes = body.position_m[nearest], body.enu_R_rig[nearest]
    level = np.column_stack([plan_m, origin[:, 2]])
    x, y, _ = np.einsum("nji,nj->in", axes, level - origin)
    fall = np.empty(len(plan_m))
    for side, rows in (("left", y >= 0.0), ("right", y < 0.0)):
        rng = stream(seed, f"ground to the {side}")
        drive = lasting * rng.normal()
        here = np.empty(len(plan_m))
        here[order] = gauss_markov(rng, at[order], 1.0, spec.fall_lasts_s)
        fall[rows] = (drive + here * falls[nearest])[rows]
    rng = stream(seed, "ground at the feet")
    slope = min(spec.slope, _changes_of_slope(motion))
    own = rng.normal(size=len(plan_m)) * np.sqrt(
        spec.height_m**2 + (slope * x) ** 2 + (spec.verge_slope * y) ** 2
    )
    above = np.abs(y) * fall + rng.normal() * spec.height_m + own
    # So high that the foot lies `above` along the plane's own upright.
    tilt = axes[:, :, 2]
    up = origin[:, 2] + (above - np.einsum("nk,nk->n", tilt[:, :2], plan_m - origin[:, :2])) / tilt[:, 2]
    return np.column_stack([plan_m, up])


def _nearest(here_m: FloatArray, car_m: FloatArray, station_m: FloatArray, plan_m: FloatArray) -> IntArray:
    """When (n,) the car, at stations (t,) and places (t, 2), came nearest to each pole on its own road."""
    first = np.minimum(np.searchsorted(here_m, station_m - _ALONG_M), here_m.size - 1)
    last = np.maximum(np.searchsorted(here_m, station_m + _ALONG_M), first + 1)
    ways = zip(first.tolist(), last.tolist(), plan_m, strict=True)
    return np.array([a + int(np.argmin(np.hypot(*(car_m[a:b] - place).T))) for a, b, place in ways])


def _changes_of_slope(motion: TrueMotion) -> float:
    """How much the ground ahead departs from the slope below the car, one sigma, on the way it drove."""
    ends = motion.station_m(np.array([0.0, motion.spec.duration_s]))
    low, high = min(ends) + _CHORD_M, max(ends) - _CHORD_M
    if high - low < _CHORD_M:
        return np.inf
    middle = np.arange(low, high, 1.0)
    before, here, after = (
        motion.road.surface_m(middle + off, np.full(middle.size, motion.spec.lane_offset_m))
        for off in (-_CHORD_M, 0.0, _CHORD_M)
    )
    return max(_FLATTEST, float(np.sqrt(np.mean((before - 2.0 * here + after) ** 2))) / _CHORD_M)
