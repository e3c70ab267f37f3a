"""What a test keeps in a file is in a database of PostgreSQL instead, where that is asked for.

Where a test names a file, that file holds the address of a database. A copy of such a file names a copy
of the database.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from postgres_server import Server

from twin.store import store as stores
from twin.store.address import StoreAddress
from twin.store.backend import Backend

ASKED = os.environ.get("TWIN_TEST_STORES") == "postgresql"
_HEAD = "a database of the tests\n"


@contextmanager
def instead_of_files(server: Server) -> Iterator[None]:
    """Keep stores in databases of this server until the block ends; files that are there stay files."""
    from twin.store.postgres import Postgres

    in_file = stores._backend

    def opened(address: StoreAddress, *, create: bool) -> Backend:
        path = address.file
        if path is None or not path.parent.is_dir() or path.is_dir():
            return in_file(address, create=create)
        database = _named_by(path)
        if database is None and (path.exists() or not create):
            return in_file(address, create=create)
        if database is None:
            database = server.new()
            path.write_text(_HEAD + database)
        pictures = path.absolute().with_name(f"{path.name}.evidence")
        backend = Postgres(StoreAddress(f"{database}&pictures={pictures}"), create=create)
        backend.name = str(path)
        return backend

    in_files = shutil.copy

    def copied(source: Path | str, target: Path | str) -> Path | str:
        made = Path(in_files(source, target))
        database = _named_by(made)
        if database is not None:
            made.write_text(_HEAD + _copy(server, database))
        return target

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stores, "_backend", opened)
        patch.setattr(shutil, "copy", copied)
        yield


def _named_by(path: Path) -> str | None:
    """Which database a file names; None of any other file, or of none."""
    if not path.exists():
        return None
    with path.open("rb") as file:
        is_ours = file.read(len(_HEAD)) == _HEAD.encode()
        return file.read().decode() if is_ours else None


def _copy(server: Server, address: str) -> str:
    database = StoreAddress(address).url().database
    # A database is copied only while nobody is connected to it; who was connects again.
    server.run(f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{database}'")
    return server.copy(address)
