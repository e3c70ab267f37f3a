"""What an ingest of a drive costs, step by step; and against another checkout of this repository.

Usage: OMP_NUM_THREADS=1 python benchmarks/ingest.py [--kinds highway urban] [--minutes 15] [--rounds 3]
       [--before CHECKOUT] [--bar 0.5]

A road that does not repeat (`geoloc.simulation.long_roads`) is driven once, every pole annotated by its id,
written as a trip and taken in by `ingest_drive`, each time in a process of its own with an empty store. A
step's time is its own, without that of the steps that it calls. Times are the processor's: other work on the
machine does not count.

With ``--before`` that checkout's ingest and this one's take turns on the same folder. The ratio is that of
the medians; the bar is on it. Everything that the two stores hold of the drive (estimates with covariances
and budgets, sightings, poses, corrections, warnings) is compared: what is no number must be the same, numbers
may differ by 1e-9, in whatever unit they are kept.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from itertools import chain, starmap
from pathlib import Path
from typing import Any

from twin.cli.output import print_table

STEPS: Mapping[str, tuple[str, ...]] = {
    "reading the drive": ("twin.ingest.ingest:read_drive",),
    "trajectory": ("twin.ingest.ingest:trajectory_of",),
    "objects without ids": ("twin.ingest.ingest:_with_objects",),
    "locating, single frames": ("twin.ingest.ingest:locate_annotations",),
    "adjustment": ("twin.ingest.locate:adjust", "geoloc.association.associate:adjust"),
    "adjustment: equations": ("geoloc.adjustment.equations:Equations.system",),
    "adjustment: factor": (
        "geoloc.adjustment.equations:factorised",
        "geoloc.adjustment.solve:factorised",
        "geoloc.adjustment.fronts:Fronts.factorised",
    ),
    "check of ids": ("twin.ingest.ingest:_id_doubts",),
    "misfits, rows, views": (
        "twin.ingest.ingest:misfits_of",
        "twin.ingest.ingest:absence_gap",
        "twin.ingest.ingest:_drive_row",
        "twin.ingest.ingest:drive_record",
        "twin.ingest.ingest:sighting_rows",
        "twin.ingest.ingest:sightings_of",
        "twin.ingest.ingest:estimates_of",
        "twin.ingest.ingest:positions_of",
    ),
    "writing to the store": ("twin.ingest.ingest:save_drive",),
}
"""Functions by the step that they are; one that this checkout does not have is left out."""
REST = "the rest"
_MOST_APART = 1e-9
"""A sum in another order may differ by so much."""
_NOT_COMPARED = frozenset({"ingested_at", "folder", "annotation_set"})


class Clock:
    """Time that each step takes for itself."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._running: list[str] = []
        self._since = time.process_time()

    def _switch(self) -> None:
        now = time.process_time()
        if self._running:
            self.seconds[self._running[-1]] += now - self._since
        self._since = now

    def timed(self, step: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function so that its own time counts as the step's."""

        def wrapped(*arguments: Any, **options: Any) -> Any:
            self._switch()
            self._running.append(step)
            try:
                return work(*arguments, **options)
            finally:
                self._switch()
                self._running.pop()

        return wrapped

    def wrap(self, step: str, place: str) -> None:
        """Wrap ``module:name`` or ``module:Class.method`` where it is looked up."""
        module, _, name = place.partition(":")
        if importlib.util.find_spec(module) is None:
            return
        holder: Any = importlib.import_module(module)
        *path, last = name.split(".")
        for part in path:
            holder = getattr(holder, part)
        if hasattr(holder, last):
            setattr(holder, last, self.timed(step, getattr(holder, last)))


def ingest_once(folder: Path, store: Path, seconds: Path) -> None:
    """Ingest in this process, and write what each step took as JSON."""
    from twin.ingest import ingest
    from twin.store.store import Store

    clock = Clock()
    for step, places in STEPS.items():
        for place in places:
            clock.wrap(step, place)
    with Store.open(store) as opened:
        clock.timed(REST, ingest.ingest_drive)(opened, folder)
    seconds.write_text(json.dumps(clock.seconds))


def apart(checkout: Path, folder: Path, store: Path) -> dict[str, float]:
    """Ingest by a checkout's code in a process of its own: processor's seconds of each step."""
    store.unlink(missing_ok=True)
    out = store.with_suffix(".json")
    command = [sys.executable, __file__, "--one", str(folder), str(store), str(out)]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": str(checkout)}, cwd=checkout)
    seconds: dict[str, float] = json.loads(out.read_text())
    return seconds


def make_drive(folder: Path, kind: str, minutes: float) -> None:
    """Simulate a drive and write it as a trip."""
    from geoloc.simulation.simulate import scenario, simulate_drive
    from twin.samples.write_drive import write_driveworks_trip

    write_driveworks_trip(simulate_drive(scenario(kind, None, 0, minutes), 0), folder)


def most_apart(one: Path, other: Path) -> float:
    """Largest difference between numbers of two stores; infinite where anything else differs."""
    from contextlib import closing

    apart_by = 0.0
    with closing(sqlite3.connect(one)) as left, closing(sqlite3.connect(other)) as right:
        for table in ("drive", "drive_method", "estimate", "sighting"):
            columns = [row[1] for row in left.execute(f"PRAGMA table_info({table})")]
            kept = ", ".join(f'"{name}"' for name in columns if name not in _NOT_COMPARED)
            rows = [
                file.execute(f"SELECT {kept} FROM {table} ORDER BY rowid").fetchall()
                for file in (left, right)
            ]
            if len(rows[0]) != len(rows[1]):
                return math.inf
            pairs = zip(chain.from_iterable(rows[0]), chain.from_iterable(rows[1]), strict=True)
            apart_by = max([apart_by, *starmap(_apart, pairs)])
    return apart_by


def _apart(one: object, other: object) -> float:
    if one == other:
        return 0.0
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other)
    if isinstance(one, str) and isinstance(other, str) and one[:1] == other[:1] == "{":
        return _apart(json.loads(one), json.loads(other))
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return max(_apart(value, other[name]) for name, value in one.items())
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return max(starmap(_apart, zip(one, other, strict=True)))
    return math.inf


def main() -> int:
    """Print a table for each kind of drive; 1 if a bar is missed or numbers differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", choices=("highway", "urban"), nargs="+", default=["highway", "urban"])
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--before", type=Path, help="another checkout, which takes turns with this one")
    parser.add_argument("--bar", type=float, default=0.5, help="this one's time over the other's, at most")
    parser.add_argument("--one", type=Path, nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        ingest_once(*options.one)
        return 0
    here = Path(__file__).resolve().parents[1]
    checkouts = {"now": here} if options.before is None else {"before": options.before.resolve(), "now": here}
    with tempfile.TemporaryDirectory() as temporary:
        return max(_compared(kind, checkouts, options, Path(temporary)) for kind in options.kinds)


def _compared(kind: str, checkouts: Mapping[str, Path], options: argparse.Namespace, work: Path) -> int:
    """Ingest one drive by each checkout in turns, and print what it took."""
    make_drive(work / kind, kind, options.minutes)
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in checkouts}
    for _ in range(options.rounds):
        for name, checkout in checkouts.items():
            runs[name].append(apart(checkout, work / kind, work / f"{name}.db"))
    whole = {name: statistics.median(sum(run.values()) for run in of) for name, of in runs.items()}
    rows = []
    for step in [*STEPS, REST]:
        took = {name: statistics.median(run.get(step, 0.0) for run in of) for name, of in runs.items()}
        rows.append([step, *(f"{took[name]:.2f} s, {took[name] / whole[name]:.0%}" for name in took)])
    rows.append(["whole", *(f"{seconds:.2f} s" for seconds in whole.values())])
    title = f"Ingest of {options.minutes:g} minutes, {kind}: processor's time, median of {options.rounds}"
    print_table(title, ["step", *checkouts], rows, right_from=1)
    if "before" not in checkouts:
        return 0
    ratio, differ = whole["now"] / whole["before"], most_apart(work / "before.db", work / "now.db")
    kept = ratio <= options.bar and differ <= _MOST_APART
    print(f"now / before: {ratio:.2f}, numbers differ by {differ:.1e}: {'ok' if kept else 'MISSED'}")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
