"""Estimates against surveyed truth: the numbers that the paper reports."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.locate.accuracy import ErrorStats, ellipse_coverage, error_stats, stats_by_range
from twin.errors import TruthError
from twin.reports.error_groups import GroupErrors, grouped
from twin.reports.object_errors import (
    HeightErrors,
    ObjectError,
    driven_ways,
    height_errors,
    mean_nees,
    object_errors,
)
from twin.reports.pairing import Pairing, Placed, by_id, by_position, nearest_m
from twin.reports.sighting_errors import SightingError, sighting_errors
from twin.reports.survey_doubts import SurveyDoubt, survey_doubts
from twin.reports.truth import Truth, read_truth
from twin.reports.zones import check_pairs, system_that_fits
from twin.store import schema
from twin.store.records import Estimate
from twin.store.store import Store

__all__ = ["PAIR_BY", "WITHIN_M", "Evaluation", "MethodResult", "Truth", "evaluate", "read_truth"]

PAIR_BY = ("auto", "id", "position")
"""Ways to find out which surveyed object an estimate is of."""
WITHIN_M = 5.0
"""An estimate farther from every surveyed position is of another object, if they are paired by position."""
ONE_FRAME = ("single-frame", "paper")
"""Methods whose single sightings are positions of their own; `adjusted` only ever places whole objects."""


@dataclass(frozen=True, slots=True)
class RangeErrors:
    """Horizontal errors, metres, of what was seen from ``[from_m, to_m)``; `to_m` is None for no limit.

    `coverage95` is the share of the truths inside the 95 % ellipse.
    """

    from_m: float
    to_m: float | None
    n: int
    mean: float
    median: float
    p95: float
    max: float
    rmse: float
    coverage95: float


@dataclass(frozen=True, slots=True)
class MethodResult:
    """Errors of one method.

    Attributes
    ----------
    objects : ErrorStats
        Of the estimates' horizontal errors.
    coverage95 : float
        Share of the truths inside the 95 % ellipse.
    objects_by_range, sightings_by_range : tuple of RangeErrors
        The same by distance: of the estimates by that of their nearest sighting, and of single
        sightings; the latter empty for `adjusted`, whose sightings are no positions by themselves.
    not_estimated : tuple of str
        Truth objects that this method has no estimate of.
    not_in_truth : int
        Estimates of this method that are of no truth object.
    paired_by : str
        ``id`` or ``position``.
    nees_per_dof : float or None
        Mean of the estimates' squared errors in sigmas, divided by the plane's 2 degrees of freedom: 1 where
        the ellipses are honest.
    heights : HeightErrors
        Where the truth has heights.
    each : tuple of ObjectError
        The estimates one by one, by drive and object.
    """

    method: str
    objects: ErrorStats
    coverage95: float
    objects_by_range: tuple[RangeErrors, ...]
    sightings_by_range: tuple[RangeErrors, ...]
    not_estimated: tuple[str, ...]
    not_in_truth: int
    paired_by: str
    nees_per_dof: float | None
    heights: HeightErrors
    each: tuple[ObjectError, ...]


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Results by method, and the arrays behind them for plots."""

    methods: tuple[MethodResult, ...]
    sightings: dict[str, dict[str, FloatArray]]
    """Method of one frame → ``range_m``, ``speed_mps``, ``error_m`` of every located sighting of a truth
    object."""
    estimates: dict[str, dict[str, FloatArray]]
    """method → ``range_m`` (nearest sighting), ``speed_mps`` (the car's mean while it saw the object) and
    ``error_m`` of every estimate."""
    doubts: tuple[SurveyDoubt, ...] = ()
    """What speaks against the survey: look at these before the errors."""
    each_sighting: tuple[SightingError, ...] = ()
    """Every located sighting of a truth object, of the methods of one frame."""

    def as_json(self) -> list[dict[str, Any]]:
        """Return the numbers without the arrays."""
        return [asdict(result) for result in self.methods]

    def grouped(self, by: Sequence[str]) -> tuple[GroupErrors, ...]:
        """Summarise errors by camera, speed, range or several of them (`twin.reports.error_groups`)."""
        objects = [one for result in self.methods for one in result.each]
        return grouped(objects, self.each_sighting, by)


def evaluate(
    store: Store, truths: Sequence[Truth], *, pair_by: str = PAIR_BY[0], within_m: float = WITHIN_M
) -> Evaluation:
    """Compare every method in the store with the truth.

    Parameters
    ----------
    pair_by : {"auto", "id", "position"}
        How estimates find their truth. By position they are paired one-to-one, a drive and method at a time,
        where both know sign codes only if they share one. Default: by id, or by position if no id fits.
    within_m : float
        Farther apart than this nothing is paired by position. What is paired by id and mostly farther apart
        is doubted.

    Returns
    -------
    Evaluation
        ``methods`` has the numbers by method, each object's in ``methods[k].each``, each sighting's in
        ``each_sighting``; ``estimates`` and ``sightings`` the arrays for plots; ``doubts`` what speaks
        against the survey; ``grouped`` gives them by camera, speed and range.

    Raises
    ------
    TruthError
        None of the truth's objects has an estimate.
    """
    sightings = _sightings(store)
    estimates = _estimates(store, sightings)
    if not estimates:
        raise TruthError(f"The store {store.name} has no estimates yet: run `twin ingest-drive` first.")
    find, paired_by = _pairing(store, estimates, truths, pair_by, within_m)
    check_pairs(_paired(estimates, find))
    ways = driven_ways(store)
    results: list[MethodResult] = []
    sighting_arrays: dict[str, dict[str, FloatArray]] = {}
    estimate_arrays: dict[str, dict[str, FloatArray]] = {}
    each_sighting: list[SightingError] = []
    for method in store.methods():
        mine = [estimate for estimate in estimates if estimate.method == method]
        own = _paired(mine, find)
        if not own:
            continue
        placed = (s for s in sightings if s.method == method in ONE_FRAME and math.isfinite(s.east_m))
        single = _paired(placed, find)
        objects, singles = _errors(own), _errors(single)
        estimate_arrays[method] = objects.arrays()
        if single:
            sighting_arrays[method] = singles.arrays()
            each_sighting += sighting_errors(single, ways)
        missed = {truth.object for truth in truths} - {truth.object for _, truth in own}
        each = object_errors(own, ways)
        results.append(
            _result(method, objects, singles, each, sorted(missed), len(mine) - len(own), paired_by)
        )
    doubts = survey_doubts([one for result in results for one in result.each], within_m)
    return Evaluation(tuple(results), sighting_arrays, estimate_arrays, doubts, tuple(each_sighting))


_NUMBERS = ("east_m", "north_m", "cov_ee_m2", "cov_en_m2", "cov_nn_m2", "range_m", "speed_mps")


def _sightings(store: Store) -> list[Placed]:
    """Sightings that took part, with the positions that they give alone; NaN where they give none."""
    table = schema.sighting.c
    columns = [table[name] for name in ("method", "drive_id", "object", "camera", "epoch_ns", *_NUMBERS)]
    sightings = []
    order = table.drive_id, table.method, table.number
    for row in store.rows(sa.select(*columns).where(table.rejected == "").order_by(*order)):
        numbers = (math.nan if row[name] is None else row[name] for name in _NUMBERS)
        east_m, north_m, ee, en, nn, range_m, speed_mps = numbers
        whose = row["method"], row["drive_id"], row["object"]
        one = Placed(*whose, (), east_m, north_m, (ee, en, nn), range_m, speed_mps)
        sightings.append(replace(one, camera=row["camera"], epoch_ns=row["epoch_ns"]))
    return sightings


def _estimates(store: Store, sightings: Sequence[Placed]) -> list[Placed]:
    """Estimates in the order of their ids, at the distance of their nearest sighting."""
    speeds, cameras = _mean_speeds(sightings), _cameras(sightings)
    estimates = []
    for row in store.rows(sa.select(schema.estimate).order_by(schema.estimate.c.estimate_id)):
        one = Estimate.from_row(row)
        whose = one.method, one.drive_id, one.object
        speed_mps = speeds.get(whose, math.nan)
        estimates.append(
            Placed(
                *(*whose, one.codes, one.east_m, one.north_m, one.covariance_m2, one.range_min_m, speed_mps),
                height_m=one.height_m,
                sigma_height_m=math.nan if one.sigma_height_m is None else one.sigma_height_m,
                camera="+".join(sorted(cameras.get(whose, ()))),
            )
        )
    return estimates


def _result(
    method: str,
    objects: _Errors,
    singles: _Errors,
    each: tuple[ObjectError, ...],
    missed: list[str],
    not_in_truth: int,
    paired_by: str,
) -> MethodResult:
    return MethodResult(
        method=method,
        objects=error_stats(objects.error_m),
        coverage95=float(ellipse_coverage(objects.offset_m, objects.covariance_m2)),
        objects_by_range=objects.by_range(),
        sightings_by_range=singles.by_range(),
        not_estimated=tuple(missed),
        not_in_truth=not_in_truth,
        paired_by=paired_by,
        nees_per_dof=mean_nees(each),
        heights=height_errors(each),
        each=each,
    )


def _pairing(
    store: Store, estimates: Sequence[Placed], truths: Sequence[Truth], pair_by: str, within_m: float
) -> tuple[Pairing, str]:
    """How estimates find their truth, and which way that is.

    Raises
    ------
    TruthError
        No estimate finds any.
    """
    if pair_by not in PAIR_BY:
        raise TruthError(f"Estimates cannot be paired by {pair_by!r}: use one of {', '.join(PAIR_BY)}.")
    ways = {"id": by_id(truths), "position": by_position(estimates, truths, within_m)}
    for way in ways if pair_by == "auto" else (pair_by,):
        if any(ways[way](estimate) is not None for estimate in estimates):
            return ways[way], way
    names = ", ".join(sorted({t.object for t in truths})[:3])
    held = ", ".join(sorted({estimate.object for estimate in estimates})[:3])
    if pair_by == "id":
        raise TruthError(
            f"No estimate in {store.name} belongs to an object of the truth file ({names}, …): the "
            f"column object must hold the ids of the store's objects ({held}, …), as `twin export` shows "
            "them; or pair them by position (--pair-by position)."
        )
    away_m = nearest_m(estimates, _places(truths))
    fits = "" if away_m < _FAR_M else _zone_that_fits(estimates, truths)
    if fits:
        raise TruthError(f"No estimate in {store.name} stands within {away_m:,.0f} m of the survey: {fits}")
    raise TruthError(
        f"No estimate in {store.name} ({held}, …) has the id of an object of the truth file ({names}, "
        f"…), or stands within {within_m:g} m of one; the nearest is {away_m:,.1f} m away: is it "
        f"the right file, and in EPSG:{truths[0].epsg} (--epsg)? --within allows more."
    )


_FAR_M = 5_000.0
"""Nearer than this a survey is in the system that it was taken to be in, but of other objects."""


def _places(truths: Sequence[Truth]) -> FloatArray:
    return np.array([(truth.east_m, truth.north_m) for truth in truths])


def _zone_that_fits(estimates: Sequence[Placed], truths: Sequence[Truth]) -> str:
    one_system = [truth for truth in truths if truth.epsg == truths[0].epsg]
    return system_that_fits(_places(one_system), truths[0].epsg, lambda at_m: nearest_m(estimates, at_m))


def _paired(placed: Iterable[Placed], find: Pairing) -> list[tuple[Placed, Truth]]:
    """What has a truth, with it."""
    return [(one, truth) for one in placed if (truth := find(one)) is not None]


def _mean_speeds(sightings: Sequence[Placed]) -> dict[tuple[str, str, str], float]:
    """(method, drive, object) → the car's mean speed over the sightings that took part."""
    speeds: dict[tuple[str, str, str], list[float]] = {}
    for sighting in sightings:
        if math.isfinite(sighting.speed_mps):
            speeds.setdefault(sighting.key, []).append(sighting.speed_mps)
    return {key: float(np.mean(values)) for key, values in speeds.items()}


def _cameras(sightings: Sequence[Placed]) -> dict[tuple[str, str, str], set[str]]:
    """(method, drive, object) → the cameras whose sightings took part."""
    cameras: dict[tuple[str, str, str], set[str]] = {}
    for sighting in sightings:
        cameras.setdefault(sighting.key, set()).add(sighting.camera)
    return cameras


@dataclass(frozen=True, slots=True)
class _Errors:
    """Positions minus truth, EPSG:25833, with their covariance and the range to the object."""

    offset_m: FloatArray
    covariance_m2: FloatArray
    range_m: FloatArray
    speed_mps: FloatArray

    @property
    def error_m(self) -> FloatArray:
        return np.asarray(np.hypot(self.offset_m[:, 0], self.offset_m[:, 1]))

    def arrays(self) -> dict[str, FloatArray]:
        return {"range_m": self.range_m, "speed_mps": self.speed_mps, "error_m": self.error_m}

    def by_range(self) -> tuple[RangeErrors, ...]:
        bins = []
        for one in stats_by_range(self.error_m, self.range_m):
            if one.stats.n:
                inside = (self.range_m >= one.from_m) & (self.range_m < one.to_m)
                covered = ellipse_coverage(self.offset_m[inside], self.covariance_m2[inside])
                # JSON has no infinity: the last bin is open.
                to_m = one.to_m if math.isfinite(one.to_m) else None
                bins.append(
                    RangeErrors(from_m=one.from_m, to_m=to_m, coverage95=float(covered), **asdict(one.stats))
                )
        return tuple(bins)


def _errors(pairs: Sequence[tuple[Placed, Truth]]) -> _Errors:
    offset = [(placed.east_m - truth.east_m, placed.north_m - truth.north_m) for placed, truth in pairs]
    covariance = np.array([placed.covariance_m2 for placed, _ in pairs]).reshape(-1, 3)
    return _Errors(
        offset_m=np.array(offset).reshape(-1, 2),
        covariance_m2=covariance[:, [0, 1, 1, 2]].reshape(-1, 2, 2),
        range_m=np.array([placed.range_m for placed, _ in pairs]),
        speed_mps=np.array([placed.speed_mps for placed, _ in pairs]),
    )
