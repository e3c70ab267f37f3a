"""The twin's state: one SQLite file (WAL), reached through SQLAlchemy Core.

A state change is one transaction: a killed process leaves the state before it or after it. The tables'
columns are declared in :mod:`twin.store.schema`.
"""

from __future__ import annotations

import datetime as dt
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from twin.errors import RefusedError, StoreError
from twin.store import schema
from twin.store.tables import Tables
from twin.store.upgrades import UPGRADES

Row = Mapping[str, Any]

_BUSY_TIMEOUT_S = 10.0


def utc_now() -> str:
    """Return the present instant as ISO 8601 UTC to the second: ``2026-06-10T08:00:00Z``."""
    return dt.datetime.now(dt.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


_REVISION = "revision"


class Snapshot:
    """One state of a store, for several queries that must agree: what one transaction sees.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        Inside a transaction.
    path : Path
        Of the store, for messages.
    """

    def __init__(self, connection: sa.Connection, path: Path) -> None:
        self._connection = connection
        self._path = path

    def rows(self, statement: sa.Select[Any]) -> list[Row]:
        """Run a query and return its rows as mappings."""
        result = self._connection.execute(statement)
        names = list(result.keys())
        return [dict(zip(names, row, strict=True)) for row in result]

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
            raise StoreError(f"The store {self._path} has no findings yet: run `twin match` first.")
        if last["revision"] != self.revision():
            raise RefusedError(
                f"The store {self._path} has changed since the last match (sync or ingest): "
                "run `twin match` again first."
            )
        return last

    def columns(self, statement: sa.Select[Any]) -> dict[str, list[Any]]:
        """Run a query and return its columns: much faster than rows where there are many."""
        result = self._connection.execute(statement)
        names, rows = list(result.keys()), result.fetchall()
        return {name: [row[i] for row in rows] for i, name in enumerate(names)}


class Store(Tables):
    """An open store, to be closed or used as a context manager: ``with Store("twin.db") as store: ...``.

    Parameters
    ----------
    path : Path or str
        The SQLite file.
    create : bool
        Whether a missing file is made, which :meth:`open` does. Without it, a store that cannot be written,
        for want of rights or of space, opens all the same: to be read.

    Raises
    ------
    StoreError
        Missing, not a store, unreadable, or written by a newer version.
    """

    def __init__(self, path: Path | str, *, create: bool = False) -> None:
        self.path = Path(path)
        self._engine, self._read_only, self._frozen_as = _opened(self.path, create=create)

    @classmethod
    def open(cls, path: Path | str, *, create: bool = True) -> Store:
        """Open a store, making a new one where there is none."""
        return cls(path, create=create)

    def close(self) -> None:
        """Close every connection."""
        self._engine.dispose()

    def __enter__(self) -> Store:
        """Return the store itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    @property
    def read_only(self) -> StoreError | None:
        """Why nothing can be written; None where it can."""
        return self._read_only

    @contextmanager
    def transaction(self) -> Iterator[sa.Connection]:
        """Give a connection inside one write transaction: all of it is kept, or nothing.

        Raises
        ------
        StoreError
            Another process writes to the store, the disk is full, or the folder is read-only.
        """
        if self._read_only is not None:
            raise self._read_only
        writer = self._engine.execution_options(writes=True)
        with store_errors(self.path), writer.begin() as connection:
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
        with store_errors(self.path), self._engine.connect() as connection, connection.begin():
            yield Snapshot(connection, self.path)
        if self._frozen_as is not None and self._frozen_as != _written(self.path):
            raise StoreError(f"The store {self.path} was written while it was read: run this again.")

    def view(self, connection: sa.Connection) -> Snapshot:
        """Return the state that the caller's transaction sees."""
        return Snapshot(connection, self.path)

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

    def touch(self, connection: sa.Connection) -> None:
        """Count a change of drives or mirror, inside the caller's transaction."""
        self.put_fact(connection, _REVISION, {"n": self.view(connection).revision() + 1})

    def put_fact(self, connection: sa.Connection, key: str, value: Row) -> None:
        """Keep a JSON object under `key` inside the caller's transaction."""
        self.drop_fact(connection, key)
        text = json.dumps(dict(value), ensure_ascii=False)
        connection.execute(sa.insert(schema.meta), [{"key": key, "value": text}])

    def drop_fact(self, connection: sa.Connection, key: str) -> None:
        """Forget what is kept under `key`, inside the caller's transaction."""
        connection.execute(sa.delete(schema.meta).where(schema.meta.c.key == key))


_Written = tuple[int, int, bool]


def _opened(path: Path, *, create: bool) -> tuple[sa.Engine, StoreError | None, _Written | None]:
    """Connect to a store; and say why it cannot be written, and as what the engine takes it to be frozen."""
    try:
        existed = path.exists()
    except OSError as error:
        raise StoreError(f"The store {path} could not be used ({error.strerror}): {_ALLOW}.") from error
    if not existed and not create:
        raise StoreError(
            f"There is no store at {path.absolute()}: run `twin sync-nvdb` or `twin ingest-drive` first, "
            "or name another with --store."
        )
    if not path.parent.is_dir():
        raise StoreError(f"The folder of the store {path} does not exist: make it, or name another --store.")
    if create or _may_write(path):
        try:
            return _checked(_engine(path), path, create=create), None, None
        except StoreError as error:
            # SQLite's log and the log's index need room, also to read.
            if create or _has_log(path) or _code(error.__cause__) not in _NOT_WRITTEN:
                raise
            refused = error
    else:
        refused = _unwritable(path)
    # What others are writing stands in the log.
    frozen = not _has_log(path)
    try:
        engine = _checked(_engine(path, frozen=frozen), path)
    except StoreError as error:
        if frozen or _code(error.__cause__) != sqlite3.SQLITE_CANTOPEN:
            raise
        # Without its index beside it SQLite reads a log only where it may make one.
        raise StoreError(
            f"The last changes of the store {path} stand in {path.name}-wal, which only who may write the "
            "folder can read: let its owner run `twin status` once, or copy both files to a folder of "
            "yours."
        ) from error
    return engine, refused, _written(path) if frozen else None


def _engine(path: Path, *, frozen: bool = False) -> sa.Engine:
    """Connect to a file; a frozen one is taken as nobody writes it: no locks, and no log beside it."""
    url = sa.URL.create("sqlite", database=str(path))
    if frozen:
        address = path.absolute().as_uri()
        url = sa.URL.create("sqlite", database=address, query={"immutable": "1", "uri": "true"})
    engine = sa.create_engine(url, connect_args={"timeout": _BUSY_TIMEOUT_S})

    # pysqlite opens transactions late and commits on its own; SQLAlchemy's documented cure is to take over.
    @sa.event.listens_for(engine, "connect")
    def _on_connect(connection: Any, _record: Any) -> None:
        connection.isolation_level = None
        cursor = connection.cursor()
        cursor.execute("PRAGMA foreign_keys=ON")
        cursor.close()

    @sa.event.listens_for(engine, "begin")
    def _on_begin(connection: sa.Connection) -> None:
        # A writer takes the lock at once: one that read first could find the state changed under it.
        writes = connection.get_execution_options().get("writes", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine


_WAIT = "another process is writing to it; try again when that has ended"
_ALLOW = "give this user the right to read and write the file and its folder, or name another --store"
_FREE = "free some space; nothing was changed"
_ANOTHER = "it is not a twin store; name another --store"
_NOT_WRITTEN = {sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR}
_CURES = {
    sqlite3.SQLITE_BUSY: _WAIT,
    sqlite3.SQLITE_LOCKED: _WAIT,
    sqlite3.SQLITE_PERM: _ALLOW,
    sqlite3.SQLITE_CANTOPEN: _ALLOW,
    sqlite3.SQLITE_FULL: _FREE,
    sqlite3.SQLITE_IOERR: _FREE,
    sqlite3.SQLITE_NOTADB: _ANOTHER,
    sqlite3.SQLITE_CORRUPT: _ANOTHER,
}


@contextmanager
def store_errors(path: Path) -> Iterator[None]:
    """Turn what SQLite says into one sentence with a cure."""
    try:
        yield
    except sa.exc.DBAPIError as error:
        if _code(error) == sqlite3.SQLITE_READONLY:
            raise _unwritable(path) from error
        cure = _CURES.get(_code(error), "nothing was changed")
        raise StoreError(f"The store {path} could not be used ({error.orig}): {cure}.") from error


def _unwritable(path: Path) -> StoreError:
    return StoreError(f"The store {path} cannot be written: {_ALLOW}.")


def _code(error: BaseException | None) -> int:
    """What SQLite says is wrong; 0 where it said nothing."""
    # The extended codes (SQLITE_BUSY_SNAPSHOT) hold the code itself in their lowest byte.
    return int(getattr(getattr(error, "orig", None), "sqlite_errorcode", 0)) & 0xFF


def _may_write(path: Path) -> bool:
    """Whether this user may write the file, and SQLite's log beside it.

    Asked before SQLite does, which else would leave a log that the file's owner cannot write.
    """
    who = os.access in os.supports_effective_ids
    return all(os.access(each, os.W_OK, effective_ids=who) for each in (path, path.parent))


def _has_log(path: Path) -> bool:
    """Whether some of the store stands in SQLite's log: a process is writing, or was killed."""
    log = path.with_name(f"{path.name}-wal")
    return log.exists() and log.stat().st_size > 0


def _written(path: Path) -> _Written:
    """When the file was written last, its length, and whether there is a log."""
    status = path.stat()
    return status.st_mtime_ns, status.st_size, _has_log(path)


def _checked(engine: sa.Engine, path: Path, *, create: bool = False) -> sa.Engine:
    """Return the engine of a store that can be used; any other is given up."""
    try:
        _check_or_create(engine, path, create=create)
    except BaseException:
        engine.dispose()
        raise
    return engine


def _check_or_create(engine: sa.Engine, path: Path, *, create: bool) -> None:
    with store_errors(path), engine.connect() as connection:
        tables = set(sa.inspect(connection).get_table_names())
    if not tables and not create:
        raise StoreError(f"{path} is empty and not a twin store: name another --store.")
    if not tables:
        with store_errors(path):
            _create(engine)
        return
    if schema.meta.name not in tables:
        raise StoreError(f"{path} is a database but not a twin store: name another --store.")
    with store_errors(path), engine.connect() as connection:
        value = connection.execute(
            sa.select(schema.meta.c.value).where(schema.meta.c.key == "schema_version")
        ).scalar()
    version_found = int(value) if value is not None and str(value).isdigit() else None
    if version_found is None:
        raise StoreError(f"The store {path} does not say its version: it is damaged; name another --store.")
    if version_found > schema.VERSION:
        raise StoreError(
            f"The store {path} was written by a newer twin (schema {version_found}; this twin knows "
            f"{schema.VERSION}): upgrade twin, or name another --store."
        )
    if version_found < schema.VERSION:
        _upgrade(engine, path, version_found)


def _upgrade(engine: sa.Engine, path: Path, version_found: int) -> None:
    """Bring the tables of an older store to this version, in one transaction; what it holds stays.

    Raises
    ------
    StoreError
        The store is older than any that can be upgraded, or cannot be written.
    """
    if any(version not in UPGRADES for version in range(version_found, schema.VERSION)):
        raise StoreError(
            f"The store {path} was written by an older twin (schema {version_found}; this twin needs "
            f"{schema.VERSION}): sync and ingest into a new --store."
        )
    is_version = schema.meta.c.key == "schema_version"
    with store_errors(path), engine.execution_options(writes=True).begin() as connection:
        # Asked again inside the transaction: another process may have upgraded it meanwhile.
        current = int(connection.execute(sa.select(schema.meta.c.value).where(is_version)).scalar_one())
        for version in range(current, schema.VERSION):
            for statement in UPGRADES[version]:
                connection.exec_driver_sql(statement)
        connection.execute(sa.update(schema.meta).where(is_version).values(value=str(schema.VERSION)))


def _create(engine: sa.Engine) -> None:
    # WAL is a property of the file: set once, outside any transaction.
    raw = engine.raw_connection()
    try:
        raw.cursor().execute("PRAGMA journal_mode=WAL")
    finally:
        raw.close()
    with engine.execution_options(writes=True).begin() as connection:
        schema.metadata.create_all(connection)
        connection.execute(sa.insert(schema.meta), [{"key": "schema_version", "value": str(schema.VERSION)}])
