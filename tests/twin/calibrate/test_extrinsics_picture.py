"""The picture of a calibration of extrinsics: what is written in it can be read."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from yard_scene import MODELS, pictures_of

from geoloc.calibration.extrinsics import Sigmas, calibrate_extrinsics
from geoloc.simulation.pictures.yard import draw_yard
from twin.calibrate.extrinsics.layout import YardLayout
from twin.calibrate.extrinsics.picture import extrinsics_figure

MISPLACED = 8


@pytest.fixture(scope="module")
def figure() -> Figure:
    """A yard in which one tag's place was measured 12 cm wrong."""
    yard = draw_yard(np.random.default_rng(31))
    tag = yard.tags[MISPLACED]
    tags = {**yard.tags, MISPLACED: replace(tag, centre_m=tag.centre_m + np.array([0.12, 0.0, 0.0]))}
    found = calibrate_extrinsics(MODELS, pictures_of(yard), tags)
    assert list(found.misplaced) == [MISPLACED]
    made = extrinsics_figure(found, YardLayout(tags, {}, Sigmas()))
    FigureCanvasAgg(made).draw()
    return made


def test_no_two_texts_of_a_view_lie_over_each_other(figure: Figure) -> None:
    """From above every number has room of its own, and from the side too."""
    for axes in figure.axes:
        boxes = [text.get_window_extent() for text in axes.texts]
        assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
        inside = axes.get_window_extent()
        assert all(inside.contains(*corner) for box in boxes for corner in (box.min, box.max))


def test_side_view_numbers_doubtful_tags_alone(figure: Figure) -> None:
    """Tags hide each other from the side: only the misplaced one is numbered there, red as from above."""
    plan, side, _ = figure.axes
    (number,) = (text for text in side.texts if text.get_text().isdigit())
    assert number.get_text() == str(MISPLACED)
    red = {text.get_text() for text in plan.texts if text.get_color() == number.get_color()}
    assert red == {str(MISPLACED)}
    assert sum(text.get_text().isdigit() for text in plan.texts) > 15
