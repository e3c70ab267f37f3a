"""All that one store holds into another, of SQLite or PostgreSQL."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import sqlalchemy as sa

from twin.errors import ConfigError, RefusedError, StoreError
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.backup import copy_picture
from twin.store.postgres_tables import SCHEMA
from twin.store.sql import as_values, bulk_insert
from twin.store.store import Snapshot, Store

_AT_ONCE = 5_000
_VERSION = "schema_version"


@dataclass(frozen=True, slots=True)
class StoreCopied:
    """What was copied.

    Attributes
    ----------
    source, target : str
        The stores' names.
    rows : mapping of str to int
        Table → rows, of tables that have some.
    n_pictures, n_lost : int
        Crops of pictures that are in the target's folder, and those whose files are not there.
    """

    source: str
    target: str
    rows: Mapping[str, int]
    n_pictures: int
    n_lost: int


def copy_store(
    source: StoreAddress | Path | str,
    target: StoreAddress | Path | str,
    *,
    progress: Callable[[str], None] | None = None,
) -> StoreCopied:
    """Copy one state of a store into a new or empty one; others may read and write the source meanwhile.

    Rows come into the target in one transaction: all of them, or none. Pictures come first.

    Parameters
    ----------
    source, target : StoreAddress, Path or str
        As ``--store`` takes them. The source is brought to this version first, as by every command.
    progress : callable, optional
        Called with one sentence a table.

    Raises
    ------
    StoreError
        One of them cannot be used.
    RefusedError
        The target holds something.
    ConfigError
        Both are the same store, or the target's address names no folder for pictures that the source has.
    """
    say = progress or (lambda _text: None)
    from_, to = StoreAddress.of(source), StoreAddress.of(target)
    with Store.open(from_, create=False) as old, Store.open(to) as new:
        if old.name == new.name:
            raise ConfigError(f"{old.name} is both the store to copy and the one to copy into: name two.")
        if held := [
            table.name for table in schema.metadata.sorted_tables if new.count(table) > (table is schema.meta)
        ]:
            raise RefusedError(
                f"The store {new.name} holds something already (table {held[0]}): name an empty one."
            )
        with old.snapshot() as view:
            hashes = [row["sha256"] for row in view.rows(sa.select(schema.crop.c.sha256).distinct())]
            if hashes:
                say(f"copying {len(hashes):,} pictures")
                for sha256 in hashes:
                    copy_picture(old.pictures, new.pictures, sha256)
            with new.transaction() as connection:
                rows = {
                    table.name: _copied(view, connection, table, say)
                    for table in schema.metadata.sorted_tables
                }
                _check(view, new.view(connection), new.name)
        n_there = sum(any((new.pictures / one[:2]).glob(f"{one}.*")) for one in hashes)
        return StoreCopied(
            old.name,
            new.name,
            {name: n for name, n in rows.items() if n},
            n_there,
            len(hashes) - n_there,
        )


def _copied(view: Snapshot, connection: sa.Connection, table: sa.Table, say: Callable[[str], None]) -> int:
    rows = sa.select(table)
    if table is schema.meta:
        rows = rows.where(schema.meta.c.key != _VERSION)
    n = 0
    for chunk in view.chunks(rows, _AT_ONCE):
        bulk_insert(connection, table, as_values(table, chunk))
        n += len(chunk)
        say(f"{table.name}: {n:,} rows")
    if n and connection.dialect.name == "postgresql":
        _count_on(connection, table)
    return n


def _count_on(connection: sa.Connection, table: sa.Table) -> None:
    """Let PostgreSQL number new rows after those that were copied with their numbers."""
    column = table.autoincrement_column
    if column is not None:
        newest = sa.select(sa.func.max(column)).scalar_subquery()
        sequence = sa.func.pg_get_serial_sequence(f"{SCHEMA}.{table.name}", column.name)
        connection.execute(sa.select(sa.func.setval(sequence, newest)))


def _check(old: Snapshot, new: Snapshot, name: str) -> None:
    """Raise if a table came out with other rows than it had; the caller's transaction then ends."""
    for table in schema.metadata.sorted_tables:
        count = sa.select(sa.func.count().label("n")).select_from(table)
        before, after = (view.rows(count)[0]["n"] for view in (old, new))
        if before != after:
            raise StoreError(
                f"{before:,} rows of {table.name} became {after:,} in {name}: nothing was copied. Please "
                "report this."
            )
