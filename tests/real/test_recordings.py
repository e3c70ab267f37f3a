"""ROS recordings that others made."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from checkout import REAL
from rosbags.highlevel import AnyReader

from twin.drives.track.formats.rosbag import (
    looks_like_rosbag,
    read_rosbag,
    read_rosbag_poses,
    recorded_topics,
)
from twin.errors import DriveError

RECORDINGS = REAL / "recordings"
BAG, MCAP = "robot_localization_test2.bag", "wbag_0.mcap"


def recording(name: str) -> Path:
    """Path of one real file; skip the test where it is absent."""
    path = RECORDINGS / name
    if not path.is_file():
        pytest.skip(f"the real file {name} is not beside the checkout")
    return path


def test_robot_localization_bag_has_an_imu_and_odometry() -> None:
    """A ROS 1 bag of a minute: 3,061 Imu and 3,060 Odometry messages, and no positions."""
    path = recording(BAG)
    assert looks_like_rosbag(path.read_bytes()[:64])
    topics = {"/imu/data": "sensor_msgs/msg/Imu", "/jackal_velocity_controller/odom": "nav_msgs/msg/Odometry"}
    assert recorded_topics([path], BAG) == topics
    with AnyReader([path]) as reader:
        assert Counter(c.topic for c, _, _ in reader.messages()) == {
            "/imu/data": 3061,
            "/jackal_velocity_controller/odom": 3060,
        }


def test_robot_localization_imu_attitudes_are_those_of_its_quaternions() -> None:
    """Every attitude of the bag, against SciPy's rotation from the same quaternion."""
    from scipy.spatial.transform import Rotation

    from twin.drives.track.formats.rosbag import attitude_of

    path = recording(BAG)
    ours, theirs = [], []
    with AnyReader([path]) as reader:
        wanted = [c for c in reader.connections if c.topic == "/imu/data"]
        for _, _, raw in reader.messages(wanted):
            message = reader.deserialize(raw, "sensor_msgs/msg/Imu")
            q = message.orientation
            ours.append(attitude_of(message)[:3])
            theirs.append(Rotation.from_quat([q.x, q.y, q.z, q.w]).as_euler("ZYX", degrees=True)[::-1])
    roll, pitch, heading = np.transpose(ours)
    expected = np.transpose(theirs)
    assert len(roll) == 3061
    assert roll == pytest.approx(expected[0], abs=1e-9)
    assert pitch == pytest.approx(expected[1], abs=1e-9)
    assert heading == pytest.approx(90.0 - expected[2], abs=1e-9)


def test_wbag_mcap_holds_1246_strings_on_eight_topics() -> None:
    """A ROS 2 recording without anything that says where the car was."""
    path = recording(MCAP)
    assert looks_like_rosbag(path.read_bytes()[:64])
    topics = recorded_topics([path], MCAP)
    assert topics == dict.fromkeys(
        ("AAA", "BBB", "CCC", "DDD", "EEE", "FFF", "GGG", "HHH"), "std_msgs/msg/String"
    )
    with AnyReader([path]) as reader:
        assert reader.message_count == 1246


@pytest.mark.parametrize(("name", "seen"), [(BAG, "/imu/data (Imu)"), (MCAP, "AAA (String)")])
def test_recording_without_positions_is_refused_with_what_it_has(name: str, seen: str) -> None:
    """One sentence that names the topics."""
    path = recording(name)
    for read in (lambda: read_rosbag([path], "a", name), lambda: read_rosbag_poses([path], name, {})):
        with pytest.raises(DriveError) as caught:
            read()
        assert f"{name} has no topic of NavSatFix: it has {seen}" in str(caught.value)
