"""Which views are used: sharp ones, and such as differ."""

from __future__ import annotations

import numpy as np

from geoloc.calibration.intrinsics import View, alike, sharp, spread

BOARD = np.argwhere(np.ones((5, 4))).astype(np.float64) * 0.1


def view(name: str, shift: tuple[float, float], scale: float = 300.0, squeeze: float = 1.0) -> View:
    """A board straight on, at a place, of a size, made narrower."""
    return View(name, BOARD, BOARD * (scale * squeeze, scale) + shift)


def test_blurred_views_are_told_by_their_edges() -> None:
    """A view with edges much wider than most is not sharp; one that could not be measured stays."""
    edges = np.array([2.0, 2.2, 2.1, 5.0, np.nan, 2.4])
    assert sharp(edges).tolist() == [True, True, True, False, True, True]


def test_views_all_alike_in_blur_stay() -> None:
    """Blur that all views share is no reason to leave one out."""
    assert sharp(np.full(6, 9.0)).all()
    assert sharp(np.full(3, np.nan)).all()


def test_spread_takes_views_that_differ_in_place_size_and_tilt() -> None:
    """Of forty views nearly alike and four that differ, the four are taken."""
    rng = np.random.default_rng(1)
    alike = [view(f"alike {i}", tuple(500.0 + rng.normal(scale=3.0, size=2))) for i in range(40)]
    others = [
        view("left", (20.0, 500.0)),
        view("near", (300.0, 300.0), scale=900.0),
        view("tilted", (500.0, 500.0), squeeze=0.5),
        view("right", (1500.0, 400.0)),
    ]
    taken = spread([*alike, *others], 1920, 1208, 5)
    assert set(range(40, 44)) <= set(taken.tolist())
    assert len(taken) == 5


def test_spread_keeps_all_views_if_there_are_no_more() -> None:
    """Fewer views than may be used are all used, in their order."""
    views = [view(str(i), (100.0 * i, 50.0)) for i in range(4)]
    assert spread(views, 1920, 1208, 10).tolist() == [0, 1, 2, 3]


def test_views_that_are_the_same_count_once() -> None:
    """Of views that show the board alike the sharpest is kept; place, size and form make others of them."""
    views = [
        view("blurred", (500.0, 500.0)),
        view("sharp", (503.0, 499.0)),
        view("larger", (500.0, 500.0), scale=310.0),
        view("aside", (530.0, 500.0)),
        view("tilted", (500.0, 500.0), squeeze=0.96),
    ]
    assert alike(views, 1920, np.array([3.0, 2.0, 2.0, 2.0, 2.0])) == {0: 1}
