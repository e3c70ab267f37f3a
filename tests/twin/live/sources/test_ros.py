"""Topics of a ROS 2 recording that is played."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from live_senders import ROOF, WIDE, Listener, until
from track_writers import Ros

from twin.drives.track.formats.gpsd import read_gpsd
from twin.drives.track.formats.rosbag import read_rosbag
from twin.errors import ConfigError
from twin.live.car import Car
from twin.live.ports import TroubleKind
from twin.live.recorder import Recorder
from twin.live.sources import Gives, open_source

S = 1_000_000_000
START_NS = 1_781_078_400 * S


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Fixes and frames of three seconds, one fix without a position."""
    ros, messages = Ros(2), []
    for k in range(15):
        at = START_NS + k * S // 5
        fix = ros.fix(at, 63.4 + 1e-6 * k, 10.4, 80.0, status=-1 if k == 7 else 2, sigma_m=(0.01, 0.02, 0.03))
        messages.append(("/fix", at + 20_000_000, fix))
        line: dict[str, object] = {"camera": WIDE, "frame": k, "stamp_ns": at}
        line["detections"] = [{"foot": [700, 600], "object": "P"}]
        messages.append(("/signs", at + 90_000_000, ros.text(json.dumps(line))))
    return ros.write(tmp_path / "run", messages)


def test_recording_is_played_and_recorded_again(car: Car, run: Path, tmp_path: Path) -> None:
    """Fixes and frames arrive when they were recorded; the copy gives the fixes of the recording."""
    with Recorder(tmp_path / "recorded", car) as recorder:
        for gives in Gives:
            source = open_source(f"mcap://{run}?speed=max", gives, car, recorder=recorder)
            with Listener(source) as listener:
                until(listener.ended)
            if gives is Gives.FIXES:
                fixes = listener
    paths = [path for path in run.iterdir() if path.suffix == ".mcap"]
    expected = read_rosbag(paths, ROOF, "run").fixes
    assert [fix.epoch_ns for fix in fixes.fixes()] == expected.epoch_ns.tolist()
    sigmas_m = [fix.sigma_horizontal_m for fix in fixes.fixes()]
    assert sigmas_m == pytest.approx(expected.sigma_horizontal_m.tolist())
    assert [fix.quality for fix in fixes.fixes()] == expected.quality.tolist()
    assert [one.at_ns for one in fixes.got[:-1]] == expected.host_ns.tolist()
    (no_fix,) = fixes.troubles(TroubleKind.GARBAGE)
    assert no_fix.count == 1
    again = read_gpsd((tmp_path / "recorded" / "gnss50_vehicle.gpsd").read_bytes(), ROOF, "a").fixes
    assert again.epoch_ns.tolist() == expected.epoch_ns.tolist()
    assert again.latitude_deg.tolist() == expected.latitude_deg.tolist()
    assert [frame.number for frame in listener.frames()] == list(range(15))
    assert listener.frames()[3].detections[0].object == "P"


class Rclpy:
    """As much of rclpy as a node that listens needs, whose executor hands on what a test has put in."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.messages: list[Any] = []
        self.topic, self._take = "", lambda _message: None
        modules = {
            name: ModuleType(name) for name in ("rclpy", "rclpy.qos", "rclpy.executors", "sensor_msgs.msg")
        }
        modules["rclpy"].__spec__ = ModuleSpec("rclpy", None)
        for name, module in modules.items():
            monkeypatch.setitem(sys.modules, name, module)
        nothing = SimpleNamespace(try_shutdown=lambda: None)
        node = SimpleNamespace(create_subscription=self._subscribe, destroy_node=lambda: None)
        executor = SimpleNamespace(add_node=lambda _: None, spin_once=self._spin, shutdown=lambda: None)
        vars(modules["rclpy"]).update(
            Context=lambda: nothing, init=lambda context: None, create_node=lambda _name, context: node
        )
        vars(modules["rclpy.qos"])["qos_profile_sensor_data"] = 5
        vars(modules["rclpy.executors"])["SingleThreadedExecutor"] = lambda context: executor
        vars(modules["sensor_msgs.msg"])["NavSatFix"] = object

    def _subscribe(self, _kind: object, topic: str, take: Callable[[Any], None], _qos: object) -> None:
        self.topic, self._take = topic, take

    def _spin(self, timeout_sec: float) -> None:
        while self.messages:
            self._take(self.messages.pop(0))
        time.sleep(timeout_sec)


def test_live_topic_gives_fixes(car: Car, monkeypatch: pytest.MonkeyPatch) -> None:
    """By ROS 2's own node, which is played here; messages without a fix are passed by."""
    rclpy, ros = Rclpy(monkeypatch), Ros(2)
    with Listener(open_source("ros2:///gnss/fix", Gives.FIXES, car)) as listener:
        places = [(63.4 + 1e-6 * k, 10.4, 80.0) for k in range(5)]
        rclpy.messages = [
            ros.fix(START_NS + k * S, *place, status=-1 if k == 2 else 2) for k, place in enumerate(places)
        ]
        until(lambda: len(listener.fixes()) == 4)
    assert rclpy.topic == "/gnss/fix"
    assert [fix.epoch_ns for fix in listener.fixes()] == [START_NS + k * S for k in (0, 1, 3, 4)]
    assert listener.fixes()[-1].latitude_deg == places[-1][0]


def test_topic_that_is_not_clear_is_asked_for(car: Car, run: Path) -> None:
    """The sentence lists those of the type."""
    with pytest.raises(ConfigError, match=r"no topic /gps .* name one with \?topic=.* \(it has /fix\)"):
        open_source(f"mcap://{run}?topic=/gps", Gives.FIXES, car)
