"""A finding's map: GeoJSON of what was seen, what NVDB says, and from where it was looked at."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.locate.combine import cep95_m, ring95_m
from twin.review.drives import DriveShown, degrees_from_utm33, glances_at, glances_towards, track_near
from twin.review.index import NEAR_M, Index
from twin.review.records import Feature, FeatureCollection, Geometry, Properties
from twin.store import schema
from twin.store.records import Estimate, Finding
from twin.store.store import Row, Snapshot
from twin.words import sign_titles

_MAX_RAYS = 24
_TRACK_M = 0.3
"""How far a simplified track may lie from where the car was: less than a mark covers."""
_CORNERS = 48
_SEEN_FROM_M = 20.0
"""How far a place is looked at from, as `twin match` counts it: ``view_range_m``."""


@dataclass(frozen=True, slots=True)
class Seeing:
    """A drive, and the object in it that a finding rests on; None of one that did not see it."""

    drive: DriveShown
    estimate: Estimate | None


def map_of(
    view: Snapshot,
    finding: Finding,
    nvdb_m: FloatArray | None,
    seeing: Sequence[Seeing],
    index: Index,
) -> FeatureCollection:
    """Draw a finding's map.

    Parameters
    ----------
    view : Snapshot
    finding : Finding
    nvdb_m : float64 (2,) or None
        NVDB's position, EPSG:25833.
    seeing : sequence of Seeing
    index : Index
        Whose findings and signs stand around.
    """
    features: list[Feature] = []
    for one in seeing:
        features += _of_drive(view, finding, one)
    features += _neighbours(finding, index)
    if finding.covariance_m2 is not None:
        features.append(_ellipse(finding, finding.covariance_m2))
    if nvdb_m is not None:
        features += _points("nvdb", nvdb_m[None])
    if finding.n_sightings:
        features += _points("seen", np.array([[finding.east_m, finding.north_m]]))
    return FeatureCollection(features)


def tracks_of(view: Snapshot) -> FeatureCollection:
    """Draw where all drives went, as exactly as a map of all findings shows it."""
    drive = schema.drive.c
    rows = view.rows(sa.select(drive.name, drive.line).order_by(drive.started_ns))
    lines = shapely.simplify(shapely.from_wkb([row["line"] for row in rows]), _TRACK_M)
    tracks = [shapely.get_coordinates(line) for line in lines]
    return FeatureCollection(
        [_line("track", at_m, row["name"]) for row, at_m in zip(rows, tracks, strict=True) if len(at_m) > 1]
    )


def radius95_m(covariance_m2: tuple[float, float, float]) -> float:
    """Return the radius of the circle that holds the sign with 95 % probability."""
    return float(cep95_m(_matrix(covariance_m2)))


def _matrix(covariance_m2: tuple[float, float, float]) -> FloatArray:
    ee, en, nn = covariance_m2
    return np.array([[ee, en], [en, nn]], dtype=np.float64)


def _ellipse(finding: Finding, covariance_m2: tuple[float, float, float]) -> Feature:
    place = np.array([finding.east_m, finding.north_m])
    corners = place + ring95_m(_matrix(covariance_m2), _CORNERS)
    ring = degrees_from_utm33(np.vstack([corners, corners[:1]]))
    return Feature(Geometry("Polygon", [ring]), Properties(kind="ellipse"))


def _of_drive(view: Snapshot, finding: Finding, seeing: Seeing) -> Iterator[Feature]:
    drive, estimate = seeing.drive, seeing.estimate
    for piece in track_near(drive, finding.east_m, finding.north_m, NEAR_M):
        yield _line("track", piece, drive.name)
    sightings = [] if estimate is None else _sightings(view, estimate)
    if sightings:
        rays = [row for row in sightings if row["eye_east_m"] is not None]
        for at in np.unique(np.linspace(0, len(rays) - 1, min(len(rays), _MAX_RAYS)).round().astype(int)):
            row = rays[at]
            ends = [(row["eye_east_m"], row["eye_north_m"]), (finding.east_m, finding.north_m)]
            yield _line("ray", np.array(ends), drive.name, row["camera"])
        glances = glances_at(
            drive, [row["epoch_ns"] for row in sightings], [row["camera"] for row in sightings]
        )
    else:
        ((lon, lat),) = degrees_from_utm33(np.array([[finding.east_m, finding.north_m]]))
        glances = glances_towards(drive, lon, lat, _SEEN_FROM_M)
    for glance in glances:
        of = Properties(kind="camera", drive=drive.name, camera=glance.camera, facing_deg=glance.facing_deg)
        yield Feature(Geometry("Point", [glance.lon, glance.lat]), of)


def _sightings(view: Snapshot, estimate: Estimate) -> list[Row]:
    s = schema.sighting.c
    return view.rows(
        sa.select(s.camera, s.epoch_ns, s.eye_east_m, s.eye_north_m)
        .where(s.drive_id == estimate.drive_id, s.method == estimate.method.value)
        .where(s.object == estimate.object, s.rejected == "", s.is_measured)
        .order_by(s.epoch_ns)
    )


def _neighbours(finding: Finding, index: Index) -> Iterator[Feature]:
    def near(east_m: FloatArray, north_m: FloatArray) -> list[int]:
        apart = np.hypot(east_m - finding.east_m, north_m - finding.north_m)
        rows: list[int] = np.flatnonzero(apart <= NEAR_M).tolist()
        return rows

    for row in near(index.signs.east_m, index.signs.north_m):
        if index.signs.nvdb_id[row] == _point_of(finding):
            continue
        codes = index.signs.codes.get(index.signs.nvdb_id[row], ())
        at = np.array([[index.signs.east_m[row], index.signs.north_m[row]]])
        yield from _points("neighbour", at, title=sign_titles(codes, index.names))
    for row in near(index.east_m, index.north_m):
        if index.change_id[row] != finding.change_id:
            at = np.array([[index.east_m[row], index.north_m[row]]])
            yield from _points("neighbour", at, title=index.title[row], change_id=index.change_id[row])


def _point_of(finding: Finding) -> int | None:
    """The Skiltpunkt that a finding is about."""
    site = finding.terms.get("site")
    return finding.nvdb_id if site is None else site["nvdb_id"]


def _points(kind: str, at_m: FloatArray, *, title: str = "", change_id: str = "") -> Iterable[Feature]:
    of = Properties(kind=kind, title=title, change_id=change_id)
    return [Feature(Geometry("Point", at), of) for at in degrees_from_utm33(at_m)]


def _line(kind: str, at_m: FloatArray, drive: str, camera: str = "") -> Feature:
    of = Properties(kind=kind, drive=drive, camera=camera)
    return Feature(Geometry("LineString", degrees_from_utm33(at_m)), of)
