"""Estimates against surveyed truth: the numbers and the figures that the paper reports."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from geoloc.accuracy import ellipse_coverage, error_stats, stats_by_range
from twin import schema
from twin.errors import TruthError
from twin.folders import make_folder
from twin.store import Store

FloatArray = NDArray[np.float64]
Row = Mapping[str, Any]

_REQUIRED = ("object", "easting", "northing")


@dataclass(frozen=True, slots=True)
class Truth:
    """One surveyed object, EPSG:25833. `drive_id` is "" where the file does not tell drives apart."""

    object: str
    drive_id: str
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class MethodResult:
    """Errors of one method.

    Attributes
    ----------
    objects : dict
        n, mean, median, p95, max, rmse of the estimates' horizontal errors, metres.
    coverage95 : float
        Share of the truths inside the 95 % ellipse.
    objects_by_range, sightings_by_range : list of dict
        The same statistics by distance: of the estimates by that of their nearest sighting, and of single
        sightings. ``from_m``, ``to_m`` (None: no limit), n … rmse, ``coverage95``.
    not_estimated : tuple of str
        Truth objects that this method has no estimate of.
    """

    method: str
    objects: dict[str, float]
    coverage95: float
    objects_by_range: list[dict[str, Any]]
    sightings_by_range: list[dict[str, Any]]
    not_estimated: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Results by method, and the arrays behind them for plots."""

    methods: tuple[MethodResult, ...]
    sightings: dict[str, dict[str, FloatArray]]
    """method → ``range_m``, ``speed_mps`` and ``error_m`` of every located sighting of a truth object."""
    estimates: dict[str, dict[str, FloatArray]]
    """method → ``range_m`` (nearest sighting) and ``error_m`` of every estimate."""

    def as_json(self) -> list[dict[str, Any]]:
        """Return the numbers without the arrays."""
        return [asdict(result) for result in self.methods]


def read_truth(path: Path | str) -> list[Truth]:
    """Read surveyed positions: CSV with the columns object, label, easting, northing (EPSG:25833).

    A column ``drive_id`` is optional; without it an object's truth holds for every drive in the store.

    Raises
    ------
    TruthError
        No such file, a missing column, or a number that is none: file, line and cure.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise TruthError(f"The truth file {path} cannot be read ({error}): name a CSV file.") from error
    reader = csv.DictReader(text.splitlines())
    missing = [name for name in _REQUIRED if name not in (reader.fieldnames or ())]
    if missing:
        raise TruthError(
            f"The truth file {path} lacks the column {', '.join(missing)}: it needs object, label, easting, "
            "northing (EPSG:25833), separated by commas."
        )
    truths = [_truth(row, path, number) for number, row in enumerate(reader, start=2)]
    if not truths:
        raise TruthError(f"The truth file {path} has no rows: give one a surveyed object.")
    return truths


def _truth(row: Mapping[str, str | None], path: Path, line: int) -> Truth:
    try:
        east, north = float(row["easting"] or ""), float(row["northing"] or "")
    except ValueError as error:
        raise TruthError(f"{path}, line {line}: easting and northing must be numbers ({error}).") from error
    if not (-200_000 < east < 1_200_000 and 6_300_000 < north < 8_100_000):
        raise TruthError(
            f"{path}, line {line}: easting {east} and northing {north} are not in Norway in EPSG:25833: "
            "check the coordinate system and that the columns are not swapped."
        )
    return Truth((row["object"] or "").strip(), (row.get("drive_id") or "").strip(), east, north)


def evaluate(store: Store, truths: Sequence[Truth]) -> Evaluation:
    """Compare every method in the store with the truth.

    Raises
    ------
    TruthError
        None of the truth's objects has an estimate.
    """
    known = {(truth.drive_id, truth.object): truth for truth in truths}
    estimates = store.rows(sa.select(schema.estimate).order_by(schema.estimate.c.estimate_id))
    sightings = store.rows(
        sa.select(schema.sighting).where(
            schema.sighting.c.rejected == "", schema.sighting.c.east_m.is_not(None)
        )
    )
    results: list[MethodResult] = []
    sighting_arrays: dict[str, dict[str, FloatArray]] = {}
    estimate_arrays: dict[str, dict[str, FloatArray]] = {}
    for method in store.methods():
        own = [(e, t) for e in estimates if e["method"] == method and (t := _find(known, e)) is not None]
        seen = [(s, t) for s in sightings if s["method"] == method and (t := _find(known, s)) is not None]
        if not own:
            continue
        objects, singles = _errors(own, "range_min_m"), _errors(seen, "range_m")
        estimate_arrays[method], sighting_arrays[method] = objects.arrays(), singles.arrays()
        found = {row["object"] for row, _ in own}
        results.append(
            MethodResult(
                method=method,
                objects=asdict(error_stats(objects.error_m)),
                coverage95=float(ellipse_coverage(objects.offset_m, objects.covariance_m2)),
                objects_by_range=objects.by_range(),
                sightings_by_range=singles.by_range(),
                not_estimated=tuple(sorted({t.object for t in truths} - found)),
            )
        )
    if not estimates:
        raise TruthError(f"The store {store.path} has no estimates yet: run `twin ingest-drive` first.")
    if not results:
        names = ", ".join(sorted({t.object for t in truths})[:3])
        raise TruthError(
            f"No estimate in {store.path} belongs to an object of the truth file ({names}, …): the column "
            "object must hold the annotator's track ids as `twin export` shows them."
        )
    return Evaluation(tuple(results), sighting_arrays, estimate_arrays)


def _find(known: Mapping[tuple[str, str], Truth], row: Row) -> Truth | None:
    return known.get((row["drive_id"], row["object"])) or known.get(("", row["object"]))


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

    def by_range(self) -> list[dict[str, Any]]:
        bins = []
        for one in stats_by_range(self.error_m, self.range_m):
            if one.stats.n:
                inside = (self.range_m >= one.from_m) & (self.range_m < one.to_m)
                covered = ellipse_coverage(self.offset_m[inside], self.covariance_m2[inside])
                # JSON has no infinity: the last bin is open.
                to_m = one.to_m if math.isfinite(one.to_m) else None
                bins.append(
                    {"from_m": one.from_m, "to_m": to_m, **asdict(one.stats), "coverage95": float(covered)}
                )
        return bins


def _errors(pairs: Sequence[tuple[Row, Truth]], range_name: str) -> _Errors:
    def column(*names: str) -> FloatArray:
        values = [[row.get(name) for name in names] for row, _ in pairs]
        return np.array(values, dtype=np.float64).reshape(len(pairs), len(names))

    truth = np.array([(t.east_m, t.north_m) for _, t in pairs]).reshape(-1, 2)
    covariance = column("cov_ee_m2", "cov_en_m2", "cov_en_m2", "cov_nn_m2").reshape(-1, 2, 2)
    return _Errors(
        offset_m=column("east_m", "north_m") - truth,
        covariance_m2=covariance,
        range_m=column(range_name)[:, 0],
        speed_mps=column("speed_mps")[:, 0],
    )


def plot(evaluation: Evaluation, folder: Path | str) -> list[Path]:
    """Draw error against distance and against speed, every method in each, like the paper's figures.

    Returns
    -------
    list of Path
        ``error_distance.png`` (the paper's figures 9 and 11) and ``error_speed.png``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    folder = make_folder(folder)
    written = []
    for name, column, label, scale in (
        ("error_distance.png", "range_m", "distance from camera to object [m]", 1.0),
        ("error_speed.png", "speed_mps", "speed [km/h]", 3.6),
    ):
        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        for (method, arrays), colour in zip(
            sorted(evaluation.sightings.items()), ("#d55e00", "#0072b2", "#009e73"), strict=False
        ):
            n = len(arrays["error_m"])
            axes.plot(
                arrays[column] * scale,
                arrays["error_m"],
                ".",
                ms=4,
                alpha=0.5,
                color=colour,
                label=f"{method}, {n} single sightings",
            )
            if column == "range_m":
                objects = evaluation.estimates[method]
                axes.plot(
                    objects["range_m"],
                    objects["error_m"],
                    "D",
                    ms=6,
                    mec="black",
                    color=colour,
                    label=f"{method}, {len(objects['error_m'])} objects (at their nearest sighting)",
                )
        axes.set(xlabel=label, ylabel="horizontal error [m]", ylim=(0, None))
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
        path = folder / name
        figure.savefig(path, dpi=120)
        written.append(path)
    return written
