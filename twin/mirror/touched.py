"""Where NVDB's signs change with a sync: a match looks only there.

What stands at a place is a Skiltpunkt with its plates, or plates that share a position
(:func:`twin.matching.sites.sites_from_mirror`): a changed object concerns the place of what it belongs to.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import sqlalchemy as sa

from twin.store import schema
from twin.store.sql import each_number
from twin.store.touched import Place

MOST = 10_000
"""Of more changed objects than these everything counts as changed."""
_CLAIMED_WITHIN_M = 128.0
"""A Skiltpunkt that names a plate which names none stands this near to it."""
_SKILTPUNKT, _SKILTPLATE = 95, 96

Changed = Mapping[int, frozenset[int]]
"""Type → ids of objects."""


def changed_ids(connection: sa.Connection, tables: schema.MirrorTables) -> frozenset[int]:
    """Ids of objects aside that are not visible, or otherwise; at most one more than `MOST`."""
    a, v = tables.aside, tables.visible
    asked = sa.select(a.c.nvdb_id).select_from(a.outerjoin(v, a.c.nvdb_id == v.c.nvdb_id))
    differs = v.c.nvdb_id.is_(None) | (a.c.raw != v.c.raw)
    return frozenset(connection.execute(asked.where(differs).limit(MOST + 1)).scalars())


def gone_ids(connection: sa.Connection, tables: schema.MirrorTables) -> frozenset[int]:
    """Ids of visible objects that are not aside; at most one more than `MOST`."""
    a, v = tables.aside, tables.visible
    asked = sa.select(v.c.nvdb_id).select_from(v.outerjoin(a, a.c.nvdb_id == v.c.nvdb_id))
    return frozenset(connection.execute(asked.where(a.c.nvdb_id.is_(None)).limit(MOST + 1)).scalars())


def places_of(connection: sa.Connection, changed: Changed) -> frozenset[Place]:
    """Places of all that these objects belong to, as they are visible inside the caller's transaction."""
    points, plates = set(changed[_SKILTPUNKT]), set(changed[_SKILTPLATE])
    plates |= _plates_of(connection, points)
    points |= _points_of(connection, plates)
    plates |= _plates_of(connection, points)
    found = set[Place]()
    for table, ids in ((schema.skiltpunkt, points), (schema.skiltplate, plates)):
        asked = sa.select(table.c.east_m, table.c.north_m).where(_one_of(table.c.nvdb_id, ids))
        for east, north in connection.execute(asked):
            if east is not None and north is not None:
                found.add((math.floor(east), math.floor(north)))
    return frozenset(found)


def _plates_of(connection: sa.Connection, points: set[int]) -> set[int]:
    """Plates that these points name, or that name one of them."""
    point, plate = schema.skiltpunkt.c, schema.skiltplate.c
    named = connection.execute(sa.select(point.plate_ids).where(_one_of(point.nvdb_id, points))).scalars()
    found = {one for some in named for one in some}
    return found | set(
        connection.execute(sa.select(plate.nvdb_id).where(_one_of(plate.point_id, points))).scalars()
    )


def _points_of(connection: sa.Connection, plates: set[int]) -> set[int]:
    """Points that these plates name; of those that name none which there is, points that name them."""
    point, plate = schema.skiltpunkt.c, schema.skiltplate.c
    asked = sa.select(plate.nvdb_id, plate.point_id, plate.east_m, plate.north_m)
    rows = connection.execute(asked.where(_one_of(plate.nvdb_id, plates))).all()
    named = {point_id for _, point_id, _, _ in rows if point_id is not None}
    there = set(connection.execute(sa.select(point.nvdb_id).where(_one_of(point.nvdb_id, named))).scalars())
    for nvdb_id, point_id, east, north in rows:
        if point_id in there or east is None or north is None:
            continue
        near = sa.and_(
            point.east_m.between(east - _CLAIMED_WITHIN_M, east + _CLAIMED_WITHIN_M),
            point.north_m.between(north - _CLAIMED_WITHIN_M, north + _CLAIMED_WITHIN_M),
        )
        claims = connection.execute(sa.select(point.nvdb_id, point.plate_ids).where(near))
        there |= {claimant for claimant, some in claims if nvdb_id in some}
    return there


def _one_of(column: sa.ColumnElement[int], ids: Iterable[int]) -> sa.ColumnElement[bool]:
    return column.in_(each_number(sorted(ids)))
