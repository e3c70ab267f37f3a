"""Topics of a ROS 2 recording that is played."""

from __future__ import annotations

import json
from pathlib import Path

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


def test_topic_that_is_not_clear_is_asked_for(car: Car, run: Path) -> None:
    """The sentence lists those of the type."""
    with pytest.raises(ConfigError, match=r"no topic /gps .* name one with \?topic=.* \(it has /fix\)"):
        open_source(f"mcap://{run}?topic=/gps", Gives.FIXES, car)
