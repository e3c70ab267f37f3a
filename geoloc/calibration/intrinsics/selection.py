"""Choice of views: sharp ones, spread over the image, over distances and over tilts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.calibration.intrinsics.views import View

_BLUR_FACTOR, _BLUR_SLACK_PX = 1.6, 1.0
_SPREAD = np.array([0.3, 0.3, 0.4, 0.2, 0.2])
"""Differences that count alike: place (parts of the image), logarithms of size and of foreshortening."""
_SAME_PLACE, _SAME_FORM = 0.01, 0.01
"""Views are the same that differ by less: in place (part of the image's width), and in form (RMS of corners'
shifts but for the mean one, as part of the board's size in the image: 0.6° of turn, 1 % of distance)."""


def sharp(edge_px: FloatArray) -> NDArray[np.bool_]:
    """Which views (v,) are about as sharp as most, by the width of the print's edges in them.

    Left out is what is wider than 1.6 times the median, and by a pixel more: moved, or out of focus.
    Views whose edges could not be measured (NaN) stay.
    """
    known = edge_px[np.isfinite(edge_px)]
    limit = _BLUR_FACTOR * float(np.median(known)) + _BLUR_SLACK_PX if known.size else np.inf
    return np.asarray(~(edge_px > limit))


def alike(views: Sequence[View], width_px: int, edge_px: FloatArray) -> dict[int, int]:
    """Views that show the board just as another one does: their number → the number of the one to keep.

    Of views that are the same, the sharpest (by `edge_px`, see `sharp`) is kept: the others have its errors
    too, and would only make everything look surer than it is.
    """
    kept: list[int] = []
    same: dict[int, int] = {}
    for number in np.argsort(edge_px, kind="stable").tolist():
        like = next((k for k in kept if _same(views[number], views[k], width_px)), None)
        if like is None:
            kept.append(number)
        else:
            same[number] = like
    return same


def _same(a: View, b: View, width_px: int) -> bool:
    number_of = {tuple(corner): n for n, corner in enumerate(np.round(b.board_m, 9).tolist())}
    pairs = [
        (n, number_of[tuple(corner)])
        for n, corner in enumerate(np.round(a.board_m, 9).tolist())
        if tuple(corner) in number_of
    ]
    # Less than most of the corners in common: the image's edge cuts the board elsewhere.
    if len(pairs) < 0.8 * max(len(a.board_m), len(b.board_m)):
        return False
    first, second = np.array(pairs).T
    one, off = a.pixel_px[first], b.pixel_px[second] - a.pixel_px[first]
    moved = off.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((one - one.mean(axis=0)) ** 2, axis=1))))
    changed = float(np.sqrt(np.mean(np.sum((off - moved) ** 2, axis=1))))
    return bool(np.linalg.norm(moved) < _SAME_PLACE * width_px and changed < _SAME_FORM * size)


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
