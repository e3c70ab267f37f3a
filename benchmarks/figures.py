"""Draws the figures of docs/accuracy.md: error against distance and speed in simulated drives, every method.

Usage: python benchmarks/figures.py [--out docs/images]

An urban drive at 25 km/h and highways at 35, 45, 60 and 80 km/h, two of each, through the product itself:
written as recordings, ingested by every method, compared with their truth. The figure of error against the
number of drives takes 200 drives: `benchmarks/many_drives.py --figure docs/images/many_drives.png`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from rich.progress import track

from twin.cli.output import console
from twin.ingest.ingest import ingest_drive
from twin.reports.error_picture import plot
from twin.reports.evaluation import Truth, evaluate, read_truth
from twin.samples.simulation import simulate
from twin.store.schema import METHODS
from twin.store.store import Store

DRIVES = [("urban", 25.0), ("highway", 35.0), ("highway", 45.0), ("highway", 60.0), ("highway", 80.0)]
SEEDS = (1, 2)


def main() -> None:
    """Simulate, ingest, evaluate, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    out = parser.parse_args().out
    truths: list[Truth] = []
    with tempfile.TemporaryDirectory() as name, Store.open(Path(name) / "twin.db") as store:
        jobs = [(world, speed, seed) for world, speed in DRIVES for seed in SEEDS]
        for world, speed, seed in track(jobs, description="drives", console=console(stderr=True)):
            folder = Path(name) / f"{world}-{speed:.0f}-{seed}"
            simulate(folder, name=world, speed_kmh=speed, seed=seed)
            for method in METHODS:
                drive = ingest_drive(store, folder, method=method).drive_id
            (table,) = folder.glob("truth.csv")
            truths += [Truth(t.object, drive, t.east_m, t.north_m) for t in read_truth(table)]
        for path in plot(evaluate(store, truths), out):
            print(path)


if __name__ == "__main__":
    main()
