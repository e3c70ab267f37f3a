"""Objects on the ground against NVDB's of the same type: new, found, missing, of another size.

Everything is judged by geometry alone, within three sigmas of both sides. Lines are compared stretch by
stretch, since NVDB cuts a guard rail elsewhere than an annotator does; anything else one to one, by distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.earth.geodesy import geographic_from_utm33, utm33_from_geographic
from geoloc.locate.combine import ellipse
from geoloc.locate.visibility import views
from twin.matching.config import MatchConfig
from twin.objects.locate import DriveObjects, GroundObject
from twin.objects.nvdb import NvdbObject, NvdbObjects
from twin.objects.shapes import plane_geometry

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

NVDB_SIGMA_M = 0.3
_SIGMAS = 3.0
_SAMPLE_M = 0.5
"""NVDB's lines are looked at in pieces so long."""
_NEAR_M = 30.0
"""Objects of NVDB further from the driven way are none of the drive's."""
_ENOUGH_M = 5.0
"""Of a line so much must have been in view, or half of it, before nothing of it says that it is gone."""


class GroundVerdict(StrEnum):
    """What becomes of an object of either side."""

    NEW = "new"
    FOUND = "found"
    SIZE_DIFFERS = "size differs"
    MISSING = "missing"
    NOT_DRAWN = "not drawn"
    """In view, and not drawn, in a drive of which nobody says that everything was drawn."""
    NOT_SEEN = "not seen"


@dataclass(frozen=True, slots=True)
class Compared:
    """One object of NVDB with what was found of it, or one that NVDB does not have.

    Attributes
    ----------
    verdict : GroundVerdict
    nvdb_type : int
    nvdb_id : str
        "" of what is new.
    objects : tuple of str
        Ours.
    distance_m, sigma_m : float
        Between the geometries, and its one sigma; NaN where there are not two.
    nvdb_size, seen_size, found_size : float
        Metres of lines, square metres of areas: all that NVDB has; what of it was in view; what of it was
        found. NaN where there is no size to compare.
    beyond_m : float
        Of lines, what was found beyond NVDB's ends.
    size_sigma : float
        One sigma of what differs in size.
    geometry : shapely geometry
        EPSG:25833: NVDB's, or ours where it is new.
    """

    verdict: GroundVerdict
    nvdb_type: int
    nvdb_id: str
    objects: tuple[str, ...]
    geometry: BaseGeometry
    distance_m: float = np.nan
    sigma_m: float = np.nan
    nvdb_size: float = np.nan
    seen_size: float = np.nan
    found_size: float = np.nan
    beyond_m: float = np.nan
    size_sigma: float = np.nan


@dataclass(frozen=True, slots=True)
class Comparison:
    """A drive's objects against NVDB's of some types.

    Attributes
    ----------
    rows : tuple of Compared
    left_out : int
        Objects of NVDB without a geometry of their own.
    elsewhere : int
        Objects of NVDB further than 30 m from where the car drove: nothing is said of them.
    """

    rows: tuple[Compared, ...]
    left_out: int
    elsewhere: int


@dataclass(frozen=True, slots=True)
class _Ours:
    """One of ours, with its geometry and the longest axis of its worst corner's ellipse."""

    object: GroundObject
    geometry: BaseGeometry
    sigma_m: float


def compare(
    found: DriveObjects,
    nvdb: Sequence[NvdbObjects],
    *,
    nvdb_sigma_m: float = NVDB_SIGMA_M,
    all_drawn: bool = False,
) -> Comparison:
    """Compare a drive's objects with NVDB's.

    Parameters
    ----------
    found : DriveObjects
    nvdb : sequence of NvdbObjects
        A type each.
    nvdb_sigma_m : float
        One sigma of NVDB's positions, a horizontal axis.
    all_drawn : bool
        Whether every object of these types that was in view was drawn: only then one can be missing.
    """
    rows: list[Compared] = []
    judge, elsewhere = _Judge(found, nvdb_sigma_m, all_drawn), 0
    for of_type in nvdb:
        ours = [
            _Ours(one, plane_geometry(one), float(np.max(ellipse(one.outline.corner_m2)[0])))
            for one in found.objects
            if one.nvdb_type == of_type.nvdb_type
        ]
        theirs = _along_the_way(found, of_type.objects)
        elsewhere += len(of_type.objects) - len(theirs)
        lines = [one for one in theirs if one.geometry.geom_type.endswith("LineString")]
        others = [one for one in theirs if not one.geometry.geom_type.endswith("LineString")]
        our_lines = [one for one in ours if one.object.kind == "line"]
        if ours and not our_lines:
            rows += judge.places(ours, theirs)
            continue
        rows += judge.stretches(our_lines, lines)
        rows += judge.places([one for one in ours if one.object.kind != "line"], others)
    return Comparison(tuple(rows), sum(one.left_out for one in nvdb), elsewhere)


def _along_the_way(found: DriveObjects, theirs: Sequence[NvdbObject]) -> list[NvdbObject]:
    """Those of NVDB's that the car may have come near."""
    import shapely

    valid = found.poses.valid
    way = utm33_from_geographic(found.poses.latitude_deg[valid], found.poses.longitude_deg[valid])
    if not theirs or len(way[0]) < 2:
        return list(theirs)
    apart = shapely.distance(shapely.LineString(np.stack(way, axis=1)), [one.geometry for one in theirs])
    return [one for one, distance in zip(theirs, apart.tolist(), strict=True) if distance <= _NEAR_M]


@dataclass(frozen=True, slots=True)
class _Judge:
    found: DriveObjects
    nvdb_sigma_m: float
    all_drawn: bool

    def reach_m(self, one: _Ours) -> float:
        """How far apart the same object may lie on both sides."""
        return float(_SIGMAS * np.hypot(one.sigma_m, self.nvdb_sigma_m))

    def unfound(self, is_seen: bool) -> GroundVerdict:
        """What is said of an object of NVDB that nothing was drawn of."""
        if not is_seen:
            return GroundVerdict.NOT_SEEN
        return GroundVerdict.MISSING if self.all_drawn else GroundVerdict.NOT_DRAWN

    def seen(self, points_m: FloatArray) -> BoolArray:
        """Whether each place (n, 2) was in view in pictures enough."""
        config, drive = MatchConfig(), self.found.drive
        lat, lon = geographic_from_utm33(points_m[:, 0], points_m[:, 1])
        cameras = sorted({row.camera for row in drive.on_ground})
        count = np.zeros(len(points_m), dtype=np.int64)
        for view in views(
            drive.rig, self.found.poses, lat, lon, max_range_m=config.view_range_m, cameras=cameras
        ):
            np.add.at(count, view.site, 1)
        return np.asarray(count >= config.min_views)

    def places(self, ours: Sequence[_Ours], theirs: Sequence[NvdbObject]) -> list[Compared]:
        """Compare one to one, the nearest first."""
        import shapely

        shapes = [other.geometry for other in theirs]
        pairs = sorted(
            (distance, i, j)
            for i, one in enumerate(ours)
            for j, distance in enumerate(shapely.distance(one.geometry, shapes).tolist())
            if distance <= self.reach_m(one)
        )
        of_theirs: dict[int, tuple[int, float]] = {}
        taken: set[int] = set()
        for distance, i, j in pairs:
            if i not in taken and j not in of_theirs:
                taken.add(i)
                of_theirs[j] = (i, distance)
        rows = []
        middles = np.array([(one.geometry.centroid.x, one.geometry.centroid.y) for one in theirs])
        seen = self.seen(middles.reshape(-1, 2))
        for j, other in enumerate(theirs):
            if j in of_theirs:
                i, distance = of_theirs[j]
                rows.append(self._pair(ours[i], other, distance))
            else:
                verdict = self.unfound(bool(seen[j]))
                rows.append(Compared(verdict, other.nvdb_type, other.nvdb_id, (), other.geometry))
        return rows + [_new(one) for i, one in enumerate(ours) if i not in taken]

    def _pair(self, one: _Ours, other: NvdbObject, distance_m: float) -> Compared:
        sigma_m = float(np.hypot(one.sigma_m, self.nvdb_sigma_m))
        area, size = one.object.area, float(other.geometry.area)
        if area is None or not size:
            return Compared(
                *(GroundVerdict.FOUND, other.nvdb_type, other.nvdb_id, (one.object.object,), other.geometry),
                *(distance_m, sigma_m),
            )
        sigma = float(np.hypot(area.sigma, _area_sigma(other.geometry, self.nvdb_sigma_m)))
        differs = abs(area.value - size) > _SIGMAS * sigma
        return Compared(
            verdict=GroundVerdict.SIZE_DIFFERS if differs else GroundVerdict.FOUND,
            nvdb_type=other.nvdb_type,
            nvdb_id=other.nvdb_id,
            objects=(one.object.object,),
            geometry=other.geometry,
            distance_m=distance_m,
            sigma_m=sigma_m,
            nvdb_size=size,
            found_size=area.value,
            size_sigma=sigma,
        )

    def stretches(self, ours: Sequence[_Ours], theirs: Sequence[NvdbObject]) -> list[Compared]:
        """Compare lines: what of NVDB's was seen, what of that was found, what goes on beyond its ends."""
        import shapely

        shapes = np.array([other.geometry for other in theirs], dtype=object)
        beyond_m, mine, new = np.zeros(len(theirs)), [list[_Ours]() for _ in theirs], []
        for one in ours:
            beside = shapely.buffer(shapes, self.reach_m(one), cap_style="flat")
            common = shapely.length(shapely.intersection(beside, one.geometry))
            runs = np.flatnonzero(common >= min(1.0, 0.5 * one.geometry.length))
            if not runs.size:
                new.append(_new(one))
                continue
            for j in runs.tolist():
                mine[j].append(one)
            outside = one.geometry.difference(shapely.union_all(beside[runs]))
            for part in shapely.get_parts(outside):
                beyond_m[runs[np.argmin(shapely.distance(shapes[runs], part))]] += part.length
        samples = [_samples(other.geometry) for other in theirs]
        ends = np.cumsum([len(points) for points, _ in samples])[:-1]
        seen = np.split(self.seen(np.concatenate([np.empty((0, 2)), *(at for at, _ in samples)])), ends)
        judged = zip(theirs, mine, beyond_m.tolist(), samples, seen, strict=False)
        return [self._line(*one) for one in judged] + new

    def _line(
        self,
        other: NvdbObject,
        mine: Sequence[_Ours],
        beyond_m: float,
        sample: tuple[FloatArray, float],
        in_view: BoolArray,
    ) -> Compared:
        import shapely

        points, piece_m = sample
        places = shapely.points(points)
        covered = np.zeros(len(points), dtype=np.bool_)
        for one in mine:
            area = shapely.buffer(one.geometry, self.reach_m(one), cap_style="flat")
            covered |= shapely.intersects(area, places)
        seen = in_view | covered
        gap_m, found_m = float((seen & ~covered).sum() * piece_m), float(covered.sum() * piece_m)
        if not mine:
            enough_m = min(_ENOUGH_M, 0.5 * float(other.geometry.length))
            verdict = self.unfound(bool(seen.sum() * piece_m >= enough_m))
            return Compared(
                *(verdict, other.nvdb_type, other.nvdb_id, (), other.geometry),
                nvdb_size=float(other.geometry.length),
                seen_size=float(seen.sum() * piece_m),
            )
        # Either end of both lines is off along the line; what is cut at the reach has no end there.
        sigma = float(np.hypot(max(one.sigma_m for one in mine), self.nvdb_sigma_m))
        shorter = self.all_drawn and gap_m - piece_m > _SIGMAS * sigma
        return Compared(
            verdict=GroundVerdict.SIZE_DIFFERS
            if shorter or beyond_m > _SIGMAS * sigma
            else GroundVerdict.FOUND,
            nvdb_type=other.nvdb_type,
            nvdb_id=other.nvdb_id,
            objects=tuple(one.object.object for one in mine),
            geometry=other.geometry,
            distance_m=min(float(shapely.distance(one.geometry, other.geometry)) for one in mine),
            sigma_m=sigma,
            nvdb_size=float(other.geometry.length),
            seen_size=float(seen.sum() * piece_m),
            found_size=found_m,
            beyond_m=beyond_m,
            size_sigma=sigma,
        )


def _new(one: _Ours) -> Compared:
    measure = one.object.length or one.object.area
    return Compared(
        *(GroundVerdict.NEW, one.object.nvdb_type or 0, "", (one.object.object,), one.geometry),
        found_size=np.nan if measure is None else measure.value,
        size_sigma=np.nan if measure is None else measure.sigma,
    )


def _samples(line: BaseGeometry) -> tuple[FloatArray, float]:
    """Middles of the pieces of a line (n, 2), and how long each is."""
    import shapely

    count = max(1, round(line.length / _SAMPLE_M))
    piece_m = line.length / count
    parts = list(getattr(line, "geoms", [line]))
    starts = np.cumsum([0.0, *(part.length for part in parts)])
    at = (np.arange(count) + 0.5) * piece_m
    which = np.clip(np.searchsorted(starts, at, side="right") - 1, 0, len(parts) - 1)
    points = shapely.line_interpolate_point(np.array(parts)[which], at - starts[which])
    return np.asarray(shapely.get_coordinates(points)), float(piece_m)


def _area_sigma(polygon: BaseGeometry, sigma_m: float) -> float:
    """One sigma of an area each of whose corners is off by itself."""
    import shapely

    total = 0.0
    for ring in shapely.get_rings(polygon):
        corner = shapely.get_coordinates(ring)[:-1]
        chord = np.roll(corner, -1, axis=0) - np.roll(corner, 1, axis=0)
        total += float(np.sum((0.5 * sigma_m * np.hypot(*chord.T)) ** 2))
    return float(np.sqrt(total))
