"""Poses that state no sigmas: errors and ellipses on simulated drives, and on KITTI where it is there.

Usage: python benchmarks/unstated_poses.py [--drives 3]

The true poses of simulated drives, 30 a second, with errors that each pose has for itself, or that last five
seconds or a minute (Gauss-Markov), from 1 cm and 0.05° to 0.3 m and 0.5°, and no sigma stated. Bar: 85 to
99 % of the signs inside their ellipses. Nothing here is a timing.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from accuracy import CHI2_95, Case, Recorded, offsets, recorded
from real import errors_of
from real_drives import POSE_COLUMNS, REAL
from real_kitti import kitti_drives
from rich.progress import track

from geoloc.adjustment.adjust import adjust
from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_enu
from geoloc.locate.accuracy import nees
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind
from geoloc.simulation.noise import gauss_markov, stream
from geoloc.trajectory.trajectory import PoseTrack, trajectory_from_poses
from twin.cli.output import console, print_table

LEVELS = ((0.01, 0.05), (0.1, 0.2), (0.3, 0.5))
LASTS_S = (0.0, 5.0, 60.0)
_FIRST_SEED = 9_000


def without_sigmas(
    poses: PoseTrack, seed: int, sigma_m: float, sigma_deg: float, lasts_s: float
) -> PoseTrack:
    """Give true poses errors that last so long; 0: each pose its own."""
    time_s = (poses.epoch_ns - poses.epoch_ns[0]) / 1e9

    def error(name: str, sigma: float) -> FloatArray:
        random = stream(seed, f"pose {name}")
        if lasts_s:
            return gauss_markov(random, time_s, sigma, lasts_s)
        return np.asarray(random.normal(size=time_s.size) * sigma)

    east, north, up = (error(axis, sigma_m) for axis in "enu")
    latitude, longitude = geographic_from_enu(poses.latitude_deg, poses.longitude_deg, east, north)
    nothing = np.full(time_s.size, np.nan)
    return replace(
        poses,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=poses.height_m + up,
        roll_deg=poses.roll_deg + error("roll", sigma_deg),
        pitch_deg=poses.pitch_deg + error("pitch", sigma_deg),
        heading_deg=np.mod(poses.heading_deg + error("heading", sigma_deg), 360.0),
        sigma_horizontal_m=nothing,
        sigma_vertical_m=nothing,
        sigma_roll_pitch_deg=nothing,
        sigma_heading_deg=nothing,
    )


def result_of(recording: Recorded, poses: PoseTrack) -> tuple[FloatArray, FloatArray]:
    """Lengths of the errors (n,), and their squares over the variances."""
    feet = np.full(recording.object.size, Kind.FOOT)
    adjusted = adjust(
        Observations(
            recording.drive.rig,
            recording.sightings,
            feet,
            recording.object,
            recording.epoch_ns,
            trajectory_from_poses(poses),
        )
    )
    error = offsets(recording.drive, adjusted.object, adjusted.latitude_deg, adjusted.longitude_deg)
    error = error[adjusted.object]
    there = np.isfinite(error[:, 0])
    return np.hypot(*error[there].T), nees(error[there], adjusted.covariance_m2[there])


def kitti_row() -> tuple[object, ...]:
    """KITTI through `twin ingest-drive`, its poses without their columns of sigmas."""
    with tempfile.TemporaryDirectory() as folder:
        drives = kitti_drives(Path(folder) / "kitti")
        for drive in drives:
            poses = drive.folder / "poses.csv"
            with poses.open(encoding="utf-8", newline="") as file:
                rows = [row[: len(POSE_COLUMNS)] for row in csv.reader(file)]
            poses.write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")
        errors = errors_of(drives, "adjusted", Path(folder) / "kitti.db")
    squares = nees(errors.offset_m, errors.covariance_m2)
    return _row("KITTI", errors.error_m, squares)


def _row(label: str, error_m: FloatArray, squares: FloatArray) -> tuple[object, ...]:
    return (
        label,
        error_m.size,
        f"{np.median(error_m):.2f} / {np.percentile(error_m, 95):.2f}",
        f"{np.mean(squares <= CHI2_95):.0%}",
        f"{np.mean(squares) / 2.0:.2f}",
    )


def main() -> None:
    """Print one row a road, level and how long errors last, then KITTI."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=3, help="drives a row (default 3)")
    count = parser.parse_args().drives
    table: list[tuple[object, ...]] = []
    for road in ("urban", "highway"):
        case = Case(road, road, (None,), (0.0, None))
        drives = [recorded(case, None, seed) for seed in range(_FIRST_SEED, _FIRST_SEED + count)]
        for lasts_s in LASTS_S:
            for sigma_m, sigma_deg in LEVELS:
                label = f"{road}, {sigma_m:g} m, {sigma_deg:g}°, {f'{lasts_s:g} s' if lasts_s else 'each'}"
                bar = track(drives, description=label, console=console(stderr=True), transient=True)
                results = [
                    result_of(
                        one, without_sigmas(one.drive.poses, one.drive.seed, sigma_m, sigma_deg, lasts_s)
                    )
                    for one in bar
                ]
                table.append(_row(label, *(np.concatenate([one[i] for one in results]) for i in (0, 1))))
    if REAL.exists():
        table.append(kitti_row())
    header = ["drive", "objects", "median / p95 [m]", "in ellipse", "NEES / 2"]
    print_table("Poses that state no sigmas", header, table, right_from=1)


if __name__ == "__main__":
    main()
