"""A million single-frame sightings, against the vectorised `gpsFromImage` of cameratransform.

Usage: python benchmarks/locate.py [--sightings 1000000] [--rounds 7]
(`pip install --no-deps cameratransform==1.2.1 tqdm`, or the extra `bench` in an environment of its own;
without it our own times are printed alone.)

Ours: the pose of its frame from an hour's trajectory at 5 Hz for every row (nine sightings a frame), an
f-theta ray, the tilted road, the ellipsoid. Theirs: one pose for all rows, a pinhole camera, level ground, a
sphere, no covariances. Times are the processor's, so that other work on the machine counts less. Rounds are
interleaved; the shortest of each is shown, and the ratio is the median of the rounds' own. Everything runs on
one core: set OMP_NUM_THREADS=1, for BLAS's threads, which only theirs uses, would be counted together.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.cameras.ftheta import FThetaCamera
from geoloc.earth.geodesy import geographic_from_enu, rotation_from_rpy
from geoloc.locate.combine import combine
from geoloc.locate.records import Located, Sightings
from geoloc.locate.single_frame import ErrorBudget, locate_single_frame
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera
from geoloc.trajectory.poses import PoseTrack
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_poses

SEED = 1
DRIVE_S = 3600.0
CAMERAS = {"front": 0.0, "left": 60.0, "right": -60.0}
# An hour at thirty pictures a second.
FRAMES = 108_000


def rig() -> Rig:
    """Three 120° f-theta cameras 1.5 m above the road."""
    model = FThetaCamera(1920, 1208, 951.0, 612.0, theta_from_r=(0.0, 9.9e-4, 2e-9, -1.1e-11))
    cameras = {
        name: RigCamera(
            name, model, rotation_from_rpy(0.4, 2.6, yaw) @ FLU_R_RDF, np.array([1.8, 0.01 * yaw, 1.5])
        )
        for name, yaw in CAMERAS.items()
    }
    return Rig(cameras, {}, "benchmark")


def trajectory() -> Trajectory:
    """An hour at 5 Hz and 15 m/s, winding north."""
    t = np.arange(0.0, DRIVE_S, 0.2)
    full = np.ones_like(t)
    track = PoseTrack(
        epoch_ns=1_780_000_000_000_000_000 + (t * 1e9).astype(np.int64),
        latitude_deg=63.4 + 1.2e-4 * t,
        longitude_deg=10.4 + 5e-4 * np.sin(t / 20.0),
        height_m=60.0 + 5.0 * np.sin(t / 30.0),
        roll_deg=1.5 * np.sin(t / 7.0),
        pitch_deg=2.0 * np.sin(t / 11.0),
        heading_deg=(30.0 * np.cos(t / 20.0)) % 360.0,
        sigma_horizontal_m=0.02 * full,
        sigma_vertical_m=0.03 * full,
        sigma_roll_pitch_deg=0.2 * full,
        sigma_heading_deg=0.15 * full,
    )
    return trajectory_from_poses(track)


def sighted(n: int, mixed: bool, rng: np.random.Generator) -> tuple[NDArray[np.int64], Sightings]:
    """Epochs in order, and pixels on the road; of one camera, or of all in turns."""
    frame = np.sort(rng.integers(0, FRAMES, n))
    epoch = 1_780_000_000_000_000_000 + (frame * (0.999 * DRIVE_S / FRAMES * 1e9)).astype(np.int64)
    pixel = rng.uniform([500.0, 760.0], [1400.0, 1150.0], (n, 2))
    names = list(CAMERAS)
    camera = rng.choice(names, n) if mixed else np.full(n, names[0])
    return epoch, Sightings(camera, pixel)


def their_baseline(pixel_px: NDArray[np.float64]) -> Callable[[], Any] | None:
    """`gpsFromImage` of all pixels, or None where the package is absent."""
    try:
        import cameratransform as ct
    except ImportError:
        return None
    camera = ct.Camera(
        ct.RectilinearProjection(focallength_px=1870.0, image=(1920, 1208)),
        ct.SpatialOrientation(elevation_m=1.5, tilt_deg=85.0, heading_deg=30.0),
    )
    camera.setGPSpos(63.4, 10.4, 0.0)
    return lambda: camera.gpsFromImage(pixel_px)


def about_one_place(located: Located, rng: np.random.Generator) -> Located:
    """The sightings moved to where they would be of one object: scattered by their own covariances."""
    root = np.linalg.cholesky(located.covariance_m2)
    offset = (root @ rng.normal(size=(*root.shape[:2], 1)))[:, :, 0]
    latitude, longitude = geographic_from_enu(63.4, 10.4, offset[:, 0], offset[:, 1])
    return replace(located, latitude_deg=latitude, longitude_deg=longitude)


def times_of(works: dict[str, Callable[[], Any]], rounds: int) -> NDArray[np.float64]:
    """Processor time of each work in each round, ``(rounds, works)`` seconds; each round runs all of them."""
    times = np.empty((rounds, len(works)))
    for row in times:
        for i, work in enumerate(works.values()):
            begin = time.process_time()
            work()
            row[i] = time.process_time() - begin
    return times


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sightings", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    n, rng = options.sightings, np.random.default_rng(SEED)
    cameras, track, budget = rig(), trajectory(), ErrorBudget()
    epoch, sightings = sighted(n, False, rng)
    mixed_epoch, mixed = sighted(n, True, rng)
    works: dict[str, Callable[[], Any]] = {
        "poses alone": lambda: track.poses_at(epoch),
    }
    baseline = their_baseline(sightings.pixel_px)
    if baseline is None:
        print(
            "cameratransform is not installed (pip install --no-deps cameratransform==1.2.1 tqdm): no ratios."
        )
    else:
        works = {"cameratransform gpsFromImage": baseline, **works}
    times = times_of(works, options.rounds)
    located = locate_single_frame(cameras, sightings, track.poses_at(epoch), budget)
    scattered, group = about_one_place(located, rng), np.arange(n) // 60
    slow: dict[str, Callable[[], Any]] = {
        "positions and covariances": lambda: locate_single_frame(
            cameras, sightings, track.poses_at(epoch), budget
        ),
        "the same, three cameras mixed": lambda: locate_single_frame(
            cameras, mixed, track.poses_at(mixed_epoch), budget
        ),
        "combine, 60 sightings an object": lambda: combine(scattered, group),
    }
    slow_times = times_of(slow, min(options.rounds, 2))
    print(f"{n:,} sightings, {located.valid.mean():.0%} located, seed {SEED}")
    print(f"{'':34}{'seconds':>9}{'M/s':>8}{'time ratio':>12}")
    seconds = [*times.min(axis=0), *slow_times.min(axis=0)]
    ratios = [*np.median(times / times[:, :1], axis=0), *(slow_times.min(axis=0) / times[:, 0].min())]
    for name, took, ratio in zip([*works, *slow], seconds, ratios, strict=True):
        shown = "–" if baseline is None else f"{ratio:.2f}"
        print(f"{name:34}{took:9.3f}{n / took / 1e6:8.2f}{shown:>12}")


if __name__ == "__main__":
    main()
