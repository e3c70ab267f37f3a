"""The sign's face in a picture in which only the pole's foot was annotated: found by its code's outline.

A rectangle above the foot would protect whoever stands behind it. So the outline that the code says (a
circle, a triangle …) is looked for inside that rectangle, and what is found is protected; nothing else is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from twin.drawings import face

Image = NDArray[np.uint8]

_SIZES_M = (0.4, 1.0)
"""Narrowest and widest face."""
_AXIS_M = 0.35
"""How far beside the foot a face's middle may be: the pole leans, and the foot was clicked by hand."""
_EDGE = 14.0
"""Grey values over two pixels that make an edge."""
_FOUND = 0.8
"""Share of the outline that must lie on edges that cross it."""
_AS_GOOD, _SAME_MIDDLE_M = 0.85, 0.06
_SMALLEST_PX = 9.0
_FEW_POINTS, _POINTS = 24, 64
_COARSE_PX_PER_M, _FOUND_COARSELY = 40.0, 0.6
"""What is enough to see where a face may be, and how well its outline must fit there."""
_GROWN, _GROWN_PX = 1.03, 1.0


class _Edges(NamedTuple):
    """Strongest slope of a colour at each pixel, as a vector."""

    across: FloatArray
    down: FloatArray


class _Grid(NamedTuple):
    """Middles to try: every one of these columns in every one of these rows."""

    u: FloatArray
    v: FloatArray


def find_faces(
    image: Image, window_px: FloatArray, codes: Sequence[str], metre_px: FloatArray
) -> tuple[FloatArray, ...]:
    """Find the faces of a pole's plates.

    Parameters
    ----------
    image : uint8 (rows, columns, 3)
        The whole frame.
    window_px : float64 (k, 2)
        Where they are, see :class:`twin.evidence.sights.Sight`.
    codes : sequence of str
        Of the plates; those whose outline is not known are left out.
    metre_px : float64 (k, 2, 2)
        What a metre to the right, and one down, is in pixels at the face, for each way that it may look.

    Returns
    -------
    tuple of float64 (k, 2)
        An outline each, in pixels of the frame, a little wider than the face; those that were not found are
        left out.
    """
    found: list[FloatArray] = []
    left, top = np.maximum(np.floor(window_px.min(axis=0)).astype(int) - 4, 0).tolist()
    right, low = (np.ceil(window_px.max(axis=0)).astype(int) + 4).tolist()
    origin = np.array([left, top])
    scales = _scales(image[top:low, left:right], float(np.hypot(*metre_px[0, 0])))
    for code in dict.fromkeys(codes):
        if code.startswith(_UNDER_PLATE) and found:
            window = _under(found[-1])
        elif code.startswith(_ONE_FORM):
            window = window_px - origin
        else:
            continue
        best = _best(scales, [_outline(code) @ way for way in metre_px], window)
        if best is not None:
            found.append(best)
    return tuple(one + origin for one in found)


class _Scale(NamedTuple):
    """Edges of a picture that was made smaller by a factor."""

    edges: _Edges
    factor: float


def _scales(image: Image, px_per_m: float) -> tuple[_Scale, _Scale]:
    """The picture with as few pixels as show a face, and as it is."""
    import cv2

    factor = max(px_per_m / _COARSE_PX_PER_M, 1.0)
    rows, columns = image.shape[:2]
    size = max(round(columns / factor), 1), max(round(rows / factor), 1)
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return _Scale(_edges(small), factor), _Scale(_edges(image), 1.0)


def outline_of(code: str) -> FloatArray | None:
    """Outline (k, 2) of a face by its code, in units of its width about its middle; None if it varies."""
    return _outline(code) if code.startswith(_ONE_FORM) else None


def _outline(code: str) -> FloatArray:
    sign = face(code)
    return (np.array(sign.outline) - [50.0, sign.height / 2]) / 100.0


_ONE_FORM, _UNDER_PLATE = tuple("12345"), "8"
"""Warning, priority, prohibition, mandatory and information signs have one form each; a plate under one of
them is looked for there alone; direction signs have any form."""


def _under(face_px: FloatArray) -> FloatArray:
    """Where a plate under a face is: two opposite corners of a box in its pixels."""
    (left, top), (right, low) = face_px.min(axis=0), face_px.max(axis=0)
    return np.array([[left, low - 0.1 * (low - top)], [right, low + 0.8 * (right - left)]])


def _edges(image: Image) -> _Edges:
    import cv2

    smooth = cv2.GaussianBlur(image, (3, 3), 0).astype(np.float32)
    across = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3) / 4.0
    down = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3) / 4.0
    strongest = np.argmax(across**2 + down**2, axis=2)[..., None]
    pick = [np.take_along_axis(part, strongest, axis=2)[..., 0] for part in (across, down)]
    return _Edges(np.asarray(pick[0], np.float64), np.asarray(pick[1], np.float64))


def _best(
    scales: tuple[_Scale, _Scale], outlines: Sequence[FloatArray], window_px: FloatArray
) -> FloatArray | None:
    """Place the outline of a face 1 m wide (k, 2) where it lies on edges best; None if it does so nowhere.

    First in the smaller picture, everywhere in the window; then in the picture itself, about the place found.

    Parameters
    ----------
    outlines : sequence of float64 (k, 2)
        The same one for each way that the face may look.
    """
    coarse, fine = scales
    starts = []
    for number, outline in enumerate(outlines):
        small = outline / coarse.factor
        tried = _tried(coarse.edges, small, _everywhere(small, window_px / coarse.factor), _FEW_POINTS)
        starts += [(*one, number) for one in tried if one[0] >= _FOUND_COARSELY]
    if not starts:
        return None
    _, width, u, v, number = max(starts)
    outline, middle = outlines[number], np.array([u, v]) * coarse.factor
    near = _about(middle, width, outline, 1.5 * coarse.factor)
    tried = _tried(fine.edges, outline, near, _POINTS)
    if not tried or max(tried)[0] < _FOUND:
        return None
    top, _, u, v = max(tried)
    # The inner edge of a rim is a good outline too: the largest one about the same middle is the face's.
    enough, apart = max(_FOUND, _AS_GOOD * top), _SAME_MIDDLE_M * float(np.ptp(outline[:, 0]))
    same = [one for one in tried if one[0] >= enough and np.hypot(one[2] - u, one[3] - v) <= apart]
    _, width, u, v = max(same, key=lambda one: one[1])
    return np.asarray(np.array([u, v]) + _wider(width * outline))


def _tried(
    edges: _Edges, outline: FloatArray, candidates: Iterator[tuple[float, _Grid]], n_points: int
) -> list[tuple[float, float, float, float]]:
    """Score, width and middle of the best place of each width."""
    point, normal = _around(outline, n_points)
    tried = []
    for width, grid in candidates:
        score = _score(edges, grid, width * point, normal)
        row, column = np.unravel_index(np.argmax(score), score.shape)
        tried.append((float(score[row, column]), width, float(grid.u[column]), float(grid.v[row])))
    return tried


def _wider(outline: FloatArray) -> FloatArray:
    """Let an outline about its middle take in the pixels of its edge."""
    length = np.maximum(np.hypot(*outline.T), 1.0)[:, None]
    return np.asarray(outline * (_GROWN + _GROWN_PX / length))


def _everywhere(outline: FloatArray, window_px: FloatArray) -> Iterator[tuple[float, _Grid]]:
    """Widths [m], and the middles of faces of that width that fit into the window."""
    (_, top), (_, low) = window_px.min(axis=0), window_px.max(axis=0)
    middle, reach = float(window_px[:, 0].mean()), _AXIS_M * float(np.ptp(outline[:, 0]))
    for width in _widths(*_SIZES_M, 1.06):
        wide, tall = width * np.ptp(outline, axis=0)
        v = np.arange(top + tall / 2, low - tall / 2 + 1e-9, 1.0)
        if wide >= _SMALLEST_PX and v.size:
            yield width, _Grid(np.arange(middle - reach, middle + reach + 1e-9, 1.0), v)


def _about(
    middle: FloatArray, width: float, outline: FloatArray, reach: float
) -> Iterator[tuple[float, _Grid]]:
    """The same near a place and a width that were found."""
    step = max(width * float(np.ptp(outline[:, 0])) / 60.0, 0.5)
    steps = np.arange(-reach, reach + 1e-9, step)
    for one in _widths(0.85 * width, 1.5 * width, 1.03):
        yield one, _Grid(middle[0] + steps, middle[1] + steps)


def _widths(narrowest: float, widest: float, factor: float) -> list[float]:
    n = round(math.log(widest / narrowest) / math.log(factor)) + 1
    return [float(width) for width in np.geomspace(narrowest, widest, n)]


def _around(outline: FloatArray, n_points: int) -> tuple[FloatArray, FloatArray]:
    """Points along an outline, evenly, and its normals there."""
    ends = np.roll(outline, -1, axis=0)
    length = np.hypot(*(ends - outline).T)
    count = np.maximum(np.round(n_points * length / length.sum()), 1).astype(int)
    points, normals = [], []
    for start, end, n in zip(outline, ends, count, strict=True):
        t = (np.arange(n) + 0.5)[:, None] / n
        points.append(start + t * (end - start))
        normals.append(np.tile(np.array([end[1] - start[1], start[0] - end[0]]), (n, 1)))
    normal = np.concatenate(normals)
    return np.concatenate(points), normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _score(edges: _Edges, grid: _Grid, points: FloatArray, normal: FloatArray) -> FloatArray:
    """Share of the points (k, 2) around each middle (rows, columns) on edges which cross the outline."""
    n_rows, n_columns = edges.across.shape
    column, row = (np.round(one[:, None] + points[:, k]).astype(np.int64) for k, one in enumerate(grid))
    inside_u, inside_v = (column >= 0) & (column < n_columns), (row >= 0) & (row < n_rows)
    column, row = np.clip(column, 0, n_columns - 1), np.clip(row, 0, n_rows - 1)
    at = (row * n_columns)[:, None] + column[None]
    along = edges.across.ravel().take(at) * normal[:, 0]
    along += edges.down.ravel().take(at) * normal[:, 1]
    np.abs(along, out=along)
    along /= _EDGE
    np.minimum(along, 1.0, out=along)
    along *= inside_v[:, None] & inside_u[None]
    return np.asarray(along.mean(axis=2))
