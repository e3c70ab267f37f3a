"""The twin's state: a SQLite file or a PostgreSQL database, reached through SQLAlchemy Core.

A state change is one transaction: a killed process leaves the state before it or after it. The tables'
columns are declared in :mod:`twin.store.schema`.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from twin.errors import RefusedError, StoreError
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.backend import Backend
from twin.store.clock import utc_now
from twin.store.tables import Tables
from twin.store.touched import FACT as TOUCHED
from twin.store.touched import Place, Touched, with_one_more

__all__ = ["Row", "Snapshot", "Store", "utc_now"]

Row = Mapping[str, Any]

_REVISION = "revision"


class Snapshot:
    """One state of a store, for several queries that must agree: what one transaction sees.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        Inside a transaction.
    name : str
        Of the store, for messages.
    """

    def __init__(self, connection: sa.Connection, name: str) -> None:
        self._connection = connection
        self._name = name

    def rows(self, statement: sa.Select[Any]) -> list[Row]:
        """Run a query and return its rows as mappings."""
        result = self._connection.execute(statement)
        names = list(result.keys())
        return [dict(zip(names, row, strict=True)) for row in result.fetchall()]

    def fact(self, key: str) -> dict[str, Any] | None:
        """As :meth:`Store.fact`, of this state."""
        asked = sa.select(schema.meta.c.value).where(schema.meta.c.key == key)
        value = self._connection.execute(asked).scalar()
        return None if value is None else json.loads(value)

    def revision(self) -> int:
        """As :meth:`Store.revision`, of this state."""
        return int((self.fact(_REVISION) or {"n": 0})["n"])

    def matched(self) -> dict[str, Any]:
        """As :meth:`Store.matched`, of this state."""
        last = self.fact("last_match")
        if last is None:
            raise StoreError(f"The store {self._name} has no findings yet: run `twin match` first.")
        if last["revision"] != self.revision():
            raise RefusedError(
                f"The store {self._name} has changed since the last match (sync or ingest): "
                "run `twin match` again first."
            )
        return last

    def columns(self, statement: sa.Select[Any]) -> dict[str, list[Any]]:
        """Run a query and return its columns: much faster than rows where there are many."""
        result = self._connection.execute(statement)
        names, rows = list(result.keys()), result.fetchall()
        return {name: [row[i] for row in rows] for i, name in enumerate(names)}

    def chunks(self, statement: sa.Select[Any], size: int) -> Iterator[list[Row]]:
        """Run a query and yield its rows as mappings, without holding more than `size` of them."""
        with self._connection.execute(statement, execution_options={"yield_per": size}) as result:
            for rows in result.mappings().partitions():
                yield [dict(row) for row in rows]


class Store(Tables):
    """An open store, to be closed or used as a context manager: ``with Store("twin.db") as store: ...``.

    Parameters
    ----------
    address : StoreAddress, Path or str
        The SQLite file, or ``postgresql://USER@HOST/DATABASE``.
    create : bool
        Whether a missing store is made, which :meth:`open` does. Without it, a store that cannot be written,
        for want of rights or of space, opens all the same: to be read.

    Raises
    ------
    StoreError
        Missing, not a store, not reached, or written by a newer version.
    """

    def __init__(self, address: StoreAddress | Path | str, *, create: bool = False) -> None:
        self._backend = _backend(StoreAddress.of(address), create=create)

    @classmethod
    def open(cls, address: StoreAddress | Path | str, *, create: bool = True) -> Store:
        """Open a store, making a new one where there is none."""
        return cls(address, create=create)

    @staticmethod
    def exists(address: StoreAddress | Path | str) -> bool:
        """Whether there is a store that can be opened, or something in its place that is none.

        Raises
        ------
        StoreError
            The server of a database is not reached.
        """
        address = StoreAddress.of(address)
        if address.file is None:
            from twin.store.postgres import is_there

            return is_there(address)
        try:
            return address.file.is_dir() or bool(address.file.stat().st_size)
        except FileNotFoundError:
            return False
        except OSError:
            return True  # of which opening it says more

    def close(self) -> None:
        """Close every connection."""
        self._backend.engine.dispose()

    def __enter__(self) -> Store:
        """Return the store itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    @property
    def name(self) -> str:
        """For messages: the file's path, or the database's address without a password."""
        return self._backend.name

    @property
    def address(self) -> StoreAddress:
        """By which another process opens it; shown it has no password."""
        return self._backend.address

    @property
    def path(self) -> Path:
        """The SQLite file.

        Raises
        ------
        StoreError
            The store is a database.
        """
        if self._backend.file is None:
            raise StoreError(f"The store {self.name} is no file: name one of SQLite with --store.")
        return self._backend.file

    @property
    def pictures(self) -> Path:
        """The folder for crops of pictures: beside the file, or as the database's address names it.

        Raises
        ------
        ConfigError
            The address names none.
        """
        return self._backend.pictures()

    @property
    def read_only(self) -> StoreError | None:
        """Why nothing can be written; None where it can."""
        return self._backend.read_only

    @property
    def login(self) -> str | None:
        """The name by which the database knows its user; None of a file."""
        return self._backend.login

    def alone(self, task: str, what: str) -> AbstractContextManager[None]:
        """Hold a lock that one process has at a time; the database or the system frees it with the process.

        Parameters
        ----------
        task : str
            Which lock: ``sync``, ``submit``.
        what : str
            What this process does, for the message to others.

        Raises
        ------
        RefusedError
            Another process holds it; the message says which.
        """
        return self._backend.alone(task, what)

    def give_room_back(self, tables: Collection[str]) -> None:
        """Give back the room of rows that were deleted: SQLite's file shrinks, PostgreSQL uses it again.

        Parameters
        ----------
        tables : collection of str
            From which they were deleted.

        Raises
        ------
        StoreError
            Others write, or there is no room to write the file anew; the store is as it was.
        """
        self._backend.give_room_back(tables)

    @contextmanager
    def transaction(self) -> Iterator[sa.Connection]:
        """Give a connection inside one write transaction: all of it is kept, or nothing.

        Raises
        ------
        StoreError
            Another process writes to the store, the disk is full, or the folder is read-only.
        """
        if self._backend.read_only is not None:
            raise self._backend.read_only
        with self._backend.errors(), self._backend.writing() as connection:
            yield connection

    def rows(self, statement: sa.Select[Any]) -> list[Row]:
        """Run a query and return its rows as mappings, inside one read transaction."""
        with self.snapshot() as view:
            return view.rows(statement)

    def count(self, table: sa.Table) -> int:
        """Count the rows of a table."""
        return int(self.rows(sa.select(sa.func.count().label("n")).select_from(table))[0]["n"])

    @contextmanager
    def snapshot(self) -> Iterator[Snapshot]:
        """Give a view of one and the same state, however many queries are asked of it."""
        with self._backend.errors(), self._backend.reading() as connection:
            yield Snapshot(connection, self.name)

    def view(self, connection: sa.Connection) -> Snapshot:
        """Return the state that the caller's transaction sees."""
        return Snapshot(connection, self.name)

    def methods(self) -> list[str]:
        """Return the geolocation methods by which drives were ingested, in alphabetical order."""
        column = schema.drive_method.c.method
        return [row["method"] for row in self.rows(sa.select(column).distinct().order_by(column))]

    def matched(self) -> dict[str, Any]:
        """Return the facts of the last match, whose findings are those of the store's drives and mirror.

        Raises
        ------
        StoreError
            Nothing was matched yet.
        RefusedError
            Drives or mirror have changed since.
        """
        with self.snapshot() as view:
            return view.matched()

    # -- small facts ---------------------------------------------------------------------------------------

    def fact(self, key: str) -> dict[str, Any] | None:
        """Return a JSON object kept under `key` (``mirror``, ``last_match``), or None."""
        with self.snapshot() as view:
            return view.fact(key)

    def revision(self) -> int:
        """Return how often drives or the mirror have changed: findings of an older revision are stale."""
        with self.snapshot() as view:
            return view.revision()

    def touch(
        self,
        connection: sa.Connection,
        drives: Collection[str] | None = None,
        *,
        places: Collection[Place] | None = None,
    ) -> None:
        """Count a change of drives or mirror, inside the caller's transaction.

        The next match is of what was touched. If neither drives nor places are named, anything may have
        changed.

        Parameters
        ----------
        connection : Connection
        drives : collection of str, optional
            That came, went or were read anew.
        places : collection of (int, int), optional
            Where NVDB's signs, or what they face, were or are otherwise: EPSG:25833, cut to whole metres.
        """
        view = self.view(connection)
        revision = view.revision() + 1
        what = Touched(frozenset(drives or ()), frozenset(places or ()))
        is_known = drives is not None or places is not None
        fact = with_one_more(view.fact(TOUCHED), revision, what if is_known else None)
        self.put_fact(connection, _REVISION, {"n": revision})
        self.put_fact(connection, TOUCHED, fact)

    def put_fact(self, connection: sa.Connection, key: str, value: Row) -> None:
        """Keep a JSON object under `key` inside the caller's transaction."""
        self.drop_fact(connection, key)
        text = json.dumps(dict(value), ensure_ascii=False)
        connection.execute(sa.insert(schema.meta), [{"key": key, "value": text}])

    def drop_fact(self, connection: sa.Connection, key: str) -> None:
        """Forget what is kept under `key`, inside the caller's transaction."""
        connection.execute(sa.delete(schema.meta).where(schema.meta.c.key == key))


def _backend(address: StoreAddress, *, create: bool) -> Backend:
    if address.file is None:
        from twin.store.postgres import Postgres

        return Postgres(address, create=create)
    from twin.store.sqlite_file import SqliteFile

    return SqliteFile(address.file, create=create)
