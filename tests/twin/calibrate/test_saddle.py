"""Sub-pixel corners: right wherever the board's neighbours put them, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from geoloc.simulation.pictures.board_views import draw_board_poses
from geoloc.simulation.pictures.render import Plane, render_planes
from twin.calibrate.boards.boards import board_from_text
from twin.calibrate.boards.detect import detect
from twin.calibrate.boards.saddle import local_maps, refined
from twin.calibrate.intrinsics.example import example_camera

GRID = np.column_stack([np.tile(np.arange(7.0), 6), np.repeat(np.arange(6.0), 7)])
SQUARE = np.array([[21.3, 6.1], [-4.2, 17.4]])
"""Pixels a square: columns to the right, rows down, on a plate that is seen aslant."""
PLACE = GRID @ SQUARE + (60.3, 22.6)


def drawn(blur_px: float = 0.7, light: float = 0.0) -> np.ndarray:
    """A checkerboard with its corners at `PLACE`, its light falling by this part from left to right."""
    v, u = np.mgrid[0:150, 0:220]
    square = (np.stack([u, v], axis=-1) - (60.3, 22.6)) @ np.linalg.inv(SQUARE)
    across = np.abs(np.linalg.det(SQUARE)) / np.linalg.norm(SQUARE, axis=1)[::-1]
    away = (square - np.rint(np.clip(square, (0, 0), (6, 5)))) * across / (np.sqrt(2.0) * blur_px)
    parity = (-1.0) ** np.rint(np.clip(square, (0, 0), (6, 5))).sum(axis=-1)
    grey = 120.0 + 80.0 * parity * np.prod(erf(away), axis=-1)
    return np.asarray(np.rint(grey * (1.0 - light * u / 220.0)), dtype=np.uint8)


def test_corners_of_a_foreshortened_board_are_as_good_as_any() -> None:
    """Far ends of boards tilted by 45 to 55° keep the window off markers: no corner is off by 0.15 px.

    A square window of one size for the whole picture (`cornerSubPix`) is off by 2 px there, which made
    calibrations wrong by more than their sigmas.
    """
    board, camera, rng = (
        board_from_text("charuco:12x9:0.06:0.045"),
        example_camera(),
        np.random.default_rng(11),
    )
    texture, size = board.texture()
    errors = []
    for rotation, position in draw_board_poses(
        camera, size, 4, rng, fill=(0.5, 0.9), tilt_deg=(45.0, 55.0), inside=0.75
    ):
        image = render_planes(camera, [Plane(texture, size, rotation, position)], rng=rng, supersample=2)
        seen = detect(image, board, "picture")
        assert seen is not None
        place = np.column_stack([board.corners_m(seen.ids) + board.texture_offset_m, 0.0 * seen.ids])
        true = camera.pixel_from_camera_point(place @ rotation.T + position)[0]
        errors.append(np.linalg.norm(seen.view.pixel_px - true, axis=1))
    off = np.concatenate(errors)
    assert len(off) > 200
    assert off.max() < 0.15
    assert np.sqrt(np.mean(off**2)) < 0.02


@pytest.mark.parametrize("light", [0.0, 0.6])
def test_uneven_light_does_not_move_corners(light: float) -> None:
    """Light multiplies what the print reflects: a steep fall of it leaves every corner in its place."""
    found, good = refined(drawn(light=light), GRID, np.rint(PLACE), 0.5)
    assert good.all()
    np.testing.assert_allclose(found, PLACE, atol=0.01)
    assert np.abs((found - PLACE).mean(axis=0)).max() < 1e-3


def test_coarse_corner_that_is_wrong_is_found_by_its_neighbours() -> None:
    """One that was detected 5 px aside comes back to where the others say that it is."""
    coarse = PLACE.copy()
    coarse[17] += (5.0, -3.0)
    found, good = refined(drawn(), GRID, coarse, 0.5)
    assert good.all()
    np.testing.assert_allclose(found[17], PLACE[17], atol=0.02)


def test_what_is_no_corner_is_not_found() -> None:
    """A corner under grey tape, one on a plain edge, and one at the image's border are left out."""
    image = drawn()
    for number, (left, right) in ((9, (90, 90)), (25, (40, 200))):
        u, v = np.rint(PLACE[number]).astype(int)
        image[v - 11 : v + 12, u - 11 : u + 1] = left
        image[v - 11 : v + 12, u + 1 : u + 12] = right
    top = int(PLACE[0, 1]) - 1
    moved = PLACE - (0.0, top)
    found, good = refined(image[top:], GRID, moved, 0.5)
    assert not good[[0, 9, 25]].any()
    apart = np.linalg.norm(PLACE[:, np.newaxis] - PLACE[[0, 9, 25]], axis=-1).min(axis=1)
    assert good[apart > 25.0].all()
    np.testing.assert_allclose(found[apart > 25.0], moved[apart > 25.0], atol=0.02)


def test_corners_in_one_line_tell_no_map() -> None:
    """A row of corners does not say which way the columns go: nothing is found, and nothing breaks."""
    row = GRID[:, 1] == 2.0
    _, good = refined(drawn(), GRID[row], PLACE[row], 0.5)
    assert not good.any()


def test_local_maps_are_the_derivatives_of_the_grid() -> None:
    """On a plane that is bent by a parabola, slopes and curvature come out to a hundredth of a pixel."""
    bent = PLACE + 0.05 * GRID[:, :1] ** 2 * np.array([[1.0, -2.0]])
    maps = local_maps(GRID, bent, np.ones(len(GRID), dtype=bool), 9)
    middle = 17
    np.testing.assert_allclose(maps[middle, 0], bent[middle], atol=0.01)
    np.testing.assert_allclose(
        maps[middle, 1], SQUARE[0] + 0.1 * GRID[middle, 0] * np.array([1, -2]), atol=0.01
    )
    np.testing.assert_allclose(maps[middle, 2], SQUARE[1], atol=0.01)
    np.testing.assert_allclose(maps[middle, 3], [0.1, -0.2], atol=0.01)
