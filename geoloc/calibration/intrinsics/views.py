"""Pictures of a board as a calibration takes them: corners in the image and where they are on the board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.errors import CalibrationError

MIN_CORNERS = 8
"""A view with fewer says little beyond its own pose (6 numbers)."""


@dataclass(frozen=True, slots=True)
class View:
    """One picture of the board.

    Attributes
    ----------
    name : str
        What to call it in messages: a file, a frame.
    board_m : float64 (n, 2)
        Corners on the board: x right, y down, as its reader sees it.
    pixel_px : float64 (n, 2)
        The same corners in the picture.

    Raises
    ------
    CalibrationError
        If the shapes do not fit, a number is not finite, or there are fewer than `MIN_CORNERS` corners.
    """

    name: str
    board_m: FloatArray
    pixel_px: FloatArray

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        shape = self.pixel_px.shape
        if len(shape) != 2 or shape[1] != 2 or self.board_m.shape != shape:
            raise CalibrationError(
                f"View {self.name} has corners of shape {shape} for board points of shape "
                f"{self.board_m.shape}: both must be (n, 2)."
            )
        if not (np.isfinite(self.pixel_px).all() and np.isfinite(self.board_m).all()):
            raise CalibrationError(
                f"View {self.name} has a corner that is not a finite number: leave it out."
            )
        if len(self.pixel_px) < MIN_CORNERS:
            raise CalibrationError(
                f"View {self.name} has {len(self.pixel_px)} corners: give at least {MIN_CORNERS}."
            )


@dataclass(frozen=True, slots=True)
class Corners:
    """The corners of all views in one list, view by view.

    Attributes
    ----------
    board_m : float64 (n, 2)
    pixel_px : float64 (n, 2)
    view : int64 (n,)
        Number of the view, rising.
    """

    board_m: FloatArray
    pixel_px: FloatArray
    view: IntArray

    @property
    def n_views(self) -> int:
        """How many views there are."""
        return int(self.view[-1]) + 1

    @property
    def first(self) -> IntArray:
        """(v,): where each view begins."""
        return np.searchsorted(self.view, np.arange(self.n_views))

    @property
    def half_size_m(self) -> float:
        """Half the longer side of the board, as far as it has corners."""
        return 0.5 * float(np.ptp(self.board_m, axis=0).max())

    @property
    def middle_m(self) -> FloatArray:
        """(2,): middle of the board, as far as it has corners."""
        return np.asarray(0.5 * (self.board_m.min(axis=0) + self.board_m.max(axis=0)))

    def of(self, views: IntArray) -> Corners:
        """Take some of the views, numbered anew in the order of the old numbers."""
        rows = np.isin(self.view, views)
        number = np.searchsorted(np.sort(views), self.view[rows])
        return Corners(self.board_m[rows], self.pixel_px[rows], number.astype(np.int64))


def corners_of(views: Sequence[View]) -> Corners:
    """Put views into one list of corners."""
    return Corners(
        np.concatenate([view.board_m for view in views]),
        np.concatenate([view.pixel_px for view in views]),
        np.repeat(np.arange(len(views)), [len(view.pixel_px) for view in views]).astype(np.int64),
    )
