"""Association without ids on simulated drives, and its time for an hour's drive.

Usage: python benchmarks/association.py [--seeds 6]

Scores are over pairs of sightings, slips of the hand aside, and do not depend on the machine. The hour is
33 copies of one drive one after the other along the map, about 30,000 sightings of 528 poles.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from geoloc.associate import Association, associate
from geoloc.locate import Sightings
from geoloc.poses import Poses
from geoloc.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory import trajectory_from_gnss
from twin.cli.output import console, print_table

IntArray = NDArray[np.int64]

WORLDS = (("urban", 0.005), ("highway", 0.005), ("urban", 0.02), ("highway", 0.02))
COPIES = 33


def simulated(name: str, blunder_rate: float, seed: int) -> tuple[SimulatedDrive, Poses]:
    """One drive, and its poses at the sightings, from its GNSS."""
    world = scenario(name, None, seed)
    drive = simulate_drive(replace(world, noise=replace(world.noise, blunder_rate=blunder_rate)), seed)
    arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    seen = drive.sightings
    epoch = [drive.frame_host_ns[c][f] for c, f in zip(seen.camera.tolist(), seen.frame, strict=True)]
    return drive, trajectory_from_gnss(drive.gnss, arms).poses_at(np.array(epoch))


def associated(drive: SimulatedDrive, poses: Poses, *, labels: bool, copies: int = 1) -> Association:
    """Associate the feet of a drive, repeated a kilometre and two minutes farther each time."""
    seen = drive.sightings
    again = np.repeat(np.arange(copies), seen.camera.size)
    tiled = Poses(**{f.name: np.tile(getattr(poses, f.name), copies) for f in fields(Poses)})
    tiled = replace(tiled, latitude_deg=tiled.latitude_deg + 0.01 * again)
    code = drive.objects.skiltnummer[seen.object_index] if labels else np.full(seen.camera.shape, "")
    return associate(
        drive.rig,
        Sightings(np.tile(seen.camera, copies), np.tile(seen.pixel_px, (copies, 1))),
        tiled,
        np.full(again.size, "foot"),
        np.tile(code, copies),
        tiled.epoch_ns + again * 120_000_000_000,
    )


def pair_score(truth: IntArray, found: IntArray) -> tuple[float, float]:
    """Precision and recall over pairs; a sighting left out belongs with nothing."""
    table = np.zeros((truth.max() + 1, found.max() + 1))
    np.add.at(table, (truth[found >= 0], found[found >= 0]), 1)
    true, put, both = (
        (n * (n - 1.0) / 2.0).sum() for n in (np.bincount(truth).astype(float), table.sum(axis=0), table)
    )
    return float(both / put), float(both / true)


def main() -> None:
    """Print one row a world, and the hour."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=6, help="drives a world (default 6)")
    seeds = parser.parse_args().seeds
    rows: list[tuple[object, ...]] = []
    for name, rate in WORLDS:
        drives = [
            simulated(name, rate, seed) for seed in track(range(seeds), name, console=console(stderr=True))
        ]
        for labels in (True, False):
            scores, extra = [], []
            for drive, poses in drives:
                found = associated(drive, poses, labels=labels)
                kept = ~drive.sightings.blunder
                scores.append(pair_score(drive.sightings.object_index[kept], found.object[kept]))
                extra.append(len(found.objects) - drive.objects.object.size)
            precision, recall = np.array(scores).T
            worst = f"{precision.min():.3f} / {recall.min():.3f}"
            mean = f"{precision.mean():.4f} / {recall.mean():.4f}"
            label = f"{name}, {rate:.1%} slips, {'codes' if labels else 'no codes'}"
            rows.append((label, mean, worst, sum(extra)))
    header = ["drives", "precision / recall", "worst", "objects too many"]
    print_table(f"Association without ids, {seeds} simulated drives a row", header, rows, right_from=1)
    drive, poses = simulated("highway", 0.005, 1)
    # Of the processor: other work on the machine does not count.
    start = time.process_time()
    found = associated(drive, poses, labels=True, copies=COPIES)
    took = time.process_time() - start
    hour = [(found.object.size, COPIES * drive.objects.object.size, len(found.objects), f"{took:.1f} s")]
    print_table("An hour", ["sightings", "poles", "objects found", "processor time"], hour, right_from=0)


if __name__ == "__main__":
    main()
