"""The tables of the mirror: NVDB's signs and road network, as :mod:`.schema` hands them on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from twin.store.types import JSON, REAL, ROWID, TEXT

metadata = sa.MetaData()
"""Of every table of the store."""


def _nvdb_columns() -> list[sa.Column[Any]]:
    """Make the columns that both object types carry."""
    return [
        sa.Column("nvdb_id", ROWID, primary_key=True, autoincrement=False, comment="NVDB's id of the object"),
        sa.Column("version", sa.Integer, comment="its version in NVDB"),
        sa.Column("start_date", TEXT, comment="first day of that version"),
        sa.Column("end_date", TEXT, comment="last day of it; null while it stands"),
        sa.Column("last_modified", TEXT, comment="NVDB's sist_modifisert"),
        sa.Column("east_m", REAL, comment="easting, EPSG:25833, metres; null where NVDB has no position"),
        sa.Column("north_m", REAL, comment="northing, likewise"),
        sa.Column("height_m", REAL, comment="NN2000, metres; null where unknown"),
        sa.Column(
            "own_geometry",
            sa.Boolean,
            nullable=False,
            comment="whether the position is the object's own; else it lies on the road's line",
        ),
        sa.Column("accuracy_cm", REAL, comment="NVDB's nøyaktighet: one sigma in plan, centimetres"),
        sa.Column("capture_method", TEXT, comment="NVDB's datafangstmetode"),
        sa.Column("road_reference", TEXT, comment="vegsystemreferanse, as people write it"),
        sa.Column("kommuner", JSON, nullable=False, comment="numbers of the kommuner that it lies in"),
        sa.Column(
            "stedfesting",
            JSON,
            nullable=False,
            comment="where on the road network: veglenkesekvenser and relative positions",
        ),
        sa.Column(
            "problems",
            JSON,
            nullable=False,
            comment="what could not be read of the object, a sentence each",
        ),
        sa.Column("raw", sa.LargeBinary, nullable=False, comment="the object as NVDB gave it, compressed"),
        sa.Column("synced_at", TEXT, nullable=False, comment="when it was fetched, UTC"),
    ]


def _skiltpunkt_columns() -> list[sa.Column[Any]]:
    return [
        *_nvdb_columns(),
        sa.Column("plate_ids", JSON, nullable=False, comment="NVDB ids of its plates"),
    ]


def _skiltplate_columns() -> list[sa.Column[Any]]:
    return [
        *_nvdb_columns(),
        sa.Column(
            "point_id", sa.BigInteger, comment="NVDB id of its Skiltpunkt; null where the plate has none"
        ),
        sa.Column("skiltnummer", TEXT, comment="sign code, 362.50"),
        sa.Column("skiltnummer_text", TEXT, comment="NVDB's name of that code"),
        sa.Column("skiltnummer_enum_id", sa.Integer, comment="NVDB's id of that value"),
        sa.Column("ansiktsside", TEXT, comment="which traffic its face looks at"),
        sa.Column("text", TEXT, comment="what is written on it"),
        sa.Column("plasseringskode", sa.Integer, comment="NVDB's code of where beside the road it stands"),
    ]


@dataclass(frozen=True, slots=True)
class MirrorTables:
    """The tables of one object type.

    Attributes
    ----------
    visible : Table
        The mirror that everybody reads: always whole.
    aside : Table
        A backfill, or a round of changes, that is not whole yet. Same columns.
    history : Table
        States that were replaced or deleted, with ``seen_until``: when we learnt of it.
    """

    visible: sa.Table
    aside: sa.Table
    history: sa.Table


def _mirror_tables(name: str, what: str, columns: Callable[[], list[sa.Column[Any]]]) -> MirrorTables:
    visible = sa.Table(name, metadata, *columns(), comment=f"{what} as NVDB shows them now: always whole.")
    aside = sa.Table(
        f"{name}_aside",
        metadata,
        *columns(),
        comment=f"As {name}: a backfill, or a round of changes, that is not whole yet.",
    )
    history = sa.Table(
        f"{name}_history",
        metadata,
        *columns(),
        sa.Column(
            "seen_until", TEXT, primary_key=True, comment="when we learnt that this state was over, UTC"
        ),
        comment=f"As {name}: states that were replaced or deleted.",
    )
    return MirrorTables(visible, aside, history)


MIRROR = {
    95: _mirror_tables("skiltpunkt", "Skiltpunkter (95)", _skiltpunkt_columns),
    96: _mirror_tables("skiltplate", "Skiltplater (96)", _skiltplate_columns),
}
"""Vegobjekttype → its tables."""

skiltpunkt = MIRROR[95].visible
skiltplate = MIRROR[96].visible

_FOUND_BY = ("east_m", "point_id", "skiltnummer")

for _column in (skiltpunkt.c.east_m, *(skiltplate.c[name] for name in _FOUND_BY)):
    # Of the visible tables alone: a backfill is written faster without, and gets them as it becomes visible.
    sa.Index(f"ix_{_column.table.name}_{_column.name}", _column)


def _veglenke_columns() -> list[sa.Column[Any]]:
    # NVDB says that sekvens, number and segment are unique; the rest of the key costs nothing and makes sure
    # that a link without a segment number never takes the place of another.
    return [
        sa.Column(
            "veglenkesekvensid",
            sa.BigInteger,
            primary_key=True,
            autoincrement=False,
            comment="NVDB's id of the sequence of links",
        ),
        sa.Column(
            "veglenkenummer",
            sa.Integer,
            primary_key=True,
            autoincrement=False,
            comment="number of the link in it",
        ),
        sa.Column(
            "segmentnummer",
            sa.Integer,
            primary_key=True,
            autoincrement=False,
            comment="number of the segment in the link",
        ),
        sa.Column("startposisjon", REAL, primary_key=True, comment="relative position of its start, 0 to 1"),
        sa.Column("startdato", TEXT, primary_key=True, comment="first day"),
        sa.Column("sluttposisjon", REAL, nullable=False, comment="relative position of its end, 0 to 1"),
        sa.Column("sluttdato", TEXT, comment="last day; null while it stands"),
        sa.Column("konnektering", sa.Boolean, nullable=False, comment="whether it only connects other links"),
        sa.Column("detaljert", sa.Boolean, nullable=False, comment="whether it is of the detailed network"),
        sa.Column("type_veg", TEXT, nullable=False, comment="kind of road, NVDB's typeVeg"),
        sa.Column("detaljniva", TEXT, nullable=False, comment="NVDB's detaljnivå"),
        sa.Column("vegkategori", TEXT, nullable=False, comment="E, R, F, K, P or S"),
        sa.Column("trafikantgruppe", TEXT, nullable=False, comment="K vehicles, G walking and cycling"),
        sa.Column("kortform", TEXT, nullable=False, comment="vegsystemreferanse, as people write it"),
        sa.Column(
            "retning", sa.Integer, nullable=False, comment="1 with the metering, -1 against it, 0 unknown"
        ),
        sa.Column("fra_meter", REAL, comment="metering at its start, metres"),
        sa.Column("til_meter", REAL, comment="metering at its end, metres"),
        sa.Column(
            "geometri", sa.LargeBinary, nullable=False, comment="WKB LineString Z, EPSG:25833 and NN2000"
        ),
    ]


veglenke = sa.Table(
    "veglenke", metadata, *_veglenke_columns(), comment="The road network of an area, a row for each segment."
)
"""The columns of :class:`nvdb.vegnett.Vegnett`."""
veglenke_aside = sa.Table(
    "veglenke_aside",
    metadata,
    *_veglenke_columns(),
    comment="As veglenke: a road network whose last page has not come yet.",
)
