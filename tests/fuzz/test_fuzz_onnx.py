"""ONNX files, damaged, and outputs of any numbers."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np
from mutate import either, fuzzed, listed, mutated
from onnx import TensorProto, helper, numpy_helper

from twin.drives.detection.network import Detector
from twin.drives.detection.yolo_output import Letterbox, candidates, kept
from twin.errors import DriveError


def _model() -> bytes:
    inputs = [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, "rows", 64])]
    outputs = [helper.make_tensor_value_info("output0", TensorProto.FLOAT, [1, 3, 64, 64])]
    weight = numpy_helper.from_array(np.ones((3, 3, 1, 1), np.float32), "w")
    node = helper.make_node("Conv", ["images", "w"], ["output0"])
    model = helper.make_model(helper.make_graph([node], "g", inputs, outputs, [weight]))
    helper.set_model_props(model, {"names": "{0: 'stop', 1: 'yield'}"})
    return bytes(model.SerializeToString())


@fuzzed(mutated([_model()]))
def test_damaged_network_raises_nothing_but_drive_errors(content: bytes) -> None:
    """Whatever the bytes: a DriveError, or boxes in a picture; the process lives on."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.onnx"
        path.write_bytes(content)
        try:
            detector = Detector(path)
            boxes = detector.find(np.zeros((48, 64, 3), np.uint8), 0.25, Counter())
        except DriveError:
            return
    assert all(isinstance(name, str) for name in detector.names)
    assert np.isfinite(boxes.box_px).all()


def _bits(random: Random) -> float:
    """Any float32: NaN, infinity, giants, numbers next to 0."""
    return float(np.frombuffer(random.randbytes(4), np.float32)[0])


@fuzzed(
    lambda random: random.randint(0, 7),
    lambda random: random.randint(0, 7),
    lambda random: random.choice([None, 1, 2, 3]),
    listed(either(_bits, lambda random: random.uniform(-1.0, 70.0), Random.random), 49),
)
def test_outputs_of_any_numbers_give_sound_boxes(
    first: int, second: int, n_classes: int | None, numbers: list[float]
) -> None:
    """NaN, infinities and giants in a network's output never become boxes."""
    output = np.resize(np.array(numbers or [0.5], np.float32), (1, first, second))
    try:
        found = candidates(output, n_classes, "a.onnx")
    except DriveError:
        return
    boxes = kept(found, Letterbox((1.0, 1.0), (0, 0)), (64, 48), 0.25, Counter())
    assert np.isfinite(boxes.box_px).all()
    assert np.all(boxes.box_px[:, 2:] > boxes.box_px[:, :2])
    assert np.all(boxes.score >= 0.25)
