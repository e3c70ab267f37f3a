"""ONNX files: what they say, and what comes out of them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from twin.drives.detection.network import Detector
from twin.drives.detection.yolo_output import GREY, Detections, Letterbox, candidates, kept, letterboxed
from twin.errors import DriveError

GREY_IMAGE = np.full((64, 96, 3), 90, np.uint8)


@pytest.mark.parametrize(
    ("imgsz", "size"), [("[320, 416]", (320, 416)), ("[-1, 0]", (640, 640)), ("large", (640, 640))]
)
def test_size_that_is_left_open_is_the_one_trained_on(
    networks: Any, tmp_path: Path, imgsz: str, size: tuple[int, int]
) -> None:
    """Ultralytics writes ``imgsz`` beside an input of open size; nonsense in it is none: then 640."""
    import onnx

    path = networks.constant(
        tmp_path / "net.onnx", np.zeros((1, 3, 6)), shape=("batch", 3, "height", "width")
    )
    model = onnx.load(path)
    onnx.helper.set_model_props(model, {"imgsz": imgsz})
    path.write_bytes(model.SerializeToString())
    assert Detector(path).input_px == (size[1], size[0])


def test_weights_listed_as_inputs_are_not_the_input(tmp_path: Path) -> None:
    """Files of the first ONNX versions name every weight as an input, sometimes first."""
    from onnx import TensorProto, helper, numpy_helper

    made = [("w", [1]), ("images", [1, 3, 8, 16])]
    inputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in made]
    weight = numpy_helper.from_array(np.ones(1, np.float32), "w")
    node = helper.make_node("Mul", ["images", "w"], ["out"])
    out = helper.make_tensor_value_info("out", TensorProto.FLOAT, [1, 3, 8, 16])
    graph = helper.make_graph([node], "old", inputs, [out], [weight])
    for ir_version in (3, 8):
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=ir_version)
        (tmp_path / "old.onnx").write_bytes(model.SerializeToString())
        assert Detector(tmp_path / "old.onnx").input_px == (16, 8)


@pytest.mark.parametrize(
    "content", [b"", b"<html>", b"\x3a\xff\xff\xff\x7f", bytes(100), b"\x08" + b"\xff" * 20]
)
def test_what_is_no_onnx_file_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    """One sentence, whatever the bytes."""
    (tmp_path / "no.onnx").write_bytes(content)
    with pytest.raises(DriveError, match=r"no\.onnx is not an ONNX model"):
        Detector(tmp_path / "no.onnx")


def test_absent_file_is_named(tmp_path: Path) -> None:
    """One sentence with the cure."""
    with pytest.raises(DriveError, match=r"none\.onnx cannot be read"):
        Detector(tmp_path / "none.onnx")


def test_grid_network_finds_the_red_square(networks: Any, tmp_path: Path) -> None:
    """A YOLOv8 head, run on a picture of another shape: the box is in its pixels."""
    image = np.full((64, 128, 3), 90, np.uint8)
    image[16:32, 48:64] = (255, 0, 0)
    detector = Detector(networks.grid(tmp_path / "grid.onnx"))
    found = detector.find(image, 0.5, Counter())
    assert detector.name_of(int(found.class_index[0])) == "red board"
    # Scale 1/2, 16 px of padding above: one cell of 8 px is 16 px of the picture.
    assert found.box_px == pytest.approx(np.array([[47.5, 15.5, 63.5, 31.5]]))
    assert found.score == pytest.approx([1.0], abs=0.01)


@pytest.mark.parametrize(
    ("output", "names"),
    [
        (np.array([[[30, 20, 40, 30, 0.9, 1], [5, 5, 9, 9, 0.1, 0]]]), "{0: 'a', 1: 'b'}"),
        (np.array([[[35, 25, 10, 10, 0.9, 0.0, 1.0], [7, 7, 4, 4, 0.1, 1.0, 0.0]]]), "{0: 'a', 1: 'b'}"),
        (np.array([[[35, 7], [25, 7], [10, 4], [10, 4], [0, 0.1], [0.9, 0]]]), "{0: 'a', 1: 'b'}"),
        (np.array([[[30, 20, 40, 30, 0.9, 1], [5, 5, 9, 9, 0.1, 0]]]), ""),
    ],
    ids=["suppressed", "objectness", "columns", "suppressed, no names"],
)
def test_all_forms_of_output_give_the_same_box(
    networks: Any, tmp_path: Path, output: np.ndarray, names: str
) -> None:
    """The three heads of the family, through a real network of the picture's size."""
    detector = Detector(networks.constant(tmp_path / "net.onnx", output, names))
    found = detector.find(GREY_IMAGE, 0.5, Counter())
    assert found.box_px == pytest.approx(np.array([[29.5, 19.5, 39.5, 29.5]]), abs=1e-4)
    assert found.score == pytest.approx([0.9])
    assert detector.name_of(int(found.class_index[0])) == ("b" if names else "class 1")


@pytest.mark.parametrize(
    ("shape", "n_classes", "form"),
    [
        ((1, 84, 8400), 80, "columns"),
        ((1, 5, 8400), 1, "columns"),
        ((1, 25200, 85), 80, "rows"),
        ((1, 25200, 6), 1, "rows"),
        ((1, 300, 6), 80, "boxes"),
        ((1, 300, 6), 1, "boxes"),
        ((1, 84, 8400), None, "columns"),
        ((1, 25200, 85), None, "rows"),
        ((1, 300, 6), None, "boxes"),
    ],
)
def test_form_of_the_output_is_told_by_its_shape(
    shape: tuple[int, ...], n_classes: int | None, form: str
) -> None:
    """Shapes that the family's exporters write at 640 px: the box of each form is read as that form says."""
    output = np.zeros(shape, np.float32)
    if form == "columns":
        output[0, :5, 0] = (10, 20, 4, 6, 0.8)
    elif form == "rows":
        output[0, 0, :6] = (10, 20, 4, 6, 0.8, 1.0)
    else:
        output[0, 0] = (8, 17, 12, 23, 0.8, 0)
    found = candidates(output, n_classes, "net.onnx")
    assert found.box_px[0] == pytest.approx([8, 17, 12, 23])
    assert (found.score[0], found.class_index[0]) == (pytest.approx(0.8), 0)


@pytest.mark.parametrize("shape", [(1, 84), (2, 84, 8400), (1, 84, 8400, 1), (1, 60, 8400), (1, 300, 7)])
def test_output_that_is_no_detector_is_refused(shape: tuple[int, ...]) -> None:
    """A classifier, a batch, or a head of other classes than the names: one sentence with the forms."""
    with pytest.raises(DriveError, match=r"net\.onnx gives an output of shape"):
        candidates(np.zeros(shape, np.float32), 80, "net.onnx")


def test_names_beside_the_file_are_used(networks: Any, tmp_path: Path) -> None:
    """``net.names``, one class a line, where the file has none."""
    (tmp_path / "net.names").write_text("stop\nyield\n", encoding="utf-8")
    detector = Detector(networks.constant(tmp_path / "net.onnx", np.zeros((1, 3, 6))))
    assert detector.names == ("stop", "yield")
    assert detector.name_of(-1) == "class -1"


@pytest.mark.parametrize("shape", [(1, 1, 64, 64), (4, 3, 64, 64), (1, 3, 64), (1, 3, 9000, 64)])
def test_input_that_is_no_picture_is_refused(networks: Any, tmp_path: Path, shape: tuple[int, ...]) -> None:
    """Grey input, batches and giant inputs are named with what is wanted."""
    flat = ("Reshape", ["images", "form"], "output0", {})
    path = networks.save(tmp_path / "net.onnx", [flat], {"form": np.array([1, 1, -1])}, shape)
    with pytest.raises(DriveError, match="must be \\(1, 3, rows, columns\\)"):
        Detector(path)


@pytest.mark.parametrize(
    "node",
    [
        ("NoSuchOperation", ["images"], "output0", {}),
        ("Conv", ["images", "w"], "output0", {"kernel_shape": [1, 1], "strides": [0, 0]}),
    ],
    ids=lambda node: node[0],
)
def test_network_that_cannot_be_run_is_refused(networks: Any, tmp_path: Path, node: Any) -> None:
    """An unknown operation, and strides of 0: one sentence with the runtime's reason."""
    path = networks.save(
        tmp_path / "net.onnx", [node], {"w": np.ones((5, 3, 1, 1), np.float32)}, (1, 3, 64, 64)
    )
    with pytest.raises(DriveError, match=r"cannot be run|can be run") as caught:
        Detector(path).find(GREY_IMAGE, 0.5, Counter())
    assert "onnxruntime" not in str(caught.value).lower()


@pytest.mark.parametrize(("rows", "columns"), [(400, 640), (640, 400), (64, 64), (1208, 1920)])
def test_letterbox_and_back_is_the_identity(rows: int, columns: int) -> None:
    """A box over the whole picture comes back as the whole picture, from corner to corner."""
    blob, box = letterboxed(np.zeros((rows, columns, 3), np.uint8), 640, 640)
    assert (blob.shape, blob.dtype) == ((1, 3, 640, 640), np.float32)
    black = np.argwhere(blob[0, 0] == 0.0)
    (top, left), (bottom, right) = black.min(axis=0), black.max(axis=0) + 1
    inner = np.array([[left + 20.0, top + 20.0, right - 20.0, bottom - 20.0]])
    found = kept(Detections(inner, np.ones(1), np.zeros(1, np.int64)), box, (columns, rows), 0.5, Counter())
    cut_x, cut_y = 20.0 / box.scale[0], 20.0 / box.scale[1]
    expected = [cut_x - 0.5, cut_y - 0.5, columns - 0.5 - cut_x, rows - 0.5 - cut_y]
    assert found.box_px[0] == pytest.approx(expected, abs=1e-6)
    assert blob.max() in (0.0, pytest.approx(GREY / 255))


def test_boxes_that_say_nothing_are_counted() -> None:
    """Weak, doubled, infinite, tiny and cut boxes do not come out; all but the first two are counted."""
    boxes = np.array(
        [
            [10.0, 10, 20, 20],
            [10, 10.5, 20, 20.5],
            [np.nan, 0, 9, 9],
            [30, 30, 31, 31],
            [0, 40, 10, 50],
            [60, 40, 70, 50],
        ]
    )
    score = np.array([0.9, 0.8, 0.9, 0.9, 0.9, 0.1])
    faults: Counter[str] = Counter()
    found = kept(Detections(boxes, score, np.arange(6)), Letterbox((1.0, 1.0), (0, 0)), (96, 64), 0.5, faults)
    assert found.class_index.tolist() == [0]
    assert {reason: n for reason, n in faults.items() if n} == {
        "box that is no box": 1,
        "box smaller than 3 px": 1,
        "box cut by the edge of the picture": 1,
    }
