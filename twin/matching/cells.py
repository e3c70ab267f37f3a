"""Small squares of the grid by number: which places lie where, and what lies about them."""

from __future__ import annotations

import math

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray

CELL_M = 64.0
_COLUMN = 1_000_000
"""A cell's number is its column times this, plus its row."""
NOWHERE: IntArray = np.zeros(0, dtype=np.int64)


def cells_of(place_m: FloatArray) -> IntArray:
    """Numbers (n,) of the cells that places (n, 2), EPSG:25833, lie in."""
    column, row = np.floor(place_m.reshape(-1, 2) / CELL_M).astype(np.int64).T
    return np.asarray(column * _COLUMN + row)


def cells_about(place_m: FloatArray, reach_m: float) -> IntArray:
    """Numbers, once each, of cells that hold everything within so far of places."""
    return widened(cells_of(place_m), math.ceil(reach_m / CELL_M))


def widened(cells: IntArray, by: int) -> IntArray:
    """Cells and those so many about them, once each."""
    step = np.arange(-by, by + 1)
    return np.unique(np.unique(cells)[:, None] + (step[:, None] * _COLUMN + step).ravel())


def cells_touched(place_m: FloatArray, reach_m: float) -> IntArray:
    """Cells, once each, of which some part lies within a square of so far about a place."""
    steps = np.linspace(-reach_m, reach_m, max(2, math.ceil(2 * reach_m / CELL_M) + 1))
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, -1, 2)
    return np.unique(cells_of((place_m.reshape(-1, 1, 2) + offsets).reshape(-1, 2)))


def cells_within(corner_m: FloatArray, side_m: float, margin_m: float) -> IntArray:
    """Cells that a square with a margin about it touches."""
    (west, south), (east, north) = corner_m - margin_m, corner_m + side_m + margin_m
    columns = np.arange(math.floor(west / CELL_M), math.ceil(east / CELL_M))
    rows = np.arange(math.floor(south / CELL_M), math.ceil(north / CELL_M))
    return np.asarray((columns[:, None] * _COLUMN + rows).ravel())


def coarser(cells: IntArray, times: int) -> IntArray:
    """Numbers (n,) of the cells so many times as wide that cells lie in."""
    column, row = np.divmod(cells, _COLUMN)
    return np.asarray(column // times * _COLUMN + row // times)


def middles_of(cells: IntArray) -> FloatArray:
    """Middles (n, 2) of cells, EPSG:25833."""
    return (np.stack(np.divmod(cells, _COLUMN), axis=1) + 0.5) * CELL_M


def are_among(cells: IntArray, some: IntArray) -> BoolArray:
    """Which cells are among some that are sorted."""
    if not some.size:
        return np.zeros(cells.size, dtype=bool)
    at = np.minimum(np.searchsorted(some, cells), some.size - 1)
    return np.asarray(some[at] == cells)


class Grid:
    """Places by the cells that they lie in.

    Parameters
    ----------
    place_m : float64 (n, 2)
        EPSG:25833.
    """

    def __init__(self, place_m: FloatArray) -> None:
        numbers = cells_of(place_m)
        self._order = np.argsort(numbers, kind="stable")
        self._sorted = numbers[self._order]

    def inside(self, cells: IntArray) -> IntArray:
        """Which places lie in one of the cells, in ascending order."""
        first, last = (np.searchsorted(self._sorted, cells, side=side) for side in ("left", "right"))
        some = first < last
        rows = [self._order[a:b] for a, b in zip(first[some].tolist(), last[some].tolist(), strict=True)]
        return np.sort(np.concatenate([NOWHERE, *rows]))
