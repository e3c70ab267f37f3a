"""The smoothed trajectory on simulated drives whose truth is known: errors, and what was stated of them.

Usage: python benchmarks/trajectory.py [--seeds 6]

Errors do not depend on the machine; nothing here is a timing.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from geoloc.geodesy import enu_offset
from geoloc.interpolation import wrap_deg
from geoloc.simulate import scenario, simulate_drive
from geoloc.trajectory import trajectory_from_gnss

FloatArray = NDArray[np.float64]

CASES: tuple[tuple[str, float | None, int], ...] = (
    ("still", None, 2),
    ("approach", 15.0, 2),
    ("urban", 25.0, 2),
    ("highway", 35.0, 2),
    ("highway", 60.0, 2),
    ("highway", 80.0, 2),
    ("urban", 25.0, 1),
    ("highway", 60.0, 1),
)
COLUMNS = ("heading [°]", "pitch [°]", "roll [°]", "along [m]", "across [m]", "up [m]")


def errors_of(name: str, speed_kmh: float | None, antennas: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Errors and stated sigmas ``(frames, 6)`` in the order of `COLUMNS`, of annotated frames."""
    drive = simulate_drive(scenario(name, speed_kmh, seed), seed)
    fixes = drive.gnss[:antennas]
    levers = {one.antenna: drive.rig.antennas[one.antenna].rig_t_antenna_m for one in fixes}
    poses, truth = trajectory_from_gnss(fixes, levers).poses_at(drive.frame_epoch_ns), drive.poses
    east, north = enu_offset(truth.latitude_deg, truth.longitude_deg, poses.latitude_deg, poses.longitude_deg)
    heading = np.radians(truth.heading_deg)
    errors = (
        wrap_deg(poses.heading_deg - truth.heading_deg),
        poses.pitch_deg - truth.pitch_deg,
        poses.roll_deg - truth.roll_deg,
        east * np.sin(heading) + north * np.cos(heading),
        east * np.cos(heading) - north * np.sin(heading),
        poses.height_m - truth.height_m,
    )
    sigmas = (
        poses.sigma_heading_deg,
        poses.sigma_pitch_deg,
        poses.sigma_roll_deg,
        poses.sigma_horizontal_m,
        poses.sigma_horizontal_m,
        poses.sigma_vertical_m,
    )
    first = int(drive.scenario.annotate_from_s * drive.scenario.motion.frame_rate_hz)
    return np.stack(errors, axis=1)[first:], np.stack(sigmas, axis=1)[first:]


def main() -> None:
    """Print one row a case, in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=6)
    seeds = range(parser.parse_args().seeds)
    print("| drive | antennas | " + " | ".join(COLUMNS) + " |")
    print("|---" * (len(COLUMNS) + 2) + "|")
    for name, speed_kmh, antennas in CASES:
        found = [errors_of(name, speed_kmh, antennas, seed) for seed in seeds]
        error, sigma = (
            np.sqrt(np.mean(np.concatenate(part) ** 2, axis=0)) for part in zip(*found, strict=True)
        )
        cells = [
            f"{e:.2f} ({s:.2f})" if i < 3 else f"{e:.3f} ({s:.3f})"
            for i, (e, s) in enumerate(zip(error, sigma, strict=True))
        ]
        label = name if speed_kmh is None else f"{name}, {speed_kmh:.0f} km/h"
        print(f"| {label} | {antennas} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
