"""The part of the image that a calibration vouches for: where boards were seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.calibration.intrinsics.views import Corners

CELL_PX = 8
MAP_PX = 32
"""Cells of maps that a report keeps."""
_EDGES = 1e-9
_DOWN, _ACROSS = ("top", "", "bottom"), ("left", "", "right")


@dataclass(frozen=True, slots=True)
class Coverage:
    """Cells of the image inside the outline of at least one board.

    Between corners a smooth lens is known; outside of all boards its formula only goes on, and nothing says
    that the lens does.

    Attributes
    ----------
    covered : bool (rows, columns)
        Cells of `CELL_PX` pixels; the first one's corner is the image's.
    width_px, height_px : int
    """

    covered: BoolArray
    width_px: int
    height_px: int

    @property
    def fraction(self) -> float:
        """Part of the image that is covered."""
        return float(self.covered.mean())

    def covers(self, pixel_px: FloatArray) -> BoolArray:
        """Whether pixels ``(..., 2)`` lie in covered cells; false off the image and for NaN."""
        pixel = np.asarray(pixel_px, dtype=np.float64)
        known = np.asarray(np.isfinite(pixel).all(axis=-1))
        cell = np.floor((np.where(known[..., np.newaxis], pixel, -1.0) + 0.5) / CELL_PX).astype(np.int64)
        rows, columns = self.covered.shape
        inside = np.asarray(known & ((cell >= 0) & (cell < (columns, rows))).all(axis=-1))
        place = np.where(inside, cell[..., 1] * columns + cell[..., 0], 0)
        return np.asarray(inside & self.covered.ravel()[place])

    def missing(self) -> tuple[str, ...]:
        """Names of the ninths of the image of which less than half is covered: ``top left``, ``middle``."""
        names = []
        for band, down in zip(np.array_split(self.covered, 3, axis=0), _DOWN, strict=True):
            for part, across in zip(np.array_split(band, 3, axis=1), _ACROSS, strict=True):
                if part.mean() < 0.5:
                    names.append(f"{down} {across}".strip() or "middle")
        return tuple(names)


def map_pixels(width_px: int, height_px: int) -> FloatArray:
    """Middles (rows, columns, 2) of cells of `MAP_PX` pixels, on the image: where maps are worked out."""
    u, v = (
        np.minimum(MAP_PX * (np.arange(-(-n // MAP_PX)) + 0.5) - 0.5, n - 1.0) for n in (width_px, height_px)
    )
    return np.stack(np.meshgrid(u, v), axis=-1)


def part_name(pixel_px: FloatArray, width_px: int, height_px: int) -> str:
    """Name of the ninth of the image that a pixel (2,) lies in: ``top left``, ``middle``, ``bottom``."""
    column, row = np.clip((pixel_px + 0.5) / (width_px, height_px) * 3.0, 0, 2).astype(int)
    return f"{_DOWN[row]} {_ACROSS[column]}".strip() or "middle"


def coverage_of(corners: Corners, inlier: BoolArray, width_px: int, height_px: int) -> Coverage:
    """Find the cells whose middle lies inside the convex outline of a view's corners."""
    rows, columns = -(-height_px // CELL_PX), -(-width_px // CELL_PX)
    x, y = (CELL_PX * (np.arange(n) + 0.5) - 0.5 for n in (columns, rows))
    covered = np.zeros((rows, columns), dtype=bool)
    for view in range(corners.n_views):
        pixels = corners.pixel_px[(corners.view == view) & inlier]
        low, high = pixels.min(axis=0, initial=np.inf), pixels.max(axis=0, initial=-np.inf)
        window = np.ix_((y >= low[1]) & (y <= high[1]), (x >= low[0]) & (x <= high[0]))
        covered[window] |= _inside(pixels, x[window[1].ravel()], y[window[0].ravel()])
    return Coverage(covered, width_px, height_px)


def _inside(pixels: FloatArray, x: FloatArray, y: FloatArray) -> BoolArray:
    """Which nodes of a grid lie inside the convex hull of points."""
    from scipy.spatial import ConvexHull, QhullError

    nodes = np.ones((len(y), len(x)), dtype=bool)
    try:
        hull = ConvexHull(pixels)
    except (QhullError, ValueError):
        return ~nodes
    for across, down, offset in hull.equations:
        nodes &= across * x + down * y[:, np.newaxis] + offset <= _EDGES
    return nodes
