"""Which views of a board are missing, against how the boards were truly held."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.calibration.intrinsics import View
from geoloc.calibration.intrinsics.missing_views import Reach, ShownViews, Tilt, shown_views
from geoloc.cameras import FThetaCamera
from geoloc.simulation.pictures.board_views import draw_board_poses

CAMERA = FThetaCamera(960, 604, 477.6, 305.4, (0.0, 2.08e-3, 0.0, -6e-10))
POINTS = np.stack(np.meshgrid(np.arange(1, 12) * 0.06, np.arange(1, 9) * 0.06), axis=-1).reshape(-1, 2)
SIZE = (0.72, 0.54)


def held(n: int, seed: int, **how: tuple[float, float]) -> tuple[list[View], list[Tilt], list[float]]:
    """Views of a board, the side that is truly nearer in the picture, and the true tilts in degrees."""
    views, nearer, tilts = [], [], []
    poses = draw_board_poses(CAMERA, SIZE, n, np.random.default_rng(seed), **how)
    for number, (rotation, position) in enumerate(poses):
        point = np.column_stack([POINTS, np.zeros(len(POINTS))]) @ rotation.T + position
        pixel, _ = CAMERA.pixel_from_camera_point(point)
        views.append(View(f"{number}", POINTS, pixel))
        far = np.linalg.norm(point, axis=1)
        # The slope of the distance over the picture says which side is nearer.
        across, down, _ = np.linalg.lstsq(np.column_stack([pixel, np.ones(len(far))]), far, rcond=None)[0]
        sides = {Tilt.RIGHT: -across, Tilt.LEFT: across, Tilt.BOTTOM: -down, Tilt.TOP: down}
        nearer.append(max(sides, key=lambda side: sides[side]))
        middle = point.mean(axis=0)
        cosine = rotation[:, 2] @ middle / np.linalg.norm(middle)
        tilts.append(float(np.degrees(np.arccos(cosine))))
    return views, nearer, tilts


def test_tilts_are_those_of_the_board() -> None:
    """Tilts are right to 6°, and so is the nearer side where the board is tilted, both from corners alone."""
    views, nearer, tilts = held(40, 3, tilt_deg=(5.0, 50.0))
    shown = shown_views(views, 960, 604).views
    assert len(shown) == 40
    np.testing.assert_allclose([s.tilt_deg for s in shown], tilts, atol=6.0)
    told = [(s.tilt, side) for s, side, tilt in zip(shown, nearer, tilts, strict=True) if 22.0 < tilt < 50.0]
    assert len(told) > 15
    # Between two sides either is right.
    assert sum(a is b for a, b in told) >= 0.85 * len(told)


def test_few_and_straight_views_lack_what_they_lack() -> None:
    """Straight boards in the middle lack tilts and corners; the next views ask for just these."""
    views, *_ = held(6, 1, tilt_deg=(0.0, 5.0), fill=(0.64, 0.68))
    shown: ShownViews = shown_views(views, 960, 604)
    assert {tilt for tilt in Tilt if shown.lacking[tilt]} == set(Tilt)
    assert shown.lacking[Reach.MIDDLING] > 0
    assert shown.lacking[Reach.NEAR] == 0
    wanted = shown.next_views(4)
    assert {view.tilt for view in wanted} == set(Tilt)
    zones = shown.zone_views.ravel()
    assert zones[wanted[0].zone] == zones.min()


def test_many_good_views_are_enough_and_copies_count_once() -> None:
    """Well-spread views end the asking; the same views twice are not twice as many."""
    views, *_ = held(50, 2, tilt_deg=(15.0, 50.0), fill=(0.4, 0.95))
    shown = shown_views(views, 960, 604)
    few = shown_views([*views[:10], *views[:10]], 960, 604)
    assert few.n_alike == 10
    assert len(few.views) == 10
    assert shown.n_missing < few.n_missing
    assert shown.lacking.total() == 0


def test_nothing_yet_lacks_everything() -> None:
    """Before the first picture all is missing, and there is a hint."""
    shown = shown_views([], 960, 604)
    assert shown.n_missing >= 30
    assert len(shown.next_views(3)) == 3
    assert shown.zone_views.sum() == pytest.approx(0.0)
