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

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.locate.outlines import Outline, joined, mean_outline
from twin.drives.drive import Annotation
from twin.objects.lines import SHORTEST_M, STEP_M, Pieces, covered, neighbours, pieces_of, stitched

_OF_TRACK = ("gnss east", "gnss north", "time", "lever arm x", "lever arm y")
"""Errors that are the same in pictures a few seconds apart, wherever in them an object shows."""
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
    alike: dict[tuple[str, str], list[_Drawn]] = defaultdict(list)
    for reading in sorted(readings, key=lambda one: (one.sigma_m, one.picture, one.row.object)):
        alike[reading.row.kind, reading.row.label].append(_Drawn.of(reading))
    return [
        _together([drawn[k] for k in sorted(group)], way)
        for drawn in alike.values()
        for group in _groups(drawn)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """A drawing and its corners in EPSG:25833; of a line, also its pieces."""

    reading: Reading
    corners_m: FloatArray
    pieces: Pieces | None

    @classmethod
    def of(cls, reading: Reading) -> _Drawn:
        outline = reading.outline
        corners = np.stack(utm33_from_geographic(outline.latitude_deg, outline.longitude_deg), axis=1)
        return cls(reading, corners, pieces_of(outline, corners) if reading.row.kind == "line" else None)


def _groups(drawn: Sequence[_Drawn]) -> list[set[int]]:
    """Which drawings of one kind and label, the best first, are one object each."""
    units: dict[str, set[int]] = defaultdict(set)
    for k, one in enumerate(drawn):
        units[one.reading.row.object].add(k)
    near = neighbours([one.corners_m for one in drawn], np.array([_reach_m(one) for one in drawn]))
    group_of: dict[int, set[int]] = {}
    named = []
    for unit in units.values():
        row = drawn[min(unit)].reading.row
        if row.has_id and not row.is_track:
            named.append(unit)
            continue
        others = {id(group_of[j]): group_of[j] for k in sorted(unit) for j in near[k] if j in group_of}
        whole = unit.union(*_same_as(drawn, unit, list(others.values()), near))
        group_of |= dict.fromkeys(whole, whole)
    return named + list({id(group): group for group in group_of.values()}.values())


def _reach_m(one: _Drawn) -> float:
    """How far from its corners another drawing of the same object may lie."""
    return 1.0 if one.pieces is not None else 4.0 * one.reading.sigma_m


def _same_as(
    drawn: Sequence[_Drawn], unit: set[int], others: Sequence[set[int]], near: Sequence[Sequence[int]]
) -> list[set[int]]:
    """Return the groups that a drawing or track belongs to.

    A line joins all that it lies beside; a point or an area the one that it fits best, of those that no
    picture shows beside it.
    """
    fits = []
    for group in others:
        pairs = [(k, j) for k in unit for j in near[k] if j in group]
        apart = min(_apart(drawn[k], drawn[j]) for k, j in pairs)
        shown = {drawn[k].reading.picture for k in unit}
        may_join = drawn[min(unit)].pieces is not None or shown.isdisjoint(
            drawn[j].reading.picture for j in group
        )
        if apart <= _GATE and may_join:
            fits.append((apart, group))
    fits.sort(key=lambda one: one[0])
    return [group for _, group in (fits if drawn[min(unit)].pieces is not None else fits[:1])]


def _apart(a: _Drawn, b: _Drawn) -> float:
    """How far two drawings of different pictures are from being of one object; up to `_GATE` they are.

    Of points and areas χ² of the distance between their middles, in which the errors of the track cancel.
    Those of the ground and the body's unrest do not: every picture has its own plane.
    """
    if a.reading.picture == b.reading.picture:
        return np.inf
    if a.pieces is not None and b.pieces is not None:
        beside_m = covered(a.pieces, b.pieces).sum() * STEP_M
        return 0.0 if beside_m >= min(2.0 * SHORTEST_M, 0.5 * len(a.pieces.begin_m) * STEP_M) else np.inf
    both = joined([a.reading.outline, b.reading.outline])
    moves = [both.shared_m[both.part == part].mean(axis=0) for part in (0, 1)]
    cancels = np.isin(both.source, _OF_TRACK)
    shared = np.concatenate(
        [moves[0][:, cancels] - moves[1][:, cancels], *(move[:, ~cancels] for move in moves)], axis=1
    )
    own = [both.own_m2[both.part == part].mean(axis=0) / np.sum(both.part == part) for part in (0, 1)]
    covariance = own[0] + own[1] + shared @ shared.T
    apart = a.corners_m.mean(axis=0) - b.corners_m.mean(axis=0)
    distance = float(apart @ np.linalg.solve(covariance, apart))
    return min(distance, _GATE) if _overlap(a, b) else distance


def _overlap(a: _Drawn, b: _Drawn) -> bool:
    """Whether two areas share half of the smaller."""
    import shapely

    if min(len(a.corners_m), len(b.corners_m)) < 3:
        return False
    first, second = shapely.Polygon(a.corners_m), shapely.Polygon(b.corners_m)
    return bool(first.intersection(second).area >= 0.5 * min(first.area, second.area))


def _together(group: Sequence[_Drawn], way: tuple[FloatArray, FloatArray]) -> OneObject:
    """Settle the outline of one object; the drawings are in order of their sigmas."""
    readings, n = tuple(one.reading for one in group), len(group)
    best = readings[0]
    alike = {(one.row.object, len(one.outline.own_m2), *one.has_ends) for one in readings}
    if n > 1 and (best.row.kind == "point" or (len(alike) == 1 and all(best.has_ends))):
        mean = mean_outline([one.outline for one in readings])
        if mean is not None:
            return OneObject(readings, mean[0], n - mean[1], is_whole=True)
    if n > 1 and best.row.kind == "line":
        lines = [one.pieces for one in group if one.pieces is not None]
        whole = stitched([one.outline for one in readings], lines, [one.has_ends for one in readings], way)
        if whole is not None:
            return OneObject(readings, whole.outline, whole.n_used, whole.is_whole)
    return OneObject(readings, best.outline, 1, all(best.has_ends))
