"""Association without ids on simulated drives: poles taken for two, or two for one; and its time for an hour.

Usage: python benchmarks/association.py [--seeds 20] [--only-cameras]

To every third pole of the urban and the highway road another one of the same codes is added: opposite, 1.5 m
beside it, or 1.5 m behind it. "2 m" is one antenna at 1 Hz whose fixes are off by metres: "slow" mostly by
what lasts for minutes, "noisy" by 1.5 m anew at each fix. "By turns" are two poles of the same codes of which
each second picture shows the one, and the others the other, so that only where they stand tells them apart.

A pole is split where two objects or more have most of their sightings (at least 3) from it. An object is
merged where a second pole has a tenth of its sightings, and at least 3. Slips of the hand (one sighting in
200) aside. "Before" is `associate` alone, on the track as the fixes give it; "after" is `associate_drive`.
Counts do not depend on the machine.

"Cameras" are the same drives annotated camera by camera, as three tasks whose tracks know nothing of one
another: the adjustment of the tracks as they are ("apart"), joined by `join_cameras`, and with the ids that
an annotator would have given. The bars: one estimate a pole for 98 % of them, and a median error within 10 %
of that with ids. The hour is 33 copies of one drive one after the other along the map,
about 30,000 sightings of 528 poles.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from geoloc.adjustment.adjust import adjust
from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.association.associate import Association, associate, associate_drive, join_cameras
from geoloc.earth.geodesy import utm33_covariance_from_enu, utm33_from_geographic
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.simulation.simulate import NoiseSpec, PoleSpec, Scenario, SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.poses import GnssFixes, Poses
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_gnss
from twin.cli.output import console, print_table

WORLDS = ("urban", "highway")
FIXES: dict[str, dict[str, float]] = {
    "RTK": {},
    "2 m slow": {
        "gnss_white_horizontal_m": 0.3,
        "gnss_white_vertical_m": 0.5,
        "gnss_slow_horizontal_m": 1.9,
        "gnss_slow_vertical_m": 3.0,
        "gnss_multipath_m": 0.5,
    },
    "2 m noisy": {
        "gnss_white_horizontal_m": 1.5,
        "gnss_white_vertical_m": 2.5,
        "gnss_slow_horizontal_m": 1.3,
        "gnss_slow_vertical_m": 2.0,
    },
}
FIXES_OF_ONE_SECOND = 5
COPIES = 33


def with_twins(world: Scenario) -> Scenario:
    """Add a second pole of the same codes near every third one."""
    poles: list[PoleSpec] = []
    for i, pole in enumerate(world.poles):
        poles.append(pole)
        away = np.sign(pole.offset_m) * 1.5
        place = [
            (pole.station_m + 0.3, -pole.offset_m),
            (pole.station_m, pole.offset_m + away),
            (pole.station_m + 1.5, pole.offset_m),
        ][i // 3 % 3]
        if i % 3 == 0:
            poles.append(PoleSpec(f"{pole.object}b", pole.skiltnummer, *place))
    return replace(world, poles=tuple(poles))


def simulated(name: str, fixes: str, seed: int) -> tuple[SimulatedDrive, Trajectory]:
    """One drive, and its trajectory."""
    world = with_twins(scenario(name, None, seed))
    noise = replace(NoiseSpec(), **FIXES[fixes])
    drive = simulate_drive(replace(world, noise=noise), seed)
    arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    gnss = drive.gnss if not FIXES[fixes] else (each_second(drive.gnss[0]),)
    return drive, trajectory_from_gnss(gnss, arms)


def each_second(fixes: GnssFixes) -> GnssFixes:
    """One fix a second, of quality 1: single, 2 m."""
    rows = np.arange(0, fixes.epoch_ns.size, FIXES_OF_ONE_SECOND)
    columns = {f.name: getattr(fixes, f.name)[rows] for f in fields(fixes) if f.name != "antenna"}
    return replace(fixes, **{**columns, "quality": np.ones(rows.size, dtype=np.int64)})


def by_turns(drive: SimulatedDrive) -> SimulatedDrive:
    """Leave out sightings so that no picture shows two poles of the same codes."""
    seen = drive.sightings
    is_twin = np.char.endswith(drive.objects.object, "b")
    partner = is_twin | np.roll(is_twin, -1)
    odd = seen.frame // drive.scenario.annotate_every % 2 == 1
    keep = ~partner[seen.object_index] | (odd == is_twin[seen.object_index])
    return replace(drive, sightings=type(seen)(*(getattr(seen, f.name)[keep] for f in fields(seen))))


def epochs(drive: SimulatedDrive) -> IntArray:
    """Stamp of each sighting's picture."""
    seen = drive.sightings
    pictures = zip(seen.camera.tolist(), seen.frame, strict=True)
    return np.array([drive.frame_host_ns[camera][frame] for camera, frame in pictures])


def codes(drive: SimulatedDrive, *, labels: bool) -> NDArray[np.str_]:
    """Codes of each sighting, or none."""
    seen = drive.sightings
    return drive.objects.skiltnummer[seen.object_index] if labels else np.full(seen.camera.shape, "")


def both_ways(drive: SimulatedDrive, trajectory: Trajectory, *, labels: bool) -> tuple[Association, ...]:
    """Associate the feet of a drive on the track as it is, and on the corrected one."""
    seen = drive.sightings
    feet, unknown = np.full(seen.camera.size, Kind.FOOT), np.full(seen.camera.size, -1)
    sightings = Sightings(seen.camera, seen.pixel_px)
    observations = Observations(drive.rig, sightings, feet, unknown, epochs(drive), trajectory)
    label = codes(drive, labels=labels)
    return associate(observations, label), associate_drive(observations, label)


def an_hour(drive: SimulatedDrive, trajectory: Trajectory) -> Association:
    """Associate a drive that is repeated a kilometre and two minutes farther each time."""
    seen = drive.sightings
    poses = trajectory.poses_at(epochs(drive))
    again = np.repeat(np.arange(COPIES), seen.camera.size)
    tiled = Poses(**{f.name: np.tile(getattr(poses, f.name), COPIES) for f in fields(Poses)})
    tiled = replace(tiled, latitude_deg=tiled.latitude_deg + 0.01 * again)
    observations = Observations(
        drive.rig,
        Sightings(np.tile(seen.camera, COPIES), np.tile(seen.pixel_px, (COPIES, 1))),
        np.full(again.size, Kind.FOOT),
        np.full(again.size, -1),
        tiled.epoch_ns + again * 120_000_000_000,
        trajectory,
    )
    return associate(observations, np.tile(codes(drive, labels=True), COPIES), tiled)


def split_and_merged(truth: IntArray, found: IntArray) -> tuple[int, int, int]:
    """Count poles seen, poles that are split, and objects that are merged."""
    table = np.zeros((truth.max() + 1, found.max() + 2))
    np.add.at(table, (truth, found), 1)
    objects = table[:, :-1]
    size, owner = objects.sum(axis=0), objects.argmax(axis=0)
    parts = np.bincount(owner[size >= 3], minlength=len(table))
    second = np.sort(objects, axis=0)[-2]
    seen = table.sum(axis=1) > 0
    return int(seen.sum()), int((parts > 1).sum()), int((second >= np.maximum(3, 0.1 * size)).sum())


def row(name: str, fixes: str, seeds: int, *, labels: bool, turns: bool = False) -> tuple[object, ...]:
    """One row of the table: what is counted over all drives of a kind."""
    label = f"{name}, {fixes}, {'by turns, ' if turns else ''}{'codes' if labels else 'no codes'}"
    counts = np.zeros((2, 3), dtype=np.int64)
    for seed in track(range(seeds), label, console=console(stderr=True)):
        drive, trajectory = simulated(name, fixes, seed)
        drive = by_turns(drive) if turns else drive
        kept = ~drive.sightings.blunder
        for k, one in enumerate(both_ways(drive, trajectory, labels=labels)):
            counts[k] += split_and_merged(drive.sightings.object_index[kept], one.object[kept])
    (poles, *before), (_, *after) = counts.tolist()
    return label, poles, *before, *after


@dataclass(frozen=True)
class Placed:
    """What the adjustment made of a drive's objects, numbered in one way.

    Attributes
    ----------
    error_m : float64 (k,)
        Of each estimate in plan, from the pole that most of its sightings show.
    inside : bool (k,)
        Whether the pole stands in its 95 % ellipse.
    n_of_pole : int64 (p,)
        Estimates of each pole that was seen.
    n_mixed : int
        Estimates that hold sightings of two poles.
    """

    error_m: FloatArray
    inside: BoolArray
    n_of_pole: IntArray
    n_mixed: int


CHI2_95_2DOF = 5.991
BAR_RATIO, BAR_ONE = 1.10, 0.98
POOR_FIXES_SHARE = 5
"""One drive with poor fixes for five with RTK: their adjustments take several times as long."""


def placed(drive: SimulatedDrive, observations: Observations, number: IntArray) -> Placed:
    """Adjust a drive whose sightings are numbered by object in this way."""
    adjusted = adjust(replace(observations, object_index=number))
    table = np.zeros((number.max() + 1, drive.objects.object.size))
    np.add.at(table, (number, drive.sightings.object_index), 1)
    pole = table.argmax(axis=1)
    east, north = utm33_from_geographic(adjusted.latitude_deg, adjusted.longitude_deg)
    off = np.stack(
        [east - drive.objects.east_utm33_m[pole], north - drive.objects.north_utm33_m[pole]], axis=1
    )
    covariance = utm33_covariance_from_enu(
        adjusted.covariance_m2, adjusted.latitude_deg, adjusted.longitude_deg
    )
    d2 = np.einsum("ij,ijk,ik->i", off, np.linalg.inv(covariance), off)
    seen = table.sum(axis=0) > 0
    n_mixed = int(((table > 0).sum(axis=1) > 1).sum())
    n_of_pole = np.bincount(pole, minlength=seen.size)[seen]
    return Placed(np.hypot(*off.T), d2 <= CHI2_95_2DOF, n_of_pole, n_mixed)


def cameras(name: str, fixes: str, seeds: int) -> tuple[tuple[object, ...], bool]:
    """One row of the table of three tasks without common ids, and whether it keeps the bars."""
    found: dict[str, list[Placed]] = {"apart": [], "joined": [], "ids": []}
    for seed in track(range(seeds), f"cameras, {name}, {fixes}", console=console(stderr=True)):
        drive, trajectory = simulated(name, fixes, seed)
        seen = drive.sightings
        tracks = np.array([f"{c}:{o}" for c, o in zip(seen.camera, seen.object_index, strict=True)])
        number = np.unique(tracks, return_inverse=True)[1]
        feet = np.full(seen.camera.size, Kind.FOOT)
        sightings = Sightings(seen.camera, seen.pixel_px)
        observations = Observations(drive.rig, sightings, feet, number, epochs(drive), trajectory)
        is_track = np.ones(tracks.size, dtype=np.bool_)
        joined = join_cameras(observations, codes(drive, labels=True), tracks, is_track)
        numbers = {"apart": number, "joined": np.unique(joined, return_inverse=True)[1]}
        numbers["ids"] = np.unique(seen.object_index, return_inverse=True)[1]
        for how, of in numbers.items():
            found[how].append(placed(drive, observations, of))
    median = {how: float(np.median(np.concatenate([p.error_m for p in all_]))) for how, all_ in found.items()}
    inside = {how: float(np.concatenate([p.inside for p in all_]).mean()) for how, all_ in found.items()}
    count = np.concatenate([p.n_of_pole for p in found["joined"]])
    mixed = sum(p.n_mixed for p in found["joined"])
    one = float((count == 1).mean())
    keeps = one >= BAR_ONE and median["joined"] <= BAR_RATIO * median["ids"]
    cells = [f"{median[how]:.3f} m, {inside[how]:.0%}" for how in found]
    return (f"{name}, {fixes}", count.size, *cells, f"{one:.1%}", mixed, "ok" if keeps else "MISSED"), keeps


def print_cameras(seeds: int) -> bool:
    """Print the table of three tasks without common ids; whether all bars are kept."""
    few = max(seeds // POOR_FIXES_SHARE, 1)
    rows = [cameras(name, fixes, few if FIXES[fixes] else seeds) for name in WORLDS for fixes in FIXES]
    header = ["drives", "poles", "apart", "joined", "with ids", "one estimate", "of two poles", "bars"]
    title = f"Three cameras without common ids, {seeds} drives (poor fixes: {few}): median error, in ellipse"
    print_table(title, header, [cells for cells, _ in rows], right_from=1)
    return all(keeps for _, keeps in rows)


def main() -> None:
    """Print one row a world, kind of fixes and labels, the cameras and the hour."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="drives a row (default 20)")
    parser.add_argument("--only-cameras", action="store_true", help="only the table of three tasks")
    options = parser.parse_args()
    seeds = options.seeds
    if not print_cameras(seeds):
        raise SystemExit(1)
    if options.only_cameras:
        return
    rows = [
        row(name, fixes, seeds, labels=labels)
        for name in WORLDS
        for fixes in FIXES
        for labels in (True, False)
    ]
    rows += [row(WORLDS[0], fixes, seeds, labels=True, turns=True) for fixes in FIXES]
    header = ["drives", "poles", "split before", "merged before", "split after", "merged after"]
    print_table(f"Association without ids, {seeds} simulated drives a row", header, rows, right_from=1)
    drive, trajectory = simulated("highway", "RTK", 1)
    # Of the processor: other work on the machine does not count.
    start = time.process_time()
    found = an_hour(drive, trajectory)
    took = time.process_time() - start
    hour = [(found.object.size, COPIES * drive.objects.object.size, len(found.objects), f"{took:.1f} s")]
    print_table("An hour", ["sightings", "poles", "objects found", "processor time"], hour, right_from=0)


if __name__ == "__main__":
    main()
