"""One road driven many times: error of its poles, and the share inside the ellipses, against the drives.

Usage: python benchmarks/many_drives.py [--receivers rtk consumer] [--roads 6] [--minutes 20] [--figure FILE]

Journeys of so many minutes at 60 km/h, each on a day of its own, that pass the same poles on a kilometre of
road in their middle, every other one the other way. One camera (120°), one antenna. Each drive is adjusted by
itself, as `twin ingest-drive` does it, and `geoloc.fusion` puts their estimates together. Groups of drives
do not overlap: one road gives 25 single drives, five groups of five, one of 25. "Tied to measured signs" is
what `twin match --map-aided` does with every other pole measured to 10 cm. Nothing here is a timing.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from accuracy import CHI2_95, Recorded, adjusted_of, offsets, show
from rich.progress import track
from simulated_receiver import ConsumerSpec, consumer_drive

from geoloc.arrays import FloatArray, IntArray
from geoloc.fusion.agreeing import fuse_with_agreeing
from geoloc.fusion.fuse import Clocks, Fused, Known, Passes
from geoloc.fusion.sources import FoundClock, parts_of
from geoloc.locate.accuracy import nees
from geoloc.locate.records import Sightings
from geoloc.simulation.scenarios import Scenario, scenario
from geoloc.simulation.simulate import SimulatedDrive, simulate_drive
from geoloc.trajectory.trajectory import GnssFixes, trajectory_from_gnss
from twin.cli.output import console
from twin.store.figure_files import write_figure

CAMERA = "C3_tricam120"
DRIVES = 25
COUNTS = (1, 2, 5, 10, 25)
BARS_M = {"consumer": 0.25}
"""Bar on the median at 25 drives; ellipses are to hold 90 to 98 % at 1, 5 and 25."""
RECEIVERS: dict[str, ConsumerSpec | None] = {
    "rtk": None,
    "consumer": ConsumerSpec(),
    "consumer-good": ConsumerSpec(error_m=(1.2, 2.4)),
    "consumer-nmea": ConsumerSpec(velocity_mps=0.1, velocity_stated_mps=0.15),
    "consumer-fixes": ConsumerSpec(velocity_mps=None),
}
LABELS = {
    "rtk": "RTK",
    "consumer": "consumer, fixes off by 2–4 m (rms), Doppler velocities",
    "consumer-good": "consumer, fixes off by 2–4 m (95 %), Doppler velocities",
    "consumer-nmea": "consumer, 2–4 m (rms), speed and course of RMC or VTG",
    "consumer-fixes": "consumer, 2–4 m (rms), fixes alone",
}
_FIRST_SEED = 90_000
_HALF_M = 500.0
_MOST_POLES, _MEASURED_M = 100, 0.1


class Estimates(NamedTuple):
    """What one drive says of the poles: errors east and north stand for places."""

    pole: IntArray
    epoch_ns: IntArray
    heading_deg: FloatArray
    offset_m: FloatArray
    by_source: dict[str, FloatArray]
    clock_s: tuple[float, float, float, float]
    """Found, one sigma of that, one sigma beforehand, and how late the receiver may be."""
    solved_s: float
    """One sigma by the least squares alone."""
    lasts_s: float
    """Correlation time of what the track is off."""


def road(seed: int, minutes: float, *, against: bool) -> Scenario:
    """A road with poles on the kilometre in its middle, and a car that drives it one way or the other."""
    world = scenario("highway", None, seed, minutes)
    length_m, motion = world.road.length_m, world.motion
    middle = tuple(pole for pole in world.poles if abs(pole.station_m - length_m / 2.0) < _HALF_M)
    if against:
        motion = replace(motion, against=True, start_station_m=length_m, lane_offset_m=-motion.lane_offset_m)
    built = replace(world.road, seed=seed)
    return replace(world, road=built, motion=motion, poles=middle, cameras=(CAMERA,), annotate_every=6)


def driven(world: Scenario, seed: int, spec: ConsumerSpec | None) -> tuple[SimulatedDrive, GnssFixes]:
    """Drive once, with RTK or a consumer receiver."""
    if spec is not None:
        return consumer_drive(world, seed, spec)
    drive = simulate_drive(world, seed)
    return drive, drive.gnss[0]


def estimates_of(drive: SimulatedDrive, fixes: GnssFixes) -> Estimates:
    """Adjust one drive."""
    seen = drive.sightings
    arms = {fixes.antenna: drive.rig.antennas[fixes.antenna].rig_t_antenna_m}
    trajectory = trajectory_from_gnss((fixes,), arms)
    stamps = drive.frame_host_ns[CAMERA][seen.frame]
    sightings = Sightings(seen.camera, seen.pixel_px)
    recording = Recorded(drive, trajectory, sightings, seen.true_pixel_px, seen.object_index, stamps, 1)
    adjusted = adjusted_of(recording, sightings)
    pole = adjusted.object
    offset = offsets(drive, pole, adjusted.latitude_deg, adjusted.longitude_deg)[pole]
    last = np.array([stamps[seen.object_index == one].max() for one in pole])
    heading = trajectory.poses_at(last).heading_deg
    there, clock = np.isfinite(offset[:, 0]), adjusted.time_offset_ms
    return Estimates(
        pole[there],
        last[there],
        heading[there],
        offset[there],
        {source: covariance[there] for source, covariance in adjusted.by_source.items()},
        (1e-3 * clock.value, 1e-3 * clock.sigma, 1e-3 * adjusted.time_prior_ms, trajectory.late_sigma_s),
        1e-3 * adjusted.time_solved_ms,
        trajectory.lasts_s,
    )


def fused_of(drives: Sequence[Estimates], known: Known | None = None) -> Fused:
    """Fuse drives of one car, tied to measured signs if there are any."""
    clocks = Clocks.of_drives(
        np.zeros(len(drives), dtype=np.int64), *np.array([one.clock_s for one in drives]).T
    )
    parts = [
        Passes(
            one.pole,
            np.full(one.pole.size, number),
            one.epoch_ns,
            one.offset_m,
            *parts_of(
                one.by_source,
                one.heading_deg,
                FoundClock(float(clocks.prior_s[number]), one.solved_s, one.clock_s[1]),
            ),
            np.full(one.pole.size, one.lasts_s),
        )
        for number, one in enumerate(drives)
    ]
    columns = (
        np.concatenate([getattr(part, name) for part in parts]) for name in Passes.__dataclass_fields__
    )
    passes = Passes(*columns)
    known = known or Known(np.full((_MOST_POLES, 2), np.nan), np.ones(_MOST_POLES))
    poles = int(passes.pole.max()) + 1
    return fuse_with_agreeing(passes, clocks, known.part(np.arange(poles)))[0]


def measured(number: int) -> Known:
    """Signs of a road as NVDB has them: every other one measured to 10 cm, one in ten of these moved 3 m."""
    rng = np.random.default_rng([_FIRST_SEED, number])
    place = rng.normal(size=(_MOST_POLES, 2)) * _MEASURED_M
    place[rng.random(_MOST_POLES) < 0.1] += [3.0, 0.0]
    place[1::2] = np.nan
    return Known(place, np.full(_MOST_POLES, _MEASURED_M))


def floor_m(spec: ConsumerSpec, minutes: float, draws: int = 60, step_s: float = 8.0) -> tuple[float, float]:
    """Median error of 25 drives by their tracks alone: the best linear one.

    If the noise of each drive were known; and if all are taken alike, fixes off by 2 m an axis for 120 s.
    Half-way through a journey, with all else exact: fixes err as `spec` says, and Doppler velocities, whose
    errors last 1 s, let the place wander away from there.
    """
    rng = np.random.default_rng(_FIRST_SEED)
    since_s = np.arange(0.0, 60.0 * minutes, step_s) - 30.0 * minutes
    apart_s = np.abs(since_s[:, None] - since_s)
    same_side = np.sign(since_s[:, None]) * np.sign(since_s) > 0
    away_s = np.where(same_side, np.minimum(np.abs(since_s[:, None]), np.abs(since_s)), 0.0)
    wander_m2 = 2.0 * (spec.velocity_mps or np.inf) ** 2 * away_s
    typical_m2 = 1.8**2 * np.exp(-apart_s / 120.0) + 0.8**2 * np.exp(-apart_s / 10.0)
    weight = np.linalg.inv(typical_m2 + wander_m2).sum(axis=0)
    weight /= weight.sum()
    information, alike_m2 = [], []
    for _ in range(draws):
        axis_m2, lasts_s = rng.uniform(*spec.error_m) ** 2 / 2.0, rng.uniform(*spec.lasts_s)
        reflected_m2 = spec.multipath_share**2 * axis_m2
        fixes_m2 = (axis_m2 - reflected_m2) * np.exp(-apart_s / lasts_s)
        fixes_m2 += reflected_m2 * np.exp(-apart_s / 10.0) + spec.white_m**2 * np.eye(since_s.size)
        information.append(np.linalg.inv(fixes_m2 + wander_m2).sum())
        alike_m2.append(weight @ (fixes_m2 + wander_m2) @ weight)
    variances_m2 = np.array([1.0 / np.mean(information), np.mean(alike_m2)]) / DRIVES
    known_m, typical_m = np.sqrt(2.0 * np.log(2.0) * variances_m2).tolist()
    return known_m, typical_m


class Row(NamedTuple):
    """Of a number of drives: lengths of errors, and squares over the variances."""

    count: int
    groups: int
    error_m: FloatArray
    square: FloatArray

    def cells(self) -> tuple[str, ...]:
        """What is printed."""
        return (
            f"{self.groups}",
            f"{np.median(self.error_m):.2f} / {np.percentile(self.error_m, 95):.2f}",
            f"{np.mean(self.square <= CHI2_95):.0%}",
            f"{np.mean(self.square) / 2.0:.2f}",
        )


def rows_of(roads: Sequence[Sequence[Estimates]], *, map_aided: bool = False) -> list[Row]:
    """Fuse groups of drives."""
    rows = []
    for count in COUNTS:
        errors, squares, groups = [], [], 0
        for number, drives in enumerate(roads):
            known = measured(number) if map_aided else None
            for first in range(0, len(drives) - count + 1, count):
                fused = fused_of(drives[first : first + count], known)
                there = np.isfinite(fused.place_m[:, 0])
                errors.append(np.hypot(*fused.place_m[there].T))
                squares.append(nees(fused.place_m[there], fused.covariance_m2[there]))
                groups += 1
        rows.append(Row(count, groups, np.concatenate(errors), np.concatenate(squares)))
    return rows


def run(receiver: str, roads: int, minutes: float) -> list[list[Estimates]]:
    """All drives with one receiver, road by road."""
    spec = RECEIVERS[receiver]
    jobs = [(number, drive) for number in range(roads) for drive in range(DRIVES)]
    found: list[list[Estimates]] = [[] for _ in range(roads)]
    for number, drive in track(jobs, description=receiver, console=console(stderr=True), transient=True):
        world = road(_FIRST_SEED + number, minutes, against=drive % 2 == 1)
        found[number].append(estimates_of(*driven(world, _FIRST_SEED + 100 * (number + 1) + drive, spec)))
    return found


_COLOURS = ("#009e73", "#0072b2", "#cc79a7", "#d55e00", "#777777")


def draw(found: Mapping[str, Sequence[Row]], path: Path) -> None:
    """Draw error against the number of drives: medians as lines, 95th percentiles dashed."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.8), layout="constrained", dpi=80)
    axes = figure.add_subplot()
    axes.set_xscale("log")
    axes.set_yscale("log")
    for k, (label, rows) in enumerate(found.items()):
        drives, colour = [row.count for row in rows], _COLOURS[k % len(_COLOURS)]
        axes.plot(drives, [np.median(row.error_m) for row in rows], "o-", label=label, color=colour)
        axes.plot(drives, [np.percentile(row.error_m, 95) for row in rows], "--", linewidth=1.0, color=colour)
    axes.set_xticks(COUNTS, [str(count) for count in COUNTS])
    ticks = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("drives past a pole")
    axes.set_ylabel("error [m]: median, 95 % dashed")
    axes.grid(alpha=0.3)
    # Above, where it hides no line.
    figure.legend(loc="outside upper center", fontsize="small", ncols=1, frameon=False)
    write_figure(figure, path)


def main() -> None:
    """Print one row a receiver and number of drives."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--receivers", choices=RECEIVERS, nargs="+", default=["rtk", "consumer", "consumer-good"]
    )
    parser.add_argument("--roads", type=int, default=6, help="roads, each driven 25 times (default 6)")
    parser.add_argument("--minutes", type=float, default=20.0, help="length of a journey (default 20)")
    parser.add_argument("--markdown", action="store_true", help="print a table for the docs")
    parser.add_argument("--figure", type=Path, help="draw error against the number of drives into this file")
    parser.add_argument("--floor", action="store_true", help="only what tracks leave of 25 drives at best")
    options = parser.parse_args()
    if options.floor:
        specs = {LABELS[name]: RECEIVERS[name] for name in ("consumer", "consumer-good")}
        better = replace(ConsumerSpec(), velocity_mps=0.02)
        some = {**specs, "consumer, 2–4 m (rms), Doppler velocities of 2 cm/s": better}
        floors = [
            (
                label,
                *("{:.2f} / {:.2f}".format(*floor_m(spec, minutes)) for minutes in (5.0, 10.0, 20.0, 60.0)),
            )
            for label, spec in some.items()
            if spec is not None
        ]
        header = ["receiver", "5 min", "10 min", "20 min", "60 min"]
        show(
            "Best median of 25 drives by tracks alone [m]: noise known / all alike",
            header,
            floors,
            markdown=options.markdown,
        )
        return
    found: dict[str, list[Row]] = {}
    for name in options.receivers:
        roads = run(name, options.roads, options.minutes)
        found[LABELS[name]] = rows_of(roads)
        if name in BARS_M:
            found[f"{LABELS[name]}, tied to measured signs"] = rows_of(roads, map_aided=True)
    header = ["receiver", "drives", "groups", "median / p95 [m]", "in ellipse", "NEES / 2", "bar"]
    bars = {LABELS[name]: f"{bar:.2f}" for name, bar in BARS_M.items()}
    table = [
        (label, row.count, *row.cells(), bars.get(label, "") if row.count == DRIVES else "")
        for label, rows in found.items()
        for row in rows
    ]
    show("Error against the number of drives", header, table, markdown=options.markdown)
    if options.figure:
        draw(found, options.figure)


if __name__ == "__main__":
    main()
