"""The road network as rows of the store, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from nvdb.vegnett import Vegnett
from twin.errors import StoreError
from twin.store import schema
from twin.store.sql import bulk_insert
from twin.store.store import Store

Column = NDArray[Any]

FACT = "vegnett"
"""Key of what the store knows of its network: area, url, fetched_at, count, n_rejected, rejected."""
ROWS_AT_ONCE = 50_000

_DATES = frozenset({"startdato", "sluttdato"})
_TYPES: Mapping[str, type[np.generic]] = {
    **dict.fromkeys(("veglenkesekvensid", "veglenkenummer", "segmentnummer", "retning"), np.int64),
    **dict.fromkeys(("startposisjon", "sluttposisjon", "fra_meter", "til_meter"), np.float64),
    **dict.fromkeys(("konnektering", "detaljert"), np.bool_),
}
"""Columns of a Vegnett that are neither text nor dates nor lines."""


def load_vegnett(store: Store) -> Vegnett:
    """Return the store's road network.

    Returns
    -------
    Vegnett
        ``rejected`` names the first 100 links that could not be read.

    Raises
    ------
    StoreError
        The store holds none.
    """
    fact = need_network(store)
    columns: dict[str, list[Column]] = {column.name: [] for column in schema.veglenke.columns}
    with store.snapshot() as view:
        table = schema.veglenke
        for rows in view.chunks(sa.select(table).order_by(*table.primary_key.columns), ROWS_AT_ONCE):
            for name, arrays in columns.items():
                arrays.append(_column(name, [row[name] for row in rows]))
    return Vegnett(
        **{name: np.concatenate([_column(name, []), *arrays]) for name, arrays in columns.items()},
        rejected=tuple(fact["rejected"]),
    )


def need_network(store: Store) -> Mapping[str, Any]:
    """Return what the store knows of its network (:data:`FACT`); StoreError if it holds none."""
    fact = store.fact(FACT)
    if fact is None:
        raise StoreError(
            f"The store {store.name} holds no road network: run `twin sync-nvdb` with --vegnett first."
        )
    return fact


def insert_aside(connection: sa.Connection, nett: Vegnett) -> None:
    """Keep links aside; one that comes again takes the place of the first."""
    table = schema.veglenke_aside
    columns = (_values(name, getattr(nett, name)) for name in (c.name for c in table.columns))
    bulk_insert(connection, table, list(zip(*columns, strict=True)), replace=True)


def differs_aside(connection: sa.Connection) -> bool:
    """Whether the network aside is another one than the visible: then findings may be stale."""
    old, new = schema.veglenke, schema.veglenke_aside
    for one, other in ((old, new), (new, old)):
        odd = sa.except_(sa.select(*one.columns), sa.select(*other.columns)).limit(1)
        if connection.execute(odd).first() is not None:
            return True
    return False


def _values(name: str, column: Column) -> list[Any]:
    """A column of a Vegnett as :func:`bulk_insert` takes it. Inverse of :func:`_column`."""
    if name == "geometri":
        import shapely

        return list(shapely.to_wkb(column))
    values: list[Any] = column.tolist()
    if name in _DATES:
        return [None if day is None else day.isoformat() for day in values]
    return values


def _column(name: str, values: list[Any]) -> Column:
    """A column of the table as Vegnett takes it."""
    if name in _TYPES:
        return np.array(values, dtype=_TYPES[name])
    if name in _DATES:
        return np.array(values, dtype="datetime64[D]")
    column = np.empty(len(values), dtype=np.object_)
    if name == "geometri" and values:
        import shapely

        column[:] = shapely.from_wkb(values)
    else:
        column[:] = values
    return column
