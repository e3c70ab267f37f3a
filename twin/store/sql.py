"""What SQLite and PostgreSQL write differently, as one thing each; and rows in bulk."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

Insert = sqlite.Insert | postgresql.Insert
Values = Sequence[object]


class _Written(FunctionElement[Any]):
    """What each database writes its own way: ``{}`` stands for what it is about."""

    inherit_cache = True
    sqlite: str
    postgresql: str


@compiles(_Written)
def _written(element: _Written, compiler: Any, **how: Any) -> str:
    words: str = getattr(element, compiler.dialect.name)
    return words.format(compiler.process(element.clauses, **how))


class _Each(_Written):
    """The elements of a JSON list as rows, in a column ``value``."""

    inherit_cache = True
    sqlite = "json_each({})"
    postgresql = "json_array_elements_text(CAST({} AS JSON))"


class _Cut(_Written):
    """A number without its fraction: SQLite's CAST cuts, that of PostgreSQL rounds."""

    inherit_cache = True
    type = sa.BigInteger()
    sqlite = "CAST({} AS INTEGER)"
    postgresql = "CAST(trunc({}) AS BIGINT)"


class _Size(_Written):
    """Bytes that a value takes, about."""

    inherit_cache = True
    type = sa.BigInteger()
    sqlite = "coalesce(length(CAST({} AS BLOB)), 0)"
    postgresql = "coalesce(pg_column_size({}), 0)"


def from_json(document: Any) -> Any:
    """Read JSON that was asked for as text; some databases' drivers have done that already."""
    return json.loads(document) if isinstance(document, (str, bytes)) else document


def size_of(column: sa.ColumnElement[Any]) -> sa.ColumnElement[int]:
    """Bytes that a value takes, about; 0 for NULL."""
    return _Size(column)


def cut(number: sa.ColumnElement[Any]) -> sa.ColumnElement[int]:
    """Return a number without its fraction, as `numpy.trunc` does."""
    return _Cut(number)


def rounded(number: sa.ColumnElement[Any]) -> sa.ColumnElement[int]:
    """Return the nearest whole number, of two the one further from zero."""
    return _Cut(number + sa.case((number < 0, -0.5), else_=0.5))


def each_text(values: Iterable[str]) -> sa.Select[tuple[str]]:
    """Any number of texts as one parameter: for ``column.in_(each_text(names))``."""
    return sa.select(_listed(list(values)))


def each_number(values: Iterable[int]) -> sa.Select[tuple[int]]:
    """Any number of whole numbers as one parameter."""
    return sa.select(sa.cast(_listed(list(values)), sa.BigInteger).label("value"))


def _listed(values: list[Any]) -> sa.ColumnElement[Any]:
    document = sa.literal(json.dumps(values), sa.String)
    return _Each(document).table_valued(sa.column("value", sa.String)).c.value


def inserting(connection: sa.Connection, table: sa.Table) -> Insert:
    """Begin an INSERT that may say ``on_conflict_do_update`` and ``on_conflict_do_nothing``."""
    return postgresql.insert(table) if _is_postgresql(connection) else sqlite.insert(table)


def taking_place(connection: sa.Connection, table: sa.Table) -> Insert:
    """Begin an INSERT whose rows take the place of those with the same key."""
    insert = inserting(connection, table)
    keys = list(table.primary_key.columns.keys())
    others = {c.name: insert.excluded[c.name] for c in table.columns if c.name not in keys}
    return insert.on_conflict_do_update(index_elements=keys, set_=others)


def as_values(table: sa.Table, rows: Iterable[Mapping[str, Any]]) -> list[Values]:
    """Return rows as :func:`bulk_insert` takes them; a column that a row does not name is NULL."""
    columns = [(column.name, isinstance(column.type, sa.JSON)) for column in table.columns]
    return [
        [_as_json(row.get(name)) if is_json else row.get(name) for name, is_json in columns] for row in rows
    ]


def _as_json(document: object) -> str | None:
    return None if document is None else json.dumps(document, ensure_ascii=False)


def bulk_insert(
    connection: sa.Connection, table: sa.Table, rows: Sequence[Values], *, replace: bool = False
) -> None:
    """Write many rows past SQLAlchemy's handling of parameters: PostgreSQL takes them by COPY.

    Parameters
    ----------
    connection : Connection
        In a transaction.
    table : Table
    rows : sequence of sequences
        In the order of the table's columns, JSON as text; NaN becomes NULL.
    replace : bool
        Whether a row takes the place of one with the same key, also of an earlier one of `rows`.
    """
    if not rows:
        return
    if not _is_postgresql(connection):
        names, marks = _names(table), ", ".join("?" * len(table.columns))
        verb = "INSERT OR REPLACE" if replace else "INSERT"
        connection.exec_driver_sql(
            f"{verb} INTO {table.name} ({names}) VALUES ({marks})",
            [tuple(row) for row in rows],
        )
        return
    if not replace:
        _copy(connection, table.name, table, rows)
        return
    keys = [at for at, column in enumerate(table.columns) if column.primary_key]
    last = {tuple(row[at] for at in keys): row for row in rows}
    connection.exec_driver_sql(f"CREATE TEMPORARY TABLE incoming (LIKE {table.name}) ON COMMIT DROP")
    incoming = sa.table("incoming", *(sa.column(c.name, c.type) for c in table.columns))
    _copy(connection, incoming.name, table, list(last.values()))
    every = sa.select(*incoming.columns)
    connection.execute(taking_place(connection, table).from_select(table.columns.keys(), every))
    connection.exec_driver_sql("DROP TABLE incoming")


def swap(connection: sa.Connection, visible: sa.Table, aside: sa.Table) -> None:
    """Let the rows of one table take the place of all rows of another; the first is empty then.

    SQLite renames: a country's mirror is over a gigabyte. In PostgreSQL that would stop readers, and show
    those that have begun an empty table.
    """
    if _is_postgresql(connection):
        names = visible.columns.keys()
        connection.execute(sa.delete(visible))
        connection.execute(sa.insert(visible).from_select(names, sa.select(*(aside.c[n] for n in names))))
        connection.execute(sa.delete(aside))
        return
    connection.exec_driver_sql(f"DROP TABLE {visible.name}")
    connection.exec_driver_sql(f"ALTER TABLE {aside.name} RENAME TO {visible.name}")
    for index in sorted(visible.indexes, key=lambda one: str(one.name)):
        connection.execute(sa.schema.CreateIndex(index))
    connection.execute(sa.schema.CreateTable(aside))


def _is_postgresql(connection: sa.Connection) -> bool:
    return connection.dialect.name == "postgresql"


def _names(table: sa.Table) -> str:
    return ", ".join(f'"{column.name}"' for column in table.columns)


def _copy(connection: sa.Connection, into: str, table: sa.Table, rows: Sequence[Values]) -> None:
    raw: Any = connection.connection.driver_connection
    with raw.cursor() as cursor, cursor.copy(f"COPY {into} ({_names(table)}) FROM STDIN") as copy:
        for row in rows:
            # NaN alone differs from itself.
            copy.write_row([None if value != value else value for value in row])  # noqa: PLR0124
