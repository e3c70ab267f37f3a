"""Detected signs against the truth: simulated drives of three cameras, and a detector that errs.

Usage: python benchmarks/detector.py [--seeds 3]

No pictures: the faces of the poles are projected, 2.2 m up, into every third frame of each camera from 60 m
on, boxed with an error of 0.7 px and one percent of the size, called by another class one time in twenty,
missed or invented as often as the case says. Then it is the program's own way: tracker, label map, joining of
tracks, adjustment. "Mixed" tracks hold two boxes or more of a second sign, or of none.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.simulation.car import true_camera
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.noise import stream
from geoloc.simulation.observe import horizontal_range_m, project
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from twin.drives.annotations.gather import gather
from twin.drives.detection.shapes import Looked, annotation_file
from twin.drives.detection.yolo_output import Detections
from twin.drives.objects.join_tracks import with_joined_tracks
from twin.drives.read import read_drive
from twin.ingest.locate import in_euref89, locate_annotations, trajectory_of
from twin.ingest.rows import positions_of
from twin.samples.write_drive import write_driveworks_trip

FACE_M, FACE_UP_M, EVERY = 0.6, 2.2, 3
NEAREST_M, FARTHEST_M, SMALLEST_PX = 4.0, 60.0, 8.0


@dataclass(frozen=True)
class Case:
    """One row of the table."""

    name: str
    scenario: str
    speed_kmh: float
    missed: float
    invented: float
    """A picture."""


CASES = (
    Case("urban 25, misses 15 %, 0.05 false a picture", "urban", 25.0, 0.15, 0.05),
    Case("urban 40, misses 40 %, 0.5 false a picture", "urban", 40.0, 0.40, 0.50),
    Case("highway 60, misses 15 %, 0.05 false a picture", "highway", 60.0, 0.15, 0.05),
    Case("highway 80, misses 40 %, 0.5 false a picture", "highway", 80.0, 0.40, 0.50),
)


def looked(drive: SimulatedDrive, case: Case, camera: str) -> Iterator[tuple[Looked, NDArray[np.int64]]]:
    """What the detector finds in each picture, and the pole of each box, -1 for none."""
    world = drive.scenario
    true, rng = true_camera(drive.rig.camera(camera), drive.drawn), stream(drive.seed, f"detector {camera}")
    motion = TrueMotion(Road(world.road, drive.seed), world.motion, world.noise, drive.seed)
    size_px = np.array([true.model.width_px, true.model.height_px], dtype=np.float64)
    focal_px = size_px[0] / true.model.horizontal_fov_rad
    faces, codes = drive.objects.enu_m + np.array([0, 0, FACE_UP_M]), np.unique(drive.objects.skiltnummer)
    time_s = (drive.frame_epoch_ns - world.start_utc_ns) / 1e9
    for frame in range(0, time_s.size, EVERY):
        now = np.full(len(faces), time_s[frame])
        distance = horizontal_range_m(true, motion, faces, now)
        middle, seen = project(world.noise, true, motion, faces, now)
        half = FACE_M / distance[:, None] * focal_px / 2.0
        middle = middle + rng.normal(size=middle.shape) * (0.7 + 0.02 * half)
        seen &= (distance > NEAREST_M) & (distance < FARTHEST_M) & (2.0 * half[:, 0] > SMALLEST_PX)
        with np.errstate(invalid="ignore"):
            seen &= ((middle - half > 0.5) & (middle + half < size_px - 1.5)).all(axis=1)
        rows = np.flatnonzero(seen & (rng.random(len(faces)) >= case.missed))
        count = rng.poisson(case.invented)
        false_middle, false_half = rng.uniform(size=(count, 2)) * size_px, rng.uniform(4.0, 30.0, (count, 1))
        box = np.concatenate(
            [
                np.concatenate([middle[rows] - half[rows], middle[rows] + half[rows]], axis=1),
                np.concatenate([false_middle - false_half, false_middle + false_half], axis=1),
            ]
        )
        said = np.concatenate(
            [np.searchsorted(codes, drive.objects.skiltnummer[rows]), rng.integers(codes.size, size=count)]
        )
        wrong = rng.random(said.size) < 0.05
        said = np.where(wrong, rng.integers(codes.size, size=said.size), said).astype(np.int64)
        found = Detections(box, np.full(len(box), 0.9), said)
        pole = np.concatenate([rows, np.full(count, -1)]).astype(np.int64)
        yield Looked(frame, int(drive.frame_host_ns[camera][frame]), found), pole


def run(case: Case, seed: int) -> tuple[int, int, int, int, NDArray[np.float64]]:
    """Tracks, mixed tracks, objects, poles, and the error of each object's position in metres."""
    made = simulate_drive(scenario(case.scenario, speed_kmh=case.speed_kmh, seed=seed), seed)
    codes = np.unique(made.objects.skiltnummer).tolist()
    files, n_tracks, n_mixed = [], 0, 0
    for camera in made.scenario.cameras:
        pictures, poles = zip(*looked(made, case, camera), strict=True)
        file, _ = annotation_file(pictures, lambda i: codes[i], camera)
        files.append((file, camera))
        pole_of = {
            (p.frame, *box): pole
            for p, rows in zip(pictures, poles, strict=True)
            for box, pole in zip(p.found.box_px.tolist(), rows.tolist(), strict=True)
        }
        shown: dict[str, Counter[int]] = {}
        for shape in file.shapes:
            shown.setdefault(shape.track, Counter())[pole_of[shape.frame, *shape.box_px]] += 1
        n_tracks += len(shown)
        n_mixed += sum(sum(n >= 2 for n in counts.values()) > 1 for counts in shown.values())
    with tempfile.TemporaryDirectory() as folder:
        write_driveworks_trip(made, Path(folder))
        drive = read_drive(folder)
    drive, sigma_m = in_euref89(replace(drive, annotations=gather(files, drive.rig).annotations))
    trajectory = trajectory_of(drive)
    drive = with_joined_tracks(drive, trajectory)
    sighted = locate_annotations(drive, trajectory, method="adjusted", datum_sigma_m=sigma_m)
    found = positions_of(sighted)
    good = np.isfinite(found.latitude_deg)
    place = np.column_stack(utm33_from_geographic(found.latitude_deg[good], found.longitude_deg[good]))
    truth = np.column_stack([made.objects.east_utm33_m, made.objects.north_utm33_m])
    error_m = np.linalg.norm(place[:, None] - truth[None], axis=-1).min(axis=1)
    return n_tracks, n_mixed, int(good.sum()), len(truth), error_m


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    seeds = parser.parse_args().seeds
    print("| case | tracks | mixed | objects / poles | median | p95 |\n|---|---|---|---|---|---|")
    for case in CASES:
        *counts, errors = zip(*(run(case, seed) for seed in range(1, seeds + 1)), strict=True)
        tracks, mixed, objects, poles = (sum(numbers) for numbers in counts)
        error_m = np.concatenate(errors)
        median, p95 = np.percentile(error_m, [50, 95])
        print(f"| {case.name} | {tracks} | {mixed} | {objects} / {poles} | {median:.2f} m | {p95:.2f} m |")


if __name__ == "__main__":
    main()
