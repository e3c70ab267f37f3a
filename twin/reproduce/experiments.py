"""What an experiment measured, and the paper's tables of it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from geoloc.arrays import FloatArray
from twin.reports.object_errors import ObjectError
from twin.reports.sighting_errors import SightingError
from twin.reproduce.published import standing_m
from twin.store.kinds import Method

Error = SightingError | ObjectError
METHODS = (Method.PAPER, Method.SINGLE_FRAME, Method.ADJUSTED)
STANDS_KMH = 1.0
"""A car that is slower stands."""
SHOWN_M = 20.0
"""Farthest distance of tables by distance and of figures: the paper's is 19.3 m."""
BAND_M = 2.5
_ONE_SPEED = 0.2
"""Speeds that differ by less, of the greater, are one series."""


@dataclass(frozen=True)
class Experiment:
    """Errors of one experiment: one or more drives past the same objects.

    Attributes
    ----------
    name : str
    figure : str
        The paper's figure in whose place ours stands; "" of one's own drives.
    sightings : tuple of SightingError
        Single frames of ``paper`` and ``single-frame``.
    objects : tuple of ObjectError
        Of all methods.
    """

    name: str
    figure: str
    sightings: tuple[SightingError, ...]
    objects: tuple[ObjectError, ...]

    @cached_property
    def stands(self) -> bool:
        """Whether the car stood while it saw most of the objects."""
        return stands(self.sightings)

    @cached_property
    def slow_below_kmh(self) -> float | None:
        """Where slow ends and fast begins; None where the car kept one speed."""
        speeds = [kmh(one) for one in self.sightings if np.isfinite(kmh(one))]
        if not speeds or self.stands:
            return None
        low, high = np.percentile(speeds, [5.0, 95.0])
        return float(low + high) / 2.0 if high - low > _ONE_SPEED * high else None

    def series_of(self, one: Error) -> str:
        """The series that an error belongs to: a camera where the car stands, else ``slow`` or ``fast``."""
        if self.stands:
            return one.camera if isinstance(one, SightingError) else "all cameras"
        if self.slow_below_kmh is None:
            return "one speed"
        return "slow" if kmh(one) < self.slow_below_kmh else "fast"

    def series(self, one_kind: Sequence[Error]) -> dict[str, Points]:
        """Distances and errors by series, the slow one first."""
        members: dict[str, list[Error]] = defaultdict(list)
        for one in one_kind:
            members[self.series_of(one)].append(one)
        order = sorted(members, key=lambda name: (name == "fast", name))
        return {name: self._points(members[name]) for name in order}

    def distance_m(self, one: Error) -> float:
        """From the car to the survey, of an object where it was nearest; NaN where unknown."""
        if isinstance(one, SightingError):
            return one.distance_m
        range_m = float("nan") if one.range_m is None else one.range_m
        return self._nearest_m.get((one.drive_id, one.truth), range_m)  # of boxes no single one has a place

    @cached_property
    def _nearest_m(self) -> dict[tuple[str, str], float]:
        nearest: dict[tuple[str, str], float] = {}
        for one in self.sightings:
            key = one.drive_id, one.truth
            nearest[key] = min(one.distance_m, nearest.get(key, one.distance_m))
        return nearest

    def _points(self, members: Sequence[Error]) -> Points:
        distance = np.array([self.distance_m(one) for one in members])
        shown = distance <= SHOWN_M
        speeds = np.array([kmh(one) for one in members])[shown]
        middle = float(np.nanmedian(speeds)) if np.isfinite(speeds).any() else float("nan")
        return Points(distance[shown], np.array([one.error_m for one in members])[shown], middle)

    def of(self, method: str) -> tuple[Sequence[Error], Sequence[Error]]:
        """Single frames and objects of one method."""
        frames = [one for one in self.sightings if one.method == method]
        return frames, [one for one in self.objects if one.method == method]


@dataclass(frozen=True, slots=True)
class Points:
    """Errors against distance, (n,) each, and the car's median speed."""

    distance_m: FloatArray
    error_m: FloatArray
    kmh: float

    def trend(self) -> tuple[float, float] | None:
        """Least-squares line: error at distance 0, and metres a metre; None of fewer than three errors."""
        if self.distance_m.size < 3 or np.ptp(self.distance_m) < 1.0:
            return None
        slope, intercept = np.polyfit(self.distance_m, self.error_m, 1)
        return float(intercept), float(slope)


def kmh(one: Error) -> float:
    """Speed of the car, NaN where unknown."""
    return float("nan") if one.speed_mps is None else 3.6 * one.speed_mps


def stands(sightings: Sequence[SightingError]) -> bool:
    """Tell whether the car stood while it saw most of the objects."""
    speeds = [kmh(one) for one in sightings]
    return bool(speeds) and float(np.nanmedian(speeds)) < STANDS_KMH


@dataclass(frozen=True, slots=True)
class StandingRow:
    """A row of table 1: mean error of the frames of one camera that show one object, metres.

    `adjusted_m` is the error of the object's one position from all cameras together; `published_m` what the
    paper's table has of that camera at that distance. None where there is none.
    """

    experiment: str
    camera: str
    object: str
    distance_m: float
    frames: int
    paper_m: float | None
    single_frame_m: float | None
    adjusted_m: float | None
    published_m: float | None


@dataclass(frozen=True, slots=True)
class SignRow:
    """A row of tables 2 and 3: one object of one drive, metres.

    `distance_m`, `camera` and the first two errors are of one picture, the nearest; the last three of all
    pictures together.
    """

    experiment: str
    drive_id: str
    object: str
    speed_kmh: float | None
    distance_m: float
    camera: str
    paper_m: float | None
    single_frame_m: float | None
    paper_together_m: float | None
    single_frame_together_m: float | None
    adjusted_m: float | None


@dataclass(frozen=True, slots=True)
class BandRow:
    """Errors of a figure between two distances: of single frames, or of objects with all their frames."""

    experiment: str
    method: str
    kind: str
    series: str
    speed_kmh: float | None
    from_m: float
    to_m: float
    n: int
    median_m: float
    p95_m: float
    max_m: float


@dataclass(frozen=True, slots=True)
class TrendRow:
    """The trend line of a series: error = at_0_m + slope · distance."""

    experiment: str
    method: str
    kind: str
    series: str
    speed_kmh: float | None
    n: int
    at_0_m: float
    slope: float


@dataclass(frozen=True, slots=True)
class Reproduction:
    """The paper's tables, a tuple of rows each, and what they were made of."""

    experiments: tuple[Experiment, ...]
    standing: tuple[StandingRow, ...]
    signs: tuple[SignRow, ...]
    bands: tuple[BandRow, ...]
    trends: tuple[TrendRow, ...]
    warnings: tuple[str, ...] = ()
    files: tuple[Path, ...] = field(default=())


def reproduction(experiments: Sequence[Experiment], warnings: Sequence[str] = ()) -> Reproduction:
    """Work out the tables of some experiments."""
    standing = [row for one in experiments if one.stands for row in _standing(one)]
    moving = [one for one in experiments if not one.stands]
    return Reproduction(
        experiments=tuple(experiments),
        standing=tuple(standing),
        signs=tuple(row for one in moving for row in _signs(one)),
        bands=tuple(row for one in moving for row in _per_series(one, _bands)),
        trends=tuple(row for one in experiments for row in _per_series(one, _trends)),
        warnings=tuple(warnings),
    )


def _standing(experiment: Experiment) -> list[StandingRow]:
    frames: dict[tuple[str, str], dict[str, list[SightingError]]] = defaultdict(lambda: defaultdict(list))
    for one in experiment.sightings:
        frames[one.camera, one.truth][one.method].append(one)
    together = {one.truth: one.error_m for one in experiment.objects if one.method == Method.ADJUSTED}
    rows = []
    for (camera, truth), by_method in frames.items():
        every = next(iter(by_method.values()))
        far_m = float(np.mean([one.distance_m for one in every]))
        paper, single = (_mean_error(by_method[method]) for method in METHODS[:2])
        where = experiment.name, camera, truth, far_m, len(every)
        rows.append(StandingRow(*where, paper, single, together.get(truth), standing_m(camera, far_m)))
    return sorted(rows, key=lambda row: (row.camera, row.distance_m))


def _mean_error(frames: Sequence[SightingError]) -> float | None:
    return float(np.mean([one.error_m for one in frames])) if frames else None


def _signs(experiment: Experiment) -> list[SignRow]:
    alone: dict[tuple[str, str], dict[str, list[SightingError]]] = defaultdict(lambda: defaultdict(list))
    for one in experiment.sightings:
        alone[one.drive_id, one.truth][one.method].append(one)
    together = {(one.drive_id, one.truth, one.method): one.error_m for one in experiment.objects}
    rows = []
    for (drive, truth), by_method in alone.items():
        near = {method: min(frames, key=lambda one: one.distance_m) for method, frames in by_method.items()}
        first = near.get(Method.PAPER) or next(iter(near.values()))
        paper, single = (near[method].error_m if method in near else None for method in METHODS[:2])
        of_all = (together.get((drive, truth, method)) for method in METHODS)
        speed = None if first.speed_mps is None else kmh(first)
        where = experiment.name, drive, truth, speed, first.distance_m, first.camera
        rows.append(SignRow(*where, paper, single, *of_all))
    return sorted(rows, key=lambda row: (row.drive_id, row.distance_m))


_Row = TypeVar("_Row", BandRow, TrendRow)
_Where = tuple[str, str, str, str, float | None]


def _per_series(experiment: Experiment, rows_of: Callable[[_Where, Points], list[_Row]]) -> list[_Row]:
    rows: list[_Row] = []
    for method in METHODS:
        for kind, errors in zip(("sightings", "objects"), experiment.of(method), strict=True):
            for name, points in experiment.series(errors).items():
                speed = points.kmh if np.isfinite(points.kmh) else None
                rows += rows_of((experiment.name, method, kind, name, speed), points)
    return rows


def _bands(where: _Where, points: Points) -> list[BandRow]:
    rows = []
    for low in np.arange(0.0, SHOWN_M, BAND_M):
        error = points.error_m[(points.distance_m >= low) & (points.distance_m < low + BAND_M)]
        if error.size:
            middle, high = np.percentile(error, [50.0, 95.0])
            numbers = float(middle), float(high), float(error.max())
            rows.append(BandRow(*where, float(low), float(low + BAND_M), error.size, *numbers))
    return rows


def _trends(where: _Where, points: Points) -> list[TrendRow]:
    trend = points.trend()
    return [] if trend is None else [TrendRow(*where, points.error_m.size, *trend)]
