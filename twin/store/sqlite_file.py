"""A store in one SQLite file (WAL)."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from twin.errors import StoreError
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.backend import Backend, create_tables
from twin.store.lock import exclusive

_BUSY_TIMEOUT_S = 10.0

_Written = tuple[int, int, bool]


class SqliteFile(Backend):
    """A SQLite file, open.

    Parameters
    ----------
    path : Path
    create : bool
        Whether a missing file is made. Without it, one that cannot be written, for want of rights or of
        space, opens all the same: to be read.

    Raises
    ------
    StoreError
        Missing, not a store, unreadable, or written by a newer version.
    """

    def __init__(self, path: Path, *, create: bool) -> None:
        self._path = path
        self.name = str(path)
        self._frozen_as: _Written | None = None
        self._open(create=create)

    @property
    def address(self) -> StoreAddress:
        """The file, as it is found from any folder."""
        return StoreAddress.of(self._path.absolute())

    @property
    def file(self) -> Path:
        """The file."""
        return self._path

    @contextmanager
    def errors(self) -> Iterator[None]:
        """As :func:`sqlite_errors`."""
        with sqlite_errors(self._path):
            yield

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """Give a connection that sees one and the same state."""
        with self.engine.connect() as connection, connection.begin():
            yield connection
        if self._frozen_as is not None and self._frozen_as != _written(self._path):
            raise StoreError(f"The store {self._path} was written while it was read: run this again.")

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """Give a connection inside a write transaction: one writer at a time."""
        with self.engine.execution_options(writes=True).begin() as connection:
            yield connection

    @contextmanager
    def alone(self, task: str, what: str) -> Iterator[None]:
        """Hold a lock file beside the store."""
        with exclusive(self._beside(f".{task}-lock"), f"{what} of {self._path.name}"):
            yield

    def give_room_back(self, tables: Collection[str]) -> None:
        """Write the file anew without its holes: all of it, whatever the tables."""
        del tables
        with self.errors():
            raw = self.engine.raw_connection()
            try:
                raw.cursor().execute("VACUUM")
                raw.cursor().execute("PRAGMA wal_checkpoint(TRUNCATE)")
            except sqlite3.DatabaseError as error:
                raise sa.exc.DBAPIError("VACUUM", None, error) from error
            finally:
                raw.close()

    def pictures(self) -> Path:
        """Return ``twin.db.evidence`` beside ``twin.db``."""
        return self._beside(".evidence")

    def _beside(self, end: str) -> Path:
        return self._path.with_name(f"{self._path.name}{end}")

    def _open(self, *, create: bool) -> None:
        """Connect; and say why it cannot be written, and as what the engine takes it to be frozen."""
        path = self._path
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
            raise StoreError(
                f"The folder of the store {path} does not exist: make it, or name another --store."
            )
        if create or _may_write(path):
            try:
                self._connect(create=create)
            except StoreError as error:
                # SQLite's log and the log's index need room, also to read.
                if create or _has_log(path) or _code(error.__cause__) not in _NOT_WRITTEN:
                    raise
                self.read_only = error
            else:
                return
        else:
            self.read_only = _unwritable(path)
        # What others are writing stands in the log.
        frozen = not _has_log(path)
        try:
            self._connect(frozen=frozen)
        except StoreError as error:
            if frozen or _code(error.__cause__) != sqlite3.SQLITE_CANTOPEN:
                raise
            # Without its index beside it SQLite reads a log only where it may make one.
            raise StoreError(
                f"The last changes of the store {path} stand in {path.name}-wal, which only who may write "
                "the folder can read: let its owner run `twin status` once, or copy both files to a folder "
                "of yours."
            ) from error
        self._frozen_as = _written(path) if frozen else None

    def _connect(self, *, create: bool = False, frozen: bool = False) -> None:
        """Connect to a store that can be used; any other is given up."""
        self.engine = _engine(self._path, frozen=frozen)
        try:
            self._check_or_create(create=create)
        except BaseException:
            self.engine.dispose()
            raise

    def _check_or_create(self, *, create: bool) -> None:
        with self.errors(), self.engine.connect() as connection:
            tables = set(sa.inspect(connection).get_table_names())
        if not tables and not create:
            raise StoreError(f"{self._path} is empty and not a twin store: name another --store.")
        if not tables:
            with self.errors():
                self._create()
        elif schema.meta.name not in tables:
            raise StoreError(f"{self._path} is a database but not a twin store: name another --store.")
        else:
            self.check_version()

    def _create(self) -> None:
        # WAL is a property of the file: set once, outside any transaction.
        raw = self.engine.raw_connection()
        try:
            raw.cursor().execute("PRAGMA journal_mode=WAL")
        finally:
            raw.close()
        with self.writing() as connection:
            create_tables(connection)


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
def sqlite_errors(path: Path) -> Iterator[None]:
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
