"""Printed boards, tags and yards: the PDF as another program shows it, before our detectors and a rule."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pypdfium2
import pytest
from command_line import Twin

from geoloc.arrays import ByteArray
from geoloc.calibration.extrinsics import Pose, Tag
from geoloc.cameras import PinholeCamera
from geoloc.rig.rig import Rig, rig_document
from geoloc.simulation.pictures.yard import Yard, yard_picture
from twin.calibrate.boards.boards import board_from_text
from twin.calibrate.boards.detect import detect
from twin.calibrate.extrinsics.example import example_rig
from twin.calibrate.extrinsics.layout import read_layout
from twin.calibrate.extrinsics.tag_corners import find_tags
from twin.calibrate.prints.yard_places import planned_tags

PX_A_MM = 4.0 * (1.0 - 1e-7)
"""A hair below 4: PDFium takes the next whole number of pixels, and stretches what is on the page."""
TAG_0 = 0xD5D628584
"""Of the AprilTag library's tag36h11.c: a bit a cell, row by row from the top left, white is 1."""


def shown(path: Path, page: int = 0) -> tuple[ByteArray, tuple[float, float]]:
    """A page as PDFium shows it, and its size in millimetres."""
    with pypdfium2.PdfDocument(path) as document:
        whole = document[page]
        size = whole.get_size()
        grey = whole.render(scale=PX_A_MM * 25.4 / 72.0, grayscale=True).to_numpy()
        return np.array(grey).reshape(grey.shape[:2]), (size[0] / 72.0 * 25.4, size[1] / 72.0 * 25.4)


@pytest.mark.parametrize(
    ("text", "page"),
    [
        ("charuco:12x9:0.02:0.015", (297.0, 210.0)),
        ("charuco:5x7:0.03:0.022:DICT_4X4_50", (210.0, 297.0)),
        ("checkerboard:9x6:0.025", (297.0, 210.0)),
    ],
)
def test_boards_are_read_at_the_size_that_they_say(
    text: str, page: tuple[float, float], twin: Twin, tmp_path: Path
) -> None:
    """Every corner is where the text of the board puts it, to 0.02 mm, on the smallest page that holds it."""
    answer = twin("calibrate", "print-board", text, "--out", tmp_path / "board.pdf")
    assert answer.code == 0, answer.err
    grey, size = shown(tmp_path / "board.pdf")
    assert size == pytest.approx(page, abs=0.01)
    board = board_from_text(text)
    found = detect(grey, board, "print")
    assert found is not None
    assert len(found.ids) == board.n_corners
    places = found.view.pixel_px / PX_A_MM
    stated = 1000.0 * found.view.board_m
    turned = -1.0 if (places[-1] - places[0])[1] * (stated[-1] - stated[0])[1] < 0.0 else 1.0
    off = (places - places.mean(axis=0)) - turned * (stated - stated.mean(axis=0))
    assert np.abs(off).max() < 0.02


def test_apriltags_of_boards_have_their_makers_way_up(twin: Twin, tmp_path: Path) -> None:
    """A board of AprilTags is read by their own dictionary, not by one that is turned."""
    text = "charuco:5x7:0.03:0.022:DICT_APRILTAG_36h11"
    assert twin("calibrate", "print-board", text, "--out", tmp_path / "board.pdf").code == 0
    grey, _ = shown(tmp_path / "board.pdf")
    board = board_from_text(text)
    _, ids, _, _ = cv2.aruco.CharucoDetector(board.aruco()).detectBoard(grey)
    assert ids is not None
    assert len(ids) == board.n_corners


def test_tags_are_the_official_ones_the_right_way_up_and_size(twin: Twin, tmp_path: Path) -> None:
    """Each page has its tag; tag 0's cells are AprilTag's own bits; a side is 100 mm to 0.05."""
    out = tmp_path / "tags.pdf"
    assert twin("calibrate", "print-tags", "0,7-8", "--size", "0.1", "--out", out).code == 0
    for page, number in enumerate((0, 7, 8)):
        grey, _ = shown(out, page)
        height, width = grey.shape
        flat = PinholeCamera(width, height, 9e4, 9e4, width / 2, height / 2)
        found = find_tags(grey, flat)
        assert found.ids.tolist() == [number]
        corners_mm = found.corners_px[0] / PX_A_MM
        sides = np.linalg.norm(corners_mm - np.roll(corners_mm, 1, axis=0), axis=1)
        np.testing.assert_allclose(sides, 100.0, atol=0.05)
        if number == 0:
            low = found.corners_px[0].min(axis=0)
            cell = (found.corners_px[0].max(axis=0) - low) / 8.0
            v, u = np.mgrid[1:7, 1:7] + 0.5
            bits = grey[(low[1] + v * cell[1]).astype(int), (low[0] + u * cell[0]).astype(int)] > 127
            assert int("".join("1" if bit else "0" for bit in bits.ravel()), 2) == TAG_0


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (["print-board", "charuco:12x9:0.06:0.045", "--page", "A2"], "does not fit on A2: take A1"),
        (["print-board", "charuco:12x9:0.06:0.045", "--page", "letter"], "There is no page letter"),
        (["print-tags", "5", "--size", "0.9"], "print it smaller"),
        (["print-tags", "580-590"], "ids of 0 to 586"),
        (["print-board", "charuco:12x9:0.02:0.015", "--out", "board.png"], "let its name end in .pdf"),
    ],
)
def test_what_cannot_be_printed_is_told_in_one_sentence(command: list[str], told: str, twin: Twin) -> None:
    """What does not fit its page, and what is none, ends with exit code 2 and the cure."""
    answer = twin("calibrate", *command)
    assert answer.code == 2
    assert told in answer.err


def stood(rig: Rig, size_m: float) -> tuple[Yard, dict[str, set[int]]]:
    """A planned yard as somebody stood it up, facing the car, and which tags each camera is to see."""
    tags, poses, seen = {}, {}, {name: set[int]() for name in rig.cameras}
    for plan in planned_tags(rig, size_m):
        place = np.array(plan.place_m)
        rotation = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
        if not plan.on_floor:
            into = np.append(place[:2] - (1.8, 0.0), 0.0) / np.linalg.norm(place[:2] - (1.8, 0.0))
            down = np.array([0.0, 0.0, -1.0])
            rotation = np.stack([np.cross(down, into), down, into], axis=1)
        poses[plan.id] = Pose(rotation, place)
        tags[plan.id] = Tag(plan.id, size_m)
        for name in plan.cameras:
            seen[name].add(plan.id)
    return Yard(tags, poses), seen


@pytest.mark.slow
def test_every_tag_of_a_planned_yard_is_seen_by_the_cameras_it_is_for() -> None:
    """In rendered pictures of the yard each camera's tags are found, at least eight, none behind another."""
    rig = example_rig()
    yard, seen = stood(rig, 0.5)
    for name in ("C1_front60Single", "C3_tricam120"):
        picture = yard_picture(yard, rig.cameras[name], np.random.default_rng(0))
        found = set(find_tags(picture, rig.cameras[name].model).ids.tolist())
        assert seen[name] <= found
        assert len(seen[name]) >= 8


def with_unplaced(rig: Path) -> Path:
    """The same rig, its cameras' places not known."""
    document = json.loads(rig.read_text())
    for sensor in document["rig"]["sensors"]:
        sensor["nominalSensor2Rig_FLU"]["t"] = [0.0, 0.0, 0.0]
    rig.write_text(json.dumps(document))
    return rig


@pytest.mark.slow
def test_yard_is_written_with_its_layout_and_tags(twin: Twin, tmp_path: Path) -> None:
    """From a rig: a plan, a page a tag, and a layout that `extrinsics` reads as it stands."""
    rig = tmp_path / "rig.json"
    rig.write_text(json.dumps(rig_document(example_rig())))
    answer = twin("calibrate", "print-yard", rig, "--size", "0.3", "--out", tmp_path / "yard")
    assert answer.code == 0, answer.err
    layout = read_layout((tmp_path / "yard" / "layout.toml").read_bytes(), "layout.toml")
    assert 2 <= sum(tag.on_floor for tag in layout.tags.values()) <= 10
    with pypdfium2.PdfDocument(tmp_path / "yard" / "tags.pdf") as document:
        assert len(document) == len(layout.tags) >= 15
    with pypdfium2.PdfDocument(tmp_path / "yard" / "plan.pdf") as document:
        text = document[1].get_textpage().get_text_bounded()
    assert all(name in text for name in ("seen by", "C1_front60Single", "measured", "floor"))
    measured = (tmp_path / "yard" / "layout.toml").read_text() + "# 4 mm\n"
    (tmp_path / "yard" / "layout.toml").write_text(measured)
    again = twin("calibrate", "print-yard", rig, "--size", "0.3", "--out", tmp_path / "yard")
    assert again.code == 5
    assert (tmp_path / "yard" / "layout.toml").read_text() == measured, "what somebody measured stays"
    empty = twin("calibrate", "print-yard", with_unplaced(rig), "--out", tmp_path / "none")
    assert empty.code == 2
    assert "does not say where a camera sits" in empty.err
