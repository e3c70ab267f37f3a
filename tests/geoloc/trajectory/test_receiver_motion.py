"""Headings and velocities that receivers have of themselves: what the trajectory makes of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from simulated_receiver import (
    ConsumerSpec,
    ReceiverSpec,
    as_single_fixes,
    consumer_drive,
    metre_fixes,
    with_receiver_motion,
)

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu, wrap_deg
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import locate_single_frame
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.fix_checks import lateness_s
from geoloc.trajectory.heading import heading_against_course
from geoloc.trajectory.poses import GnssFixes, Poses
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_gnss


@cache
def driven(name: str, speed_kmh: float | None, seed: int, noise_m: float = 0.0) -> SimulatedDrive:
    """A simulated drive; with `noise_m` its fixes are that noisy an axis."""
    world = scenario(name, speed_kmh, seed)
    if not noise_m:
        return simulate_drive(world, seed)
    drive = simulate_drive(metre_fixes(world, noise_m), seed)
    return replace(drive, gnss=tuple(as_single_fixes(fixes, noise_m) for fixes in drive.gnss))


def parked() -> SimulatedDrive:
    """A car that stands for 20 s, a pole 9 m ahead of it, and never moved."""
    world = scenario("still")
    stop_m = world.poles[0].station_m - 9.0
    motion = replace(world.motion, speed=((0.0, 0.0),), duration_s=20.0, start_station_m=stop_m)
    return simulate_drive(replace(world, motion=motion, annotate_from_s=0.0), 5)


def told(
    drive: SimulatedDrive, *, heading: bool = False, velocity: bool = False, mounted_deg: float = 1.5
) -> GnssFixes:
    """Fixes of the first antenna with what its receiver has of itself; its pair may be askew."""
    spec = ReceiverSpec(mounted_deg=mounted_deg)
    spec = replace(spec, heading_deg=heading * spec.heading_deg, velocity_mps=velocity * spec.velocity_mps)
    one = drive.gnss[0]
    arm = drive.rig.antennas[one.antenna].rig_t_antenna_m + drive.drawn.lever_arm_m[one.antenna]
    return with_receiver_motion(one, drive.scenario, drive.seed, arm, spec)


def turned(fixes: GnssFixes, by_deg: float) -> GnssFixes:
    """The same with headings of a pair that is mounted otherwise."""
    return replace(fixes, heading_deg=(fixes.heading_deg + by_deg) % 360.0)


def as_late_as_usual(fixes: GnssFixes) -> GnssFixes:
    """The same from a receiver that stamps them late, as most do without corrections."""
    return replace(fixes, epoch_ns=fixes.epoch_ns + round(1e9 * lateness_s([fixes])[0]))


def smoothed(drive: SimulatedDrive, fixes: GnssFixes) -> Trajectory:
    """Trajectory of one antenna with the lever arm of its rig."""
    fixes = as_late_as_usual(fixes)
    return trajectory_from_gnss([fixes], {fixes.antenna: drive.rig.antennas[fixes.antenna].rig_t_antenna_m})


def heading_error_deg(poses: Poses, drive: SimulatedDrive) -> FloatArray:
    """Heading minus the true one, at the drive's frames."""
    return wrap_deg(poses.heading_deg - drive.poses.heading_deg)


def test_car_that_stands_locates_a_sign_by_its_receivers_heading() -> None:
    """One antenna that never moved has no heading of its own; with the receiver's a pole 9 m off is found.

    Half a degree of the receiver's and 1.5° of its mounting are 1.6°: 0.3 m at 10 m.
    """
    drive = parked()
    seen = drive.sightings
    rows = (seen.object_index == 0) & ~seen.blunder
    sightings = Sightings(seen.camera[rows], seen.pixel_px[rows])
    epochs = drive.frame_epoch_ns[seen.frame[rows]]

    def located(fixes: GnssFixes) -> Any:
        poses = smoothed(drive, fixes).poses_at(epochs)
        return poses, locate_single_frame(drive.rig, sightings, poses)

    without, nowhere = located(drive.gnss[0])
    assert not without.valid.any()
    assert (nowhere.rejected != "").all()
    poses, found = located(told(drive, heading=True))
    assert poses.valid.all()
    assert 1.5 < np.median(poses.sigma_heading_deg) < 1.65
    assert np.abs(wrap_deg(poses.heading_deg - drive.poses.heading_deg[0])).max() < 3.5
    where = drive.objects
    off = np.hypot(
        *enu_offset(where.latitude_deg[0], where.longitude_deg[0], found.latitude_deg, found.longitude_deg)
    )
    assert np.median(off) < 0.5


def test_mounting_error_of_a_heading_is_found_where_the_car_drives() -> None:
    """A pair that is mounted 3° askew helps a car that drove up and stands: it is not taken at its word."""
    drive = driven("still", None, 1)
    stands = drive.frame_epoch_ns > drive.frame_epoch_ns[0] + 13_700_000_000
    helped, plain = (
        smoothed(drive, fixes).poses_at(drive.frame_epoch_ns)
        for fixes in (turned(told(drive, heading=True, mounted_deg=0.0), 3.0), drive.gnss[0])
    )
    assert np.abs(heading_error_deg(helped, drive)[stands]).max() < 0.8
    assert (helped.sigma_heading_deg < 0.7 * plain.sigma_heading_deg)[stands].all()


def test_velocities_make_headings_of_metre_fixes_better() -> None:
    """At 15 km/h with fixes good to a metre, errors and sigmas of the heading shrink to less than half.

    Places wander by twice the square of 5 cm/s that last for a second, and by how the roof sways.
    """
    error, sigma = np.zeros(2), np.zeros(2)
    for seed in range(2):
        drive = driven("approach", 15.0, seed, 1.0)
        for i, fixes in enumerate((drive.gnss[0], told(drive, velocity=True))):
            track = smoothed(drive, fixes)
            assert (track.wander_m2ps == np.inf) if i == 0 else (0.004 < track.wander_m2ps < 0.015)
            poses = track.poses_at(drive.frame_epoch_ns)
            error[i] += np.mean(heading_error_deg(poses, drive) ** 2)
            sigma[i] += np.mean(poses.sigma_heading_deg**2)
    assert error[1] < 0.25 * error[0]
    assert sigma[1] < 0.25 * sigma[0]


@pytest.mark.parametrize(("name", "speed_kmh"), [("still", None), ("urban", 25.0)])
def test_errors_are_as_large_as_stated(name: str, speed_kmh: float | None) -> None:
    """With both, over four drives and mountings, squared errors over stated variances are near 1."""
    ratio: dict[str, list[FloatArray]] = {"heading": [], "pitch": [], "plan": []}
    for seed in range(4):
        drive = driven(name, speed_kmh, seed, 1.0)
        fixes = told(drive, heading=True, velocity=True)
        poses, truth = smoothed(drive, fixes).poses_at(drive.frame_epoch_ns), drive.poses
        asked = slice(int(drive.scenario.annotate_from_s * 30.0), None)
        off = enu_offset(truth.latitude_deg, truth.longitude_deg, poses.latitude_deg, poses.longitude_deg)
        ratio["heading"].append((heading_error_deg(poses, drive) / poses.sigma_heading_deg)[asked])
        ratio["pitch"].append(((poses.pitch_deg - truth.pitch_deg) / poses.sigma_pitch_deg)[asked])
        ratio["plan"].append((np.hypot(*off) / np.sqrt(2.0) / poses.sigma_horizontal_m)[asked])
    for what, values in ratio.items():
        nees = float(np.mean(np.concatenate(values) ** 2))
        # Four drives are four mountings and few courses of multipath: far from many draws.
        assert 0.05 < nees < 2.0, what


def circling(
    lever: FloatArray, seconds: float = 30.0, radius_m: float = 12.0
) -> tuple[GnssFixes, FloatArray]:
    """Fixes and exact velocities of an antenna on a car that goes round a yard at 4 m/s; its headings."""
    t = np.arange(0.0, seconds, 0.2)
    rate = 4.0 / radius_m
    yaw = 0.3 + rate * t
    centre = np.stack([np.sin(yaw), -np.cos(yaw)], axis=1) * radius_m
    arm = np.stack(
        [lever[0] * np.cos(yaw) - lever[1] * np.sin(yaw), lever[0] * np.sin(yaw) + lever[1] * np.cos(yaw)], 1
    )
    velocity = 4.0 * np.stack([np.cos(yaw), np.sin(yaw)], axis=1) + rate * np.stack(
        [-arm[:, 1], arm[:, 0]], axis=1
    )
    latitude, longitude = geographic_from_enu(63.4, 10.4, *(centre + arm).T)
    stamp = 1_781_078_400_000_000_000 + np.round(t * 1e9).astype(np.int64)
    fixes = GnssFixes(
        "roof", stamp, stamp, latitude, longitude, np.full(t.size, 50.0 + lever[2]), np.full(t.size, 1)
    )
    moving = np.concatenate([velocity, np.zeros((t.size, 1))], axis=1)
    return replace(fixes, velocity_mps=moving), 90.0 - np.degrees(yaw)


def test_velocity_of_an_antenna_ahead_of_the_axle_is_that_of_the_antenna() -> None:
    """In a bend of 12 m an antenna 3 m ahead moves 14° aside of the heading: that is taken off.

    This car's axle does not slip, and 0.25° per m/s² are expected: 0.3°.
    """
    lever = np.array([3.0, 0.4, 1.5])
    fixes, heading = circling(lever)
    poses = trajectory_from_gnss([as_late_as_usual(fixes)], {"roof": lever}).poses_at(fixes.epoch_ns[10:-10])
    assert np.abs(wrap_deg(poses.heading_deg - heading[10:-10])).max() < 1.0


def test_wild_headings_and_velocities_have_no_say() -> None:
    """Five headings of a quarter turn, and velocities of 30 m/s, move the heading by less than its sigma."""
    drive = driven("urban", 25.0, 1, 1.0)
    good = told(drive, heading=True, velocity=True)
    heading, velocity = good.heading_deg.copy(), good.velocity_mps.copy()
    heading[[40, 60, 61, 80, 81]] += 90.0
    velocity[[45, 46, 70, 71, 90]] = 30.0
    bad = replace(good, heading_deg=heading % 360.0, velocity_mps=velocity)
    clean, bent = (smoothed(drive, fixes).poses_at(drive.frame_epoch_ns) for fixes in (good, bad))
    moved = np.abs(wrap_deg(bent.heading_deg - clean.heading_deg))
    assert (moved < clean.sigma_heading_deg).all()


def test_headings_and_velocities_of_a_few_epochs_are_enough_to_start() -> None:
    """A receiver whose pair was fixed for one second of standing keeps that heading for the rest of it."""
    drive = parked()
    fixes = told(drive, heading=True)
    short = np.where(np.arange(fixes.epoch_ns.size) < 10, fixes.heading_deg, np.nan)
    poses = smoothed(drive, replace(fixes, heading_deg=short)).poses_at(drive.frame_epoch_ns)
    assert poses.valid.all()
    assert poses.sigma_heading_deg[-1] > poses.sigma_heading_deg[30] > 1.0


@pytest.mark.parametrize("off_deg", [90.0, -12.0, 180.0])
def test_heading_off_the_course_is_told_and_refused(off_deg: float) -> None:
    """A pair mounted across, askew or back to front: the angle is found to 1°, the headings are dropped."""
    drive = driven("urban", 25.0, 1)
    fixes = turned(told(drive, heading=True, mounted_deg=0.0), off_deg)
    check = heading_against_course(fixes)
    assert check.contradicts
    assert check.constant
    assert wrap_deg(check.off_deg + off_deg) == pytest.approx(0.0, abs=1.0)
    trajectory = smoothed(drive, fixes)
    count = int(np.isfinite(fixes.heading_deg).sum())
    assert trajectory.dropped == ((count, f"antenna {fixes.antenna}: headings that contradict the course"),)
    plain = smoothed(drive, drive.gnss[0]).poses_at(drive.frame_epoch_ns)
    np.testing.assert_array_equal(trajectory.poses_at(drive.frame_epoch_ns).heading_deg, plain.heading_deg)


def test_heading_of_another_vehicle_is_no_angle_of_mounting() -> None:
    """Headings that stay while the car turns round contradict the course, by no one angle."""
    fixes, _ = circling(np.zeros(3), seconds=60.0)
    good = replace(fixes, quality=np.full_like(fixes.quality, 4))
    check = heading_against_course(replace(good, heading_deg=np.full(good.epoch_ns.size, 20.0)))
    assert check.contradicts
    assert not check.constant


def test_heading_of_a_car_that_hardly_drives_cannot_be_checked() -> None:
    """Standing still says nothing of how a pair is mounted: nothing is refused."""
    check = heading_against_course(turned(told(parked(), heading=True), 90.0))
    assert not check.told
    assert not check.contradicts


def test_stated_vertical_sigma_is_that_of_the_height() -> None:
    """A fix good to 2 cm in plan and 10 cm in height is not taken for 3.4 cm."""
    drive = driven("urban", 25.0, 1)
    one = drive.gnss[0]
    stated = replace(
        one,
        sigma_horizontal_m=np.full(one.epoch_ns.size, 0.02),
        sigma_vertical_m=np.full(one.epoch_ns.size, 0.10),
    )
    poses = smoothed(drive, stated).poses_at(drive.frame_epoch_ns)
    # The antenna sits aside: below it a roll that is wrong moves the rig's origin up or down.
    aside_m = drive.rig.antennas[one.antenna].rig_t_antenna_m[1]
    lean_m = aside_m * np.radians(poses.sigma_roll_deg)
    np.testing.assert_allclose(poses.sigma_vertical_m, np.hypot(0.10, lean_m), rtol=0.1)
    unsaid = replace(stated, sigma_vertical_m=np.full(one.epoch_ns.size, np.nan))
    poses = smoothed(drive, unsaid).poses_at(drive.frame_epoch_ns)
    assert poses.sigma_vertical_m.min() == pytest.approx(np.hypot(0.034, lean_m.min()), rel=0.1)


@pytest.mark.slow
def test_velocities_over_minutes_better_a_track_of_poor_fixes() -> None:
    """Ten minutes with fixes that are 2 m off an axis for two minutes: the track is better, and says so."""
    ratio, sigma_m = [], []
    for seed in range(5):
        world = scenario("highway", None, seed, 10.0)
        world = replace(world, poles=world.poles[:1], cameras=world.cameras[:1])
        error_m = 2.8 if seed < 4 else 8.4
        spec = ConsumerSpec(error_m=(error_m, error_m), lasts_s=(120.0, 120.0), late_s=(0.0, 0.0))
        drive, fixes, _ = consumer_drive(world, seed, spec)
        track, truth = smoothed(drive, fixes), drive.poses
        poses = track.poses_at(drive.frame_epoch_ns[::30])
        # Places differ from one another by no more than velocities let them.
        assert 250.0 < track.lasts_s < 1500.0
        there = truth.latitude_deg[::30], truth.longitude_deg[::30]
        off = np.hypot(*enu_offset(*there, poses.latitude_deg, poses.longitude_deg)) / np.sqrt(2.0)
        ratio.append(np.mean((off / poses.sigma_horizontal_m) ** 2))
        sigma_m.append(poses.sigma_horizontal_m.mean())
    assert np.mean(sigma_m[:4]) < 1.5
    # The last one is three times as far off, which its velocities show: √3 are left of that.
    assert sigma_m[4] > 1.4 * np.mean(sigma_m[:4])
    # A drive of ten minutes is some five courses of the atmosphere.
    assert 0.5 < np.mean(ratio) < 1.8
