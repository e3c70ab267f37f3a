"""Single sightings on hills: the plane under the car against rasters of the same simulated road.

Usage: python benchmarks/terrain.py [--seeds 3]

Errors do not depend on the machine; nothing here is a timing.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from simulated_raster import rasterised

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset
from geoloc.earth.terrain import Terrain
from geoloc.locate.accuracy import nees
from geoloc.locate.on_terrain import locate_on_terrain
from geoloc.locate.records import Located, Sightings
from geoloc.locate.single_frame import locate_single_frame
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.trajectory import trajectory_from_gnss
from twin.cli.output import console, print_table

SCENARIOS = ("sample", "urban", "highway")
RASTERS: dict[str, tuple[float, float]] = {
    "0.5 m, exact": (0.5, 0.0),
    "1 m, 2 cm noise": (1.0, 0.02),
    "1 m, 5 cm noise": (1.0, 0.05),
}
"""Name → distance and noise of the nodes, metres."""
RANGES_M = ((0.0, 8.0), (8.0, 12.0), (12.0, 16.0), (16.0, 22.0), (22.0, 30.0), (30.0, 60.0))


def methods_of(name: str, seed: int) -> dict[str, tuple[FloatArray, FloatArray, NDArray[np.bool_]]]:
    """True range, error and "inside the 95 % ellipse" of every sighting of one drive, by ground."""
    world = scenario(name, None, seed)
    drive = simulate_drive(world, seed)
    seen = drive.sightings
    arms = {antenna: place.rig_t_antenna_m for antenna, place in drive.rig.antennas.items()}
    trajectory = trajectory_from_gnss(drive.gnss, arms)
    stamps = zip(seen.camera, seen.frame, strict=True)
    poses = trajectory.poses_at(np.array([drive.frame_host_ns[camera][frame] for camera, frame in stamps]))
    sightings = Sightings(seen.camera, seen.pixel_px)
    found = {"plane": locate_single_frame(drive.rig, sightings, poses)}
    road = Road(world.road, seed)
    for label, (step_m, noise_m) in RASTERS.items():
        east, north, grid = rasterised(road, step_m, noise_m=noise_m, seed=seed)
        terrain = Terrain(east, north, step_m, grid, noise_m=noise_m)
        found[label] = locate_on_terrain(drive.rig, sightings, poses, terrain)
    return {label: _errors(drive, located) for label, located in found.items()}


def _errors(drive: SimulatedDrive, located: Located) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    known, row = drive.objects, drive.sightings.object_index
    offset = enu_offset(
        known.latitude_deg[row], known.longitude_deg[row], located.latitude_deg, located.longitude_deg
    )
    error = np.stack(offset, axis=-1)[located.valid]
    inside = nees(error, located.covariance_m2[located.valid]) <= 5.991
    return drive.sightings.range_m[located.valid], np.hypot(*error.T), inside


def main() -> None:
    """Print one row a scenario and ground: median errors by range."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3, help="drives a scenario (default 3)")
    seeds = parser.parse_args().seeds
    rows: list[tuple[object, ...]] = []
    for name in SCENARIOS:
        drives = [methods_of(name, seed) for seed in track(range(seeds), name, console=console(stderr=True))]
        for label in drives[0]:
            reach, error, inside = (
                np.concatenate(parts) for parts in zip(*(d[label] for d in drives), strict=True)
            )
            medians = [f"{np.median(error[(reach >= low) & (reach < high)]):.2f}" for low, high in RANGES_M]
            rows.append(
                (name, label, len(error), f"{np.median(error):.2f}", *medians, f"{inside.mean():.0%}")
            )
    ranges = [f"{low:.0f}-{high:.0f} m" for low, high in RANGES_M]
    header = ["scenario", "ground", "sightings", "median [m]", *ranges, "in 95 % ellipse"]
    print_table(f"Median error of single sightings, {seeds} drives a scenario", header, rows, right_from=2)


if __name__ == "__main__":
    main()
