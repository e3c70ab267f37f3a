"""Labels that drift slowly: projections of 3D boxes, propagated boxes, boxes that a detector smooths.

Usage: python benchmarks/drifting_labels.py [--drives 8] [--drift-m 0.03]

Simulated drives whose labels wander by 3 cm over two seconds, all objects of a camera alike, beside the noise
of single clicks. The next label then repeats the error of the last, and thirty labels say little more than
three. Bars: the truth is inside 85 % of the 95 % ellipses or more, and the error is no larger than that of
rays that are crossed as they are, by the trajectory as it is. Nothing here is a timing.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from accuracy import CHI2_95, Case, Recorded, adjusted_of, offsets, recorded
from rich.progress import track

from geoloc.adjustment.scene import bodies_at, rays_of
from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset
from geoloc.locate.accuracy import nees
from geoloc.locate.records import Sightings
from geoloc.simulation.car import true_camera
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.noise import gauss_markov, stream
from geoloc.simulation.observe import project
from geoloc.simulation.road import Road
from twin.cli.output import console, print_table

_LASTS_S = 2.0
_FIRST_SEED = 70_000
CASES = (
    Case("urban, 25 km/h", "urban", (None,), (0.0, None)),
    Case("highway, 60 km/h", "highway", (None,), (0.0, None)),
)


def drifting(recording: Recorded, seed: int, drift_m: float) -> Recorded:
    """The recording with labels that wander about their feet, (east, north, up) by `drift_m` each."""
    drive, world = recording.drive, recording.drive.scenario
    motion = TrueMotion(Road(world.road, seed), world.motion, world.noise, seed)
    frame_s = np.arange(drive.frame_epoch_ns.size) / world.motion.frame_rate_hz
    pixel = recording.sightings.pixel_px.copy()
    frame = drive.sightings.frame
    for name in np.unique(recording.sightings.camera):
        rows = np.flatnonzero(recording.sightings.camera == name)
        camera = true_camera(drive.rig.camera(str(name)), drive.drawn)
        when, feet = frame_s[frame[rows]], drive.objects.enu_m[recording.object[rows]]
        instant, of = np.unique(when, return_inverse=True)
        wander = [
            gauss_markov(stream(seed, f"label {name} {axis}"), instant, drift_m, _LASTS_S) for axis in "enu"
        ]
        there, _ = project(world.noise, camera, motion, feet + np.stack(wander, axis=1)[of], when)
        pixel[rows] += there - recording.true_px[rows]
    return recording._replace(sightings=replace(recording.sightings, pixel_px=pixel))


def crossed(recording: Recorded) -> FloatArray:
    """Errors (g,) of plain triangulation: where the rays of each object cross, by least squares."""
    sightings = Sightings(recording.sightings.camera, recording.sightings.pixel_px)
    rig, rays = recording.drive.rig, rays_of(recording.drive.rig, sightings)
    body, _ = bodies_at(recording.trajectory, recording.epoch_ns)
    turn = np.array([rig.camera(str(name)).rig_R_camera for name in sightings.camera])
    arm = np.array([rig.camera(str(name)).rig_t_camera_m for name in sightings.camera])
    ray = np.einsum("nij,njk,nk->ni", body.enu_R_rig, turn, rays.ray)
    truth, errors = recording.drive.objects, []
    for number in np.unique(recording.object):
        rows = np.flatnonzero((recording.object == number) & (rays.rejected == ""))
        east, north = enu_offset(
            truth.latitude_deg[number],
            truth.longitude_deg[number],
            body.latitude_deg[rows],
            body.longitude_deg[rows],
        )
        up = body.height_m[rows] - truth.height_m[number]
        eye = np.stack([east, north, up], axis=1) + np.einsum("nij,nj->ni", body.enu_R_rig[rows], arm[rows])
        across = np.eye(3) - ray[rows, :, None] * ray[rows, None, :]
        found = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, eye))
        errors.append(float(np.hypot(found[0], found[1])))
    return np.array(errors)


def main() -> None:
    """Print one row a case, with and without the drift."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=8)
    parser.add_argument("--drift-m", type=float, default=0.03)
    options = parser.parse_args()
    rows: list[tuple[object, ...]] = []
    for number, case in enumerate(CASES):
        first = _FIRST_SEED + 100 * number
        for drift_m in (0.0, options.drift_m):
            errors, plain, squares = [], [], []
            seeds = range(first, first + options.drives)
            for seed in track(seeds, description=case.label, console=console(stderr=True), transient=True):
                recording = drifting(recorded(case, None, seed), seed, drift_m)
                adjusted = adjusted_of(recording, recording.sightings)
                where = adjusted.object, adjusted.latitude_deg, adjusted.longitude_deg
                off = offsets(recording.drive, *where)[adjusted.object]
                errors.append(np.hypot(*off.T))
                plain.append(crossed(recording))
                squares.append(nees(off, adjusted.covariance_m2))
            error, square = np.concatenate(errors), np.concatenate(squares)
            rows.append(
                (
                    f"{case.label}, labels drift {100.0 * drift_m:g} cm",
                    error.size,
                    f"{np.median(np.concatenate(plain)):.2f}",
                    f"{np.nanmedian(error):.2f} / {np.nanpercentile(error, 95):.2f}",
                    f"{np.nanmean(square <= CHI2_95):.0%}",
                    f"{np.nanmean(square) / 2.0:.2f}",
                )
            )
    header = ["case", "objects", "rays crossed", "adjusted, median / p95", "in ellipse", "NEES / 2"]
    print_table("Horizontal error [m]", header, rows, right_from=1)


if __name__ == "__main__":
    main()
