"""Poles by fixed squares of the grid, each with the poles about it: what is placed together.

A square and what lies about it do not depend on poles further off: another drive elsewhere changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray, IntArray

SQUARE_M = 256.0
MARGINS_M = (128.0, 256.0, 512.0)
"""So far about a square, the first that holds enough: along a lonely road poles are few."""
ENOUGH = 12
_COLUMN = 1_000_000
"""A square's number is its column times this, plus its row."""


class Window(NamedTuple):
    """One square.

    Attributes
    ----------
    square : int
        Its number.
    inside : int64 (k,)
        Which places lie in it, ascending.
    about : int64 (n,)
        Which lie in it or within the margin, ascending.
    margin_m : float
    """

    square: int
    inside: IntArray
    about: IntArray
    margin_m: float


def squares_of(place_m: FloatArray) -> IntArray:
    """Numbers (n,) of the squares that places (n, 2), EPSG:25833, lie in."""
    column, row = np.floor(place_m / SQUARE_M).astype(np.int64).T
    return np.asarray(column * _COLUMN + row)


def corner_of(square: int) -> FloatArray:
    """Where a square begins (2,): its least easting and northing."""
    return np.array(divmod(square, _COLUMN), dtype=np.float64) * SQUARE_M


def squares_within(corner_m: FloatArray, side_m: float, margin_m: float) -> IntArray:
    """Squares that a larger square with a margin about it touches."""
    first = np.floor((corner_m - margin_m) / SQUARE_M).astype(np.int64)
    last = np.floor((corner_m + side_m + margin_m) / SQUARE_M).astype(np.int64)
    columns, rows = (np.arange(a, b + 1) for a, b in zip(first, last, strict=True))
    return np.asarray((columns[:, None] * _COLUMN + rows).ravel())


def ring_of(squares: IntArray, around: int) -> IntArray:
    """Squares and those so many about them, once each."""
    step = np.arange(-around, around + 1)
    return np.unique(np.unique(squares)[:, None] + (step[:, None] * _COLUMN + step).ravel())


class Windows:
    """Places by squares.

    Parameters
    ----------
    place_m : float64 (n, 2)
        EPSG:25833.
    """

    def __init__(self, place_m: FloatArray) -> None:
        self._place_m = place_m
        self.square_of = squares_of(place_m)
        self._order = np.argsort(self.square_of, kind="stable")
        self._sorted = self.square_of[self._order]

    def __iter__(self) -> Iterator[Window]:
        """Every square that holds a place, in the order of their numbers."""
        for square in np.unique(self._sorted).tolist():
            yield self.window(square)

    def window(self, square: int) -> Window:
        """One square; `about` is empty where no place lies there."""
        inside = self._in_squares(np.array([square]))
        for margin_m in MARGINS_M:
            about = self._within(square, margin_m)
            if about.size >= ENOUGH:
                break
        return Window(square, inside, about, margin_m)

    def _within(self, square: int, margin_m: float) -> IntArray:
        step = np.arange(-np.ceil(margin_m / SQUARE_M), np.ceil(margin_m / SQUARE_M) + 1).astype(np.int64)
        near = self._in_squares((square + step[:, None] * _COLUMN + step).ravel())
        corner = corner_of(square)
        off = self._place_m[near] - corner
        return np.asarray(near[((off >= -margin_m) & (off < SQUARE_M + margin_m)).all(axis=1)])

    def _in_squares(self, squares: IntArray) -> IntArray:
        first, last = (np.searchsorted(self._sorted, squares, side=side) for side in ("left", "right"))
        rows = [self._order[a:b] for a, b in zip(first.tolist(), last.tolist(), strict=True) if a < b]
        return np.sort(np.concatenate(rows)) if rows else np.zeros(0, dtype=np.int64)
