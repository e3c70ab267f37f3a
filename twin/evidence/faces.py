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

Image = NDArray[np.uint8]

_SIZES_M = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Widths of faces; between them the search goes in steps of 3 %."""
_AXIS_M = 0.35
"""How far beside the foot a face's middle may be: the pole leans, and the foot was clicked by hand."""
_EDGE = 14.0
"""Grey values over two pixels that make an edge."""
_FOUND = 0.8
"""Share of the outline that must lie on edges that cross it."""
_AS_GOOD, _SAME_MIDDLE = 0.93, 0.15
_SMALLEST_PX = 9.0
_OUTLINE_POINTS = 64
_GROWN, _GROWN_PX = 1.03, 1.0


class _Edges(NamedTuple):
    """Strongest slope of a colour at each pixel, as a vector."""

    across: FloatArray
    down: FloatArray


def find_faces(
    image: Image, window_px: FloatArray, codes: Sequence[str], px_per_m: float
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
    px_per_m : float
        At the sign.

    Returns
    -------
    tuple of float64 (k, 2)
        An outline each, in pixels of the frame, a little wider than the face; those that were not found are
        left out.
    """
    found: list[FloatArray] = []
    outlines = list(dict.fromkeys(outline for outline in map(outline_of, codes) if outline is not None))
    if not outlines or not px_per_m * _SIZES_M[1] >= _SMALLEST_PX:
        return ()
    left, top = np.floor(window_px.min(axis=0)).astype(int) - 4
    right, low = np.ceil(window_px.max(axis=0)).astype(int) + 4
    left, top = max(left, 0), max(top, 0)
    origin = np.array([left, top])
    edges = _edges(image[top:low, left:right])
    for outline in outlines:
        best = _best(edges, np.array(outline), window_px - origin, px_per_m)
        if best is not None:
            found.append(best + origin)
    return tuple(found)


def outline_of(code: str) -> tuple[tuple[float, float], ...] | None:
    """Outline of a sign's face by its code, in units of its width about its middle; None if not known."""
    number = code.partition(".")[0]
    if number in _OUTLINES:
        return _OUTLINES[number]
    return _UPWARDS if len(number) == 3 and number.startswith("1") else None


def _regular(sides: int, start_deg: float, radius: float) -> tuple[tuple[float, float], ...]:
    angles = np.radians(start_deg + 360.0 * np.arange(sides) / sides)
    return tuple(zip((radius * np.cos(angles)).tolist(), (radius * np.sin(angles)).tolist(), strict=True))


_CIRCLES = frozenset(
    {
        *("302", "306", "308", "310", "312", "314", "316", "318", "320", "322", "324", "326", "330", "332"),
        *("334", "335", "336", "337", "338", "340", "342", "344", "362", "364", "370", "372", "374", "376"),
        *("378", "402", "404", "406"),
    }
)
_SQUARES = frozenset({"512", "516", "518", "520", "522", "524", "526", "538", "540", "552", "555"})
_UPWARDS = (-0.5, 0.433), (0.0, -0.433), (0.5, 0.433)
_OUTLINES = {
    **dict.fromkeys(_CIRCLES, _regular(48, 0.0, 0.5)),
    **dict.fromkeys(_SQUARES, _regular(4, 45.0, math.sqrt(0.5))),
    **dict.fromkeys(("206", "208"), _regular(4, 0.0, 0.5)),
    "202": ((-0.5, -0.433), (0.5, -0.433), (0.0, 0.433)),
    "204": _regular(8, 22.5, 0.541),
}


def _edges(image: Image) -> _Edges:
    import cv2

    smooth = cv2.GaussianBlur(image, (3, 3), 0).astype(np.float32)
    across = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3) / 4.0
    down = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3) / 4.0
    strongest = np.argmax(across**2 + down**2, axis=2)[..., None]
    pick = [np.take_along_axis(part, strongest, axis=2)[..., 0] for part in (across, down)]
    return _Edges(np.asarray(pick[0], np.float64), np.asarray(pick[1], np.float64))


def _best(edges: _Edges, outline: FloatArray, window_px: FloatArray, px_per_m: float) -> FloatArray | None:
    """The outline (k, 2) that lies on edges best; None where none lies on them well enough."""
    point, normal = _around(outline)
    tried: list[tuple[float, float, FloatArray]] = []
    for width, centres in _candidates(outline, window_px, px_per_m):
        score = _score(edges, centres, width * point, normal)
        k = int(np.argmax(score))
        tried.append((float(score[k]), width, centres[k]))
    top, width, centre = max(tried, key=lambda one: one[0], default=(0.0, 0.0, np.zeros(2)))
    if top < _FOUND:
        return None
    # The inner edge of a rim is a good outline too: the largest one about the same middle is the face's.
    enough = max(_FOUND, _AS_GOOD * top)
    apart = _SAME_MIDDLE * width
    about = [one for one in tried if one[0] >= enough and np.hypot(*(one[2] - centre)) <= apart]
    _, width, centre = max(about, key=lambda one: one[1])
    return np.asarray(centre + (width * _GROWN + 2 * _GROWN_PX) * outline)


def _candidates(
    outline: FloatArray, window_px: FloatArray, px_per_m: float
) -> Iterator[tuple[float, FloatArray]]:
    """Widths, and the middles (n, 2) of faces of that width that fit into the window."""
    (_, top), (_, low) = window_px.min(axis=0), window_px.max(axis=0)
    middle = float(window_px[:, 0].mean())
    n = round(np.log(_SIZES_M[-1] / _SIZES_M[0]) / np.log(1.03)) + 1
    tall = float(np.ptp(outline[:, 1]))
    for width in np.geomspace(_SIZES_M[0], _SIZES_M[-1], n) * px_per_m:
        if width < _SMALLEST_PX:
            continue
        step = max(width / 40.0, 0.5)
        u = np.arange(middle - _AXIS_M * px_per_m, middle + _AXIS_M * px_per_m + 1e-9, step)
        v = np.arange(top + tall * width / 2, low - tall * width / 2 + 1e-9, step)
        if u.size and v.size:
            yield float(width), np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def _around(outline: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points along an outline, evenly, and its normals there."""
    ends = np.roll(outline, -1, axis=0)
    length = np.hypot(*(ends - outline).T)
    count = np.maximum(np.round(_OUTLINE_POINTS * length / length.sum()), 1).astype(int)
    points, normals = [], []
    for start, end, n in zip(outline, ends, count, strict=True):
        t = (np.arange(n) + 0.5)[:, None] / n
        points.append(start + t * (end - start))
        normals.append(np.tile(np.array([end[1] - start[1], start[0] - end[0]]), (n, 1)))
    normal = np.concatenate(normals)
    return np.concatenate(points), normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _score(edges: _Edges, centres: FloatArray, points: FloatArray, normal: FloatArray) -> FloatArray:
    """Share of the points (k, 2) around each middle (n, 2) that lie on edges which cross the outline."""
    at = np.round(centres[:, None, :] + points[None]).astype(np.int64)
    rows, columns = edges.across.shape
    inside = (at[..., 0] >= 0) & (at[..., 0] < columns) & (at[..., 1] >= 0) & (at[..., 1] < rows)
    column, row = np.clip(at[..., 0], 0, columns - 1), np.clip(at[..., 1], 0, rows - 1)
    along = np.abs(edges.across[row, column] * normal[:, 0] + edges.down[row, column] * normal[:, 1])
    return np.asarray(np.mean(np.minimum(along / _EDGE, 1.0) * inside, axis=1))
