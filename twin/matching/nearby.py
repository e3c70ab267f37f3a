"""The part of the mirror that lies near what the drives saw: a country is a hundred times as much."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from twin import schema
from twin.matching.config import MatchConfig
from twin.store import Row, Snapshot


def mirror_near(view: Snapshot, places: FloatArray, config: MatchConfig) -> tuple[list[Row], list[Row]]:
    """Read Skiltpunkt and Skiltplate near places, those that belong together always together.

    Everything within `MatchConfig.mirrored_m` of a place is there, and some beyond: the mirror is cut by
    squares of that size.

    Parameters
    ----------
    view : Snapshot
    places : float64 (n, 2)
        EPSG:25833.

    Returns
    -------
    points, plates : lists of rows
        Without the columns that matching does not need.
    """
    point, plate = schema.skiltpunkt, schema.skiltplate
    size = max(config.mirrored_m, 1.0)
    cells = _cells_about(places, size)
    parents = sa.select(plate.c.point_id).where(_in_cells(plate, cells, size))
    near = sa.or_(_in_cells(point, cells, size), point.c.nvdb_id.in_(parents))
    points = view.rows(sa.select(*_columns(point)).where(near))
    ids = [row["nvdb_id"] for row in points]
    children = [child for row in points for child in row["plate_ids"]]
    plates = view.rows(
        sa.select(*_columns(plate)).where(
            sa.or_(
                _in_cells(plate, cells, size),
                plate.c.point_id.in_(_values(ids)),
                plate.c.nvdb_id.in_(_values(children)),
            )
        )
    )
    return points, plates


_NOT_NEEDED = frozenset(
    {"raw", "kommuner", "problems", "last_modified", "road_reference", "height_m"}
    | {"skiltnummer_text", "skiltnummer_enum_id"}
)


def _columns(table: sa.Table) -> list[sa.Column[Any]]:
    return [column for column in table.columns if column.name not in _NOT_NEEDED]


_ROW = 1_000_000
"""A cell's number is its column times this, plus its row: no grid in metres has that many rows."""


def _cells_about(places: FloatArray, size: float) -> list[int]:
    """Numbers of the cells that places lie in, and of the eight about each."""
    if not len(places):
        return []
    column, row = np.unique(np.trunc(places / size), axis=0).astype(np.int64).T
    about = [(column + a) * _ROW + row + b for a in (-1, 0, 1) for b in (-1, 0, 1)]
    return [int(number) for number in np.unique(np.concatenate(about))]


def _in_cells(table: sa.Table, cells: list[int], size: float) -> sa.ColumnElement[bool]:
    """Whether a row lies in one of the cells; SQL's CAST cuts towards zero, as `numpy.trunc` does."""
    column, row = (sa.cast(table.c[name] / size, sa.Integer) for name in ("east_m", "north_m"))
    return (column * _ROW + row).in_(_values(cells))


def _values(numbers: list[int]) -> sa.Select[tuple[int]]:
    """Any number of numbers as one parameter."""
    return sa.select(sa.func.json_each(json.dumps(numbers)).table_valued("value").c.value)
