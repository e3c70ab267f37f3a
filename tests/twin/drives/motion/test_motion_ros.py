"""A car's motion from ROS recordings that rosbags itself writes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from moving_car import MovingCar, motion_of, nearly, settings_of
from track_writers import Ros, Timed

from twin.errors import DriveError


def said(car: MovingCar, ros: Ros, *, down: bool = False, frame: str = "base_link") -> Iterator[Timed]:
    """An Imu, a TwistStamped and an Odometry at every frame."""
    sign = -1.0 if down else 1.0
    rows = np.column_stack([car.speed_mps, car.turn_rad_s]).tolist()
    for epoch_ns, (v, turn) in zip(car.epoch_ns.tolist(), rows, strict=True):
        yield "/imu", epoch_ns, ros.gyro(epoch_ns, (0.01, 0.02, sign * turn), 0.002)
        yield "/twist", epoch_ns, ros.twist(epoch_ns, 1.01 * v, turn, frame)
        yield "/odom", epoch_ns, ros.moving_odometry(epoch_ns, v, turn, 0.05)


@pytest.mark.parametrize("version", [1, 2])
def test_imu_and_odometry_are_read_with_their_sigmas(car: MovingCar, version: int) -> None:
    """Of several kinds Odometry says the speed and Imu the rate; covariances become sigmas."""
    ros = Ros(version)
    name = "a.bag" if version == 1 else "a"
    ros.write(car.trip / name, said(car, ros))
    motion = motion_of(car, settings_of(file=f'"{name}"')).motion
    assert motion is not None
    assert motion.speed is not None
    assert motion.turn_rate is not None
    assert motion.wheel_angle is None
    assert motion.speed.epoch_ns.tolist() == car.epoch_ns.tolist()
    assert nearly(motion.speed.values, car.speed_mps, 1e-9)
    assert nearly(motion.turn_rate.values, car.turn_rad_s, 1e-9)
    assert motion.speed.sigma[0] == pytest.approx(0.05)
    assert motion.turn_rate.sigma[0] == pytest.approx(0.002)


def test_topic_axis_and_frame_are_stated_or_refused(car: MovingCar) -> None:
    """A named topic counts; a gyro whose z points down, and a velocity in the map's frame, are refused."""
    ros = Ros(2)
    ros.write(car.trip / "up", said(car, ros))
    motion = motion_of(car, settings_of(file='"up"', speed='"/twist"')).motion
    assert motion is not None
    assert motion.turn_rate is None
    assert motion.speed is not None
    assert nearly(motion.speed.values, 1.01 * car.speed_mps, 1e-9)
    with pytest.raises(DriveError, match="has no topic /imu of Odometry"):
        motion_of(car, settings_of(file='"up"', speed='"/imu"'))

    ros.write(car.trip / "down", said(car, ros, down=True, frame="map"))
    with pytest.raises(DriveError, match='turn_rate_axis = "-z"'):
        motion_of(car, settings_of(file='"down"', turn_rate='"/imu"'))
    motion = motion_of(car, settings_of(file='"down"', turn_rate='"/imu"', turn_rate_axis='"-z"')).motion
    assert motion is not None
    assert motion.turn_rate is not None
    assert nearly(motion.turn_rate.values, car.turn_rad_s, 1e-9)
    with pytest.raises(DriveError, match="in the frame map"):
        motion_of(car, settings_of(file='"down"', speed='"/twist"'))


def test_recording_without_motion_says_what_it_has(car: MovingCar) -> None:
    """Of a recording of words nothing is made."""
    ros = Ros(2)
    ros.write(car.trip / "talk", [("/chatter", int(car.epoch_ns[0]), ros.text("hello"))])
    with pytest.raises(DriveError, match=r"neither Imu, Odometry nor TwistStamped .*/chatter"):
        motion_of(car, settings_of(file='"talk"'))
