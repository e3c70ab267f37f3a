"""Boards, detection and pictures: what ``--board`` means, and corners without bias."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from geoloc.calibration.intrinsics import View
from geoloc.cameras import CameraModel
from geoloc.errors import CalibrationError
from geoloc.simulation.pictures.board_views import draw_board_poses
from geoloc.simulation.pictures.render import Plane, render_planes
from twin.calibrate.boards.boards import Board, board_from_text
from twin.calibrate.boards.detect import DetectedBoard, detect
from twin.calibrate.boards.pictures import count, files_of, pictures
from twin.calibrate.intrinsics.example import example_camera
from twin.errors import ConfigError

BOARDS = ("checkerboard:9x6:0.08", "charuco:12x9:0.06:0.045")


def seen_and_true(
    board: Board, n: int, blur_px: float = 0.6, fill: tuple[float, float] = (0.4, 0.7)
) -> list[tuple[DetectedBoard, np.ndarray]]:
    """Detections in rendered pictures, and where the corners truly are."""
    camera: CameraModel = example_camera()
    texture, size = board.texture()
    rng, found = np.random.default_rng(11), []
    for rotation, position in draw_board_poses(camera, size, n, rng, fill=fill):
        image = render_planes(
            camera, [Plane(texture, size, rotation, position)], rng=rng, blur_px=blur_px, supersample=2
        )
        seen = detect(image, board, "picture")
        assert seen is not None
        corners = board.corners_m(seen.ids) + board.texture_offset_m
        point = np.column_stack([corners, np.zeros(len(corners))]) @ rotation.T + position
        true = camera.pixel_from_camera_point(point)[0]
        # A checkerboard turned by half a turn is the same board.
        turned = np.abs(true[::-1] - seen.view.pixel_px).max() < np.abs(true - seen.view.pixel_px).max()
        found.append((seen, true[::-1] if turned and board.kind == "checkerboard" else true))
    return found


@pytest.mark.parametrize("text", BOARDS)
def test_corners_are_found_without_bias(text: str) -> None:
    """In uneven light the mean error is below 0.002 px, and a coordinate is good to 0.015 px (RMS)."""
    found = seen_and_true(board_from_text(text), 4)
    off = np.concatenate([seen.view.pixel_px - true for seen, true in found])
    assert len(off) > 150
    assert np.abs(off.mean(axis=0)).max() < 0.002
    assert np.sqrt(np.mean(off**2)) < 0.015


@pytest.mark.parametrize("text", BOARDS)
def test_edges_tell_the_blur(text: str) -> None:
    """Edges are wider in a picture that is more blurred, by about as much."""
    board = board_from_text(text)
    sharp, blurred = (
        np.median([seen.edge_px for seen, _ in seen_and_true(board, 2, blur_px, (0.65, 0.8))])
        for blur_px in (0.5, 1.2)
    )
    assert 1.2 < sharp < 3.0
    assert 1.2 * sharp < blurred < 2.5 * sharp


def test_markers_are_measured_against_squares() -> None:
    """The side of a ChArUco board's markers comes out as the part of the square that was printed."""
    (seen, _), *_ = seen_and_true(board_from_text(BOARDS[1]), 1)
    assert seen.marker_part == pytest.approx(0.75, abs=0.01)


@pytest.mark.parametrize("text", BOARDS)
def test_board_is_its_text(text: str) -> None:
    """What is read is written again, defaults spelled out."""
    board = board_from_text(text)
    assert board.text.startswith(text)
    assert board_from_text(board.text) == board


def test_corners_count_from_the_top_left() -> None:
    """Numbers go along the rows, a square from the board's edge on."""
    board = board_from_text("checkerboard:4x3:0.1")
    np.testing.assert_allclose(board.corners_m(np.array([0, 3, 4])), [[0.1, 0.1], [0.4, 0.1], [0.1, 0.2]])
    assert board.n_corners == 12


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("chess:9x6:0.08", "The board is given as chess:9x6:0.08"),
        ("checkerboard:9x6", "The board is given as checkerboard:9x6"),
        ("checkerboard:9xsix:0.08", "a part that is no number"),
        ("checkerboard:9x6:80", "A square of 80 m cannot be"),
        ("checkerboard:2x6:0.08", "too small"),
        ("charuco:12x9:0.045:0.06", "do not fit into squares"),
        ("charuco:12x9:0.06:0.045:DICT_NONE", "There is no marker dictionary DICT_NONE"),
        ("charuco:24x17:0.06:0.045:DICT_4X4_50", "has 204 markers, DICT_4X4_50 only 50"),
    ],
)
def test_wrong_board_is_refused(text: str, message: str) -> None:
    """The sentence names the part that is wrong."""
    with pytest.raises(ConfigError, match=message):
        board_from_text(text)


def test_picture_without_a_board_gives_nothing() -> None:
    """Noise is no board."""
    noise = np.random.default_rng(1).integers(0, 255, (300, 400), dtype=np.uint8)
    for text in BOARDS:
        assert detect(noise, board_from_text(text), "noise") is None


def test_sources_are_pictures_films_and_folders(tmp_path: Path) -> None:
    """Folders are searched, other files refused, each with a sentence."""
    picture = np.full((20, 30), 7, dtype=np.uint8)
    for name in ("b.png", "a.PNG"):
        cv2.imwrite(str(tmp_path / name), picture)
    (tmp_path / "notes.txt").write_text("nothing", encoding="utf-8")
    files = files_of([tmp_path])
    assert [file.name for file in files] == ["a.PNG", "b.png"]
    assert count(files, None) == 2
    read = list(pictures(files))
    assert [p.name for p in read] == ["a.PNG", "b.png"]
    assert (read[0].grey == 7).all()
    (tmp_path / "empty").mkdir()
    for source, message in (
        (tmp_path / "none.png", "There is no file"),
        (tmp_path / "notes.txt", "neither a picture nor a film"),
        (tmp_path / "empty", "no pictures or films"),
    ):
        with pytest.raises(CalibrationError, match=message):
            files_of([source])


def test_pictures_that_cannot_be_used_are_named(tmp_path: Path) -> None:
    """A damaged picture, one of another size, and an empty film each say which file it is."""
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((20, 30), dtype=np.uint8))
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((25, 30), dtype=np.uint8))
    with pytest.raises(CalibrationError, match=r"b.png has 30 x 25 pixels and a.png 30 x 20"):
        list(pictures(files_of([tmp_path])))
    (tmp_path / "b.png").write_bytes(b"no picture")
    with pytest.raises(CalibrationError, match=r"b.png cannot be read as a picture"):
        list(pictures(files_of([tmp_path])))
    (tmp_path / "film.avi").write_bytes(b"no film")
    with pytest.raises(CalibrationError, match=r"film\.avi"):
        list(pictures([tmp_path / "film.avi"]))


def test_view_of_a_detection_is_what_calibration_takes() -> None:
    """Board places and pixels of a detection pair up."""
    (seen, _), *_ = seen_and_true(board_from_text(BOARDS[0]), 1)
    assert isinstance(seen.view, View)
    assert seen.view.board_m.shape == seen.view.pixel_px.shape == (54, 2)
