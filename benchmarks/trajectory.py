"""The smoothed trajectory on simulated drives whose truth is known: errors, and what was stated of them.

Usage: python benchmarks/trajectory.py [--seeds 6] [--receiver]

With --receiver: one antenna with fixes good to a metre, and what its receiver adds: headings, velocities.

Errors do not depend on the machine; nothing here is a timing.
"""

from __future__ import annotations

import argparse

import numpy as np
from simulated_receiver import ReceiverSpec, as_single_fixes, metre_fixes, with_receiver_motion

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset, wrap_deg
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.trajectory import GnssFixes, trajectory_from_gnss

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
RECEIVER_CASES: tuple[tuple[str, float | None], ...] = (
    ("still", None),
    ("approach", 15.0),
    ("urban", 25.0),
    ("highway", 60.0),
)
RECEIVERS = {
    "fixes alone": ReceiverSpec(heading_deg=0.0, velocity_mps=0.0),
    "velocities": ReceiverSpec(heading_deg=0.0),
    "headings": ReceiverSpec(velocity_mps=0.0),
    "both": ReceiverSpec(),
}
COLUMNS = ("heading [°]", "pitch [°]", "roll [°]", "along [m]", "across [m]", "up [m]")


def driven(name: str, speed_kmh: float | None, antennas: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Errors and stated sigmas of a drive with RTK."""
    drive = simulate_drive(scenario(name, speed_kmh, seed), seed)
    return errors_of(drive, drive.gnss[:antennas])


def driven_with(
    spec: ReceiverSpec, name: str, speed_kmh: float | None, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Errors and stated sigmas of one antenna without corrections, whose receiver has more than positions."""
    world = metre_fixes(scenario(name, speed_kmh, seed), 1.0)
    drive = simulate_drive(world, seed)
    one = drive.gnss[0]
    arm = drive.rig.antennas[one.antenna].rig_t_antenna_m + drive.drawn.lever_arm_m[one.antenna]
    return errors_of(drive, (with_receiver_motion(as_single_fixes(one, 1.0), world, seed, arm, spec),))


def errors_of(drive: SimulatedDrive, fixes: tuple[GnssFixes, ...]) -> tuple[FloatArray, FloatArray]:
    """Errors and stated sigmas ``(frames, 6)`` in the order of `COLUMNS`, of annotated frames."""
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
    parser.add_argument("--receiver", action="store_true")
    options = parser.parse_args()
    seeds = range(options.seeds)
    print(f"| drive | {'used' if options.receiver else 'antennas'} | " + " | ".join(COLUMNS) + " |")
    print("|---" * (len(COLUMNS) + 2) + "|")
    if options.receiver:
        for name, speed_kmh in RECEIVER_CASES:
            for used, spec in RECEIVERS.items():
                print(
                    row(name, speed_kmh, used, [driven_with(spec, name, speed_kmh, seed) for seed in seeds])
                )
        return
    for name, speed_kmh, antennas in CASES:
        found = [driven(name, speed_kmh, antennas, seed) for seed in seeds]
        print(row(name, speed_kmh, str(antennas), found))


def row(name: str, speed_kmh: float | None, what: str, found: list[tuple[FloatArray, FloatArray]]) -> str:
    """Give root mean squares of errors and stated sigmas over drives, in Markdown."""
    error, sigma = (np.sqrt(np.mean(np.concatenate(part) ** 2, axis=0)) for part in zip(*found, strict=True))
    cells = [
        f"{e:.2f} ({s:.2f})" if i < 3 else f"{e:.3f} ({s:.3f})"
        for i, (e, s) in enumerate(zip(error, sigma, strict=True))
    ]
    label = name if speed_kmh is None else f"{name}, {speed_kmh:.0f} km/h"
    return f"| {label} | {what} | " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
