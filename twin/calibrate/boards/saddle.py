"""Corners to a hundredth of a pixel: a blurred saddle fitted to the grey values around each one.

The fit has the board's own directions, as the neighbouring corners tell them: a quadratic map from squares to
pixels (Datta, Kim and Kanade 2009, doi:10.1109/ICCVW.2009.5457474, flatten the picture by the camera found so
far; the neighbours do the same without one). So its window keeps clear of markers however much a board is
foreshortened, and lines that a lens bends are bent in the model too.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, ByteArray, FloatArray

_NEAREST = (21, 9)
"""Corners that tell a map, round by round: first many, against wrong ones, then those next to it, for what a
parabola is not (maps twice as wide bend edges too little: 0.0002 px, the same way in every picture)."""
_MAP_ROUNDS = 4
_LEAST_SPREAD_PX = 0.02
_RIDGE = np.diag([1e-9, 1e-9, 1e-9, 1e-3, 1e-3, 1e-3])
"""Keeps a map's curvature from running away where few neighbours are known."""

_REACH = 0.4
"""Of a square, to either side of the corner."""
_RADIUS_PX, _LEAST_RADIUS_PX = 9, 2.5
_LEAST_SQUARE_PX = 4.0
"""Across a square: of a narrower one the blur leaves no saddle."""
_MARGIN_PX = 1.5
"""Distance from markers: what a sharp lens blurs."""
_STEPS = 15
_STILL_PX = 1e-3
_FARTHEST_PX = 2.0
"""A corner that moves by more than this is another thing than what was detected."""
_MISFIT = 0.4
"""RMS of what the model leaves of the grey values, as part of the contrast: there is no saddle."""
_BLUR_PX = (0.3, 0.8, 8.0)
"""Least, first and largest sigma."""


@dataclass(frozen=True, slots=True)
class _Patches:
    """Pixels around n corners, and the directions of the print there.

    Attributes
    ----------
    start_px : float64 (n, 2)
    place_px : float64 (n, q, 2)
    grey, weight : float64 (n, q)
    square_from_px : float64 (n, 2, 2)
        Linear part of the map, from pixels to squares.
    bend_px : float64 (n, 3, 2)
        Second derivatives of pixels by squares: xx, xy, yy.
    across_px : float64 (n, 2)
        Pixels a square, across the edges that part it from the next one in x and in y.
    """

    start_px: FloatArray
    place_px: FloatArray
    grey: FloatArray
    weight: FloatArray
    square_from_px: FloatArray
    bend_px: FloatArray
    across_px: FloatArray

    def of(self, some: NDArray[np.intp]) -> _Patches:
        """Take some of the corners."""
        return _Patches(*(getattr(self, field.name)[some] for field in fields(self)))

    def squares(self, centre_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offsets (n, q, 2) of the pixels from corners, in pixels and in squares."""
        offset = self.place_px - centre_px[:, np.newaxis]
        inverse = np.swapaxes(self.square_from_px, -1, -2)
        square = offset @ inverse
        for _ in range(2):
            square = (offset - _quadratic(square) @ self.bend_px) @ inverse
        return offset, square


def refined(
    image: ByteArray, grid: FloatArray, pixel_px: FloatArray, clear_part: float
) -> tuple[FloatArray, BoolArray]:
    """Refine corners of a board.

    Parameters
    ----------
    image : uint8 (height, width)
    grid : float64 (n, 2)
        Column and row of each corner on the board.
    pixel_px : float64 (n, 2)
        Where they are, to about a pixel.
    clear_part : float
        Part of a square along an edge that has no marker beside it; 0.5 without markers.

    Returns
    -------
    pixel_px : float64 (n, 2)
    found : bool (n,)
        False where the grey values show no such corner, or the image ends within 2.5 px.
    """
    found = np.ones(len(grid), dtype=bool)
    for nearest in _NEAREST:
        maps = local_maps(grid, pixel_px, found, nearest)
        start = np.where(found[:, np.newaxis], pixel_px, maps[:, 0])
        pixel_px, found = _fitted(_patches(image, start, maps, clear_part))
    return pixel_px, found


def local_maps(grid: FloatArray, pixel_px: FloatArray, known: BoolArray, nearest: int) -> FloatArray:
    """Quadratic map (n, 6, 2) from squares to pixels around every corner, by the known ones of the nearest.

    Its rows: the place itself, the derivatives by x and y, and the second ones by xx, xy and yy; nil where
    the known ones do not tell. Locally weighted regression with bisquare weights against corners that are
    wrong (Cleveland 1979, doi:10.1080/01621459.1979.10481038).
    """
    apart = np.linalg.norm(grid[:, np.newaxis] - grid, axis=-1)
    near = np.argsort(apart, axis=1, kind="stable")[:, :nearest]
    distance = np.take_along_axis(apart, near, axis=1)
    by_distance = (1.0 - (distance / (distance[:, -1:] + 0.5)) ** 3) ** 3 * known[near]
    step = grid[near] - grid[:, np.newaxis]
    terms = np.concatenate([np.ones_like(step[..., :1]), step, _quadratic(step)], axis=-1)
    seen = pixel_px[near] - pixel_px[:, np.newaxis]
    ridge = _RIDGE * (by_distance.sum(axis=1)[:, np.newaxis, np.newaxis] + 1e-9)
    weight, maps = by_distance, np.empty((len(grid), 6, 2))
    for _ in range(_MAP_ROUNDS):
        weighted = np.swapaxes(terms * weight[..., np.newaxis], -1, -2)
        maps = np.linalg.solve(weighted @ terms + ridge, weighted @ seen)
        off = np.linalg.norm(seen - terms @ maps, axis=-1)
        spread = np.maximum(np.median(off, axis=1, keepdims=True), _LEAST_SPREAD_PX)
        weight = by_distance * np.clip(1.0 - (off / (6.0 * spread)) ** 2, 0.0, None) ** 2
    maps[:, 0] += pixel_px
    return maps


def _quadratic(square: FloatArray) -> FloatArray:
    """Terms (..., 3) that second derivatives are multiplied by."""
    x, y = square[..., 0], square[..., 1]
    return np.stack([0.5 * x * x, x * y, 0.5 * y * y], axis=-1)


def _patches(image: ByteArray, start_px: FloatArray, maps: FloatArray, clear_part: float) -> _Patches:
    height, width = image.shape
    linear = np.swapaxes(maps[:, 1:3], -1, -2)
    determinant = np.abs(np.linalg.det(linear))[:, np.newaxis]
    across = determinant / np.maximum(np.linalg.norm(linear, axis=1)[:, ::-1], 1e-9)
    wide = across.min(axis=1) >= _LEAST_SQUARE_PX
    linear = np.where(wide[:, np.newaxis, np.newaxis], linear, np.eye(2))
    offsets = np.arange(-_RADIUS_PX, _RADIUS_PX + 1)
    window = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    place = np.rint(start_px).astype(np.int64)[:, np.newaxis] + window
    column, row = np.clip(place[..., 0], 0, width - 1), np.clip(place[..., 1], 0, height - 1)
    empty = np.zeros(place.shape[:2])
    patches = _Patches(
        start_px,
        place.astype(np.float64),
        image[row, column].astype(np.float64),
        empty,
        np.asarray(np.linalg.inv(linear), dtype=np.float64),
        maps[:, 3:],
        across,
    )
    border = np.minimum(start_px, (width - 1.0, height - 1.0) - start_px).min(axis=1)
    radius = np.where(wide, np.minimum(border, _RADIUS_PX), 0.0)
    patches.weight[:] = _weights(patches, radius, clear_part)
    return patches


def _weights(patches: _Patches, radius_px: FloatArray, clear_part: float) -> FloatArray:
    """Weights (n, q), the same on both sides of a corner, so that what the model leaves does not move it.

    They fade to nothing at `_REACH` and at the radius, which the image's border makes smaller; they are
    nothing on markers. Where the radius is too small nothing is left.
    """
    offset, square = patches.squares(patches.start_px)
    part = np.sum(offset**2, axis=-1) / np.maximum(radius_px, 1e-9)[:, np.newaxis] ** 2
    part[radius_px < _LEAST_RADIUS_PX] = 1.0
    weight = np.clip(1.0 - part, 0.0, None)
    weight *= np.prod(np.clip(1.0 - (square / _REACH) ** 2, 0.0, None) ** 2, axis=-1)
    if clear_part < 0.5:
        across = patches.across_px[:, np.newaxis]
        # Markers lie farther than this from both edges; narrow lanes between them are used to the middle.
        room = ((clear_part - np.abs(square)) * across).max(axis=-1)
        margin = np.minimum(_MARGIN_PX, 0.5 * clear_part * patches.across_px.min(axis=-1))
        weight *= np.clip(room - margin[:, np.newaxis] + 0.5, 0.0, 1.0)
    return np.asarray(weight)


def _fitted(patches: _Patches) -> tuple[FloatArray, BoolArray]:
    """Gauss and Newton; corners that stand still are done."""
    n = len(patches.start_px)
    centre, found = patches.start_px.copy(), np.zeros(n, dtype=bool)
    blur = np.full(n, _BLUR_PX[1])
    moving = np.flatnonzero(patches.weight.any(axis=1))
    for _ in range(_STEPS):
        some = patches.of(moving)
        step, blur[moving], misfit = _step(some, centre[moving], blur[moving])
        length = np.linalg.norm(step, axis=1)
        centre[moving] += step / np.maximum(length, 1.0)[:, np.newaxis]
        near = np.linalg.norm(centre[moving] - some.start_px, axis=1) <= _FARTHEST_PX
        still = length < _STILL_PX
        found[moving] = still & near & (misfit <= _MISFIT)
        moving = moving[near & ~still]
        if not moving.size:
            break
    return centre - _blur_shift_px(patches, blur), found


def _blur_shift_px(patches: _Patches, blur_px: FloatArray) -> FloatArray:
    """How far (n, 2) blur moves a corner whose edges are bent: to the hollow side of both.

    A Gaussian of sigma s along an edge that lies at k l²/2 moves it by the mean of that, k s²/2.
    """
    inverse = patches.square_from_px
    linear = np.linalg.inv(inverse)
    bend = np.swapaxes(inverse @ np.swapaxes(patches.bend_px, -1, -2), -1, -2)
    # The edge that parts squares in x runs along y: it is bent by the second derivative by y.
    along = np.sum(linear**2, axis=1)[:, ::-1]
    shift = 0.5 * blur_px[:, np.newaxis] ** 2 * np.stack([bend[:, 2, 0], bend[:, 0, 1]], axis=-1) / along
    return np.asarray((linear @ shift[..., np.newaxis])[..., 0])


def _step(
    patches: _Patches, centre_px: FloatArray, blur_px: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Step (n, 2) of the corners, the new blur (n,), and the misfit (n,) before the step.

    Grey values are a level with a slope, plus a contrast times the product of two blurred edges. The level,
    the slope and the contrast are linear; they are solved for with the other unknowns' derivatives beside
    them (Golub and Pereyra 1973, in Kaufman's form).
    """
    from scipy.special import erf

    offset, square = patches.squares(centre_px)
    width = np.sqrt(2.0) * blur_px[:, np.newaxis, np.newaxis]
    away = square * patches.across_px[:, np.newaxis] / width
    edge, peak = erf(away), 2.0 / np.sqrt(np.pi) * np.exp(-(away**2)) / width
    root = np.sqrt(patches.weight)[..., np.newaxis]
    value = patches.grey[..., np.newaxis] * root
    print_ = np.concatenate([root, np.prod(edge, axis=-1, keepdims=True) * root], axis=-1)
    # Light is more on one side: that multiplies what the print reflects.
    base = np.concatenate([print_, print_ @ _solved(print_, value) * offset / _RADIUS_PX], axis=-1)
    solved = _solved(base, value)
    contrast = solved[:, 1:2]
    across = peak * edge[..., ::-1]
    by_centre = -contrast * (across @ (patches.across_px[..., np.newaxis] * patches.square_from_px))
    by_blur = -contrast * np.sum(across * away, axis=-1, keepdims=True) * np.sqrt(2.0)
    left = value - base @ solved
    other = np.concatenate([by_centre, by_blur], axis=-1) * root
    change = _solved(other - base @ _solved(base, other), left)[..., 0]
    total = np.maximum(patches.weight.sum(axis=1), 1e-9)
    misfit = np.sqrt(np.sum(left[..., 0] ** 2, axis=1) / total) / np.maximum(np.abs(contrast[:, 0, 0]), 1e-9)
    blur = np.clip(blur_px + np.clip(change[:, 2], -0.3, 0.3), _BLUR_PX[0], _BLUR_PX[2])
    return change[:, :2], blur, misfit


def _solved(design: FloatArray, value: FloatArray) -> FloatArray:
    """Least squares (n, p, m) of design (n, q, p) and values (n, q, m); nearly nil where nothing tells."""
    transposed = np.swapaxes(design, -1, -2)
    normal = transposed @ design
    tiny = 1e-9 * (np.trace(normal, axis1=1, axis2=2) + 1e-9)
    return np.linalg.solve(
        normal + tiny[:, np.newaxis, np.newaxis] * np.eye(design.shape[-1]), transposed @ value
    )
