"""Rows of the store as matching asks for them: of all drives, or of some of them."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cache
from typing import Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import IntArray
from twin.matching.cells import are_among, cells_of
from twin.store import schema
from twin.store.kinds import Method
from twin.store.records import Estimate, split_codes
from twin.store.sql import from_json
from twin.store.store import Row, Snapshot

_AT_ONCE = 500
"""Ids in one statement: SQLite of some systems takes no more than 999 parameters."""


def rows_of_drives(
    view: Snapshot, statement: sa.Select[Any], name: sa.ColumnElement[str], only: Collection[str] | None
) -> list[Row]:
    """Run a query for all rows, or for those with some names."""
    if only is None:
        return view.rows(statement)
    names = sorted(only)
    chunks = [names[start : start + _AT_ONCE] for start in range(0, len(names), _AT_ONCE)]
    return [row for chunk in chunks for row in view.rows(statement.where(name.in_(chunk)))]


def estimates_of(
    view: Snapshot, method: str, only: Collection[str] | None = None, cells: IntArray | None = None
) -> list[Estimate]:
    """What matching needs of estimates of signs by one method, in the order of drives' ids and of objects.

    Parameters
    ----------
    only : collection of str, optional
        Drives of these ids.
    cells : int64 (n,), optional
        Those that stand in one of these cells.
    """
    t = schema.estimate.c
    # JSON is read of those alone that are wanted: of a fleet that is most of the time.
    as_text = [sa.type_coerce(t[name], sa.Text).label(name) for name in _JSON]
    # What is no sign has nothing to be compared with in a mirror of signs.
    asked = sa.select(*(t[name] for name in _PLAIN), *as_text).where(
        t.method == method, t.nvdb_type.is_(None)
    )
    rows = rows_of_drives(view, asked, t.drive_id, only)
    if cells is not None and rows:
        place = np.array([(row["east_m"], row["north_m"]) for row in rows])
        rows = [rows[k] for k in np.flatnonzero(are_among(cells_of(place), cells)).tolist()]
    kind, cameras = Method(method), cache(lambda said: tuple(from_json(said)))
    return sorted((_estimate(row, kind, cameras) for row in rows), key=lambda one: (one.drive_id, one.object))


_JSON = ("cameras", "budget")
_PLAIN = (
    *("estimate_id", "drive_id", "object", "skiltnummer", "east_m", "north_m", "n_sightings"),
    *("cov_ee_m2", "cov_en_m2", "cov_nn_m2", "first_ns", "last_ns", "text"),
)


def _estimate(row: Row, method: Method, cameras: Callable[[str], tuple[str, ...]]) -> Estimate:
    budget = from_json(row["budget"])
    return Estimate(
        drive_id=row["drive_id"],
        object=row["object"],
        codes=split_codes(row["skiltnummer"]),
        east_m=row["east_m"],
        north_m=row["north_m"],
        covariance_m2=(row["cov_ee_m2"], row["cov_en_m2"], row["cov_nn_m2"]),
        cameras=cameras(row["cameras"]) if isinstance(row["cameras"], str) else tuple(row["cameras"]),
        n_sightings=row["n_sightings"],
        first_ns=row["first_ns"],
        last_ns=row["last_ns"],
        text=row["text"],
        budget={source: (ee, en, nn) for source, (ee, en, nn) in budget.items()},
        estimate_id=row["estimate_id"],
        method=method,
    )
