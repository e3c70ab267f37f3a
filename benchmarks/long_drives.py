"""Positions, ellipses and what the adjustment finds out about the car, against the length of a drive.

Usage: python benchmarks/long_drives.py [--kinds urban highway] [--minutes 1 5 20 60] [--drives 4]

Roads of the scenarios ``urban`` and ``highway`` that do not repeat (`geoloc.simulation.long_roads`), two
antennas, every pole annotated by its id. An error that lasts must not become a certainty by driving on: the
error stays that of a short drive, the share inside the ellipses stays 95 %, and the squared errors of the
clock and of the cameras' boresight stay as large as their variances (NEES 1). Nothing here is a timing.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from accuracy import CHI2_95, Case, Recorded, adjusted_of, offsets, recorded, show
from rich.progress import track

from geoloc.arrays import FloatArray
from geoloc.locate.accuracy import nees
from twin.cli.output import console

KINDS = ("urban", "highway")
_FIRST_SEED = 50_000


class Result(NamedTuple):
    """Of one drive: errors of its objects (n, 3), their squares over the variances, and of what all share."""

    error_m: FloatArray
    nees: FloatArray
    height_nees: FloatArray
    clock_nees: float
    boresight_nees: FloatArray


@dataclass(frozen=True, slots=True)
class Row:
    """One kind of road and one length."""

    kind: str
    minutes: float
    drives: int

    def case(self) -> Case:
        """The case that its drives are of."""
        return Case(self.kind, self.kind, (None,), (0.0, None), minutes=self.minutes)


def result_of(recording: Recorded) -> Result:
    """Adjust a drive and hold it against its truth."""
    adjusted, drive = adjusted_of(recording, recording.sightings), recording.drive
    plane = offsets(drive, adjusted.object, adjusted.latitude_deg, adjusted.longitude_deg)[adjusted.object]
    height = adjusted.height_m - drive.objects.height_m[adjusted.object]
    there = np.isfinite(plane[:, 0])
    clock = adjusted.time_offset_ms
    boresight = [
        ((found.value - true) / found.sigma) ** 2
        for name, corrections in adjusted.boresight_deg.items()
        for found, true in zip(
            corrections,
            drive.rig.camera(name).rig_R_camera.T @ drive.drawn.boresight_deg[name],
            strict=True,
        )
    ]
    return Result(
        np.column_stack([plane, height])[there],
        nees(plane[there], adjusted.covariance_m2[there]),
        (height / adjusted.sigma_height_m)[there] ** 2,
        ((clock.value + drive.drawn.frame_offset_ms) / clock.sigma) ** 2,
        np.array(boresight),
    )


def cells(results: list[Result]) -> tuple[str, ...]:
    """What is printed of the drives of a row."""
    error = np.concatenate([one.error_m for one in results])
    squares = np.concatenate([one.nees for one in results])
    length = np.hypot(error[:, 0], error[:, 1])
    medians = [np.median(np.hypot(*one.error_m[:, :2].T)) for one in results]
    return (
        f"{length.size:,}",
        f"{np.median(length):.2f} / {np.percentile(length, 95):.2f}",
        f"{max(medians):.2f}",
        f"{np.mean(squares <= CHI2_95):.0%}",
        f"{np.mean(squares) / 2.0:.2f}",
        f"{np.sqrt(np.mean(error[:, 2] ** 2)):.2f}",
        f"{np.mean(np.concatenate([one.height_nees for one in results])):.2f}",
        f"{np.mean([one.clock_nees for one in results]):.2f}",
        f"{np.mean([one.boresight_nees for one in results]):.2f}",
    )


def main() -> None:
    """Print one row a kind of road and length."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", choices=KINDS, nargs="+", default=list(KINDS))
    parser.add_argument("--minutes", type=float, nargs="+", default=[1.0, 5.0, 20.0, 60.0])
    parser.add_argument(
        "--drives",
        type=int,
        default=4,
        help="drives of 20 minutes and more; four and eight times as many shorter ones",
    )
    parser.add_argument("--markdown", action="store_true", help="print a table for docs/accuracy.md")
    options = parser.parse_args()
    rows = [
        Row(kind, minutes, max(1, options.drives * (8 if minutes <= 1.0 else 4 if minutes <= 5.0 else 1)))
        for kind in options.kinds
        for minutes in options.minutes
    ]
    table: list[tuple[object, ...]] = []
    seed = _FIRST_SEED + 1000 * KINDS.index(options.kinds[0])
    for row in rows:
        label = f"{row.kind}, {row.minutes:g} min"
        seeds = range(seed, seed + row.drives)
        seed += row.drives
        bar = track(seeds, description=label, console=console(stderr=True), transient=True)
        results = [result_of(recorded(row.case(), None, one)) for one in bar]
        table.append((label, row.drives, *cells(results)))
    header = [
        "drive",
        "drives",
        "objects",
        "median / p95 [m]",
        "worst drive's median",
        "in ellipse",
        "NEES / 2",
        "height rms [m]",
        "height NEES",
        "clock NEES",
        "boresight NEES",
    ]
    show(
        "Error and what is known of it, against the length of the drive",
        header,
        table,
        markdown=options.markdown,
    )


if __name__ == "__main__":
    main()
