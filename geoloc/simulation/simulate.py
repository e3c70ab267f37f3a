"""Drives with known truth: what a car's sensors and an annotator would have recorded on a known road.

The world comes first: a road, a car body that moves on it, and poles beside it. Every recording is then
derived forwards from that truth: fixes are true antenna positions plus noise, pixels are true feet projected
through the true pose, the true mounting and the true lens. Nothing here inverts the estimator, and nothing is
imported from it; `NoiseSpec` states every source of error with its value and reason, including sources that
the estimator does not model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.rig.rig import Rig, RigCamera
from geoloc.simulation.beside import feet_beside_m
from geoloc.simulation.car import simulated_rig, true_camera
from geoloc.simulation.motion import MotionSpec, TrueMotion
from geoloc.simulation.noise import DrawnErrors, NoiseSpec, draw_errors, gauss_markov, stream
from geoloc.simulation.observe import annotate, horizontal_range_m, on_the_car, project
from geoloc.simulation.road import Road, RoadSpec
from geoloc.simulation.scenarios import SCENARIOS, PoleSpec, Scenario, scenario, without_noise
from geoloc.trajectory.trajectory import GnssFixes, PoseTrack

__all__ = [
    "SCENARIOS",
    "DrawnErrors",
    "MotionSpec",
    "NoiseSpec",
    "PoleSpec",
    "RoadSpec",
    "Scenario",
    "SimulatedDrive",
    "SimulatedObjects",
    "SimulatedSightings",
    "scenario",
    "simulate_drive",
    "without_noise",
]


NS = 1_000_000_000
REACH_SHARE = 2.0
"""Along the road a foot is farther away than straight ahead, by less than this in bends that cars take."""
GNSS_BEFORE_S = 1.0
"""Fixes start one second before the first frame and end one after the last, as loggers start in turn."""


@dataclass(frozen=True, slots=True)
class SimulatedObjects:
    """Where the poles truly stand.

    Attributes
    ----------
    object : str (n,)
        Object id; the annotator's id is the same.
    skiltnummer : str (n,)
        Sign codes top down, joined by ";".
    enu_m : float64 (n, 3)
        Centre of the foot in the road's local frame.
    latitude_deg, longitude_deg, height_m : float64 (n,)
        EUREF89; `height_m` ellipsoidal.
    east_utm33_m, north_utm33_m : float64 (n,)
        EPSG:25833.
    """

    object: NDArray[np.str_]
    skiltnummer: NDArray[np.str_]
    enu_m: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    east_utm33_m: FloatArray
    north_utm33_m: FloatArray


@dataclass(frozen=True, slots=True)
class SimulatedSightings:
    """Annotated feet, in the order camera, frame, object.

    Attributes
    ----------
    camera : str (n,)
    frame : int64 (n,)
    object_index : int64 (n,)
        Row in `SimulatedObjects`.
    pixel_px : float64 (n, 2)
        As annotated; (0, 0) is the centre of the first pixel.
    true_pixel_px : float64 (n, 2)
        Where the true camera saw the visible foot.
    range_m : float64 (n,)
        True horizontal distance from the camera to the pole.
    blunder : bool (n,)
        True where the annotator hit a wrong pixel.
    """

    camera: NDArray[np.str_]
    frame: IntArray
    object_index: IntArray
    pixel_px: FloatArray
    true_pixel_px: FloatArray
    range_m: FloatArray
    blunder: BoolArray


@dataclass(frozen=True, slots=True)
class SimulatedDrive:
    """A recording and the truth behind it.

    Attributes
    ----------
    scenario : Scenario
    seed : int
    rig : Rig
        As the calibration file states it; `drawn` says how the true car differs.
    objects : SimulatedObjects
    gnss : tuple of GnssFixes
        As recorded, one an antenna.
    frame_host_ns : mapping camera → int64 (frames,)
        Host stamps as recorded.
    frame_epoch_ns : int64 (frames,)
        True epoch of the middle row of each frame.
    sightings : SimulatedSightings
    poses : PoseTrack
        True poses of the rig's frame at `frame_epoch_ns`, sigmas zero.
    drawn : DrawnErrors
        The errors that are the same for the whole drive.
    """

    scenario: Scenario
    seed: int
    rig: Rig
    objects: SimulatedObjects
    gnss: tuple[GnssFixes, ...]
    frame_host_ns: Mapping[str, IntArray]
    frame_epoch_ns: IntArray
    sightings: SimulatedSightings
    poses: PoseTrack
    drawn: DrawnErrors


def simulate_drive(world: Scenario, seed: int) -> SimulatedDrive:
    """Drive once through a world.

    Parameters
    ----------
    world : Scenario
        From `scenario`, or one's own.
    seed : int
        The same world and seed give the same drive, on every machine with the same NumPy.

    Returns
    -------
    SimulatedDrive

    Raises
    ------
    GeolocError
        If the drive or a pole is not on the road, or the rig has no camera of a name.
    """
    rig = simulated_rig()
    drawn = draw_errors(world.noise, seed, tuple(rig.cameras), tuple(rig.antennas))
    road = Road(world.road, seed)
    motion = TrueMotion(road, world.motion, world.noise, seed)
    objects = _objects(world, road, motion, seed)
    frame_s = (
        np.arange(int(world.motion.duration_s * world.motion.frame_rate_hz + 0.5))
        / world.motion.frame_rate_hz
    )
    epoch_ns = world.start_utc_ns + np.round(frame_s * NS).astype(np.int64)
    return SimulatedDrive(
        scenario=world,
        seed=seed,
        rig=rig,
        objects=objects,
        gnss=_gnss(world, rig, motion, drawn, seed),
        frame_host_ns={name: _host_stamps(epoch_ns, world.noise, drawn, seed, name) for name in rig.cameras},
        frame_epoch_ns=epoch_ns,
        sightings=_all_sightings(world, rig, motion, objects, drawn, frame_s, seed),
        poses=_poses(motion, epoch_ns, frame_s),
        drawn=drawn,
    )


def _objects(world: Scenario, road: Road, motion: TrueMotion, seed: int) -> SimulatedObjects:
    station = np.array([pole.station_m for pole in world.poles])
    offset = np.array([pole.offset_m for pole in world.poles])
    beside = world.beside
    if beside is None:
        feet = road.pole_feet_m(station, offset)
    else:
        feet = feet_beside_m(beside, motion, station, road.plan_m(station, offset), seed)
    latitude, longitude, height = road.frame.geographic_from_enu(feet)
    east, north = utm33_from_geographic(latitude, longitude)
    return SimulatedObjects(
        object=np.array([pole.object for pole in world.poles], dtype=np.str_),
        skiltnummer=np.array([pole.skiltnummer for pole in world.poles], dtype=np.str_),
        enu_m=feet,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        east_utm33_m=east,
        north_utm33_m=north,
    )


def _gnss(
    world: Scenario, rig: Rig, motion: TrueMotion, drawn: DrawnErrors, seed: int
) -> tuple[GnssFixes, ...]:
    """True antenna positions plus noise, at whole multiples of the epoch interval as receivers do."""
    noise, spec = world.noise, world.motion
    count = int((spec.duration_s + 2.0 * GNSS_BEFORE_S) * spec.gnss_rate_hz) + 1
    time_s = np.arange(count) / spec.gnss_rate_hz - GNSS_BEFORE_S
    body = motion.at(time_s)
    slow = np.array([noise.gnss_slow_horizontal_m, noise.gnss_slow_horizontal_m, noise.gnss_slow_vertical_m])
    common = body.position_m + _processes(seed, "gnss slow", time_s, noise.gnss_slow_tau_s) * slow
    return tuple(
        _fixes(
            world,
            name,
            time_s,
            motion.road.frame.geographic_from_enu(
                common
                + body.enu_R_rig @ (antenna.rig_t_antenna_m + drawn.lever_arm_m[name])
                + _receiver_noise(noise, name, time_s, seed)
            ),
            seed,
        )
        for name, antenna in rig.antennas.items()
    )


def _receiver_noise(noise: NoiseSpec, antenna: str, time_s: FloatArray, seed: int) -> FloatArray:
    """What each antenna has of its own: carrier-phase noise and multipath, ``(n, 3)`` east, north, up."""
    sigma = np.array(
        [noise.gnss_white_horizontal_m, noise.gnss_white_horizontal_m, noise.gnss_white_vertical_m]
    )
    white = stream(seed, f"gnss white {antenna}").normal(size=(time_s.size, 3)) * sigma
    reflected = _processes(seed, f"multipath {antenna}", time_s, noise.gnss_multipath_tau_s)
    return np.asarray(white + reflected * noise.gnss_multipath_m * [1.0, 1.0, noise.gnss_multipath_up])


def _fixes(
    world: Scenario,
    antenna: str,
    time_s: FloatArray,
    position: tuple[FloatArray, FloatArray, FloatArray],
    seed: int,
) -> GnssFixes:
    """Stamp positions with the receiver's clock, and with the host's when the sentence arrives."""
    noise = world.noise
    epoch_ns = world.start_utc_ns + np.round(time_s * NS).astype(np.int64)
    jitter_ms = noise.link_jitter_ms * stream(seed, f"link {antenna}").normal(size=time_s.size)
    delay_ns = np.round(np.maximum(noise.link_delay_ms + jitter_ms, 0.0) * 1e6).astype(np.int64)
    return GnssFixes(
        antenna, epoch_ns, epoch_ns + delay_ns, *position, np.full(time_s.size, 4, dtype=np.int64)
    )


def _processes(seed: int, name: str, time_s: FloatArray, tau_s: float) -> FloatArray:
    """Three unit Gauss–Markov processes, ``(n, 3)``."""
    return np.stack(
        [gauss_markov(stream(seed, f"{name} {axis}"), time_s, 1.0, tau_s) for axis in "enu"], axis=-1
    )


def _host_stamps(
    epoch_ns: IntArray, noise: NoiseSpec, drawn: DrawnErrors, seed: int, camera: str
) -> IntArray:
    jitter_ms = stream(seed, f"frame stamps {camera}").normal(size=epoch_ns.size) * noise.frame_jitter_ms
    stamps: IntArray = epoch_ns + np.round((drawn.frame_offset_ms + jitter_ms) * 1e6).astype(np.int64)
    return stamps


def _poses(motion: TrueMotion, epoch_ns: IntArray, frame_s: FloatArray) -> PoseTrack:
    from scipy.spatial.transform import Rotation

    body = motion.at(frame_s)
    frame = motion.road.frame
    latitude, longitude, height = frame.geographic_from_enu(body.position_m)
    local = frame.rotation_local_from_frame(latitude, longitude) @ body.enu_R_rig
    yaw, pitch, roll = np.moveaxis(Rotation.from_matrix(local).as_euler("ZYX", degrees=True), -1, 0)
    zero = np.zeros(epoch_ns.size)
    return PoseTrack(
        epoch_ns=epoch_ns,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        roll_deg=roll,
        pitch_deg=pitch,
        heading_deg=np.mod(90.0 - yaw, 360.0),
        sigma_horizontal_m=zero,
        sigma_vertical_m=zero,
        sigma_roll_pitch_deg=zero,
        sigma_heading_deg=zero,
    )


def _all_sightings(
    world: Scenario,
    rig: Rig,
    motion: TrueMotion,
    objects: SimulatedObjects,
    drawn: DrawnErrors,
    frame_s: FloatArray,
    seed: int,
) -> SimulatedSightings:
    parts = [
        _sightings(world, true_camera(rig.camera(name), drawn), motion, objects.enu_m, frame_s, seed)
        for name in world.cameras
    ]
    return SimulatedSightings(
        camera=np.repeat(np.array(world.cameras, dtype=np.str_), [part.frame.size for part in parts]),
        frame=np.concatenate([part.frame for part in parts]),
        object_index=np.concatenate([part.object_index for part in parts]),
        pixel_px=np.concatenate([part.pixel_px for part in parts]),
        true_pixel_px=np.concatenate([part.true_pixel_px for part in parts]),
        range_m=np.concatenate([part.range_m for part in parts]),
        blunder=np.concatenate([part.blunder for part in parts]),
    )


def _in_reach(
    motion: TrueMotion, frames: IntArray, frame_s: FloatArray, world: Scenario
) -> tuple[IntArray, IntArray]:
    """Pairs of a frame and a foot that may be within the range, in the order of frames.

    Along the road: a long one crosses itself, but the heights there are those of two roads.
    """
    reach_m = REACH_SHARE * world.range_m[1]
    here = motion.station_m(frame_s[frames])
    pole = np.array([one.station_m for one in world.poles])
    order = np.argsort(pole, kind="stable")
    low, high = (np.searchsorted(pole[order], here + side * reach_m) for side in (-1.0, 1.0))
    near = [np.sort(order[a:b]) for a, b in zip(low, high, strict=True)]
    index = np.concatenate([np.empty(0, dtype=np.int64), *near])
    return np.repeat(frames, high - low), index


def _sightings(
    world: Scenario, camera: RigCamera, motion: TrueMotion, feet_m: FloatArray, frame_s: FloatArray, seed: int
) -> SimulatedSightings:
    """What one camera sees of all feet in every annotated frame."""
    first = int(np.ceil(world.annotate_from_s * world.motion.frame_rate_hz - 1e-6))
    annotated = np.arange(first, frame_s.size, world.annotate_every)
    frame, index = _in_reach(motion, annotated, frame_s, world)
    distance = horizontal_range_m(camera, motion, feet_m[index], frame_s[frame])
    near = (distance >= world.range_m[0]) & (distance <= world.range_m[1])
    frame, index, distance = frame[near], index[near], distance[near]
    pixel, seen = project(world.noise, camera, motion, feet_m[index], frame_s[frame])
    seen &= ~on_the_car(camera, pixel)
    annotated_px, blunder = annotate(world.noise, pixel, stream(seed, f"annotator {camera.name}"))
    with np.errstate(invalid="ignore"):
        last = np.array([camera.model.width_px, camera.model.height_px]) - 1.0
        seen &= ((annotated_px >= 0.0) & (annotated_px <= last)).all(axis=-1)
    return SimulatedSightings(
        camera=np.full(int(seen.sum()), camera.name),
        frame=frame[seen].astype(np.int64),
        object_index=index[seen].astype(np.int64),
        pixel_px=annotated_px[seen],
        true_pixel_px=pixel[seen],
        range_m=distance[seen],
        blunder=blunder[seen],
    )
