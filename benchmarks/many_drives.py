"""One road driven many times: error of its poles, and the share inside the ellipses, against the drives.

Usage: python benchmarks/many_drives.py [--receivers rtk consumer] [--roads 8] [--minutes 20] [--figure FILE]

Journeys of so many minutes at 60 km/h, each on a day of its own, that pass the same poles on a kilometre of
road in their middle, every other one the other way. One camera (120°), one antenna. Each drive is adjusted by
itself, as `twin ingest-drive` does it. From there on it is what `twin match` runs: estimates are grouped into
poles (nobody tells which are one), and these are placed by all drives, in squares of 256 m with what lies
about them. Groups of drives do not overlap: one road gives 25 single drives, five groups of five, one of 25.
"Tied to measured signs" is `twin match --map-aided`: every other pole has a sign of NVDB that was measured to
10 cm, one in ten of these has been moved by 3 m since. "Best" is the best linear estimate by the very same
fixes and velocities with the noise of each drive known, if all else were exact. Nothing here is a timing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from accuracy import CHI2_95, Recorded, adjusted_of, show
from best_linear import Best, best_linear, floor_m
from rich.progress import track
from simulated_receiver import ConsumerSpec, consumer_drive

from geoloc.adjustment.result import Adjusted
from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_covariance_from_enu, utm33_from_geographic
from geoloc.locate.accuracy import nees
from geoloc.locate.records import Sightings
from geoloc.simulation.scenarios import Scenario, scenario
from geoloc.simulation.simulate import SimulatedDrive, simulate_drive
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_gnss
from twin.cli.output import console
from twin.ingest.rows import corrections_of
from twin.matching.config import MatchConfig
from twin.matching.kept import Kept
from twin.matching.poles.many_drives import Driven, with_fused_places
from twin.matching.poles.map_aided import map_aided
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.matching.sites import SKILTPUNKT, Plate, Site
from twin.store.figure_files import write_figure
from twin.store.records import Covariance, Estimate

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
FIRST_SEED = 140_000
"""Nothing was chosen on these drives or on those after them."""
_HALF_M = 500.0
_FRAMES_HZ = 5.0
_FLOOR_MINUTES = (5.0, 10.0, 20.0, 60.0)
_CONFIG = MatchConfig()
_MEASURED_M, _MOVED_M, _MOVED_SHARE = 0.1, 3.0, 0.1


class Drive(NamedTuple):
    """One drive as the store has it, and what its receiver says at best."""

    rows: list[Estimate]
    driven: Driven
    truth_m: Mapping[str, FloatArray]
    """Object → EPSG:25833."""
    best: Best


def road(seed: int, minutes: float, *, against: bool) -> Scenario:
    """A road with poles on the kilometre in its middle, and a car that drives it one way or the other."""
    world = scenario("highway", None, seed, minutes)
    length_m, motion = world.road.length_m, world.motion
    middle = tuple(pole for pole in world.poles if abs(pole.station_m - length_m / 2.0) < _HALF_M)
    if against:
        motion = replace(motion, against=True, start_station_m=length_m, lane_offset_m=-motion.lane_offset_m)
    built = replace(world.road, seed=seed)
    # No more frames than are annotated.
    motion = replace(motion, frame_rate_hz=_FRAMES_HZ)
    return replace(world, road=built, motion=motion, poles=middle, cameras=(CAMERA,), annotate_every=1)


def driven(world: Scenario, seed: int, spec: ConsumerSpec | None) -> Drive:
    """Drive once, with RTK or a consumer receiver, and adjust the drive."""
    if spec is None:
        drive = simulate_drive(world, seed)
        fixes, best = drive.gnss[0], Best(np.full(2, np.nan), np.nan)
    else:
        drive, fixes, errors = consumer_drive(world, seed, spec)
        best = best_linear(errors, spec, world.motion.duration_s / 2.0)
    arms = {fixes.antenna: drive.rig.antennas[fixes.antenna].rig_t_antenna_m}
    return _in_store(drive, trajectory_from_gnss((fixes,), arms), f"{seed}", best)


def _in_store(drive: SimulatedDrive, trajectory: Trajectory, drive_id: str, best: Best) -> Drive:
    """Adjust a drive, and lay out what the store keeps of it."""
    seen, truth = drive.sightings, drive.objects
    stamps = drive.frame_host_ns[CAMERA][seen.frame]
    sightings = Sightings(seen.camera, seen.pixel_px)
    recording = Recorded(drive, trajectory, sightings, seen.true_pixel_px, seen.object_index, stamps, 1)
    adjusted = adjusted_of(recording, sightings)
    rows = list(_estimates(drive, adjusted, drive_id))
    poses = trajectory.poses_at(np.unique([row.last_ns for row in rows]))
    corrections = corrections_of(adjusted, trajectory)
    places = zip(truth.object.tolist(), truth.east_utm33_m, truth.north_utm33_m, strict=True)
    return Drive(
        rows,
        Driven(drive_id, lambda: poses, corrections, "car", drive_id),
        {name: np.array([east, north]) for name, east, north in places},
        best,
    )


def _estimates(drive: SimulatedDrive, adjusted: Adjusted, drive_id: str) -> Iterator[Estimate]:
    """Estimates as `twin.ingest` keeps them."""
    seen, truth = drive.sightings, drive.objects
    stamps = drive.frame_host_ns[CAMERA][seen.frame]
    place = adjusted.latitude_deg, adjusted.longitude_deg
    east, north = utm33_from_geographic(*place)
    covariance = utm33_covariance_from_enu(adjusted.covariance_m2, *place)
    for k in np.flatnonzero(np.isfinite(east)).tolist():
        number = int(adjusted.object[k])
        when = stamps[seen.object_index == number]
        yield Estimate(
            drive_id=drive_id,
            object=str(truth.object[number]),
            codes=(str(truth.skiltnummer[number]),),
            east_m=float(east[k]),
            north_m=float(north[k]),
            covariance_m2=_triple(covariance[k]),
            cameras=(CAMERA,),
            n_sightings=when.size,
            first_ns=int(when.min()),
            last_ns=int(when.max()),
            budget={source: _triple(part[k]) for source, part in adjusted.by_source.items()},
        )


def _triple(covariance_m2: FloatArray) -> Covariance:
    return float(covariance_m2[0, 0]), float(covariance_m2[0, 1]), float(covariance_m2[1, 1])


def placed_by(drives: Sequence[Drive], sites: Sequence[Site]) -> list[ObservedPole]:
    """What `twin match` makes of drives of one car; tied to measured signs if there are any."""
    rows = [row for drive in drives for row in drive.rows]
    ways = [drive.driven for drive in drives]
    poles = observed_poles(rows, [one.drive_id for one in ways], _CONFIG)
    placed = with_fused_places(poles, rows, ways).poles
    return map_aided(placed, sites, rows, ways, _CONFIG, Kept())[0] if sites else placed


def measured(drive: Drive, seed: int) -> tuple[list[Site], frozenset[str]]:
    """Signs of a road as NVDB has them, and the objects whose signs were moved since."""
    rng = np.random.default_rng(seed)
    codes = {row.object: row.codes[0] for row in drive.rows}
    sites, moved = [], set()
    for number, name in enumerate(sorted(drive.truth_m)[::2]):
        place = drive.truth_m[name] + rng.normal(size=2) * _MEASURED_M
        if rng.random() < _MOVED_SHARE:
            turn = rng.uniform(0.0, 2.0 * np.pi)
            place += _MOVED_M * np.array([np.cos(turn), np.sin(turn)])
            moved.add(name)
        plate = Plate(2 * number + 1, 1, codes.get(name, ""), None)
        sites.append(
            Site(SKILTPUNKT, 2 * number, 1, float(place[0]), float(place[1]), _MEASURED_M, True, (plate,))
        )
    return sites, frozenset(moved)


class Group(NamedTuple):
    """What came of one group of drives: errors (k, 2) of its poles, which were moved since, and the best."""

    error_m: FloatArray
    square: FloatArray
    is_moved: FloatArray
    best_m: float
    wrong: int
    """Poles that are not one pole: merged of several, or a further piece of one."""


def group_of(drives: Sequence[Drive], sites: Sequence[Site], moved: frozenset[str]) -> Group:
    """Place the poles of one group of drives."""
    truth = drives[0].truth_m
    errors, squares, of_moved, first, wrong = [], [], [], set(), 0
    for pole in placed_by(drives, sites):
        names = [member.partition(":")[2] for member in pole.members]
        name = max(sorted(set(names)), key=names.count)
        wrong += len(set(names)) > 1 or name in first
        first.add(name)
        errors.append(np.array([pole.east_m, pole.north_m]) - truth[name])
        squares.append(pole.covariance_m2)
        of_moved.append(name in moved)
    error = np.array(errors)
    weight = np.array([1.0 / drive.best.variance_m2 for drive in drives])
    best = weight @ np.array([drive.best.error_m for drive in drives]) / weight.sum()
    return Group(error, nees(error, np.array(squares)), np.array(of_moved), float(np.hypot(*best)), wrong)


class Row(NamedTuple):
    """Of a number of drives: its groups."""

    count: int
    groups: list[Group]

    @property
    def error_m(self) -> FloatArray:
        """Lengths of all errors."""
        return np.concatenate([np.hypot(*group.error_m.T) for group in self.groups])

    def cells(self) -> tuple[str, ...]:
        """What is printed."""
        square = np.concatenate([group.square for group in self.groups])
        best = np.median([group.best_m for group in self.groups])
        return (
            f"{len(self.groups)}",
            f"{np.median(self.error_m):.2f} / {np.percentile(self.error_m, 95):.2f}",
            f"{best:.2f}" if np.isfinite(best) else "",
            f"{np.mean(square <= CHI2_95):.0%}",
            f"{np.mean(square) / 2.0:.2f}",
            f"{sum(group.wrong for group in self.groups)}",
        )

    def moved(self) -> Row:
        """The same of poles alone whose sign was moved."""
        return Row(
            self.count,
            [
                group._replace(error_m=group.error_m[group.is_moved], square=group.square[group.is_moved])
                for group in self.groups
            ],
        )


def rows_of(roads: Sequence[Sequence[Drive]], first_seed: int, *, tied: bool = False) -> list[Row]:
    """Place the poles by groups of drives."""
    rows = []
    for count in COUNTS:
        groups = []
        for number, drives in enumerate(roads):
            sites, moved = measured(drives[0], first_seed + number) if tied else ([], frozenset[str]())
            groups += [
                group_of(drives[first : first + count], sites, moved)
                for first in range(0, len(drives) - count + 1, count)
            ]
        rows.append(Row(count, groups))
    return rows


def run(receiver: str, roads: int, minutes: float, first_seed: int) -> list[list[Drive]]:
    """All drives with one receiver, road by road."""
    jobs = [(number, drive) for number in range(roads) for drive in range(DRIVES)]
    found: list[list[Drive]] = [[] for _ in range(roads)]
    for number, drive in track(jobs, description=receiver, console=console(stderr=True), transient=True):
        world = road(first_seed + number, minutes, against=drive % 2 == 1)
        found[number].append(driven(world, first_seed + 100 * (number + 1) + drive, RECEIVERS[receiver]))
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
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="other roads and drives")
    parser.add_argument("--markdown", action="store_true", help="print tables for the docs")
    parser.add_argument("--figure", type=Path, help="draw error against the number of drives into this file")
    parser.add_argument("--floor", action="store_true", help="only what tracks leave of 25 drives at best")
    options = parser.parse_args()
    if options.floor:
        _show_floors(markdown=options.markdown)
        return
    found: dict[str, list[Row]] = {}
    of_signs: dict[str, list[Row]] = {}
    for name in options.receivers:
        roads = run(name, options.roads, options.minutes, options.first_seed)
        found[LABELS[name]] = rows_of(roads, options.first_seed)
        if name in BARS_M:
            tied = rows_of(roads, options.first_seed, tied=True)
            found[f"{LABELS[name]}, tied to measured signs"] = tied
            of_signs[f"{LABELS[name]}, poles whose measured sign was moved"] = [row.moved() for row in tied]
    header = [
        "receiver",
        "drives",
        "groups",
        "median / p95 [m]",
        "best",
        "in ellipse",
        "NEES / 2",
        "wrong",
        "bar",
    ]
    bars = {LABELS[name]: f"{bar:.2f}" for name, bar in BARS_M.items()}
    table = [
        (label, row.count, *row.cells(), bars.get(label, "") if row.count == DRIVES else "")
        for label, rows in (found | of_signs).items()
        for row in rows
    ]
    show("Error against the number of drives", header, table, markdown=options.markdown)
    _show_roads(found, markdown=options.markdown)
    if options.figure:
        draw(found, options.figure)


def _show_roads(found: Mapping[str, Sequence[Row]], *, markdown: bool) -> None:
    """All poles of a road err together with 25 drives: each road is one draw."""
    table = [
        (
            label,
            " ".join(
                f"{np.median(np.hypot(*group.error_m.T)):.2f}/{group.best_m:.2f}" for group in row.groups
            ),
        )
        for label, rows in found.items()
        for row in rows
        if row.count == DRIVES and np.isfinite(row.groups[0].best_m)
    ]
    show("25 drives, road by road: median / best [m]", ["receiver", "roads"], table, markdown=markdown)


def _show_floors(*, markdown: bool) -> None:
    specs = {LABELS[name]: spec for name in ("consumer", "consumer-good") if (spec := RECEIVERS[name])}
    better = replace(ConsumerSpec(), velocity_mps=0.02)
    some = {**specs, "consumer, 2–4 m (rms), Doppler velocities of 2 cm/s": better}
    table = [
        (label, *("{:.2f} / {:.2f}".format(*floor_m(spec, minutes, DRIVES)) for minutes in _FLOOR_MINUTES))
        for label, spec in some.items()
    ]
    header = ["receiver", *(f"{minutes:g} min" for minutes in _FLOOR_MINUTES)]
    show(
        "Best median of 25 drives by tracks alone [m]: noise known / all alike",
        header,
        table,
        markdown=markdown,
    )


if __name__ == "__main__":
    main()
