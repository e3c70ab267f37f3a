"""Simulated drives in the form that the joint adjustment takes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.adjustment.adjust import adjust
from geoloc.adjustment.result import Adjusted
from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import enu_offset
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive, without_noise
from geoloc.trajectory.trajectory import PoseTrack, Trajectory, trajectory_from_gnss, trajectory_from_poses


class Recording(NamedTuple):
    """A simulated drive in the form that `adjust` takes."""

    drive: SimulatedDrive
    trajectory: Trajectory
    camera: NDArray[np.str_]
    pixel_px: FloatArray
    object: IntArray
    epoch_ns: IntArray

    def rows(self, keep: BoolArray | IntArray) -> Recording:
        """The same recording with some of its sightings."""
        columns = (self.camera, self.pixel_px, self.object, self.epoch_ns)
        return Recording(self.drive, self.trajectory, *(column[keep] for column in columns))

    def adjusted(self, **options: object) -> Adjusted:
        """Adjust it, all sightings being feet."""
        return adjust(self.observations(), **options)  # type: ignore[arg-type]

    def observations(self, kind: Kind = Kind.FOOT) -> Observations:
        """All its sightings, of one kind."""
        return Observations(
            self.drive.rig,
            Sightings(self.camera, self.pixel_px),
            np.full(self.camera.size, kind),
            self.object,
            self.epoch_ns,
            self.trajectory,
        )

    def errors_m(self, adjusted: Adjusted) -> FloatArray:
        """Offsets (g, 2) east and north from the truth."""
        truth = self.drive.objects
        east, north = enu_offset(
            truth.latitude_deg[adjusted.object],
            truth.longitude_deg[adjusted.object],
            adjusted.latitude_deg,
            adjusted.longitude_deg,
        )
        return np.stack([east, north], axis=1)


def true_poses(drive: SimulatedDrive) -> Trajectory:
    """The drive's true poses, as an INS with small sigmas would give them."""
    n = drive.poses.epoch_ns.size
    track: PoseTrack = replace(
        drive.poses,
        sigma_horizontal_m=np.full(n, 0.005),
        sigma_vertical_m=np.full(n, 0.005),
        sigma_roll_pitch_deg=np.full(n, 0.02),
        sigma_heading_deg=np.full(n, 0.02),
    )
    return trajectory_from_poses(track)


@cache
def recorded(
    name: str,
    speed_kmh: float | None = None,
    seed: int = 1,
    *,
    antennas: int = 2,
    ins: bool = False,
    silent: bool = False,
    kerbs: bool = True,
    kerb_everywhere_m: float | None = None,
    straight: bool = False,
    crossfall_percent: float | None = None,
    minutes: float | None = None,
    single_m: float | None = None,
    **noise: float,
) -> Recording:
    """Simulate a drive and bring it into the form that `adjust` takes."""
    world = scenario(name, speed_kmh, seed, minutes)
    world = without_noise(world) if silent else world
    if not kerbs:
        world = replace(world, road=replace(world.road, kerb_share=0.0, verge_sigma_m=0.0))
    if kerb_everywhere_m is not None:
        road = replace(world.road, kerb_share=1.0, kerb_height_m=kerb_everywhere_m)
        world = replace(world, road=road)
    if straight:
        world = replace(world, road=replace(world.road, curvature=((0.0, 0.0),)))
    if crossfall_percent is not None:
        road = replace(world.road, crossfall_percent=crossfall_percent, crossfall_spread=0.0)
        world = replace(world, road=road)
    drive = simulate_drive(replace(world, noise=replace(world.noise, **noise)), seed)
    used = drive.gnss[:antennas]
    if single_m is not None:  # as a receiver without corrections states them
        n = used[0].epoch_ns.size
        stated = {"quality": np.ones(n, dtype=np.int64), "sigma_horizontal_m": np.full(n, single_m)}
        used = tuple(replace(fixes, **stated) for fixes in used)
    arms = {fixes.antenna: drive.rig.antennas[fixes.antenna].rig_t_antenna_m for fixes in used}
    trajectory = true_poses(drive) if ins else trajectory_from_gnss(used, arms)
    seen = drive.sightings
    epoch = np.empty(seen.frame.size, dtype=np.int64)
    for camera in np.unique(seen.camera):
        rows = seen.camera == camera
        epoch[rows] = drive.frame_host_ns[str(camera)][seen.frame[rows]]
    return Recording(drive, trajectory, seen.camera, seen.pixel_px, seen.object_index, epoch)


def length(offset_m: FloatArray) -> FloatArray:
    """Horizontal errors."""
    return np.asarray(np.hypot(offset_m[:, 0], offset_m[:, 1]))
