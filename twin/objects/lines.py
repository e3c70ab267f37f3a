"""Drawings of one line, each of a stretch of it → the whole line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.locate.outlines import Outline, joined

if TYPE_CHECKING:
    import shapely

BESIDE_M = 1.0
"""Lines of one label no further from each other than this are the same line."""
STEP_M = 0.25
"""Lines are compared in pieces so long."""
SHORTEST_M = 0.5
"""Shorter stretches of a line are left to the drawings beside."""
_SIGMAS = 3.0
_FURTHER_M = 5.0
"""A line that goes on beyond an end shows within so much of it."""
_NEAR_M = 10.0
"""Drawings whose boxes, made larger by so much, do not meet say nothing of each other."""


class Stitched(NamedTuple):
    """A whole line, how many drawings it comes from, and whether both its ends were drawn."""

    outline: Outline
    n_used: int
    is_whole: bool


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """A line in pieces of `STEP_M`: ends in EPSG:25833, and where their ends lie on the sides."""

    begin_m: FloatArray
    end_m: FloatArray
    place: FloatArray
    """Of the ends, float64 (n + 1,), as `Outline.at` takes it."""
    sigma_m: FloatArray
    """Of the middles."""

    @property
    def middle_m(self) -> FloatArray:
        """Middles of the pieces."""
        return np.asarray((self.begin_m + self.end_m) / 2.0)

    def corners_m(self) -> FloatArray:
        """Ends of all pieces, float64 (n + 1, 2)."""
        return np.concatenate([self.begin_m, self.end_m[-1:]])


def pieces_of(outline: Outline, corners_m: FloatArray) -> Pieces:
    """Cut a line, whose corners are given in EPSG:25833, into pieces of one length."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners_m, axis=0).T))])
    cuts = np.linspace(0.0, along[-1], max(1, round(along[-1] / STEP_M)) + 1)
    place = np.interp(cuts, along, np.arange(len(corners_m)))
    ends = np.stack([np.interp(cuts, along, column) for column in corners_m.T], axis=1)
    middle = outline.at((place[:-1] + place[1:]) / 2.0)
    sigma_m = np.sqrt(np.trace(middle.corner_m2, axis1=1, axis2=2))
    return Pieces(ends[:-1], ends[1:], place, sigma_m)


def neighbours(shapes_m: Sequence[FloatArray], margin_m: float | FloatArray) -> list[list[int]]:
    """Return, for each shape of corners (k, 2), the others whose boxes come within the margins of its own."""
    import shapely

    low = np.array([corners.min(axis=0) for corners in shapes_m]) - np.reshape(margin_m, (-1, 1))
    high = np.array([corners.max(axis=0) for corners in shapes_m]) + np.reshape(margin_m, (-1, 1))
    boxes = shapely.box(*low.T, *high.T)
    found: list[list[int]] = [[] for _ in shapes_m]
    for one, other in shapely.STRtree(boxes).query(boxes, predicate="intersects").T.tolist():
        if one != other:
            found[one].append(other)
    return [sorted(near) for near in found]


def covered(pieces: Pieces, others: Pieces) -> BoolArray:
    """Which pieces have a piece of the others beside them."""
    side = others.end_m - others.begin_m
    size = np.hypot(*side.T)
    unit = side / np.where(size > 0.0, size, 1.0)[:, None]
    off = pieces.middle_m[:, None] - others.begin_m[None]
    along = np.einsum("ijk,jk->ij", off, unit)
    across = np.abs(off[..., 0] * unit[:, 1] - off[..., 1] * unit[:, 0])
    return np.asarray(((along >= 0.0) & (along <= size) & (across <= BESIDE_M)).any(axis=1))


def stitched(
    outlines: Sequence[Outline],
    lines: Sequence[Pieces],
    has_ends: Sequence[tuple[bool, bool]],
    way: tuple[FloatArray, FloatArray],
) -> Stitched | None:
    """Take each stretch of a line from the drawing that knows it best.

    Parameters
    ----------
    outlines : sequence of Outline
        Of drawings of one line.
    lines : sequence of Pieces
        The same in pieces.
    has_ends : sequence of (bool, bool)
        Whether the line ends at the first and the last corner of each.
    way : latitude and longitude
        Where the car drove: parts stand in this order.

    Returns
    -------
    Stitched or None
        None where every stretch is too short by itself.
    """
    import shapely

    near = neighbours([line.corners_m() for line in lines], _NEAR_M)
    kept = []
    for i, line in enumerate(lines):
        better = [_known_better(line, lines[j], is_first=i < j) for j in near[i]]
        kept.append(~np.any(better, axis=0) if better else np.ones(len(line.begin_m), dtype=np.bool_))
    ends = _ends(lines, has_ends, near)
    for end in ends:
        kept = [own & ~end.is_beyond(line) for own, line in zip(kept, lines, strict=True)]
    road = shapely.LineString(np.stack(utm33_from_geographic(*way), axis=1)) if len(way[0]) > 1 else None
    found = [
        _stretch(i, outline, line, run, road)
        for i, (outline, line) in enumerate(zip(outlines, lines, strict=True))
        for run in _runs(kept[i])
        if (run[1] - run[0]) * STEP_M >= SHORTEST_M
    ]
    if not found:
        return None
    found.sort(key=lambda one: one.station)
    return Stitched(
        joined([one.outline for one in found]), len({one.number for one in found}), is_whole=len(ends) == 2
    )


def _known_better(line: Pieces, other: Pieces, *, is_first: bool) -> BoolArray:
    """Which pieces of a line another drawing knows better; of equals the first counts."""
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(other.middle_m).query(line.middle_m)
    beside = other.sigma_m[nearest]
    better = beside < line.sigma_m if is_first else beside <= line.sigma_m
    return np.asarray(covered(line, other) & better)


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """Where a drawing says that the line ends: pieces that go on there are errors along the line."""

    at_m: FloatArray
    outwards: FloatArray
    sigma_m: float

    def _off(self, line: Pieces) -> tuple[FloatArray, FloatArray, FloatArray]:
        off = line.middle_m - self.at_m
        across = np.abs(off[:, 0] * self.outwards[1] - off[:, 1] * self.outwards[0])
        return off @ self.outwards, across, _SIGMAS * np.hypot(line.sigma_m, self.sigma_m)

    def is_beyond(self, line: Pieces) -> BoolArray:
        """Which pieces lie beyond the end, as far as errors explain that."""
        along, across, reach = self._off(line)
        return np.asarray((along > 0.0) & (along <= reach) & (across <= BESIDE_M))

    def contradicts(self, line: Pieces) -> bool:
        """Whether the line goes on here, by more than errors explain."""
        along, across, reach = self._off(line)
        near = (along <= reach + _FURTHER_M) & (across <= BESIDE_M)
        return bool(((along > reach) & near).any())


def _ends(
    lines: Sequence[Pieces], has_ends: Sequence[tuple[bool, bool]], near: Sequence[Sequence[int]]
) -> list[_End]:
    """Return the two ends, each by the drawing that knows it best of those that no other contradicts."""
    sure = []
    for line, (begins, stops), others in zip(lines, has_ends, near, strict=True):
        for is_end, at_m, inner_m, sigma_m in (
            (begins, line.begin_m[0], line.end_m[0], line.sigma_m[0]),
            (stops, line.end_m[-1], line.begin_m[-1], line.sigma_m[-1]),
        ):
            size = float(np.hypot(*(at_m - inner_m)))
            if not is_end or not size:
                continue
            end = _End(at_m, (at_m - inner_m) / size, float(sigma_m))
            if not any(end.contradicts(lines[k]) for k in others):
                sure.append(end)
    kept: list[_End] = []
    for end in sorted(sure, key=lambda one: one.sigma_m):
        if not any(end.outwards @ other.outwards > 0.0 for other in kept):
            kept.append(end)
    return kept[:2]


def _runs(kept: BoolArray) -> list[tuple[int, int]]:
    """First piece and the one after the last of each stretch."""
    edges: IntArray = np.flatnonzero(np.diff(np.concatenate([[0], kept.astype(np.int64), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


class _Stretch(NamedTuple):
    """A stretch of a line in the direction of the drive, from one drawing."""

    number: int
    station: float
    outline: Outline


def _stretch(
    number: int, outline: Outline, line: Pieces, run: tuple[int, int], road: shapely.LineString | None
) -> _Stretch:
    import shapely

    first, last = run
    begin, end = line.place[first], line.place[last]
    place = np.concatenate([[begin], np.arange(np.ceil(begin + 1e-9), end - 1e-9), [end]])
    station = np.full(2, float(number))
    if road is not None:
        points = shapely.points(np.stack([line.begin_m[first], line.end_m[last - 1]]))
        station = np.asarray(shapely.line_locate_point(road, points))
    if station[0] > station[1]:
        place = place[::-1]
    return _Stretch(number, float(station.mean()), outline.at(place))
