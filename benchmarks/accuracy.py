"""Both methods on simulated drives whose truth is known: errors and coverage of the 95 % ellipses.

Usage: python benchmarks/accuracy.py [--seeds 6]

Errors do not depend on the machine; nothing here is a timing.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import sqlalchemy as sa
from rich.progress import track

from geoloc.simulate import scenario, simulate_drive
from twin import schema
from twin.cli.output import console, print_table
from twin.drives.write import write_driveworks_trip
from twin.ingest import ingest_drive
from twin.store import Store

CASES: tuple[tuple[str, float | None], ...] = (
    ("still", None),
    ("approach", 15.0),
    ("urban", 25.0),
    ("highway", 45.0),
    ("highway", 60.0),
    ("highway", 80.0),
)
METHODS = ("paper", "single-frame")


def errors_of(name: str, speed_kmh: float | None, seed: int) -> dict[str, list[tuple[float, bool]]]:
    """Error and "inside the 95 % ellipse" of every object of one simulated drive, by method."""
    drive = simulate_drive(scenario(name, speed_kmh, seed), seed)
    known = drive.objects
    places = np.column_stack([known.east_utm33_m, known.north_utm33_m])
    truth = dict(zip(known.object.tolist(), places, strict=True))
    with tempfile.TemporaryDirectory() as folder:
        write_driveworks_trip(drive, Path(folder) / "trip")
        with Store.open(Path(folder) / "twin.db") as store:
            for method in METHODS:
                ingest_drive(store, Path(folder) / "trip", method=method)
            rows = store.rows(sa.select(schema.estimate))
    found: dict[str, list[tuple[float, bool]]] = {method: [] for method in METHODS}
    for row in rows:
        offset = np.array([row["east_m"], row["north_m"]]) - truth[row["object"]]
        cov = np.array([[row["cov_ee_m2"], row["cov_en_m2"]], [row["cov_en_m2"], row["cov_nn_m2"]]])
        # 5.991 is the 95 % quantile of chi-square with two degrees of freedom.
        inside = bool(offset @ np.linalg.solve(cov, offset) <= 5.991)
        found[row["method"]].append((float(np.hypot(*offset)), inside))
    return found


def main() -> None:
    """Print one row a case and method."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=6, help="drives a case (default 6)")
    seeds = parser.parse_args().seeds
    rows: list[tuple[object, ...]] = []
    for name, speed in CASES:
        label = name if speed is None else f"{name}, {speed:.0f} km/h"
        pooled: dict[str, list[tuple[float, bool]]] = {method: [] for method in METHODS}
        for seed in track(range(seeds), description=label, console=console(stderr=True)):
            for method, values in errors_of(name, speed, seed).items():
                pooled[method] += values
        for method in METHODS:
            error = np.array([value for value, _ in pooled[method]])
            inside = np.mean([value for _, value in pooled[method]])
            p95 = float(np.percentile(error, 95))
            rows.append((label, method, len(error), float(np.median(error)), p95, f"{inside:.0%}"))
    header = ["case", "method", "objects", "median [m]", "p95 [m]", "in 95 % ellipse"]
    print_table(
        f"Horizontal error of the estimates, {seeds} simulated drives a case", header, rows, right_from=2
    )


if __name__ == "__main__":
    main()
