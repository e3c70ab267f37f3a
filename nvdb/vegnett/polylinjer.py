"""Many polylines in flat arrays, and the feet of many points on them at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from nvdb.objects.geometri import UNKNOWN_HEIGHT

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_PAIRS_AT_ONCE: Final = 1_000_000
"""Point-segment pairs that are worked on together: bounds the memory to some 100 MB."""


@dataclass(frozen=True, slots=True)
class FootPoints:
    """The points of polylines that are nearest, in plan, to m given points. All arrays (m,).

    Attributes
    ----------
    east, north, height : float64
        The foot. `height` is NaN where the line's heights are unknown.
    distance_m : float64
        Distance in plan, not negative.
    fraction : float64
        Part of the line's length before the foot, 0 to 1. The length is 3-D where all heights of the line
        are known, else in plan.
    azimuth_deg : float64
        Direction of the line at the foot, clockwise from grid north; at a vertex the mean of both sides. NaN
        for a line without length.
    right_m : float64
        How far right of that direction the point lies (left: negative): as much as `distance_m`, but less
        at a vertex and beyond an end of the line.
    """

    east: Floats
    north: Floats
    height: Floats
    distance_m: Floats
    fraction: Floats
    azimuth_deg: Floats
    right_m: Floats


class Polylinjer:
    """Polylines in flat arrays.

    Parameters
    ----------
    lines : object array (k,) of shapely.LineString
    """

    def __init__(self, lines: NDArray[np.object_]) -> None:
        import shapely

        counts = shapely.get_num_coordinates(lines).astype(np.int64)
        xyz = shapely.get_coordinates(lines, include_z=True)
        self._xy: Floats = np.ascontiguousarray(xyz[:, :2])
        self._z: Floats = np.where(xyz[:, 2] == UNKNOWN_HEIGHT, np.nan, xyz[:, 2])
        self._first: Ints = np.cumsum(counts) - counts
        self._segments: Ints = counts - 1
        self._along = self._lengths_along(counts)

    def _lengths_along(self, counts: Ints) -> Floats:
        """Length from the beginning of its line to each vertex."""
        line = np.repeat(np.arange(len(counts)), counts)
        plan = np.zeros(len(line))
        rise = np.zeros(len(line))
        plan[1:] = np.hypot(*np.diff(self._xy, axis=0).T)
        rise[1:] = np.diff(self._z)
        plan[self._first] = 0.0
        rise[self._first] = 0.0
        # One unknown height makes the whole line flat: half a 3-D length would bend the scale inside it.
        flat = np.isin(line, line[np.isnan(self._z)])
        total = np.cumsum(np.hypot(plan, np.where(flat, 0.0, rise)))
        begin: Floats = total[self._first]
        return total - begin[line]

    def feet(self, line: Ints, east: Floats, north: Floats) -> FootPoints:
        """Nearest point of line ``line[i]`` for each point i.

        Parameters
        ----------
        line : int64 array (m,)
        east, north : float64 arrays (m,)
        """
        # Cut where the pairs counted so far cross a multiple of the limit.
        block = np.cumsum(self._segments[line]) // _PAIRS_AT_ONCE
        cuts = np.flatnonzero(np.diff(block)) + 1
        parts = [
            self._feet(line[part], np.column_stack([east[part], north[part]]))
            for part in np.split(np.arange(len(line)), cuts)
        ]
        return FootPoints(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _feet(self, line: Ints, points: Floats) -> tuple[Floats, ...]:
        segment, t = self._nearest_segment(line, points)
        start, step = self._xy[segment], self._xy[segment + 1] - self._xy[segment]
        foot = start + t[:, np.newaxis] * step
        away = points - foot
        direction = self._direction(line, segment, t)
        right = away[:, 0] * direction[:, 1] - away[:, 1] * direction[:, 0]
        azimuth = np.degrees(np.arctan2(direction[:, 0], direction[:, 1])) % 360.0
        azimuth[~direction.any(axis=1)] = np.nan
        along = self._along[segment] + t * (self._along[segment + 1] - self._along[segment])
        total = self._along[self._first[line] + self._segments[line]]
        fraction = np.divide(along, total, out=np.zeros_like(along), where=total > 0)
        height = self._z[segment] + t * (self._z[segment + 1] - self._z[segment])
        distance = np.hypot(away[:, 0], away[:, 1])
        return foot[:, 0], foot[:, 1], height, distance, np.clip(fraction, 0.0, 1.0), azimuth, right

    def _nearest_segment(self, line: Ints, points: Floats) -> tuple[Ints, Floats]:
        """First vertex of the nearest segment (the first of equals), and where on it: 0 to 1."""
        counts = self._segments[line]
        begin = np.cumsum(counts) - counts
        point = np.repeat(np.arange(len(line)), counts)
        vertex = np.arange(len(point)) - begin[point] + self._first[line][point]
        start = self._xy[vertex]
        step = self._xy[vertex + 1] - start
        away = points[point] - start
        squared = np.einsum("ij,ij->i", step, step)
        along = np.einsum("ij,ij->i", away, step)
        t = np.clip(np.divide(along, squared, out=np.zeros_like(along), where=squared > 0), 0.0, 1.0)
        left = away - t[:, np.newaxis] * step
        distance = np.einsum("ij,ij->i", left, left)
        nearest = (
            np.flatnonzero(distance == np.minimum.reduceat(distance, begin)[point]) if len(line) else point
        )
        _, first = np.unique(point[nearest], return_index=True)
        return vertex[nearest[first]], t[nearest[first]]

    def _direction(self, line: Ints, segment: Ints, t: Floats) -> Floats:
        """Unit direction (m, 2) of the line at the feet; zero where it has none.

        At a vertex one side's normal would put points in front of a bend on the wrong side: the mean of the
        two directions does not (Bærentzen and Aanæs 2005, doi:10.1109/TVCG.2005.49, in the plane).
        """
        first, last = self._first[line], self._first[line] + self._segments[line] - 1
        other = np.where(t <= 0.0, np.maximum(segment - 1, first), segment)
        other = np.where(t >= 1.0, np.minimum(segment + 1, last), other)
        own = self._unit(segment)
        mean = own + self._unit(other)
        length = np.hypot(mean[:, 0], mean[:, 1])[:, np.newaxis]
        # A road that turns back on itself has no mean direction.
        return np.divide(mean, length, out=own, where=length > 1e-9)

    def _unit(self, segment: Ints) -> Floats:
        step = self._xy[segment + 1] - self._xy[segment]
        length = np.hypot(step[:, 0], step[:, 1])[:, np.newaxis]
        return np.divide(step, length, out=np.zeros_like(step), where=length > 0)
