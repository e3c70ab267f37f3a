"""Trajectories of recorded poses."""

from __future__ import annotations

import numpy as np
import pytest
from circle_drive import (
    FRAMES_S,
    HEIGHT,
    LAT0,
    LON0,
    Circle,
    FloatArray,
    epochs,
    horizontal_errors,
    turned,
)

from geoloc.earth.geodesy import geographic_from_enu
from geoloc.errors import TrajectoryError
from geoloc.trajectory.trajectory import PoseTrack, trajectory_from_poses


def pose_track(t_s: FloatArray, drive: Circle, pitch_deg: FloatArray) -> PoseTrack:
    """Poses of this drive as an INS would record them."""
    at = drive.enu(t_s)
    lat, lon = geographic_from_enu(LAT0, LON0, at[:, 0], at[:, 1])
    flat = np.zeros_like(t_s)
    return PoseTrack(
        epochs(t_s),
        lat,
        lon,
        HEIGHT + at[:, 2],
        flat,
        pitch_deg,
        drive.heading_deg(t_s),
        flat + 0.03,
        flat + 0.05,
        flat + 0.1,
        flat + 0.2,
    )


def test_recorded_poses_are_interpolated_through_north() -> None:
    """Angles turn the shorter way through 0°, positions stay within a millimetre, sigmas are carried over."""
    drive = Circle(start_deg=10.0)
    t = np.arange(0.0, 30.0, 0.1)
    trajectory = trajectory_from_poses(pose_track(t, drive, np.sin(t)))
    poses = trajectory.poses_at(epochs(FRAMES_S))
    assert horizontal_errors(trajectory, drive, FRAMES_S).max() < 1e-3
    assert turned(poses.heading_deg, drive.heading_deg(FRAMES_S)).max() < 1e-6
    np.testing.assert_allclose(poses.pitch_deg, np.sin(FRAMES_S), atol=2e-3)
    np.testing.assert_allclose(poses.sigma_horizontal_m, 0.03, rtol=1e-2)
    np.testing.assert_allclose(poses.sigma_roll_deg, 0.1)
    np.testing.assert_allclose(poses.sigma_pitch_deg, 0.1)
    np.testing.assert_allclose(poses.speed_mps, 12.0, rtol=1e-3)


def test_recorded_poses_come_back_at_their_own_epochs() -> None:
    """At a recorded epoch the pose is the recorded one, and the nearest pose by epoch is that as well."""
    t = np.arange(0.0, 5.0, 0.25)
    track = pose_track(t, Circle(), 0.0 * t)
    trajectory = trajectory_from_poses(track)
    for poses in (trajectory.poses_at(track.epoch_ns), trajectory.nearest_fix(track.epoch_ns + 100_000_000)):
        np.testing.assert_array_equal(poses.latitude_deg, track.latitude_deg)
        np.testing.assert_array_equal(poses.heading_deg, track.heading_deg)
    assert trajectory.delay_ms() == (0.0, 0.0)
    np.testing.assert_array_equal(trajectory.measured_at_m, np.zeros(3))  # the rig's origin


def test_recorded_poses_with_a_nan_attitude_are_refused() -> None:
    """A NaN angle is an error that says how many there are."""
    t = np.arange(0.0, 5.0, 0.25)
    with pytest.raises(TrajectoryError, match="20 of 20 attitudes are NaN"):
        trajectory_from_poses(pose_track(t, Circle(), t * np.nan))


def test_poses_nanoseconds_apart_are_no_jump() -> None:
    """A logger that writes two poses 1 ns and a few millimetres apart loses neither."""
    n = 50
    epoch_ns = np.repeat(np.arange(n, dtype=np.int64) * 100_000_000, 2) + np.tile([0, 1], n)
    north_m = np.repeat(np.arange(n, dtype=np.float64), 2) + np.tile([0.0, 0.004], n)
    ones = np.ones(2 * n)
    track = PoseTrack(
        epoch_ns=epoch_ns,
        latitude_deg=63.4 + north_m / 111_450.0,
        longitude_deg=10.4 * ones,
        height_m=50.0 * ones,
        roll_deg=0.0 * ones,
        pitch_deg=0.0 * ones,
        heading_deg=0.0 * ones,
        sigma_horizontal_m=0.02 * ones,
        sigma_vertical_m=0.02 * ones,
        sigma_roll_pitch_deg=0.1 * ones,
        sigma_heading_deg=0.1 * ones,
    )
    trajectory = trajectory_from_poses(track)
    assert trajectory.dropped == ()
    assert trajectory.poses_at(np.array([2_450_000_000], dtype=np.int64)).valid.all()
