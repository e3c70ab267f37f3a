"""Which drawings show the same object, and what they say of it together.

The attribute ``object`` rules: drawings with one name are one object, with two names two. A track is one
object too, but tools number whatever is drawn in a single picture as a track: tracks, and drawings without
any id, are the same object where they are of one label and lie on one another in different pictures: points
and areas within their errors (or areas by half of the smaller), lines beside each other.

- The place of a point is the weighted mean of all its drawings.
- Corners are combined only where the annotator said that they are the same corners: one id, as many corners
  in every drawing, and none of them at odds.
- Else an area is that of the drawing that knows it best, and a line takes each stretch from the drawing that
  knows it best: a kerb is longer than one picture shows.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.locate.outlines import Outline, joined, mean_outline
from twin.drives.drive import Annotation

if TYPE_CHECKING:
    import shapely

BESIDE_M = 1.0
"""Lines of one label no further from each other than this are the same line."""
STEP_M = 0.25
"""Lines are compared in pieces so long."""
_SHORTEST_M = 0.5
"""Shorter stretches of a line are left to the drawings beside."""
_SIGMAS = 3.0
_FURTHER_M = 5.0
"""A line that goes on beyond an end shows within so much of it."""
_GATE = 13.8
"""χ² of two degrees of freedom, 99.9 %."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """One drawing, located.

    Attributes
    ----------
    row : Annotation
    outline : Outline
        Located throughout.
    epoch_ns : int
    has_ends : (bool, bool)
        Whether the object ends at its first and its last corner: False where the line goes on beyond the
        reach or out of the picture.
    """

    row: Annotation
    outline: Outline
    epoch_ns: int
    has_ends: tuple[bool, bool] = (True, True)

    @property
    def picture(self) -> tuple[str, int]:
        """Camera and frame."""
        return self.row.camera, self.row.frame

    @property
    def sigma_m(self) -> float:
        """Of its corners, on the average: what drawings of one object are compared by."""
        return float(np.sqrt(np.trace(self.outline.corner_m2, axis1=1, axis2=2).mean()))

    def plane_m(self) -> FloatArray:
        """Corners in EPSG:25833, float64 (k, 2)."""
        return np.stack(utm33_from_geographic(self.outline.latitude_deg, self.outline.longitude_deg), axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class OneObject:
    """An object and its drawings, the best of them first.

    Attributes
    ----------
    readings : tuple of Reading
    outline : Outline
    n_used : int
        Drawings that the outline comes from.
    is_whole : bool
    """

    readings: tuple[Reading, ...]
    outline: Outline
    n_used: int
    is_whole: bool

    @property
    def best(self) -> Reading:
        """The drawing that knows the object best."""
        return self.readings[0]


def same_objects(readings: Sequence[Reading], way: tuple[FloatArray, FloatArray]) -> list[OneObject]:
    """Find out which drawings are one object, and where it lies.

    Parameters
    ----------
    readings : sequence of Reading
    way : latitude and longitude
        Where the car drove: lines go on along it.
    """
    units: dict[tuple[str, str, str], list[Reading]] = defaultdict(list)
    for reading in sorted(readings, key=lambda one: (one.sigma_m, one.picture, one.row.object)):
        units[reading.row.kind, reading.row.label, reading.row.object].append(reading)
    groups: list[list[Reading]] = []
    open_to: dict[tuple[str, str], list[list[Reading]]] = defaultdict(list)
    for (kind, label, _), unit in units.items():
        if unit[0].row.has_id and not unit[0].row.is_track:
            groups.append(unit)
            continue
        others = open_to[kind, label]
        same = [group for group in others if _lie_together(unit, group, may_share_pictures=kind == "line")]
        # A line joins all that it lies beside; of points and areas the first, which is known best.
        same = same if kind == "line" else same[:1]
        rest = [group for group in others if not any(group is one for one in same)]
        whole = [one for group in (*same, unit) for one in group]
        open_to[kind, label] = [*rest, sorted(whole, key=lambda one: one.sigma_m)]
    groups += [group for several in open_to.values() for group in several]
    return [_together(group, way) for group in groups]


def _lie_together(some: Sequence[Reading], others: Sequence[Reading], *, may_share_pictures: bool) -> bool:
    """Whether drawings of two objects show one, in any two different pictures."""
    pictures = {one.picture for one in some}
    if not may_share_pictures and not pictures.isdisjoint(one.picture for one in others):
        return False
    pairs = ((one, other) for one in some for other in others if one.picture != other.picture)
    return any(_is_same(one, other) for one, other in pairs)


def _is_same(a: Reading, b: Reading) -> bool:
    """Whether two drawings of different pictures lie on one another."""
    import shapely

    if a.row.kind == "line":
        beside = _covered(_pieces(a), _pieces(b))
        return bool(beside.sum() * STEP_M >= min(_SHORTEST_M * 2, 0.5 * beside.size * STEP_M))
    one, other = a.plane_m(), b.plane_m()
    if a.row.kind == "area":
        first, second = (shapely.make_valid(shapely.Polygon(corners)) for corners in (one, other))
        if first.intersection(second).area >= 0.5 * min(first.area, second.area):
            return True
    apart = one.mean(axis=0) - other.mean(axis=0)
    covariance = _middle_m2(a.outline) + _middle_m2(b.outline)
    return bool(apart @ np.linalg.solve(covariance, apart) <= _GATE)


def _middle_m2(outline: Outline) -> FloatArray:
    """Covariance of the mean of the corners."""
    shared = outline.shared_m.mean(axis=0)
    return np.asarray(outline.own_m2.sum(axis=0) / len(outline.own_m2) ** 2 + shared @ shared.T)


def _together(group: Sequence[Reading], way: tuple[FloatArray, FloatArray]) -> OneObject:
    """Settle the outline of one object; the drawings are in order of their sigmas."""
    best, n = group[0], len(group)
    corners = {len(one.outline.own_m2) for one in group}
    may_combine = best.row.kind == "point" or (
        len({one.row.object for one in group}) == 1
        and len(corners) == 1
        and all(all(one.has_ends) for one in group)
    )
    if n > 1 and may_combine:
        mean = mean_outline([one.outline for one in group])
        if mean is not None:
            return OneObject(tuple(group), mean[0], n - mean[1], is_whole=True)
    if n > 1 and best.row.kind == "line":
        return _stitched(group, way)
    return OneObject(tuple(group), best.outline, 1, all(best.has_ends))


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """A line in pieces of `STEP_M`: ends in EPSG:25833, and where their ends lie on the sides."""

    begin_m: FloatArray
    end_m: FloatArray
    place: FloatArray
    """Of the ends, float64 (n + 1,), as `Outline.at` takes it."""
    sigma_m: FloatArray
    """Of the middles."""

    @property
    def middle_m(self) -> FloatArray:
        return np.asarray((self.begin_m + self.end_m) / 2.0)


def _pieces(reading: Reading) -> _Pieces:
    point = reading.plane_m()
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(point, axis=0).T))])
    cuts = np.linspace(0.0, along[-1], max(1, round(along[-1] / STEP_M)) + 1)
    place = np.interp(cuts, along, np.arange(len(point)))
    ends = np.stack([np.interp(cuts, along, column) for column in point.T], axis=1)
    middle = reading.outline.at((place[:-1] + place[1:]) / 2.0)
    sigma_m = np.sqrt(np.trace(middle.corner_m2, axis1=1, axis2=2))
    return _Pieces(ends[:-1], ends[1:], place, sigma_m)


def _covered(pieces: _Pieces, others: _Pieces) -> BoolArray:
    """Which pieces have a piece of the others beside them."""
    side = others.end_m - others.begin_m
    size = np.hypot(*side.T)
    unit = side / np.where(size > 0.0, size, 1.0)[:, None]
    off = pieces.middle_m[:, None] - others.begin_m[None]
    along = np.einsum("ijk,jk->ij", off, unit)
    across = np.abs(off[..., 0] * unit[:, 1] - off[..., 1] * unit[:, 0])
    return np.asarray(((along >= 0.0) & (along <= size) & (across <= BESIDE_M)).any(axis=1))


def _stitched(group: Sequence[Reading], way: tuple[FloatArray, FloatArray]) -> OneObject:
    """Take each stretch of a line from the drawing that knows it best."""
    import shapely

    lines = [_pieces(one) for one in group]
    kept = [np.ones(len(line.begin_m), dtype=np.bool_) for line in lines]
    for i, line in enumerate(lines):
        for j, other in enumerate(lines):
            if i != j:
                kept[i] &= ~_known_better(line, other, is_first=i < j)
    ends = _ends(group, lines)
    for end in ends:
        kept = [own & ~end.is_beyond(line) for own, line in zip(kept, lines, strict=True)]
    road = shapely.LineString(np.stack(utm33_from_geographic(*way), axis=1)) if len(way[0]) > 1 else None
    found = []
    for i, (reading, line) in enumerate(zip(group, lines, strict=True)):
        for first, last in _runs(kept[i]):
            if (last - first) * STEP_M >= _SHORTEST_M:
                found.append(_stretch(i, reading, line, (first, last), road))
    if not found:  # each stretch was too short by itself
        return OneObject(tuple(group), group[0].outline, 1, all(group[0].has_ends))
    found.sort(key=lambda one: one.station)
    return OneObject(
        tuple(group),
        joined([one.outline for one in found]),
        len({one.reading for one in found}),
        is_whole=len(ends) == 2,
    )


def _known_better(line: _Pieces, other: _Pieces, *, is_first: bool) -> BoolArray:
    """Which pieces of a line another drawing knows better; of equals the first counts."""
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(other.middle_m).query(line.middle_m)
    beside = other.sigma_m[nearest]
    better = beside < line.sigma_m if is_first else beside <= line.sigma_m
    return np.asarray(_covered(line, other) & better)


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """Where a drawing says that the line ends: pieces that go on there are errors along the line."""

    at_m: FloatArray
    outwards: FloatArray
    sigma_m: float

    def _off(self, line: _Pieces) -> tuple[FloatArray, FloatArray, FloatArray]:
        off = line.middle_m - self.at_m
        across = np.abs(off[:, 0] * self.outwards[1] - off[:, 1] * self.outwards[0])
        return off @ self.outwards, across, _SIGMAS * np.hypot(line.sigma_m, self.sigma_m)

    def is_beyond(self, line: _Pieces) -> BoolArray:
        """Which pieces lie beyond the end, as far as errors explain that."""
        along, across, reach = self._off(line)
        return np.asarray((along > 0.0) & (along <= reach) & (across <= BESIDE_M))

    def contradicts(self, line: _Pieces) -> bool:
        """Whether the line goes on here, by more than errors explain."""
        along, across, reach = self._off(line)
        near = (along <= reach + _FURTHER_M) & (across <= BESIDE_M)
        return bool(((along > reach) & near).any())


def _ends(group: Sequence[Reading], lines: Sequence[_Pieces]) -> list[_End]:
    """Return the two ends, each by the drawing that knows it best of those that no other contradicts."""
    found = []
    for reading, line in zip(group, lines, strict=True):
        for is_end, at_m, inner_m, sigma_m in (
            (reading.has_ends[0], line.begin_m[0], line.end_m[0], line.sigma_m[0]),
            (reading.has_ends[1], line.end_m[-1], line.begin_m[-1], line.sigma_m[-1]),
        ):
            size = float(np.hypot(*(at_m - inner_m)))
            if is_end and size > 0.0:
                found.append(_End(at_m, (at_m - inner_m) / size, float(sigma_m)))
    sure = [end for end in found if not any(end.contradicts(line) for line in lines)]
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

    reading: int
    station: float
    outline: Outline


def _stretch(
    number: int, reading: Reading, line: _Pieces, run: tuple[int, int], road: shapely.LineString | None
) -> _Stretch:
    import shapely

    first, last = run
    begin, end = line.place[first], line.place[last]
    place = np.concatenate([[begin], np.arange(np.ceil(begin + 1e-9), end - 1e-9), [end]])
    station = np.full(2, float(reading.epoch_ns))
    if road is not None:
        points = shapely.points(np.stack([line.begin_m[first], line.end_m[last - 1]]))
        station = np.asarray(shapely.line_locate_point(road, points))
    if station[0] > station[1]:
        place = place[::-1]
    return _Stretch(number, float(station.mean()), reading.outline.at(place))
