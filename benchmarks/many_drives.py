"""A road driven many times: error of its poles, and the share inside the ellipses, against the drives.

Usage: python benchmarks/many_drives.py [--receivers rtk consumer] [--scale 0.5] [--figure FILE] [--floor]

Journeys of 20 minutes at 60 km/h, each on a day of its own, that pass the same poles on a kilometre of road
in their middle, every other one the other way. One camera (120°), one antenna. Each drive is adjusted by
itself, as `twin ingest-drive` does it. From there on it is what `twin match` runs: estimates are grouped into
poles (nobody tells which are one), and these are placed by all drives, in squares of 256 m with what lies
about them. Single drives are all there are; groups are drawn at random from a road's drives, since 25 drives
of one road err together and are little more than one draw.

"Tied to measured signs" is `twin match --map-aided`: every other pole has a sign of NVDB that was measured to
10 cm, one in ten of these has been moved by 3 m since, drawn anew for each group. "Best" is the best linear
estimate by the very same fixes and velocities, the noise of each drive known and all else exact. Nothing here
is a timing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np
from accuracy import CHI2_95, Recorded, adjusted_of, show
from best_linear import NOTHING, Best, best_linear, floor_m, together
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
from twin.matching.poles.many_drives import Driven, headings_at, with_fused_places
from twin.matching.poles.map_aided import map_aided
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.matching.sites import SKILTPUNKT, Plate, Site
from twin.store.figure_files import write_figure
from twin.store.records import Covariance, Estimate

CAMERA = "C3_tricam120"
COUNTS = (1, 2, 5, 10, 25)
_MOST = COUNTS[-1]
BARS_M = {"consumer": 0.25}
"""Bar on the median at 25 drives; ellipses are to hold 90 to 98 % at 1, 5 and 25."""


_ASSUMED_M = 2.0 * np.sqrt(2.0)
"""A receiver that states no sigma is taken to be off by 2 m an axis."""


class Receiver(NamedTuple):
    """A receiver, and on how many roads how many journeys of what length are made with it."""

    label: str
    spec: ConsumerSpec | None
    roads: int = 1
    drives: int = 40
    minutes: float = 20.0


RECEIVERS = {
    "consumer": Receiver(
        "consumer, fixes off by 2–4 m (rms), Doppler velocities", ConsumerSpec(), drives=120
    ),
    "consumer-stated": Receiver(
        "consumer, fixes and lateness as they are assumed, Doppler velocities",
        ConsumerSpec(error_m=(_ASSUMED_M, _ASSUMED_M), lasts_s=(120.0, 120.0), late_s=None),
        drives=120,
    ),
    "rtk": Receiver("RTK", None, minutes=5.0),
    "consumer-good": Receiver(
        "consumer, fixes off by 2–4 m (95 %), Doppler velocities", ConsumerSpec(error_m=(1.2, 2.4))
    ),
    "consumer-nmea": Receiver(
        "consumer, 2–4 m (rms), speed and course of RMC or VTG",
        ConsumerSpec(velocity_mps=0.1, velocity_stated_mps=0.15),
    ),
    "consumer-fixes": Receiver("consumer, 2–4 m (rms), fixes alone", ConsumerSpec(velocity_mps=None)),
}
FIRST_SEED = 140_000
"""Nothing was chosen on these drives or on those after them."""
_GROUPS = 20
"""Groups of a road, of five drives and more."""
_APART = 5
_HALF_M = 500.0
_FRAMES_HZ = 5.0
_FLOOR_MINUTES, _SPEED_MPS = (5.0, 10.0, 20.0, 60.0), 60.0 / 3.6
_CONFIG = MatchConfig()
_MEASURED_M, _MOVED_M, _MOVED_SHARE = 0.1, 3.0, 0.1


NO_SIGNS: tuple[list[Site], frozenset[str]] = ([], frozenset())


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
        fixes, best = drive.gnss[0], NOTHING
    else:
        drive, fixes, errors = consumer_drive(world, seed, spec)
        best = best_linear(errors, spec, *_half_way(drive))
    arms = {fixes.antenna: drive.rig.antennas[fixes.antenna].rig_t_antenna_m}
    return _in_store(drive, trajectory_from_gnss((fixes,), arms), f"{seed}", best)


def _half_way(drive: SimulatedDrive) -> tuple[float, FloatArray]:
    """When the car is there (s), and its velocity then, east and north."""
    middle = drive.frame_epoch_ns.size // 2
    turn, speed_mps = np.radians(drive.poses.heading_deg[middle]), drive.scenario.motion.speed[0][1]
    return middle / _FRAMES_HZ, speed_mps * np.array([np.sin(turn), np.cos(turn)])


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
        Driven(
            drive_id,
            lambda: poses,
            lambda epoch_ns: headings_at(poses, epoch_ns),
            corrections,
            "car",
            drive_id,
        ),
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


def measured(drive: Drive, seed: Sequence[int]) -> tuple[list[Site], frozenset[str]]:
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
    """What came of one group of drives: errors (k, 2) of its poles, and whose signs were moved."""

    error_m: FloatArray
    square: FloatArray
    is_moved: FloatArray
    best: Best
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
    # Where signs tie the drives they tell more than fixes.
    best = NOTHING if sites else together([drive.best for drive in drives])
    return Group(error, nees(error, np.array(squares)), np.array(of_moved), best, wrong)


def groups_of(count: int, drives: Sequence[Drive], seed: int) -> Iterator[list[Drive]]:
    """Groups of so many drives, as many each way; small ones that have no drive in common."""
    rng = np.random.default_rng(seed)
    for _ in range(1 if count < _APART else _GROUPS):
        ways = [rng.permutation(np.arange(way, len(drives), 2)).tolist() for way in (0, 1)]
        order = [k for pair in zip_longest(*ways) for k in pair if k is not None]
        for first in range(0, len(drives) - count + 1 if count < _APART else 1, count):
            yield [drives[k] for k in order[first : first + count]]


class Row(NamedTuple):
    """Of a number of drives: its groups."""

    number: int
    groups: list[Group]

    @property
    def error_m(self) -> FloatArray:
        """Lengths of all errors."""
        return np.concatenate([np.hypot(*group.error_m.T) for group in self.groups])

    def cells(self) -> tuple[str, ...]:
        """What is printed."""
        square = np.concatenate([group.square for group in self.groups])
        best_m = np.array([group.best.error_m for group in self.groups])
        best_square = nees(best_m, np.array([group.best.covariance_m2 for group in self.groups]))
        return (
            f"{len(self.groups)}",
            f"{np.median(self.error_m):.2f} / {np.percentile(self.error_m, 95):.2f}",
            f"{np.mean(square <= CHI2_95):.0%}",
            f"{np.mean(square) / 2.0:.2f}",
            f"{np.median(np.hypot(*best_m.T)):.2f}" if np.isfinite(best_m).all() else "",
            f"{np.mean(best_square) / 2.0:.2f}" if np.isfinite(best_m).all() else "",
            f"{sum(group.wrong for group in self.groups)}",
        )

    def moved(self) -> Row:
        """The same of poles alone whose sign was moved."""
        return Row(
            self.number,
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
            for k, group in enumerate(groups_of(count, drives, first_seed + number)):
                sites, moved = measured(drives[0], [first_seed + number, count, k]) if tied else NO_SIGNS
                groups.append(group_of(group, sites, moved))
        rows.append(Row(count, groups))
    return rows


def run(receiver: str, scale: float, first_seed: int) -> list[list[Drive]]:
    """All drives with one receiver, road by road."""
    _, spec, roads, drives, minutes = RECEIVERS[receiver]
    drives = max(round(scale * drives), _MOST)
    jobs = [(number, drive) for number in range(roads) for drive in range(drives)]
    found: list[list[Drive]] = [[] for _ in range(roads)]
    for number, drive in track(jobs, description=receiver, console=console(stderr=True), transient=True):
        world = road(first_seed + number, minutes, against=drive % 2 == 1)
        found[number].append(driven(world, first_seed + 1000 * (number + 1) + drive, spec))
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
        drives, colour = [row.number for row in rows], _COLOURS[k % len(_COLOURS)]
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
        "--receivers", choices=RECEIVERS, nargs="+", default=["consumer", "rtk", "consumer-good"]
    )
    parser.add_argument("--scale", type=float, default=1.0, help="so many times the drives of each receiver")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="other roads and drives")
    parser.add_argument("--markdown", action="store_true", help="print tables for the docs")
    parser.add_argument("--figure", type=Path, help="draw error against the number of drives into this file")
    parser.add_argument("--floor", action="store_true", help="only what receivers leave of 25 drives at best")
    options = parser.parse_args()
    if options.floor:
        _show_floors(markdown=options.markdown)
        return
    found: dict[str, list[Row]] = {}
    for name in options.receivers:
        roads = run(name, options.scale, options.first_seed)
        label = RECEIVERS[name].label
        of_this = {label: rows_of(roads, options.first_seed)}
        if name in BARS_M:
            of_this[f"{label}, tied to measured signs"] = rows_of(roads, options.first_seed, tied=True)
        found |= of_this
        _show(name, of_this, sum(map(len, roads)), markdown=options.markdown)
    if options.figure:
        draw(found, options.figure)


def _show(name: str, found: Mapping[str, Sequence[Row]], drives: int, *, markdown: bool) -> None:
    bar = f"{BARS_M[name]:.2f}" if name in BARS_M else ""
    label, *tied = found
    rows = [("by drives alone", row) for row in found[label]]
    for one in tied:
        rows += [("tied to measured signs", row) for row in found[one]]
        rows += [("poles whose measured sign was moved", row.moved()) for row in found[one]]
    table = [
        (what, row.number, *row.cells(), bar if row.number == _MOST and what == rows[0][0] else "")
        for what, row in rows
    ]
    header = ["placed", "drives", "groups", "median / p95 [m]", "in ellipse", "NEES / 2"]
    header += ["best [m]", "its NEES / 2", "wrong", "bar"]
    show(f"{label}: {drives} drives of {RECEIVERS[name].minutes:g} minutes", header, table, markdown=markdown)


def _show_floors(*, markdown: bool) -> None:
    """Print medians that no estimator betters in the mean."""
    better = replace(ConsumerSpec(), velocity_mps=0.02)
    some = {RECEIVERS[name].label: RECEIVERS[name].spec for name in ("consumer", "consumer-good")}
    some["consumer, 2–4 m (rms), Doppler velocities of 2 cm/s"] = better
    table = [
        (
            label,
            *(
                " / ".join(f"{one:.2f}" for one in floor_m(spec, minutes, _MOST, _SPEED_MPS))
                for minutes in _FLOOR_MINUTES
            ),
        )
        for label, spec in some.items()
        if spec is not None
    ]
    header = ["receiver", *(f"{minutes:g} min" for minutes in _FLOOR_MINUTES)]
    title = "Best median of 25 drives [m]: tracks alone, noise known / late / late, all alike"
    show(title, header, table, markdown=markdown)


if __name__ == "__main__":
    main()
