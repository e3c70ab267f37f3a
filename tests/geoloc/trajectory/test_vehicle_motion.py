"""Wheel speed, turn rate and steering angle in the smoother: equations, outages, standstill, wrong units."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset, wrap_deg
from geoloc.errors import TrajectoryError
from geoloc.reasons import Reason
from geoloc.simulation.motion_sensors import MotionSensors, simulated_motion, without_fixes
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.motion_readings import MotionReadings
from geoloc.trajectory.poses import GnssFixes, Poses
from geoloc.trajectory.smoother.knot_fixes import knot_fixes
from geoloc.trajectory.smoother.odometry import MotionOnRoad, Odometry, unknowns, wandering_states
from geoloc.trajectory.smoother.state import OWN
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_gnss
from geoloc.trajectory.vehicle_motion import MotionSeries, VehicleMotion

SEED = 5
STOPS_S = (40.0, 75.0)


@cache
def recorded() -> tuple[SimulatedDrive, VehicleMotion, FloatArray]:
    """A drive in town that stops once, what its car measured, and the true bias of its gyro."""
    world = scenario("urban", 35.0, SEED, minutes=2.5)
    speed = ((30.0, 9.0), (STOPS_S[0], 0.0), (STOPS_S[1], 0.0), (82.0, 9.0), (100.0, 7.0), (110.0, 9.5))
    world = replace(
        world, motion=replace(world.motion, speed=speed), poles=world.poles[:1], annotate_every=10_000
    )
    motion, truth = simulated_motion(world, SEED, MotionSensors())
    return simulate_drive(world, SEED), motion, truth.gyro_bias_radps


def one_antenna(*outages_s: tuple[float, float]) -> GnssFixes:
    """Its fixes but for outages."""
    drive, _, _ = recorded()
    fixes, start_ns = drive.gnss[0], drive.scenario.start_utc_ns
    for begin_s, end_s in outages_s:
        fixes = without_fixes(fixes, start_ns + int(begin_s * 1e9), start_ns + int(end_s * 1e9))
    return fixes


def smoothed(fixes: GnssFixes, motion: VehicleMotion | None) -> Trajectory:
    """Trajectory with the lever arm of the rig."""
    arm = recorded()[0].rig.antennas[fixes.antenna].rig_t_antenna_m
    return trajectory_from_gnss([fixes], {fixes.antenna: arm}, motion=motion)


def errors(trajectory: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray, Poses]:
    """Seconds of frames, how far places are off, how far headings are, and the poses."""
    drive, _, _ = recorded()
    poses, truth = trajectory.poses_at(drive.frame_epoch_ns), drive.poses
    off = enu_offset(truth.latitude_deg, truth.longitude_deg, poses.latitude_deg, poses.longitude_deg)
    time_s = (drive.frame_epoch_ns - drive.scenario.start_utc_ns) / 1e9
    return time_s, np.hypot(*off), wrap_deg(poses.heading_deg - truth.heading_deg), poses


def changed(series: MotionSeries | None, factor: float = 1.0, late_s: float = 0.0) -> MotionSeries:
    """A series in another unit, or by another clock."""
    assert series is not None
    late_ns = int(late_s * 1e9)
    return replace(series, values=factor * series.values, epoch_ns=series.epoch_ns + late_ns)


def test_equations_have_the_derivatives_they_state() -> None:
    """Jacobians of way and turn are the differences of their residuals."""
    _, motion, _ = recorded()
    fixes = one_antenna()
    knots = knot_fixes([fixes], fixes.epoch_ns[:300], 1.0)
    readings = MotionReadings.of(motion, int(fixes.epoch_ns[0]))
    rng = np.random.default_rng(1)
    tilt = [rng.normal(0.0, 0.05, 300) for _ in range(4)]
    on_road = MotionOnRoad(readings, *tilt, (0.02, 0.06), rng.normal(size=300), np.array([1.5]))
    first = OWN + 2
    fit = Odometry(knots, on_road, first, 0)
    state = rng.normal(0.0, 0.3, (300, first + len(wandering_states(readings))))
    state[:, 2] += 8.0
    constants = rng.normal(0.0, 0.02, len(unknowns(readings)))
    step = 1e-6
    assert (readings.speed, readings.turn_rate) == tuple(link.one for link in fit.links)
    lags = [i for i, name in enumerate(unknowns(readings)) if name.endswith("lag")]
    assert len(lags) == 3  # how readings change with these is taken from the state: they tremble
    for link in fit.links:
        here, there, by_constants, residual = link.rows(link.one, state, constants)
        for column in range(state.shape[1]):
            for jacobian, rows in ((here, slice(None, -1, 2)), (there, slice(1, None, 2))):
                moved = state.copy()
                moved[rows, column] += step
                found = (residual - link.rows(link.one, moved, constants)[3])[::2] / step
                assert found == pytest.approx(jacobian[::2, column], abs=1e-5)
        for column in set(range(constants.size)) - set(lags):
            moved = constants.copy()
            moved[column] += step
            found = (residual - link.rows(link.one, state, moved)[3]) / step
            assert found == pytest.approx(by_constants[:, column], abs=1e-5)


def test_outage_is_bridged_and_its_sigma_holds() -> None:
    """30 s without a fix: poses all the way, within their sigmas; with half of the motion a gap."""
    _, motion, _ = recorded()
    fixes = one_antenna((95.0, 125.0))
    time_s, off_m, turned_deg, poses = errors(smoothed(fixes, replace(motion, wheel_angle=None)))
    gap = (time_s > 95.0) & (time_s < 124.5)
    assert poses.valid.all()
    assert off_m[gap].max() < 0.5
    assert (off_m / poses.sigma_horizontal_m)[gap].max() < 4.0
    assert (np.abs(turned_deg) / poses.sigma_heading_deg)[gap].max() < 4.0
    middle, ends = gap & (np.abs(time_s - 110.0) < 1.0), (time_s > 85.0) & (time_s < 90.0)
    assert poses.sigma_horizontal_m[middle].min() > poses.sigma_horizontal_m[ends].max()
    for half in (None, replace(motion, turn_rate=None, wheel_angle=None), replace(motion, speed=None)):
        reasons = errors(smoothed(fixes, half))[3].reason
        assert (reasons[gap] == Reason.IN_GAP).all()


def test_steering_angle_bridges_an_outage_less_surely() -> None:
    """Without a gyro the bicycle model turns the car: with larger sigmas that hold."""
    _, motion, _ = recorded()
    fixes = one_antenna((95.0, 125.0))
    by_gyro, by_wheels = (
        errors(smoothed(fixes, replace(motion, **without)))
        for without in ({"wheel_angle": None}, {"turn_rate": None})
    )
    gap = (by_gyro[0] > 95.0) & (by_gyro[0] < 124.5)
    assert (by_wheels[1] / by_wheels[3].sigma_horizontal_m)[gap].max() < 4.0
    assert by_wheels[3].sigma_heading_deg[gap].max() > 2.0 * by_gyro[3].sigma_heading_deg[gap].max()


def test_scale_and_bias_are_found() -> None:
    """What the sensors err by is in the result, with sigmas that hold, and noise that nobody stated."""
    drive, motion, bias = recorded()
    found = smoothed(one_antenna((95.0, 125.0)), motion).motion
    assert found is not None
    assert found.wheel_scale is not None
    assert found.gyro_bias_radps is not None
    assert found.speed_sigma_mps is not None
    _, truth = simulated_motion(drive.scenario, SEED, MotionSensors())
    # As tyres warm and turn faster, the scale changes by as much.
    assert abs(found.wheel_scale.value - 1.0 - truth.wheel_scale) < 4.0 * found.wheel_scale.sigma + 0.002
    assert abs(found.gyro_bias_radps.value - bias.mean()) < 4.0 * found.gyro_bias_radps.sigma
    assert found.gyro_bias_radps.sigma < np.radians(0.02)
    assert found.speed_sigma_mps == pytest.approx(MotionSensors().speed_noise_mps, rel=0.3)
    assert found.bridged_s == pytest.approx(30.0, abs=0.3)
    assert found.turns_show
    assert smoothed(one_antenna(), None).motion is None


def test_standing_car_keeps_its_heading_and_place() -> None:
    """Wheels at rest for half a minute: the heading's sigma stays, and the place trembles no more."""
    _, motion, _ = recorded()
    (time_s, _, turned_deg, with_motion), (_, _, _, alone) = (
        errors(smoothed(one_antenna(), one)) for one in (motion, None)
    )
    stands = (time_s > STOPS_S[0] + 1.0) & (time_s < STOPS_S[1] - 1.0)
    assert np.ptp(with_motion.sigma_heading_deg[stands]) < 0.02
    assert with_motion.sigma_heading_deg[stands].max() < 0.6 * alone.sigma_heading_deg[stands].max()
    assert np.abs(turned_deg[stands] / with_motion.sigma_heading_deg[stands]).max() < 4.0
    moved = [np.ptp(one.latitude_deg[stands]) * 111e3 for one in (with_motion, alone)]
    assert moved[0] < 0.005 < moved[1]


def test_poses_go_on_beyond_the_fixes() -> None:
    """Where fixes begin late or end early, the car's motion is followed from the nearest one."""
    _, motion, _ = recorded()
    fixes = one_antenna((-10.0, 15.0), (130.0, 1000.0))
    time_s, off_m, _, poses = errors(smoothed(fixes, motion))
    outside = (time_s < 15.0) | (time_s > 130.0)
    assert poses.valid.all()
    assert (off_m / poses.sigma_horizontal_m)[outside].max() < 4.0
    assert poses.sigma_horizontal_m[0] > 3.0 * poses.sigma_horizontal_m[time_s > 20.0][0]


@pytest.mark.parametrize(
    ("name", "factor", "late_s", "says"),
    [
        ("speed", 3.6, 0.0, "km/h"),
        ("speed", -1.0, 0.0, "turn its sign"),
        ("speed", 0.0, 0.0, "stays 0"),
        ("speed", 1.0, 2.0, "2.0 s late"),
        ("speed", 1.0, 3600.0, "stamps of the fixes' clock"),
        ("turn_rate", np.degrees(1.0), 0.0, "degrees a second"),
        ("turn_rate", -1.0, 0.0, "turn its sign"),
        ("turn_rate", 1.0, -1.5, r"1\.[3-7] s early"),
        ("wheel_angle", 16.0, 0.0, "steering ratio"),
    ],
)
def test_wrong_unit_sign_or_clock_is_named(name: str, factor: float, late_s: float, says: str) -> None:
    """What no scale of a wheel and no bias of a gyro explains is refused, with the cure."""
    _, motion, _ = recorded()
    wrong = replace(motion, **{name: changed(getattr(motion, name), factor, late_s)})
    with pytest.raises(TrajectoryError, match=says):
        smoothed(one_antenna(), wrong)


def test_speed_that_falls_to_zero_at_once_is_refused() -> None:
    """A sensor that is lost writes 0: as if the car stood."""
    _, motion, _ = recorded()
    assert motion.speed is not None
    lost = motion.speed.values.copy()
    seconds = (motion.speed.epoch_ns - motion.speed.epoch_ns[0]) / 1e9
    lost[(seconds > 20.0) & (seconds < 25.0)] = 0.0
    with pytest.raises(TrajectoryError, match="to 0 within"):
        smoothed(one_antenna((15.0, 35.0)), replace(motion, speed=replace(motion.speed, values=lost)))


def test_turn_rate_of_something_else_is_refused() -> None:
    """Noise, or a rate about another axis, does not follow the course."""
    _, motion, _ = recorded()
    assert motion.turn_rate is not None
    noise = np.random.default_rng(0).normal(0.0, 0.05, motion.turn_rate.values.size)
    with pytest.raises(TrajectoryError, match="does not follow"):
        smoothed(one_antenna(), replace(motion, turn_rate=replace(motion.turn_rate, values=noise)))


def test_wheels_that_spin_or_rest_on_a_ferry_lose_their_weight() -> None:
    """Two seconds on ice, and twenty in which the car is carried, move the track by centimetres."""
    _, motion, _ = recorded()
    assert motion.speed is not None
    values = motion.speed.values.copy()
    values[1000:1100] *= 1.5
    values[5500:6500] = 0.0
    off_m = errors(smoothed(one_antenna(), replace(motion, speed=replace(motion.speed, values=values))))[1]
    assert off_m.max() < 0.15
