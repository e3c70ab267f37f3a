"""What the adjustment of a long drive costs: time and memory against the number of sightings.

Usage: OMP_NUM_THREADS=1 python benchmarks/adjust.py

The drive is one simulated highway, driven again and again every 116 s: 31 rounds are an
hour's work with 496 objects. Its poses come as an INS gives them. The ratio compares the cost of a sighting
with that of the smallest drive: 1.0 is linear.
"""

from __future__ import annotations

import resource
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.adjustment.adjust import adjust
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.rig.rig import Rig
from geoloc.simulation.simulate import scenario, simulate_drive
from geoloc.trajectory.poses import PoseTrack
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_poses
from twin.cli.output import print_table

ROUNDS = (4, 8, 16, 31)
APART_NS = 116_000_000_000


class Drive(NamedTuple):
    """What `adjust` takes, all sightings being feet."""

    rig: Rig
    sightings: Sightings
    object: NDArray[np.int64]
    epoch_ns: NDArray[np.int64]
    trajectory: Trajectory


def driven(rounds: int) -> Drive:
    """The same road again and again."""
    drive = simulate_drive(scenario("highway", 60.0, 0), 0)
    seen, poses = drive.sightings, drive.poses
    later = APART_NS * np.arange(rounds)[:, None]
    size = poses.epoch_ns.size * rounds
    track = PoseTrack(
        epoch_ns=(poses.epoch_ns + later).ravel(),
        latitude_deg=np.tile(poses.latitude_deg, rounds),
        longitude_deg=np.tile(poses.longitude_deg, rounds),
        height_m=np.tile(poses.height_m, rounds),
        roll_deg=np.tile(poses.roll_deg, rounds),
        pitch_deg=np.tile(poses.pitch_deg, rounds),
        heading_deg=np.tile(poses.heading_deg, rounds),
        sigma_horizontal_m=np.full(size, 0.02),
        sigma_vertical_m=np.full(size, 0.03),
        sigma_roll_pitch_deg=np.full(size, 0.2),
        sigma_heading_deg=np.full(size, 0.1),
    )
    stamps = np.empty(seen.frame.size, dtype=np.int64)
    for camera in np.unique(seen.camera):
        rows = seen.camera == camera
        stamps[rows] = drive.frame_host_ns[str(camera)][seen.frame[rows]]
    number = seen.object_index + len(drive.objects.object) * np.arange(rounds)[:, None]
    return Drive(
        drive.rig,
        Sightings(np.tile(seen.camera, rounds), np.tile(seen.pixel_px, (rounds, 1))),
        number.ravel(),
        (stamps + later).ravel(),
        trajectory_from_poses(track),
    )


def main() -> None:
    """Print one row a length."""
    rows: list[tuple[object, ...]] = []
    first = 0.0
    for rounds in ROUNDS:
        rig, sightings, number, epoch, trajectory = driven(rounds)
        feet = np.full(number.size, Kind.FOOT)
        observations = Observations(rig, sightings, feet, number, epoch, trajectory)
        start = time.perf_counter()
        adjusted = adjust(observations)
        seconds = time.perf_counter() - start
        each = 1e6 * seconds / number.size
        first = first or each
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        minutes = rounds * APART_NS / 60e9
        rows.append(
            (
                f"{minutes:.0f}",
                f"{adjusted.object.size:,}",
                f"{number.size:,}",
                f"{seconds:.1f}",
                f"{each:.0f}",
                f"{each / first:.2f}",
                f"{peak_mb:.0f}",
            )
        )
    header = ["minutes", "objects", "sightings", "seconds", "µs a sighting", "ratio", "peak MB"]
    print_table("Adjustment of a drive, one core", header, rows)


if __name__ == "__main__":
    main()
