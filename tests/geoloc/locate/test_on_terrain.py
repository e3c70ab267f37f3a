"""Single sightings on known ground: closure, honest covariances, less error on hills than on a plane."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated_raster import rasterised

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset
from geoloc.earth.terrain import Terrain
from geoloc.locate.accuracy import nees
from geoloc.locate.on_terrain import locate_on_terrain
from geoloc.locate.records import Located, Sightings
from geoloc.locate.single_frame import ErrorBudget, locate_single_frame
from geoloc.reasons import Reason, stands_far_away
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive, without_noise
from geoloc.trajectory.poses import Poses
from geoloc.trajectory.trajectory import trajectory_from_gnss, trajectory_from_poses

EXACT = replace(ErrorBudget(), pitch_jitter_deg=0.0, roll_jitter_deg=0.0)


@cache
def clean_drive() -> tuple[SimulatedDrive, Terrain]:
    """A drive without noise of any kind, on a smooth hilly road without kerbs, and that road as a raster."""
    world = scenario("sample", None, 1)
    smooth = replace(world.road, roughness_m3=1e-12, kerb_share=0.0, verge_sigma_m=0.0)
    world = without_noise(replace(world, road=smooth))
    return simulate_drive(world, 1), terrain_of(Road(world.road, 1), 0.5)


def terrain_of(road: Road, step_m: float, noise_m: float = 0.0) -> Terrain:
    """The road as a raster."""
    east, north, grid = rasterised(road, step_m, noise_m=noise_m, seed=3)
    return Terrain(east, north, step_m, grid, noise_m=noise_m)


def error_m(drive: SimulatedDrive, found: Located) -> FloatArray:
    """East and north of the truth, ``(n, 2)``."""
    known, row = drive.objects, drive.sightings.object_index
    offset = enu_offset(
        known.latitude_deg[row], known.longitude_deg[row], found.latitude_deg, found.longitude_deg
    )
    return np.stack(offset, axis=-1)


def sighted(drive: SimulatedDrive, poses: str) -> tuple[Sightings, Poses]:
    """The drive's sightings, with true poses or those of its GNSS."""
    seen = drive.sightings
    if poses == "true":
        track, stamps = drive.poses, dict.fromkeys(drive.rig.cameras, drive.frame_epoch_ns)
        trajectory = trajectory_from_poses(track)
    else:
        stamps = dict(drive.frame_host_ns)
        arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
        trajectory = trajectory_from_gnss(drive.gnss, arms)
    epoch = np.array([stamps[camera][frame] for camera, frame in zip(seen.camera, seen.frame, strict=True)])
    return Sightings(seen.camera, seen.pixel_px), trajectory.poses_at(epoch)


def test_feet_on_hills_are_found_where_the_plane_misses_them() -> None:
    """Exact pixels and poses on a smooth hilly road: the raster leaves centimetres, the plane metres.

    What is left is the raster itself: nodes half a metre apart on a road with a crown.
    """
    drive, terrain = clean_drive()
    sightings, poses = sighted(drive, "true")
    flat = error_m(drive, locate_single_frame(drive.rig, sightings, poses))
    found = locate_on_terrain(drive.rig, sightings, poses, terrain, EXACT)
    near = drive.sightings.range_m < 30.0
    assert found.valid[near].all()
    hilly = np.hypot(*error_m(drive, found)[near].T)
    assert np.nanmedian(np.hypot(*flat[near].T)) > 0.5
    assert np.median(hilly) < 0.03
    assert np.percentile(hilly, 95) < 0.15
    height = drive.objects.height_m[drive.sightings.object_index]
    assert np.abs(found.height_m - height)[near].max() < 0.02


def test_wheels_on_the_terrain_stand_in_for_a_pose_that_does_not_know_its_tilt() -> None:
    """With pitch and roll of the pose unknown, the wheels' own give the same feet within decimetres."""
    drive, terrain = clean_drive()
    sightings, poses = sighted(drive, "true")
    lost = replace(
        poses,
        pitch_deg=poses.pitch_deg + 3.0,
        roll_deg=poses.roll_deg - 5.0,
        sigma_pitch_deg=np.full(poses.pitch_deg.size, 1e4),
        sigma_roll_deg=np.full(poses.roll_deg.size, 1e4),
    )
    found = locate_on_terrain(drive.rig, sightings, lost, terrain)
    near = drive.sightings.range_m < 12.0
    assert np.median(np.hypot(*error_m(drive, found)[near].T)) < 0.15


def test_height_error_of_the_whole_raster_does_not_move_a_position() -> None:
    """A raster 0.4 m too high (another geoid) gives the same places, 0.4 m higher."""
    drive, terrain = clean_drive()
    sightings, poses = sighted(drive, "true")
    found = locate_on_terrain(drive.rig, sightings, poses, terrain)
    lifted = locate_on_terrain(drive.rig, sightings, poses, replace(terrain, grid_m=terrain.grid_m + 0.4))
    np.testing.assert_allclose(lifted.latitude_deg, found.latitude_deg, rtol=0, atol=1e-9)
    np.testing.assert_allclose(lifted.height_m - found.height_m, 0.4, atol=1e-6)


@pytest.mark.parametrize(("name", "at_most"), [("sample", 0.85), ("highway", 0.7)])
def test_a_raster_of_one_metre_reduces_single_frame_errors_and_knows_its_own(
    name: str, at_most: float
) -> None:
    """A noisy recording, nodes 1 m apart with 2 cm of noise: beyond 12 m errors drop by a sixth or more.

    The 95 % ellipses hold 93 % or more.
    """
    world = scenario(name, None, 1)
    drive = simulate_drive(world, 1)
    sightings, poses = sighted(drive, "gnss")
    terrain = terrain_of(Road(world.road, 1), 1.0, noise_m=0.02)
    flat = locate_single_frame(drive.rig, sightings, poses)
    found = locate_on_terrain(drive.rig, sightings, poses, terrain)
    far = flat.valid & found.valid & ~drive.sightings.blunder & (drive.sightings.range_m > 12.0)
    reduction = np.median(np.hypot(*error_m(drive, found)[far].T)) / np.median(
        np.hypot(*error_m(drive, flat)[far].T)
    )
    assert reduction < at_most
    good = found.valid & ~drive.sightings.blunder
    inside = nees(error_m(drive, found)[good], found.covariance_m2[good]) <= 5.991
    assert inside.mean() >= 0.93


def test_covariance_is_random_plus_systematic_squared_under_the_same_names() -> None:
    """The contract of `Located`; sources that both methods know bear one name, so that they combine."""
    drive, terrain = clean_drive()
    sightings, poses = sighted(drive, "gnss")
    found = locate_on_terrain(drive.rig, sightings, poses, terrain)
    s = found.systematic_m
    np.testing.assert_allclose(found.covariance_m2, found.random_m2 + s @ np.swapaxes(s, 1, 2))
    assert (np.linalg.eigvalsh(found.covariance_m2[found.valid]) > 0).all()
    assert s.shape == (len(found.rejected), 2, len(found.source))
    flat = locate_single_frame(drive.rig, sightings, poses)
    assert set(flat.source) - set(found.source) == {"ground slope"}


def test_ground_that_the_car_does_not_drive_on_is_refused() -> None:
    """Heights in NN2000 taken for ellipsoidal (39 m), or a valley under a bridge, locate nothing."""
    drive, terrain = clean_drive()
    sightings, poses = sighted(drive, "true")
    found = locate_on_terrain(drive.rig, sightings, poses, replace(terrain, grid_m=terrain.grid_m - 39.4))
    assert set(found.rejected) == {Reason.OTHER_GROUND}
    assert np.isnan(found.latitude_deg).all()


def test_what_cannot_be_located_is_nan_with_its_reason() -> None:
    """No pose, no terrain under the car, and rays that pass over everything within reach."""
    drive, terrain = clean_drive()
    sightings, poses = sighted(drive, "true")
    n = 3
    three = Sightings(sightings.camera[:n], np.array([[950.0, 800.0], [950.0, 800.0], [950.0, 100.0]]))
    reason = np.array([Reason.AFTER_LAST_FIX, "", ""])
    valid = np.array([False, True, True])
    first = Poses(**{name: getattr(poses, name)[:n].copy() for name in poses.__dataclass_fields__})
    off = first.latitude_deg + np.array([0.0, 0.1, 0.0])
    first = replace(first, latitude_deg=off, valid=valid, reason=reason)
    found = locate_on_terrain(drive.rig, three, first, terrain)
    assert found.rejected[0] == Reason.AFTER_LAST_FIX
    assert found.rejected[1] == Reason.TERRAIN_UNKNOWN_AT_CAR
    assert stands_far_away(found.rejected).tolist() == [False, False, True]
    for values in (found.latitude_deg, found.longitude_deg, found.height_m, found.range_m):
        assert np.isnan(values).all()
    assert np.isnan(found.covariance_m2).all()
