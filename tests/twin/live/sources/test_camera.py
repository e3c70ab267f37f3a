"""A video or a camera with a network that looks at it."""

from __future__ import annotations

import json
import time
from collections import Counter
from pathlib import Path

import av
import numpy as np
import pytest
from board_drive import Networks
from live_senders import WIDE, Listener, MakeCar, until
from numpy.typing import NDArray

from twin.drives.detection.network import Detector
from twin.drives.detection.run import DetectorOptions
from twin.drives.detection.yolo_output import Detections
from twin.live.car import Car
from twin.live.ports import TroubleKind
from twin.live.recorder import Recorder
from twin.live.sources import Gives, open_source

SIZE, FRAMES = (96, 64), 12
BOX = [[20.0, 10.0, 40.0, 30.0, 0.9, 0.0]]


@pytest.fixture
def network(tmp_path: Path) -> DetectorOptions:
    """One that sees the same box in each picture of its own size."""
    path = Networks().constant(tmp_path / "net.onnx", np.array([BOX]), shape=(1, 3, SIZE[1], SIZE[0]))
    path.with_suffix(".names").write_text("362.50\n", encoding="utf-8")
    return DetectorOptions(path)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Half a second of grey."""
    path = tmp_path / "grey.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for _ in range(FRAMES):
            picture = av.VideoFrame.from_ndarray(np.full((SIZE[1], SIZE[0], 3), 90, np.uint8), format="rgb24")
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    return path


def test_video_is_looked_at_and_recorded(
    make_car: MakeCar, network: DetectorOptions, video: Path, tmp_path: Path
) -> None:
    """A box in each frame, from the centre of the first pixel, with its code; the video ends the source."""
    car = make_car(size=SIZE)
    with Recorder(tmp_path / "recorded", car) as recorder:
        source = open_source(f"file://{video}", Gives.DETECTIONS, car, recorder=recorder, detector=network)
        with Listener(source) as listener:
            until(listener.ended)
    frames = listener.frames()
    assert 1 <= len(frames) == FRAMES - sum(one.count for one in listener.troubles(TroubleKind.DROPPED))
    (found,) = frames[0].detections
    assert (found.pixel_px, found.size_px, found.kind, found.skiltnummer) == (
        (29.5, 19.5),
        20.0,
        "box",
        "362.50",
    )
    lines = (tmp_path / "recorded" / f"{WIDE}.jsonl").read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["frame"] for line in lines] == [frame.number for frame in frames]
    assert json.loads(lines[0])["detections"][0]["box"] == BOX[0][:4]


def test_frames_that_the_detector_is_too_slow_for_are_dropped_and_counted(
    make_car: MakeCar, network: DetectorOptions, video: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None waits: the newest is looked at next."""

    def slow(_self: Detector, _image: NDArray[np.uint8], _at: float, _faults: Counter[str]) -> Detections:
        time.sleep(0.2)
        return Detections(np.empty((0, 4)), np.empty(0), np.empty(0, np.int64))

    monkeypatch.setattr(Detector, "find", slow)
    source = open_source(f"file://{video}", Gives.DETECTIONS, make_car(size=SIZE), detector=network)
    with Listener(source) as listener:
        until(listener.ended)
    dropped = sum(one.count for one in listener.troubles(TroubleKind.DROPPED))
    assert dropped >= 5
    assert len(listener.frames()) == FRAMES - dropped
    assert max(frame.number for frame in listener.frames()) == FRAMES - 1


def test_pictures_of_another_size_are_left_out(car: Car, network: DetectorOptions, video: Path) -> None:
    """The rig's camera has 1920 x 1208."""
    with Listener(open_source(f"file://{video}", Gives.DETECTIONS, car, detector=network)) as listener:
        until(listener.ended)
    assert listener.frames() == []
    assert "1920 x 1208" in listener.troubles(TroubleKind.GARBAGE)[0].detail


def test_camera_that_does_not_answer_is_lost(make_car: MakeCar, network: DetectorOptions) -> None:
    """Said once, without its password; it is tried again until the source is closed, within a second."""
    url = "rtsp://car:secret@127.0.0.1:9/s"
    source = open_source(url, Gives.DETECTIONS, make_car(size=SIZE), detector=network)
    with Listener(source) as listener:
        (lost,) = until(lambda: listener.troubles(TroubleKind.LOST))
        time.sleep(1.2)
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 1.0
    assert listener.got == [lost]
    assert "secret" not in repr(lost)
