"""A store in a database of PostgreSQL with PostGIS, in a schema of its own.

Readers see one snapshot (REPEATABLE READ, read only). Writers take turns by an advisory lock and then read
what the one before has left (READ COMMITTED): under REPEATABLE READ they would wait with an old snapshot.
"""

from __future__ import annotations

import os
import re
import socket
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from twin.errors import ConfigError, MissingExtraError, RefusedError, StoreError
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.backend import Backend, create_tables
from twin.store.postgres_tables import LOCKS, POSTGIS, SCHEMA, WRITER, rules
from twin.store.qgis_views import QGIS_SCHEMA, no_views, views
from twin.store.roles import Role, rights, roles

_PATIENCE = "60s"

_LOST = "see that the server runs and can be reached, then run this again; nothing is written by halves"
_CURES = {
    "2BP01": "what rests on the layers of twin_qgis is in the way: take it away, and make it anew afterwards",
    "25006": "the server takes no changes (a standby, or read only by its settings): name its primary",
    "42501": "ask who owns the store for the right to do this",
    "42P01": "it is damaged, or not a store of this version; name another --store",
    "55P03": "another process is writing to it; try again when that has ended",
    "40P01": "another process was in the way; run this again",
}
_CLASSES = {
    "08": _LOST,
    "28": "name another user, or mend what the password file (~/.pgpass) says",
    "53": "free space or connections on its server; nothing was changed",
    "57": _LOST,
}


class Postgres(Backend):
    """A database of PostgreSQL, connected.

    Parameters
    ----------
    address : StoreAddress
    create : bool
        Whether the tables are made where there are none.

    Raises
    ------
    StoreError
        The server is not reached, there is no store, or it was written by a newer version.
    MissingExtraError
        psycopg is not installed.
    """

    def __init__(self, address: StoreAddress, *, create: bool) -> None:
        self._address = address
        self.name = str(address)
        self.engine = _engine(address)
        self._readers = self.engine.execution_options(
            isolation_level="REPEATABLE READ", postgresql_readonly=True
        )
        try:
            with self.errors():
                self._check_or_create(create=create)
        except BaseException:
            self.engine.dispose()
            raise

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Turn what PostgreSQL says into one sentence with a cure."""
        with _errors(self.name):
            yield

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """Give a connection that sees one and the same state."""
        with self._readers.connect() as connection, connection.begin():
            yield connection

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """Give a connection inside a write transaction: one writer at a time."""
        with self.engine.begin() as connection:
            connection.exec_driver_sql(f"SET LOCAL lock_timeout = '{_PATIENCE}'")
            connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({LOCKS}, {WRITER})")
            yield connection

    @contextmanager
    def alone(self, task: str, what: str) -> Iterator[None]:
        """Hold an advisory lock, on a connection of its own: it ends with its process, however that ends."""
        key = {"of": LOCKS, "task": _task_number(task)}
        doing = f"twin {what}, process {os.getpid()} on {socket.gethostname()}"
        with self.errors(), self.engine.connect() as opened:
            held = opened.execution_options(isolation_level="AUTOCOMMIT")
            if not held.execute(_TAKE, key).scalar():
                holder = held.execute(_HOLDER, key).scalar() or "another process"
                raise RefusedError(
                    f"The store {self.name} is in use ({holder}): wait until that has ended, then run this "
                    "again."
                )
            try:
                held.execute(_NAME, {"name": doing.encode("ascii", "replace").decode()[:63]})
                yield
            finally:
                # At once: a server takes a moment to see that a connection has gone, and who asks again by
                # then would be refused. Where the server itself has gone the lock is gone too.
                with suppress(sa.exc.DBAPIError):
                    held.execute(_LEAVE, key)
                opened.invalidate()

    @contextmanager
    def revising(self, connection: sa.Connection) -> Iterator[None]:
        """Take the views for QGIS away and make them anew, as the store's owner: of new tables too."""
        owner = str(connection.execute(_OWNER, {"schema": SCHEMA}).scalar())
        connection.exec_driver_sql(f"SET LOCAL ROLE {_quoted(connection, owner)}")
        for statement in no_views():
            connection.exec_driver_sql(statement)
        yield
        _make_views(connection)
        if owner == Role.OWNER:
            for statement in rights():
                connection.exec_driver_sql(statement)

    @property
    def address(self) -> StoreAddress:
        """With its password, if it has one."""
        return self._address

    @property
    def login(self) -> str:
        """The name of the login, whatever role it has taken."""
        with self.errors(), self.reading() as connection:
            return str(connection.execute(_LOGIN).scalar())

    def give_room_back(self, tables: Collection[str]) -> None:
        """Free the room for other rows of these tables; their files stay as large as they are."""
        with self.errors(), self.engine.connect() as opened:
            free = opened.execution_options(isolation_level="AUTOCOMMIT")
            for table in tables:
                free.exec_driver_sql(f"VACUUM (ANALYZE) {SCHEMA}.{table}")

    def pictures(self) -> Path:
        """Return the folder that the address names."""
        folder = self._address.pictures
        if folder is None:
            raise ConfigError(
                f"The store {self.name} names no folder for pictures: add ?pictures=FOLDER to its address, a "
                "folder that every machine which makes or shows pictures reaches."
            )
        return folder

    def _check_or_create(self, *, create: bool) -> None:
        with self.reading() as connection:
            state = _state(connection)
        if state is None and not create:
            raise StoreError(
                f"There is no store in {self.name}: run `twin sync-nvdb` or `twin ingest-drive` first, or "
                "name another with --store."
            )
        if state is None:
            with self.writing() as connection:
                if _state(connection) is None:  # another process may have made it meanwhile
                    self._create(connection)
        self.check_version()
        with self.reading() as connection:
            if not connection.execute(_MAY_WRITE).scalar():
                self.read_only = StoreError(
                    f"The store {self.name} cannot be written by this user: {_CURES['42501']}."
                )

    def _create(self, connection: sa.Connection) -> None:
        if connection.execute(_POSTGIS_THERE).scalar() is None:
            raise StoreError(
                f"The server of {self.name} has no PostGIS: install it there (Debian and Ubuntu: "
                "apt install postgresql-postgis), then run this again."
            )
        try:
            with connection.begin_nested():
                connection.exec_driver_sql(POSTGIS)
        except sa.exc.ProgrammingError as error:
            raise StoreError(
                f"The database {self.name} has no PostGIS yet, and this user may not add it: let an "
                f"administrator of the database run `{POSTGIS}` there once."
            ) from error
        connection.exec_driver_sql(f"CREATE SCHEMA IF NOT EXISTS {SCHEMA}")
        if sa.inspect(connection).get_table_names(schema=SCHEMA):
            raise StoreError(
                f"The schema {SCHEMA} of {self.name} holds tables and is not a twin store: name another "
                "database."
            )
        create_tables(connection)
        for statement in rules():
            connection.exec_driver_sql(statement)
        _make_views(connection)


def init_roles(address: StoreAddress) -> None:
    """Make the group roles of :mod:`.roles` on the store's server, and grant them what they may.

    Raises
    ------
    StoreError
        There is no store, or this user may not do that.
    ConfigError
        The store is a file.
    """
    if address.file is not None:
        raise ConfigError(
            f"The store {address} is a file, whose rights are those of the system: roles are of PostgreSQL."
        )
    store = Postgres(address, create=False)
    try:
        with store.errors(), store.writing() as connection:
            for statement in roles():
                connection.exec_driver_sql(statement)
    finally:
        store.engine.dispose()


def is_there(address: StoreAddress) -> bool:
    """Whether a database holds a store.

    Raises
    ------
    StoreError
        It is not reached.
    """
    engine = _engine(address)
    try:
        with _errors(str(address)), engine.connect() as connection:
            return _state(connection) is not None
    finally:
        engine.dispose()


@contextmanager
def _errors(name: str) -> Iterator[None]:
    import psycopg

    try:
        yield
    except sa.exc.DBAPIError as error:
        raise _said(name, error.orig) from error
    except psycopg.Error as error:
        raise _said(name, error) from error


def _said(name: str, error: Any) -> StoreError:
    state = getattr(error, "sqlstate", None) or "08000"
    cure = _CURES.get(state) or _CLASSES.get(state[:2]) or "nothing was changed"
    told = (error.diag.message_primary if hasattr(error, "diag") else None) or str(error)
    return StoreError(f"The store {name} could not be used ({_first_line(told)}): {cure}.")


_TAKE = sa.text("SELECT pg_try_advisory_lock(:of, :task)")
_LEAVE = sa.text("SELECT pg_advisory_unlock(:of, :task)")
_NAME = sa.text("SELECT set_config('application_name', :name, false)")
_HOLDER = sa.text(
    "SELECT a.application_name FROM pg_locks AS l JOIN pg_stat_activity AS a USING (pid) WHERE l.granted "
    "AND l.locktype = 'advisory' AND l.classid = :of AND l.objid = :task AND l.objsubid = 2 "
    "AND a.datname = current_database()"
)
_POSTGIS_THERE = sa.text("SELECT name FROM pg_available_extensions WHERE name = 'postgis'")
_STATE = sa.text("SELECT to_regclass(:meta)")
_MAY_WRITE = sa.text(
    f"SELECT NOT pg_is_in_recovery() AND (has_table_privilege('{SCHEMA}.{schema.meta.name}', 'INSERT') "
    f"OR has_table_privilege('{SCHEMA}.{schema.decision_log.name}', 'INSERT'))"
)


_OWNER = sa.text("SELECT pg_get_userbyid(nspowner) FROM pg_namespace WHERE nspname = :schema")
_LOGIN = sa.text("SELECT session_user")
_HAS_LAYERS = sa.text(f"SELECT to_regnamespace('{QGIS_SCHEMA}')")


def _make_views(connection: sa.Connection) -> None:
    # Asked first: the owner of a store may be one who may not make schemas, nor say IF NOT EXISTS.
    if connection.execute(_HAS_LAYERS).scalar() is None:
        connection.exec_driver_sql(f"CREATE SCHEMA {QGIS_SCHEMA}")
    for statement in views():
        connection.exec_driver_sql(statement)


def _quoted(connection: sa.Connection, name: str) -> str:
    return connection.dialect.identifier_preparer.quote_identifier(name)


def _state(connection: sa.Connection) -> str | None:
    """The table by which a store is known; None where there is none."""
    found: str | None = connection.execute(_STATE, {"meta": f"{SCHEMA}.{schema.meta.name}"}).scalar()
    return found


def _task_number(task: str) -> int:
    return 1 + (zlib.crc32(task.encode()) >> 2)


def _first_line(text: str) -> str:
    return re.split(r"[\r\n]", text.strip())[0].rstrip(":.")


def _engine(address: StoreAddress) -> sa.Engine:
    try:
        # Connections that a restarted server has closed are replaced; one that a network has forgotten shows.
        engine = sa.create_engine(
            address.connected(),
            pool_pre_ping=True,
            max_overflow=40,
            connect_args={"connect_timeout": 10, "keepalives_idle": 60},
        )
    except ModuleNotFoundError as error:
        raise MissingExtraError("A store on PostgreSQL", "psycopg", "postgres") from error

    @sa.event.listens_for(engine, "connect")
    def _on_connect(connection: Any, _record: Any) -> None:
        connection.autocommit = True
        connection.execute(f"SET search_path TO {SCHEMA}, public")
        connection.autocommit = False

    return engine
