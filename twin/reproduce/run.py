"""Trips, recorded or simulated → the paper's experiments."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from twin.errors import ConfigError, TruthError
from twin.ingest.ingest import ingest_drive
from twin.reports.evaluation import WITHIN_M, Evaluation, evaluate
from twin.reports.truth import Truth, read_truth
from twin.reproduce.experiments import METHODS, Experiment, Reproduction, reproduction, stands
from twin.samples.simulation import TRUTH, simulate
from twin.store.kinds import Method
from twin.store.store import Store

Say = Callable[[str], None]
_USUAL: Mapping[str, str] = MappingProxyType({})


class _Simulated(NamedTuple):
    """One of the paper's experiments in the simulator."""

    name: str
    figure: str
    scenario: str
    speeds_kmh: tuple[float | None, ...]


SIMULATED = (
    _Simulated("standing", "6", "still", (None,)),
    _Simulated("approach", "7", "approach", (7.0, 20.0)),
    _Simulated("urban", "9", "urban", (25.0,)),
    _Simulated("highway", "11", "highway", (35.0, 45.0)),
)


def reproduce(
    trips: Sequence[Path | str],
    truths: Sequence[Truth],
    *,
    paper: Mapping[str, str] = _USUAL,
    within_m: float = WITHIN_M,
    progress: Say | None = None,
) -> Reproduction:
    """Locate the objects of recorded trips by every method, and work out the paper's tables of their errors.

    Trips past the same surveyed objects are one experiment: slow and fast, as the paper drives; trips that
    stood are one of their own.

    Parameters
    ----------
    trips : sequence of Path or str
        Drive folders.
    truths : sequence of Truth
        Surveyed positions (:func:`twin.reports.truth.read_truth`).
    paper : mapping of str to str, optional
        How the paper's method is read (:mod:`twin.ingest.paper`).
    within_m : float
        As :func:`twin.reports.evaluation.evaluate` takes it.
    progress : callable, optional
        Called with one sentence a step.

    Raises
    ------
    ConfigError
        No trip.
    DriveError, GeolocError
        A trip cannot be read or located.
    TruthError
        A trip shows no surveyed object.
    """
    if not trips:
        raise ConfigError("No trips are named whose errors are to be worked out.")
    with tempfile.TemporaryDirectory(prefix="twin-reproduce-") as private:
        store = Path(private) / "trips.db"
        evaluation, names = _evaluated(store, trips, truths, paper, progress or _silent, within_m)
    if strange := [name for drive, name in names.items() if not _of_drives(evaluation, [drive])]:
        raise TruthError(
            f"Trip {strange[0]} shows no surveyed object: is it the truth of this trip (column object), "
            "or should the trip be left out?"
        )
    experiments = [
        Experiment(
            " and ".join(names[drive] for drive in drives),
            "",
            tuple(one for one in evaluation.each_sighting if one.drive_id in drives),
            tuple(one for result in evaluation.methods for one in result.each if one.drive_id in drives),
        )
        for drives in _past_the_same_objects(evaluation, names)
    ]
    doubts = (
        f"Trip {names[one.drive_id]}: half the estimates lie {one.metres:.1f} m or more from the survey, or "
        "all heights differ alike; twin evaluate says more."
        for one in evaluation.doubts
    )
    return reproduction(experiments, tuple(doubts))


def reproduce_simulated(
    *, seed: int = 1, paper: Mapping[str, str] = _USUAL, progress: Say | None = None
) -> Reproduction:
    """Drive the paper's four experiments in the simulator, and work out its tables and figures.

    Parameters
    ----------
    seed : int
        Of every drive.
    paper, progress
        As :func:`reproduce` takes them.
    """
    say = progress or _silent
    experiments = []
    with tempfile.TemporaryDirectory(prefix="twin-reproduce-") as private:
        for one in SIMULATED:
            evaluations = []
            for speed_kmh in one.speeds_kmh:
                folder = Path(private) / f"{one.name}-{speed_kmh or 0:g}"
                simulate(folder, name=one.scenario, speed_kmh=speed_kmh, seed=seed, progress=say)
                truths = read_truth(folder / TRUTH)
                store = folder.with_suffix(".db")
                evaluations.append(_evaluated(store, [folder], truths, paper, say)[0])
            sightings = (each for evaluation in evaluations for each in evaluation.each_sighting)
            objects = (e for evaluation in evaluations for result in evaluation.methods for e in result.each)
            experiments.append(Experiment(one.name, one.figure, tuple(sightings), tuple(objects)))
    return reproduction(experiments)


def _silent(_text: str) -> None:
    pass


def _evaluated(
    store: Path,
    trips: Iterable[Path | str],
    truths: Sequence[Truth],
    paper: Mapping[str, str],
    say: Say,
    within_m: float = WITHIN_M,
) -> tuple[Evaluation, dict[str, str]]:
    """Errors of every method on some trips, and the trips' names by drive."""
    names: dict[str, str] = {}
    with Store.open(store) as opened:
        for trip in trips:
            for method in METHODS:
                say(f"locating {Path(trip).name} by {method}")
                asked = paper if method == Method.PAPER else _USUAL
                report = ingest_drive(opened, trip, method=method, paper=asked, progress=say)
                names[report.drive_id] = report.name
        say("comparing with the survey")
        return evaluate(opened, truths, within_m=within_m), names


def _of_drives(evaluation: Evaluation, drives: Iterable[str]) -> set[str]:
    """The surveyed objects that some drives have an estimate of."""
    wanted = set(drives)
    return {one.truth for result in evaluation.methods for one in result.each if one.drive_id in wanted}


def _past_the_same_objects(evaluation: Evaluation, names: Mapping[str, str]) -> list[list[str]]:
    """Drives in groups that share objects, in the order of the trips; those that stood by themselves."""
    groups: list[tuple[list[str], set[tuple[bool, str]]]] = []
    for drive in names:
        stood = stands([one for one in evaluation.each_sighting if one.drive_id == drive])
        seen = {(stood, truth) for truth in _of_drives(evaluation, [drive])}
        mine = [group for group in groups if group[1] & seen]
        joined = [one for drives, _ in mine for one in drives], set().union(*(objects for _, objects in mine))
        groups = [group for group in groups if group not in mine]
        groups.append(([*joined[0], drive], joined[1] | seen))
    return [drives for drives, _ in groups]
