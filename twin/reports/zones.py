"""In which coordinate system a survey really is: the one in which it lies where the drives saw it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from geoloc.arrays import FloatArray
from twin.errors import TruthError
from twin.reports.pairing import Placed
from twin.reports.truth import UTM33, Truth, between

_ZONES = range(25831, 25837)
"""EUREF89 as UTM zones 31 to 36 north."""
_NEAR_M = 2_000.0
_FAR_M = 1_000.0
"""No estimate is off by this: its survey is of something else, or in another system."""


def system_that_fits(points_m: FloatArray, stated: int, distance_m: Callable[[FloatArray], float]) -> str:
    """Say as which zone the numbers of a survey would fit, with the cure; "" where as none.

    Parameters
    ----------
    points_m : float64 (n, 2)
        In EPSG:25833, as the file's numbers were taken.
    stated : int
        EPSG code of the system that they were taken to be in.
    distance_m : callable
        How far positions (n, 2) in EPSG:25833 are from where they should be.
    """
    # Back to the numbers of the file.
    own = between(points_m, UTM33, stated)
    fits = {zone: distance_m(between(own, zone, UTM33)) for zone in _ZONES if zone != stated}
    best = min(fits, key=fits.__getitem__)
    if not fits[best] < _NEAR_M:
        return ""
    said = f"as EPSG:{best} (UTM zone {best - 25800})"
    return f"its numbers fit {said}, not as EPSG:{stated}: say so by --epsg {best}, or in a column epsg."


def check_pairs(pairs: Sequence[tuple[Placed, Truth]]) -> None:
    """Refuse a survey that is far from the estimates of its own objects.

    Raises
    ------
    TruthError
        More than 1 km: which object, how far, and in which system the numbers would fit.
    """
    away = np.array([np.hypot(p.east_m - t.east_m, p.north_m - t.north_m) for p, t in pairs])
    far = [pair for pair, metres in zip(pairs, away, strict=True) if metres > _FAR_M]
    if not far:
        return
    placed, truth = pairs[int(away.argmax())]
    seen_m = np.array([(p.east_m, p.north_m) for p, t in far if t.epsg == truth.epsg])
    survey_m = np.array([(t.east_m, t.north_m) for _, t in far if t.epsg == truth.epsg])
    cure = system_that_fits(survey_m, truth.epsg, lambda at_m: float(np.median(np.hypot(*(at_m - seen_m).T))))
    n = len({t.object for _, t in far})
    others = f" (and {n - 1} more)" if n > 1 else ""
    raise TruthError(
        f"Object {truth.object}{others} of the truth file is {away.max():,.0f} m from where the drive "
        f"{placed.drive_id} saw it: "
        + (cure or "is it the object of this name? A column drive_id tells those of several drives apart.")
    )
