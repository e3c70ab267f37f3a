"""AprilTags are read as their authors print them, by any OpenCV and from any generator's print."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest
from yard_scene import MODELS, RIG, off, pictures_of

from geoloc.arrays import ByteArray, FloatArray
from geoloc.calibration.extrinsics import calibrate_extrinsics
from geoloc.calibration.extrinsics.tag_family import FAMILY, dictionary_of, turned
from geoloc.cameras import PinholeCamera
from geoloc.simulation.pictures.yard import Yard, draw_yard
from twin.calibrate.boards.boards import board_from_text
from twin.calibrate.boards.detect import detect
from twin.calibrate.extrinsics.tag_corners import find_tags

CODE_3 = 0xD7E00984B
"""Tag 0 of 36h11 as AprilTag 3 has it (tag36h11.c): the first bit highest, in a spiral of four quarters."""
SPIRAL = (
    *((1, 1), (2, 1), (3, 1), (4, 1), (5, 1), (2, 2), (3, 2), (4, 2), (3, 3)),
    *((6, 1), (6, 2), (6, 3), (6, 4), (6, 5), (5, 2), (5, 3), (5, 4), (4, 3)),
    *((6, 6), (5, 6), (4, 6), (3, 6), (2, 6), (5, 5), (4, 5), (3, 5), (4, 4)),
    *((1, 6), (1, 5), (1, 4), (1, 3), (1, 2), (2, 5), (2, 4), (2, 3), (3, 4)),
)
"""Column and row of each bit, counted from the black border's first cell."""
OUTLINE = np.array([[180.0, 120.0], [420.0, 150.0], [400.0, 390.0], [160.0, 350.0]])


def official_tag_0() -> ByteArray:
    """Ten by ten cells of the authors' print, white margin included."""
    cells = np.full((10, 10), 255, dtype=np.uint8)
    cells[1:9, 1:9] = 0
    for bit, (column, row) in enumerate(SPIRAL):
        cells[1 + row, 1 + column] = 255 * (CODE_3 >> (35 - bit) & 1)
    return cells


def pictured(cells: ByteArray) -> ByteArray:
    """The print on a grey wall, its black square's corners at `OUTLINE`, by OpenCV's own warp."""
    side = 40
    big = np.kron(cells, np.ones((side, side), dtype=np.uint8))
    black = np.array([[1, 1], [9, 1], [9, 9], [1, 9]], dtype=np.float32) * side - 0.5
    warp = cv2.getPerspectiveTransform(black, OUTLINE.astype(np.float32))
    size = (600, 480)
    there = cv2.warpPerspective(np.full_like(big, 255), warp, size)
    drawn = cv2.warpPerspective(big, warp, size, flags=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(np.where(there > 127, drawn, 150).astype(np.uint8), (0, 0), 0.8))


@pytest.fixture(params=[0, 2], ids=["this OpenCV", "an OpenCV whose tables are turned"])
def any_opencv(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """OpenCV's tables as they are, and as a change of OpenCV turns them."""
    real = cv2.aruco.getPredefinedDictionary

    def changed(name: int) -> cv2.aruco.Dictionary:
        return turned(real(name), request.param) if request.param else real(name)

    monkeypatch.setattr(cv2.aruco, "getPredefinedDictionary", changed)
    dictionary_of.cache_clear()
    yield
    dictionary_of.cache_clear()


@pytest.mark.usefixtures("any_opencv")
def test_first_corner_is_the_top_left_of_the_authors_print() -> None:
    """The authors' tag 0, drawn from their own code, comes back with its corners in the print's order."""
    found = find_tags(pictured(official_tag_0()), PinholeCamera(600, 480, 700.0, 700.0, 300.0, 240.0))
    assert found.ids.tolist() == [0]
    assert np.abs(found.corners_px[0] - OUTLINE).max() < 0.5
    ours = cv2.aruco.generateImageMarker(dictionary_of(FAMILY), 0, 8, borderBits=1)
    assert np.array_equal(ours, official_tag_0()[1:9, 1:9])


@pytest.mark.usefixtures("any_opencv")
@pytest.mark.parametrize("turns", [0, 2])
def test_boards_with_apriltags_of_either_way_are_read(turns: int) -> None:
    """The corners of a ChArUco board are the same whichever way up its AprilTags were printed."""
    board = board_from_text(f"charuco:8x6:0.04:0.03:{FAMILY}")
    print_ = board.aruco(turns).generateImage((640, 480), marginSize=0)
    seen = detect(np.pad(np.asarray(print_), 60, constant_values=255), board, "print")
    assert seen is not None
    expected = 60.0 + 80.0 * (np.column_stack([seen.ids % 7, seen.ids // 7]) + 1.0) - 0.5
    assert len(seen.ids) == 35
    assert np.abs(seen.view.pixel_px - expected).max() < 0.1


def measured_corners(yard: Yard, upside_down: tuple[int, ...]) -> Yard:
    """Five tags of which three corners were measured and no middle; of some the opposite ones."""
    tags = dict(yard.tags)
    for number in (3, 9, 10, 12, 18):
        corners: FloatArray = tags[number].corners_m()[:3]
        stood = -corners if number in upside_down else corners
        place = stood @ yard.poses[number].R.T + yard.poses[number].t_m
        tags[number] = replace(
            tags[number], centre_m=np.full(3, np.nan), marks_m=corners, mark_places_m=place
        )
    return Yard(tags, yard.poses)


@pytest.mark.parametrize("upside_down", [(), (9,), (3, 9, 10, 12, 18)])
def test_corners_of_prints_that_are_upside_down_are_taken_so(upside_down: tuple[int, ...]) -> None:
    """Tags named by the other generator's corners give the same cameras, and are told."""
    yard = measured_corners(draw_yard(np.random.default_rng(5)), upside_down)
    found = calibrate_extrinsics(MODELS, pictures_of(yard, 6), yard.tags)
    assert found.turned == upside_down
    assert found.misplaced == {}
    for camera in RIG.cameras:
        assert np.abs(off(found, camera)[:3]).max() < 0.02
