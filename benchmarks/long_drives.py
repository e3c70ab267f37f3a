"""Positions, ellipses and what the adjustment finds out about the car, against the length of a drive.

Usage: python benchmarks/long_drives.py [--kinds urban highway] [--minutes 1 5 20 60] [--drives 8]

Roads of the scenarios ``urban`` and ``highway`` that do not repeat (`geoloc.simulation.long_roads`), two
antennas, every pole annotated by its id. An error that lasts must not become a certainty by driving on: the
error stays that of a short drive, the share inside the ellipses stays 95 %, and the squared errors of the
clock and of the cameras' boresight stay as large as their variances (NEES 1). Nothing here is a timing.

The same cars drive at each length: mounting, antennas and tyres of a drive follow from its seed, so that rows
can be compared. All signs of a drive share them: how sure a figure is depends on the number of drives, not of
signs. Brackets are 95 % intervals, by drawing drives anew (bootstrap).

No length of a road shows the camera clock, so that whether eight drives look honest is the luck of eight
clocks: those of the first eight seeds are off by 1.4 of their sigmas (rms). Clocks are therefore not drawn:
they lie evenly over their distribution, with its mean square, whatever the number of drives.

The usual cars and roads err less than the error budget states, so that shares above 95 % are to be expected.
With `--as-stated` every error is as large as it is stated (see `accuracy.py`): there 95 % is the aim.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from accuracy import (
    CHI2_95,
    Case,
    Recorded,
    adjusted_of,
    offsets,
    recorded,
    show,
    with_clock,
)
from rich.progress import track
from spread_draws import evenly

from geoloc.arrays import FloatArray
from geoloc.locate.accuracy import nees
from twin.cli.output import console

KINDS = ("urban", "highway")
_FIRST_SEED = 50_000
_RESAMPLED = 1_000


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


def with_interval(parts: list[FloatArray], figure: Callable[[FloatArray], float], style: str) -> str:
    """Write a figure of all drives (one array each) with the 95 % interval of drawing them anew."""
    drawn = np.random.default_rng(0).integers(len(parts), size=(_RESAMPLED, len(parts)))
    again = [figure(np.concatenate([parts[i] for i in row])) for row in drawn]
    low, high = (format(value, style) for value in np.percentile(again, [2.5, 97.5]))
    return f"{format(figure(np.concatenate(parts)), style)} [{low}, {high}]"


def cells(results: list[Result]) -> tuple[str, ...]:
    """What is printed of the drives of a row."""
    length = [np.hypot(*one.error_m[:, :2].T) for one in results]
    up = np.concatenate([one.error_m[:, 2] for one in results])
    return (
        f"{up.size:,}",
        with_interval(length, lambda all_m: float(np.median(all_m)), ".2f"),
        with_interval(length, lambda all_m: float(np.percentile(all_m, 95)), ".2f"),
        with_interval([(one.nees <= CHI2_95).astype(np.float64) for one in results], _mean, ".0%"),
        with_interval([one.nees / 2.0 for one in results], _mean, ".2f"),
        f"{np.sqrt(np.mean(up**2)):.2f}",
        f"{np.mean(np.concatenate([one.height_nees for one in results])):.2f}",
        with_interval([np.array([one.clock_nees]) for one in results], _mean, ".2f"),
        with_interval([one.boresight_nees for one in results], _mean, ".2f"),
    )


def _mean(values: FloatArray) -> float:
    return float(np.mean(values))


def main() -> None:
    """Print one row a kind of road and length."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", choices=KINDS, nargs="+", default=list(KINDS))
    parser.add_argument("--minutes", type=float, nargs="+", default=[1.0, 5.0, 20.0, 60.0])
    parser.add_argument(
        "--drives",
        type=int,
        default=8,
        help="drives of each kind and length",
    )
    parser.add_argument("--as-stated", action="store_true", help="errors as large as the budget states them")
    parser.add_argument("--markdown", action="store_true", help="print a table for docs/accuracy.md")
    options = parser.parse_args()
    rows = [Row(kind, minutes, options.drives) for kind in options.kinds for minutes in options.minutes]
    table: list[tuple[object, ...]] = []
    for row in rows:
        label = f"{row.kind}, {row.minutes:g} min"
        first = _FIRST_SEED + 1000 * KINDS.index(row.kind)
        seeds = range(first, first + row.drives)
        bar = track(seeds, description=label, console=console(stderr=True), transient=True)
        clocks = evenly(row.drives)
        results = [
            result_of(with_clock(recorded(row.case(), None, one, stated=options.as_stated), clock))
            for one, clock in zip(bar, clocks, strict=True)
        ]
        table.append((label, row.drives, *cells(results)))
    header = [
        "drive",
        "drives",
        "objects",
        "median [m]",
        "95th percentile [m]",
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
