"""Trajectories against drives whose truth is a formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from circle_drive import (
    EPOCH0,
    EXPECTED_ROLL_DEG,
    FRAMES_S,
    HEIGHT,
    LAT0,
    LEFT,
    LON0,
    PAIR,
    RIGHT,
    Circle,
    epochs,
    horizontal_errors,
    record,
    still,
    turned,
)
from hypothesis import given
from hypothesis import strategies as st

from geoloc.earth.geodesy import enu_offset, geographic_from_enu, rotation_enu_from_rig
from geoloc.errors import TrajectoryError
from geoloc.reasons import Reason, sentences_of
from geoloc.trajectory.trajectory import GnssFixes, trajectory_from_gnss


@pytest.mark.parametrize("rate_hz", [5.0, 10.0])
def test_position_on_a_circle_is_interpolated_within_a_centimetre(rate_hz: float) -> None:
    """Between noiseless 5 or 10 Hz fixes of a 12 m/s bend the rig's origin is known to 1 cm."""
    drive = Circle()
    fixes = [record(drive, lever, name, rate_hz=rate_hz) for name, lever in PAIR.items()]
    assert horizontal_errors(trajectory_from_gnss(fixes, PAIR), drive, FRAMES_S).max() < 0.01


@pytest.mark.parametrize("lever", [[0.0, 0.0, 0.0], [1.2, 0.0, 1.6], [-0.8, 0.5, 1.5]])
def test_lever_arm_of_one_antenna_is_taken_off_in_a_bend(lever: list[float]) -> None:
    """One antenna ahead of, behind or beside the rear axle gives the same origin and height.

    The tolerance: this car's rear axle does not slip, but 0.25° per m/s² are expected: 0.4° at 1.6 m/s², or
    8 mm at 1.2 m of lever arm.
    """
    drive, arm = Circle(radius_m=40.0, speed_mps=8.0), np.array(lever)
    trajectory = trajectory_from_gnss([record(drive, arm)], {"left": arm})
    assert horizontal_errors(trajectory, drive, FRAMES_S).max() < 0.012
    poses = trajectory.poses_at(epochs(FRAMES_S))
    np.testing.assert_allclose(poses.height_m, HEIGHT, atol=1e-3)
    assert turned(poses.heading_deg, drive.heading_deg(FRAMES_S)).max() < 0.45
    np.testing.assert_allclose(poses.speed_mps, 8.0, atol=0.1)


def test_pitch_follows_the_climb_of_the_road() -> None:
    """On a 6 % climb the nose is up, which is a negative pitch, and the height is still the ground's.

    The tolerance: an antenna 0.55 m off the axle's middle is 1 % faster or slower in this bend.
    """
    drive = Circle(climb=0.06)
    fixes = [record(drive, lever, name) for name, lever in PAIR.items()]
    poses = trajectory_from_gnss(fixes, PAIR).poses_at(epochs(FRAMES_S))
    np.testing.assert_allclose(poses.pitch_deg, -np.degrees(np.arctan(0.06)), atol=0.05)
    np.testing.assert_allclose(poses.height_m, HEIGHT + 0.06 * 12.0 * FRAMES_S, atol=0.005)


def test_roll_is_seen_by_antennas_side_by_side() -> None:
    """A crossfall beyond the expected one moves the estimated roll to its side, never past it."""
    drive = Circle(radius_m=5000.0)
    for lean in (1.5, -1.5):
        roll_deg = EXPECTED_ROLL_DEG + lean
        fixes = [record(drive, lever, name, roll_deg=roll_deg) for name, lever in PAIR.items()]
        roll = trajectory_from_gnss(fixes, PAIR).poses_at(epochs(FRAMES_S)).roll_deg
        found = (roll - EXPECTED_ROLL_DEG) / lean
        assert ((found > 0.2) & (found < 1.0)).all()


def test_place_is_measured_at_the_antennas() -> None:
    """The place that a trajectory measured is that between its antennas."""
    fixes = [record(Circle(), lever, name) for name, lever in PAIR.items()]
    np.testing.assert_allclose(trajectory_from_gnss(fixes, PAIR).measured_at_m, 0.5 * (LEFT + RIGHT))


@given(heading=st.floats(0.0, 359.9), bearing=st.floats(-180.0, 180.0), length=st.floats(0.3, 3.0))
def test_heading_of_a_standing_car_comes_from_any_baseline(
    heading: float, bearing: float, length: float
) -> None:
    """Two antennas mounted in any direction give the heading, and the origin, of a car that never moves."""
    second = length * np.array([np.cos(np.radians(bearing)), np.sin(np.radians(bearing)), 0.0])
    levers = {"a": np.array([0.4, -0.3, 1.5]), "b": np.array([0.4, -0.3, 1.5]) + second}
    fixes = [still(lever, name, heading, n=12) for name, lever in levers.items()]
    poses = trajectory_from_gnss(fixes, levers).poses_at(epochs(np.array([0.3, 1.1])))
    assert poses.valid.all()
    assert turned(poses.heading_deg, heading).max() < 1e-3
    east, north = enu_offset(LAT0, LON0, poses.latitude_deg, poses.longitude_deg)
    assert np.hypot(east, north).max() < 1e-4
    # Tape and multipath of both antennas; their white noise is smoothed away, the more the longer it stands.
    expected = np.degrees(np.sqrt(2.0) * np.hypot(0.02, 0.005) / length)
    np.testing.assert_allclose(poses.sigma_heading_deg, expected, rtol=0.05, atol=0.05)


def test_heading_sigma_of_a_noisy_baseline_is_not_too_small() -> None:
    """With 1.5 cm noise on both antennas the stated sigma covers the error of a standing car's heading."""
    fixes = [
        still(LEFT, "left", 77.0, n=400, noise_m=0.015),
        replace(still(RIGHT, "right", 77.0, n=400), antenna="right"),
    ]
    poses = trajectory_from_gnss(fixes, PAIR).poses_at(fixes[0].epoch_ns)
    error = np.sqrt(np.mean(turned(poses.heading_deg, 77.0) ** 2))
    assert 0.01 < error < poses.sigma_heading_deg.mean()


def test_reversing_car_with_two_antennas_keeps_its_heading() -> None:
    """Where the course points opposite to the antennas, the car reverses: its heading is the antennas'.

    The car drives forwards round the circle first, so that its antennas are known not to be swapped.
    """
    drive = Circle()
    ahead = [record(drive, lever, name, length_s=30.0) for name, lever in PAIR.items()]
    back = []
    for one in ahead:
        stamp = np.concatenate([one.epoch_ns, one.epoch_ns[-1] + (one.epoch_ns[1:121] - one.epoch_ns[0])])
        rows = np.concatenate([np.arange(300), np.arange(298, 178, -1)])
        back.append(
            GnssFixes(
                one.antenna,
                stamp,
                stamp,
                one.latitude_deg[rows],
                one.longitude_deg[rows],
                one.height_m[rows],
                one.quality[rows],
            )
        )
    t_back = np.arange(32.0, 40.0, 0.1)
    heading = trajectory_from_gnss(back, PAIR).poses_at(epochs(t_back)).heading_deg
    assert turned(heading, drive.heading_deg(29.9 - (t_back - 29.9))).max() < 0.5


def test_swapped_antennas_are_refused() -> None:
    """Recordings of left and right that are exchanged show a car driving backwards: an error, not a track."""
    drive = Circle()
    fixes = [record(drive, LEFT, "right"), record(drive, RIGHT, "left")]
    with pytest.raises(TrajectoryError, match="backwards"):
        trajectory_from_gnss(fixes, PAIR)


def test_antennas_further_apart_than_their_lever_arms_are_refused() -> None:
    """Lever arms that contradict the recorded distance are named with both numbers."""
    drive = Circle()
    fixes = [record(drive, 2 * LEFT, "left"), record(drive, 2 * RIGHT, "right")]
    with pytest.raises(TrajectoryError, match=r"2\.20 m apart in the recording but 1\.10 m"):
        trajectory_from_gnss(fixes, PAIR)


def test_antennas_with_epochs_of_their_own_are_brought_together() -> None:
    """Receivers that measure 37 ms apart give the same origin as simultaneous ones."""
    drive = Circle()
    t = np.arange(0.0, 30.0, 0.1) + 0.037
    late = record(drive, RIGHT, "right")
    at = drive.enu(t) + rotation_enu_from_rig(drive.heading_deg(t), 0.0 * t, 0.0 * t) @ RIGHT
    lat, lon = geographic_from_enu(LAT0, LON0, at[:, 0], at[:, 1])
    late = replace(late, epoch_ns=epochs(t), host_ns=epochs(t), latitude_deg=lat, longitude_deg=lon)
    trajectory = trajectory_from_gnss([record(drive, LEFT), late], PAIR)
    assert horizontal_errors(trajectory, drive, FRAMES_S).max() < 0.01


def test_dropout_of_one_antenna_is_bridged_by_the_other() -> None:
    """Where one antenna is silent for 5 s the other one and its course carry on."""
    drive = Circle()
    left, right = (record(drive, lever, name) for name, lever in PAIR.items())
    keep = (right.epoch_ns < epochs(np.array(10.0))) | (right.epoch_ns > epochs(np.array(15.0)))
    right = GnssFixes("right", *(getattr(right, f)[keep] for f in GnssFixes.__slots__ if f != "antenna"))
    assert horizontal_errors(trajectory_from_gnss([left, right], PAIR), drive, FRAMES_S).max() < 0.03


@pytest.mark.parametrize(
    ("quality", "sigma_m"), [(4, 0.015), (5, 0.3), (2, 0.6), (1, 2.0), (6, 2.0), (9, 5.0)]
)
def test_sigma_follows_the_fix_quality(quality: int, sigma_m: float) -> None:
    """Without a lever arm the sigma of a fix is about that of its GGA quality, 1.7 times as much vertically.

    Smoothing removes of carrier-phase fixes what is each antenna's own, at most 15 %; of others, without
    velocities, next to nothing.
    """
    one = record(Circle(), np.zeros(3))
    one = replace(one, quality=np.full_like(one.quality, quality))
    poses = trajectory_from_gnss([one], {"left": np.zeros(3)}).poses_at(one.epoch_ns[50:60])
    np.testing.assert_allclose(poses.sigma_horizontal_m, sigma_m, rtol=0.15 if quality == 4 else 0.25)
    np.testing.assert_allclose(poses.sigma_vertical_m, 1.7 * sigma_m, rtol=0.15 if quality == 4 else 0.25)
    if quality == 4:
        assert (poses.sigma_horizontal_m < sigma_m).all()


def test_gap_gives_no_pose_and_says_so() -> None:
    """Inside a gap of more than a second nothing is interpolated; on its edges the fixes stand."""
    one = record(Circle(), np.zeros(3))
    t = np.arange(300) * 0.1
    keep = (t <= 10.05) | (t >= 13.15)
    one = GnssFixes("left", *(getattr(one, f)[keep] for f in GnssFixes.__slots__ if f != "antenna"))
    trajectory = trajectory_from_gnss([one], {"left": np.zeros(3)})
    poses = trajectory.poses_at(epochs(np.array([10.0, 10.01, 12.0, 13.19, 13.2])))
    np.testing.assert_array_equal(poses.valid, [True, False, False, False, True])
    assert np.isnan(poses.latitude_deg[1:4]).all()
    assert poses.reason.tolist() == ["", *[Reason.IN_GAP] * 3, ""]
    np.testing.assert_allclose(trajectory.missing_s(epochs(np.array([12.0]))), 3.2)


def test_epochs_outside_the_recording_are_refused_with_its_bounds() -> None:
    """Nothing is extrapolated, not even by a millisecond; the sentence carries both ends of the recording."""
    trajectory = trajectory_from_gnss([record(Circle(), np.zeros(3), length_s=10.1)], {"left": np.zeros(3)})
    poses = trajectory.poses_at(epochs(np.array([-0.001, 0.0, 10.0, 10.8])))
    np.testing.assert_array_equal(poses.valid, [False, True, True, False])
    bounds = "(the trajectory covers 2026-06-10T08:00:00.000 to 2026-06-10T08:00:10.000 UTC)"
    seconds = trajectory.missing_s(poses.epoch_ns)
    assert sentences_of(poses.reason, max_range_m=60.0, span_ns=trajectory.span_ns, seconds=seconds) == [
        f"0.001 s before the first fix {bounds}",
        "",
        "",
        f"0.800 s after the last fix {bounds}",
    ]
    assert trajectory.span_ns == (EPOCH0, EPOCH0 + 10_000_000_000)


def test_stamp_that_marks_a_missing_frame_is_outside() -> None:
    """The smallest int64, which readers use for "no stamp", overflows nothing and has no pose."""
    trajectory = trajectory_from_gnss([record(Circle(), np.zeros(3))], {"left": np.zeros(3)})
    unset = np.array([np.iinfo(np.int64).min])
    for poses in (trajectory.poses_at(unset), trajectory.nearest_fix(unset)):
        assert not poses.valid.any()
        assert poses.reason[0] != ""


@pytest.mark.parametrize("rows", [[40], [40, 41, 42], [0], [299], [40, 90, 91, 200]])
def test_wild_fixes_are_dropped_and_counted(rows: list[int]) -> None:
    """Fixes that imply more than 70 m/s go, in the middle or at the ends, and the track is as before."""
    drive = Circle()
    one = record(drive, np.zeros(3))
    lat = one.latitude_deg.copy()
    lat[rows] += 0.01
    trajectory = trajectory_from_gnss([replace(one, latitude_deg=lat)], {"left": np.zeros(3)})
    assert trajectory.dropped == ((len(rows), "antenna left: reached only faster than 70 m/s"),)
    assert horizontal_errors(trajectory, drive, FRAMES_S).max() < 0.02


def test_standstill_with_one_antenna_holds_the_heading_and_its_sigma_grows() -> None:
    """A car that stops on a straight road keeps its heading; how sure it is fades until it moves again."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 80.0, 0.2)
    along = np.cumsum(np.interp(t, [0, 20, 24, 55, 59, 80], [10, 10, 0, 0, 10, 10])) * 0.2
    noise = rng.normal(0.0, 0.015, (2, t.size))
    course = np.radians(300.0)
    lat, lon = geographic_from_enu(
        LAT0, LON0, along * np.sin(course) + noise[0], along * np.cos(course) + noise[1]
    )
    stamp = epochs(t)
    one = GnssFixes("left", stamp, stamp, lat, lon, np.full(t.size, 60.0), np.full(t.size, 4))
    arm = np.array([1.0, 0.0, 1.6])
    poses = trajectory_from_gnss([one], {"left": arm}).poses_at(stamp)
    assert poses.valid.all()
    assert turned(poses.heading_deg, 300.0).max() < 8.0
    driving, early, middle = (poses.sigma_heading_deg[np.abs(t - s).argmin()] for s in (10.0, 26.0, 39.0))
    assert driving < min(early, middle)
    assert (turned(poses.heading_deg, 300.0) < 4.0 * poses.sigma_heading_deg).all()


def test_standstill_at_the_end_is_less_and_less_certain() -> None:
    """After the last movement the sigma of a held heading only grows."""
    t = np.arange(0.0, 60.0, 0.2)
    along = np.cumsum(np.interp(t, [0, 20, 24, 60], [10, 10, 0, 0])) * 0.2
    lat, lon = geographic_from_enu(LAT0, LON0, along, along)
    stamp = epochs(t)
    one = GnssFixes("left", stamp, stamp, lat, lon, np.full(t.size, 60.0), np.full(t.size, 4))
    poses = trajectory_from_gnss([one], {"left": np.zeros(3)}).poses_at(stamp[t > 25.0])
    assert (np.diff(poses.sigma_heading_deg) > 0).all()
    assert turned(poses.heading_deg, 45.0).max() < 0.1


def test_car_that_never_moved_has_no_pose_with_one_antenna() -> None:
    """One antenna on a standing car says nothing of its heading: the reason is stated."""
    one = still(LEFT, "left", 50.0, noise_m=0.01)
    trajectory = trajectory_from_gnss([one], {"left": LEFT})
    poses = trajectory.poses_at(one.epoch_ns)
    assert not poses.valid.any()
    assert np.isnan(poses.heading_deg).all()
    assert set(poses.reason) == {Reason.STANDING}
    assert trajectory.line()[0].size >= 0


def test_course_that_drowns_in_the_noise_is_no_heading() -> None:
    """At walking pace, 4 s of fixes of 5 m tell no heading: a reason of its own, not standstill."""
    one = record(Circle(radius_m=500.0, speed_mps=1.6), np.zeros(3), length_s=4.0)
    one = replace(one, quality=np.full_like(one.quality, 9))
    poses = trajectory_from_gnss([one], {"left": np.zeros(3)}).poses_at(one.epoch_ns[15:25])
    assert not poses.valid.any()
    assert set(poses.reason) == {Reason.COURSE_IN_NOISE}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: [], "no GNSS fixes"),
        (lambda f: [replace(f, antenna="roof")], "Antenna roof has fixes but no lever arm"),
        (lambda f: [replace(f, epoch_ns=f.epoch_ns[::-1].copy())], "not later than the one before"),
        (lambda f: [replace(f, latitude_deg=f.latitude_deg * np.nan)], "NaN or not on Earth"),
        (
            lambda f: [
                GnssFixes("left", *(getattr(f, n)[:1] for n in GnssFixes.__slots__ if n != "antenna"))
            ],
            "at least 2",
        ),
    ],
)
def test_fixes_that_make_no_track_are_refused(change: object, message: str) -> None:
    """Each kind of impossible input is one clear TrajectoryError."""
    with pytest.raises(TrajectoryError, match=message):
        trajectory_from_gnss(change(record(Circle(), LEFT)), {"left": LEFT})  # type: ignore[operator]
