"""Choice of views: sharp ones, spread over the image, over distances and over tilts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geoloc.calibration.views import FloatArray, View

_BLUR_FACTOR, _BLUR_SLACK_PX = 1.6, 1.0
_SPREAD = np.array([0.3, 0.3, 0.4, 0.2, 0.2])
"""Differences that count alike: place (parts of the image), logarithms of size and of foreshortening."""


def sharp(edge_px: FloatArray) -> NDArray[np.bool_]:
    """Which views (v,) are about as sharp as most, by the width of the print's edges in them.

    Left out is what is wider than 1.6 times the median, and by a pixel more: moved, or out of focus.
    Views whose edges could not be measured (NaN) stay.
    """
    known = edge_px[np.isfinite(edge_px)]
    limit = _BLUR_FACTOR * float(np.median(known)) + _BLUR_SLACK_PX if known.size else np.inf
    return np.asarray(~(edge_px > limit))


def spread(views: Sequence[View], width_px: int, height_px: int, n: int) -> NDArray[np.intp]:
    """Numbers of n views as different from each other as can be, in rising order; all if there are no more.

    Each view is a point: where the board is, how large, and how much it is foreshortened in which direction.
    The view farthest from the middle comes first, then whichever is farthest from all those taken (Gonzalez
    1985).
    """
    if len(views) <= n:
        return np.arange(len(views))
    points = np.array([_description(view, width_px, height_px) for view in views])
    points = (points - points.mean(axis=0)) / _SPREAD
    taken = [int(np.linalg.norm(points, axis=1).argmax())]
    apart = np.full(len(points), np.inf)
    for _ in range(n - 1):
        apart = np.minimum(apart, np.linalg.norm(points - points[taken[-1]], axis=1))
        taken.append(int(apart.argmax()))
    return np.sort(np.array(taken))


def _description(view: View, width_px: int, height_px: int) -> FloatArray:
    """Place (2), logarithm of the size, and foreshortening by its direction in the image (2)."""
    pixel = view.pixel_px - view.pixel_px.mean(axis=0)
    board = view.board_m - view.board_m.mean(axis=0)
    linear, *_ = np.linalg.lstsq(board / np.abs(board).max(), pixel, rcond=None)
    _, (long, short), axes = np.linalg.svd(linear)
    turn = 2.0 * np.arctan2(axes[0, 1], axes[0, 0])
    ratio = np.log(long / max(short, 1e-9))
    place = view.pixel_px.mean(axis=0) / (width_px, height_px)
    size = np.log(np.sqrt(long * max(short, 1e-9)) / width_px)
    return np.array([*place, size, ratio * np.cos(turn), ratio * np.sin(turn)])
