"""Rates of turn and speeds in ROS 1 bags, ROS 2 databases and MCAP: Imu, Twist and Odometry.

Axes are those of REP 103, forward, left, up; a gyro whose z points down says ``turn_rate_axis = "-z"``. The
velocity of Odometry is in the frame of the car by its definition, that of the Twist messages in the frame of
their header. Stamps are those of the header.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSource, Quantity
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.samples import MotionRead, Samples
from twin.drives.track.fixes import LeftOutError
from twin.drives.track.formats.recording import Recording
from twin.drives.track.formats.rosbag import (
    is_ros_recording,
    messages_of,
    paths_of,
    recorded_topics,
    stamp_ns_of,
)
from twin.errors import DriveError

IMU = "sensor_msgs/msg/Imu"
_TWIST = "geometry_msgs/msg/TwistStamped"
_TWIST_COVARIANCE = "geometry_msgs/msg/TwistWithCovarianceStamped"
_ODOMETRY = "nav_msgs/msg/Odometry"
SPEED_TYPES = (_ODOMETRY, _TWIST_COVARIANCE, _TWIST)
TURN_TYPES = (IMU, *SPEED_TYPES)
_WORLDS = ("map", "odom", "world", "earth", "enu", "ned", "utm", "ecef")
"""Frames that do not turn with the car: a velocity in one of them has no direction against its wheels."""
_ROLL_X, _YAW_Z = 0, 35
"""On the diagonal of a 6 x 6 covariance: along x, and about z."""
_Row = tuple[tuple[float, ...], float]


def is_ros(folder: DriveFolder, source: MotionSource) -> bool:
    """Whether a file or folder is a ROS recording."""
    return is_ros_recording(Recording(folder, source.file))


def read(folder: DriveFolder, source: MotionSource) -> MotionRead:
    """Read the topics that ``drive.toml`` names, or the only one of its kind for each quantity.

    Raises
    ------
    DriveError
        If it is not a sound recording, or not clear which topic is meant.
    """
    paths = paths_of(Recording(folder, source.file), track=False)
    there = recorded_topics(paths, source.file)
    if Quantity.WHEEL_ANGLE in source.named:
        raise DriveError(
            f"{source.file} is a ROS recording, of which twin reads no wheel angles: export the topic as a"
            f" table (CSV) and name that under a table of its own, [motion.steering] in {SETTINGS_FILE}."
        )
    faults: Counter[str] = Counter()
    samples: dict[Quantity, Sequence[Samples]] = {}
    for quantity, types in ((Quantity.SPEED, SPEED_TYPES), (Quantity.TURN_RATE, TURN_TYPES)):
        topics = _topics(there, quantity, types, source)
        if topics:
            samples[quantity] = [
                _samples(paths, topic, there[topic], quantity, source, faults) for topic in topics
            ]
    if not samples:
        raise DriveError(
            f"{source.file} holds neither Imu, Odometry nor TwistStamped (its topics: {_listed(there)}):"
            f" record one, or take it out of [{source.table}]."
        )
    return MotionRead(samples, faults=faults)


def _topics(
    there: Mapping[str, str], quantity: Quantity, types: Collection[str], source: MotionSource
) -> tuple[str, ...]:
    """Topics of a quantity: as named, else the only one of the first type that the recording has."""
    for name in source.of(quantity).names:
        if there.get(name) not in types:
            kinds = ", ".join(kind.rpartition("/")[2] for kind in types)
            raise DriveError(
                f"{source.file} has no topic {name} of {kinds} for the {quantity} (its topics:"
                f" {_listed(there)}): correct [{source.table}] {quantity}."
            )
    if source.named:
        return source.of(quantity).names
    by_type = ([topic for topic, kind in sorted(there.items()) if kind == one] for one in types)
    fitting = next((topics for topics in by_type if topics), [])
    if len(fitting) > 1:
        raise DriveError(
            f"{source.file} has several topics for the {quantity}: name one of {', '.join(fitting)} under"
            f" [{source.table}] {quantity}."
        )
    return tuple(fitting)


def _samples(
    paths: Sequence[Path],
    topic: str,
    kind: str,
    quantity: Quantity,
    source: MotionSource,
    faults: Counter[str],
) -> Samples:
    row_of: Callable[[Any], _Row] = _turn if quantity is Quantity.TURN_RATE else _speed
    stamps: list[int] = []
    rows: list[_Row] = []
    for _, message in messages_of(paths, source.file, [topic], faults):
        if kind in (_TWIST, _TWIST_COVARIANCE):
            _check_frame(message.header.frame_id, topic, quantity, source)
        try:
            stamp_ns = stamp_ns_of(message)
        except LeftOutError as reason:
            faults[str(reason)] += 1
            continue
        stamps.append(stamp_ns)
        rows.append(row_of(message))
    values = np.array([value for value, _ in rows], np.float64)
    return Samples(
        np.array(stamps, np.int64),
        values.reshape(-1, 3) if quantity is Quantity.TURN_RATE else values.ravel(),
        unit="rad/s" if quantity is Quantity.TURN_RATE else "m/s",
        axis="z",
        sigma=np.array([sigma for _, sigma in rows], np.float64),
    )


def _check_frame(frame: str, topic: str, quantity: Quantity, source: MotionSource) -> None:
    last = frame.strip("/").rpartition("/")[2].casefold()
    if quantity is Quantity.SPEED and last in _WORLDS:
        raise DriveError(
            f"{topic} of {source.file} gives velocities in the frame {frame}, which does not turn with the"
            f" car: name a topic in the car's own frame (base_link) under [{source.table}] speed."
        )


def _speed(message: Any) -> _Row:
    twist, covariance = _twist(message)
    return (float(twist.linear.x),), _sigma(covariance[_ROLL_X])


def _turn(message: Any) -> _Row:
    if hasattr(message, "angular_velocity"):
        rate, variance = (
            message.angular_velocity,
            max(message.angular_velocity_covariance[i] for i in (0, 4, 8)),
        )
    else:
        twist, covariance = _twist(message)
        rate, variance = twist.angular, covariance[_YAW_Z]
    return (float(rate.x), float(rate.y), float(rate.z)), _sigma(variance)


def _twist(message: Any) -> tuple[Any, Sequence[float]]:
    """Twist and covariance, zeros where there is none."""
    inner = message.twist
    return (inner.twist, inner.covariance) if hasattr(inner, "covariance") else (inner, [0.0] * 36)


def _sigma(variance: float) -> float:
    """One sigma; NaN of a variance that says nothing (0, or -1 as REP 103 has it)."""
    return math.sqrt(variance) if 0.0 < variance < 1e6 else math.nan


def _listed(there: Mapping[str, str]) -> str:
    topics = [f"{topic} ({kind.rpartition('/')[2]})" for topic, kind in sorted(there.items())]
    return f"{', '.join(topics) or 'none':.300}"
