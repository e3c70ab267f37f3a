"""The mirror's rows → sites: a Skiltpunkt with its plates, or plates that share a position."""

from __future__ import annotations

import datetime as dt
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from nvdb.vegnett import stedfester
from twin.matching.config import MatchConfig
from twin.store import schema
from twin.store.sql import cut, each_number, from_json
from twin.store.store import Row, Snapshot

if TYPE_CHECKING:
    from nvdb.vegnett import Vegnett

SKILTPUNKT = 95
SKILTPLATE = 96


@dataclass(frozen=True, slots=True)
class Plate:
    """One Skiltplate of a site."""

    nvdb_id: int
    version: int | None
    code: str
    ansiktsside: str | None
    faces_deg: tuple[float, float] = (math.nan, math.nan)
    """Azimuths from true north that its face, and a second face, look towards; NaN where not known."""
    start_date: str = ""
    """ISO date from which NVDB's version of it holds; "" if unknown."""
    text: str = ""
    """What is written on it, as in NVDB; "" if unknown."""

    def shows_to(self, azimuth_deg: float) -> bool:
        """Whether somebody in this direction from the plate sees a face; True where it is not known."""
        first, second = self.faces_deg
        if math.isnan(first):
            return True
        return any(math.cos(math.radians(azimuth_deg - face)) > 0 for face in (first, second))


@dataclass(frozen=True, slots=True)
class Site:
    """One place where NVDB has signs.

    Attributes
    ----------
    nvdb_type, nvdb_id, version
        The Skiltpunkt; where the mirror has none, the first of the plates that share the position.
    east_m, north_m : float
        EPSG:25833.
    sigma_m : float
        One sigma of NVDB's position.
    own_geometry : bool
        False where the position is only the road's centre line.
    plates : tuple of Plate
        In the order of plasseringskode (top down), then id.
    start_date : str
        ISO date from which NVDB says that it stands; "" if unknown.
    road_azimuth_deg : float
        Of a site on the centre line: direction of metering there, from *grid* north. NaN if not known.
    side : str
        Of a site on the centre line: ``H`` or ``V`` of the metering, "" if not known.
    """

    nvdb_type: int
    nvdb_id: int
    version: int | None
    east_m: float
    north_m: float
    sigma_m: float
    own_geometry: bool
    plates: tuple[Plate, ...]
    start_date: str = ""
    road_azimuth_deg: float = math.nan
    side: str = ""

    @property
    def codes(self) -> tuple[str, ...]:
        """Sign codes of the plates."""
        return tuple(plate.code for plate in self.plates)


def sites_from_mirror(
    points: Sequence[Row],
    plates: Sequence[Row],
    config: MatchConfig,
    faces_deg: Mapping[int, tuple[float, float]] | None = None,
) -> list[Site]:
    """Group plates below their Skiltpunkt; plates without one by their shared position.

    Objects whose sluttdato has passed and objects without any position are left out.

    Parameters
    ----------
    points, plates : rows of the mirror
    faces_deg : mapping, optional
        Plate's id → azimuths of its faces, as :func:`twin.mirror.vegnett.facing` gives them.
    """
    faces = faces_deg or {}
    poles = [_Point.from_row(row, config) for row in points if _in_force(row)]
    live = [_MirroredPlate.from_row(row, config) for row in plates if _in_force(row)]
    ids = {pole.nvdb_id for pole in poles}
    claims = [(child, pole.nvdb_id) for pole in poles for child in pole.plate_ids]
    claimed = Counter(child for child, _ in claims)
    # A plate that two points claim is left to its own word.
    parent = {child: point for child, point in claims if claimed[child] == 1}
    children: dict[int, list[_MirroredPlate]] = {}
    orphans: dict[tuple[object, ...], list[_MirroredPlate]] = {}
    for plate in live:
        point_id = plate.point_id if plate.point_id in ids else parent.get(plate.nvdb_id)
        if point_id is not None and point_id in ids:
            children.setdefault(point_id, []).append(plate)
        elif plate.place_m is not None:
            east_m, north_m = plate.place_m
            shared = (round(east_m, 3), round(north_m, 3), plate.own_geometry)
            orphans.setdefault(shared, []).append(plate)
    sites = [_site(SKILTPUNKT, pole, children.get(pole.nvdb_id, []), config, faces) for pole in poles]
    sites += [
        _site(SKILTPLATE, min(group, key=lambda plate: plate.nvdb_id), group, config, faces)
        for group in orphans.values()
    ]
    return sorted((site for site in sites if site is not None), key=lambda s: (s.nvdb_type, s.nvdb_id))


@dataclass(frozen=True, slots=True)
class _Mirrored:
    """What matching needs of a Skiltpunkt or a Skiltplate.

    ``place_m``: EPSG:25833, None where NVDB says none; ``sigma_m``: of that, if it is the object's own;
    ``side``: of the road's metering, ``H``, ``V`` or "".
    """

    nvdb_id: int
    version: int | None
    place_m: tuple[float, float] | None
    sigma_m: float
    own_geometry: bool
    start_date: str
    side: str


@dataclass(frozen=True, slots=True)
class _Point(_Mirrored):
    plate_ids: tuple[int, ...]

    @classmethod
    def from_row(cls, row: Row, config: MatchConfig) -> _Point:
        return cls(**_shared(row, config), plate_ids=tuple(row["plate_ids"]))


@dataclass(frozen=True, slots=True)
class _MirroredPlate(_Mirrored):
    point_id: int | None
    code: str
    ansiktsside: str | None
    text: str
    plasseringskode: int

    @classmethod
    def from_row(cls, row: Row, config: MatchConfig) -> _MirroredPlate:
        return cls(
            **_shared(row, config),
            point_id=row["point_id"],
            code=row["skiltnummer"] or "",
            ansiktsside=row["ansiktsside"],
            text=row["text"] or "",
            plasseringskode=row["plasseringskode"] or 0,
        )

    def as_plate(self, faces: Mapping[int, tuple[float, float]]) -> Plate:
        faces_deg = faces.get(self.nvdb_id, _NOT_KNOWN)
        return Plate(
            self.nvdb_id, self.version, self.code, self.ansiktsside, faces_deg, self.start_date, self.text
        )


def _shared(row: Row, config: MatchConfig) -> dict[str, Any]:
    return {
        "nvdb_id": row["nvdb_id"],
        "version": row["version"],
        "place_m": None if row["east_m"] is None else (row["east_m"], row["north_m"]),
        "sigma_m": _sigma_m(row, config),
        "own_geometry": bool(row["own_geometry"]),
        "start_date": row["start_date"] or "",
        "side": "" if row["own_geometry"] else _side(row),
    }


def _in_force(row: Row) -> bool:
    """Whether the object was valid on the day of the sync: sluttdato may lie in the future."""
    return not row["end_date"] or row["end_date"] > row["synced_at"][:10]


def along_the_road(sites: Sequence[Site], nett: Vegnett, on_date: dt.date | None = None) -> list[Site]:
    """Give the sites that NVDB only has on the centre line the direction of their road."""
    from nvdb.vegnett import BILVEG

    loose = [k for k, site in enumerate(sites) if not site.own_geometry]
    if not loose:
        return list(sites)
    east, north = np.array([(sites[k].east_m, sites[k].north_m) for k in loose]).T
    azimuth = (
        stedfester(nett, on_date=on_date, type_veg=BILVEG).stedfest(east, north).metering_azimuth_grid_deg
    )
    placed = list(sites)
    for k, degrees in zip(loose, azimuth.tolist(), strict=True):
        placed[k] = replace(sites[k], road_azimuth_deg=degrees)
    return placed


def _site(
    nvdb_type: int,
    named: _Mirrored,
    plates: Sequence[_MirroredPlate],
    config: MatchConfig,
    faces: Mapping[int, tuple[float, float]],
) -> Site | None:
    """One site; a point that is only on the centre line borrows the own position of its plates."""
    placed = named
    if not named.own_geometry or named.place_m is None:
        placed = next((p for p in plates if p.own_geometry and p.place_m is not None), named)
    if placed.place_m is None:
        return None
    own = placed.own_geometry
    ordered = sorted(plates, key=lambda plate: (plate.plasseringskode, plate.nvdb_id))
    return Site(
        nvdb_type=nvdb_type,
        nvdb_id=named.nvdb_id,
        version=named.version,
        east_m=placed.place_m[0],
        north_m=placed.place_m[1],
        sigma_m=placed.sigma_m if own else config.centre_line_sigma_m,
        own_geometry=own,
        plates=tuple(plate.as_plate(faces) for plate in ordered),
        start_date=named.start_date,
        side="" if own else placed.side,
    )


_NOT_KNOWN = (math.nan, math.nan)


def _side(row: Row) -> str:
    """Side of the road by NVDB's first stedfesting, where it says one."""
    places = from_json(row.get("stedfesting")) or []
    side = places[0].get("sideposisjon") if places else None
    return side if side in {"H", "V"} else ""


def _sigma_m(row: Row, config: MatchConfig) -> float:
    """NVDB's stated accuracy; 100 cm by an unknown method is a default, not a measurement."""
    accuracy_cm = row["accuracy_cm"]
    looks_default = accuracy_cm == 100 and (row["capture_method"] in (None, "ukj"))
    if accuracy_cm is None or accuracy_cm <= 0 or looks_default:
        return config.default_accuracy_m
    return float(accuracy_cm) / 100.0


def mirror_near(
    view: Snapshot, places: FloatArray, config: MatchConfig, within_m: float | None = None
) -> tuple[list[Row], list[Row]]:
    """Read Skiltpunkt and Skiltplate near places, those that belong together always together.

    Everything within `MatchConfig.mirrored_m` of a place (or `within_m`) is there, and some beyond: the
    mirror is cut by squares of that size.

    Parameters
    ----------
    view : Snapshot
    places : float64 (n, 2)
        EPSG:25833.
    within_m : float, optional

    Returns
    -------
    points, plates : lists of rows
        Without the columns that matching does not need.
    """
    point, plate = schema.skiltpunkt, schema.skiltplate
    size = max(config.mirrored_m if within_m is None else within_m, 1.0)
    cells = _cells_about(places, size)
    of_points = _ids_in_cells(point, cells, size)
    parents = sa.select(plate.c.point_id).where(plate.c.nvdb_id.in_(_ids_in_cells(plate, cells, size)))
    asked = sa.select(*_columns(point)).where(point.c.nvdb_id.in_(of_points.union(parents)))
    points = view.rows(asked.order_by(point.c.nvdb_id))
    points = [{**row, "plate_ids": from_json(row["plate_ids"])} for row in points]
    children = each_number([child for row in points for child in row["plate_ids"]])
    of_plates = _ids_in_cells(plate, cells, size).union(
        children,
        sa.select(plate.c.nvdb_id).where(plate.c.point_id.in_(each_number([r["nvdb_id"] for r in points]))),
    )
    asked = sa.select(*_columns(plate)).where(plate.c.nvdb_id.in_(of_plates))
    plates = view.rows(asked.order_by(plate.c.nvdb_id))
    return points, plates


def codes_of_mirror(view: Snapshot) -> dict[str, int]:
    """How many plates of the mirror carry each code."""
    plate, count = schema.skiltplate.c, sa.func.count().label("n")
    has_one = plate.skiltnummer.is_not(None) & (plate.skiltnummer != "")
    rows = view.rows(sa.select(plate.skiltnummer, count).where(has_one).group_by(plate.skiltnummer))
    return {row["skiltnummer"]: row["n"] for row in rows}


_NOT_NEEDED = frozenset(
    {"raw", "kommuner", "problems", "last_modified", "road_reference", "height_m"}
    | {"skiltnummer_text", "skiltnummer_enum_id"}
)


def _columns(table: sa.Table) -> list[sa.ColumnElement[Any]]:
    """Those that matching needs; JSON as text, of which most is never read."""
    return [
        sa.type_coerce(column, sa.Text).label(column.name) if isinstance(column.type, sa.JSON) else column
        for column in table.columns
        if column.name not in _NOT_NEEDED
    ]


_ROW = 1_000_000
"""A cell's number is its column times this, plus its row: no grid in metres has that many rows."""


def _cells_about(places: FloatArray, size: float) -> list[int]:
    """Numbers of the cells that places lie in, and of the eight about each."""
    if not len(places):
        return []
    column, row = np.unique(np.trunc(places / size), axis=0).astype(np.int64).T
    about = [(column + a) * _ROW + row + b for a in (-1, 0, 1) for b in (-1, 0, 1)]
    return [int(number) for number in np.unique(np.concatenate(about))]


def _ids_in_cells(table: sa.Table, cells: list[int], size: float) -> sa.Select[tuple[int]]:
    """Ids of the rows that lie in one of the cells.

    First by columns of cells, for which an index has the eastings: a country's mirror is not read for a few
    places.
    """
    # Of a number, row and column cannot be told apart near the axes: a column more on each side holds all.
    columns = sorted({number // _ROW + side for number in cells for side in (-1, 0, 1)})
    strip = each_number(columns).subquery("strip").c.value
    in_strip = table.c.east_m.between(strip * size, (strip + 1) * size)
    column, row = (cut(table.c[name] / size) for name in ("east_m", "north_m"))
    return (
        sa.select(table.c.nvdb_id)
        .select_from(sa.join(strip.table, table, in_strip))
        .where((column * _ROW + row).in_(each_number(cells)))
    )
