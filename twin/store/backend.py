"""What a store asks of its database, and what every database must hold to be a store."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import sqlalchemy as sa

from twin.errors import StoreError
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.migrate import upgrade


class Backend(ABC):
    """One database, connected.

    Attributes
    ----------
    name : str
        For messages: the path, or the address without its password.
    engine : sqlalchemy.Engine
    read_only : StoreError or None
        Why nothing can be written.
    """

    name: str
    engine: sa.Engine
    read_only: StoreError | None = None

    @abstractmethod
    def errors(self) -> AbstractContextManager[None]:
        """Turn what the database says into one sentence with a cure (StoreError)."""

    @abstractmethod
    def reading(self) -> AbstractContextManager[sa.Connection]:
        """Give a connection that sees one and the same state."""

    @abstractmethod
    def writing(self) -> AbstractContextManager[sa.Connection]:
        """Give a connection inside a write transaction: one writer at a time."""

    @abstractmethod
    def alone(self, task: str, what: str) -> AbstractContextManager[None]:
        """Hold the lock of a task, or raise RefusedError that says who holds it.

        Parameters
        ----------
        task : str
            Which lock: ``sync``, ``submit``.
        what : str
            What this process does, for the message to others.
        """

    @abstractmethod
    def give_room_back(self, tables: Collection[str]) -> None:
        """Let others use the room of rows that were deleted from these tables, outside any transaction."""

    @abstractmethod
    def pictures(self) -> Path:
        """Return the folder for crops of pictures; StoreError where none is named."""

    def revising(self, _connection: sa.Connection) -> AbstractContextManager[None]:
        """Set aside what stands in the way of changed tables, inside the caller's transaction."""
        return nullcontext()

    @property
    @abstractmethod
    def address(self) -> StoreAddress:
        """By which another process opens it."""

    @property
    def login(self) -> str | None:
        """The name that the database knows its user by; None of a file."""
        return None

    @property
    def file(self) -> Path | None:
        """The SQLite file; None of a database."""
        return None

    def check_version(self) -> None:
        """Bring an older store to this version.

        Raises
        ------
        StoreError
            The store is newer, does not say its version, or cannot be upgraded.
        """
        with self.errors(), self.engine.connect() as connection:
            found = stated_version(connection)
        if found is None:
            raise StoreError(
                f"The store {self.name} does not say its version: it is damaged; name another --store."
            )
        if found > schema.VERSION:
            raise StoreError(
                f"The store {self.name} was written by a newer twin (schema {found}; this twin knows "
                f"{schema.VERSION}): upgrade twin, or name another --store."
            )
        if found < schema.VERSION:
            with self.errors(), self.writing() as connection, self.revising(connection):
                # Asked again inside the transaction: another process may have upgraded it meanwhile.
                upgrade(connection, stated_version(connection) or found, self.name)


def stated_version(connection: sa.Connection) -> int | None:
    """Return the schema version that a store says; None where it says none."""
    value = connection.execute(
        sa.select(schema.meta.c.value).where(schema.meta.c.key == "schema_version")
    ).scalar()
    return int(value) if value is not None and str(value).isdigit() else None


def create_tables(connection: sa.Connection) -> None:
    """Make the tables of a new store inside the caller's transaction."""
    # Not asked first what is there: PostgreSQL would find tables of the same name in others' schemas.
    schema.metadata.create_all(connection, checkfirst=False)
    connection.execute(sa.insert(schema.meta), [{"key": "schema_version", "value": str(schema.VERSION)}])
