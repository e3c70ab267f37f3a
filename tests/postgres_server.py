"""A PostgreSQL with PostGIS of the tests' own: in a temporary folder, on a socket, gone with them."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psycopg

from twin.store.store import Store

_SETTINGS = {
    "listen_addresses": "",
    "fsync": "off",
    "full_page_writes": "off",
    "synchronous_commit": "off",
    "max_connections": "60",
}
ABSENT = "PostgreSQL with PostGIS is not installed (Debian: apt install postgresql postgresql-postgis)"


class Server:
    """Makes databases."""

    def __init__(self, folder: Path, start: Callable[[], None]) -> None:
        self._folder = folder
        self._start = start
        self._numbers = itertools.count()

    def address(self, database: str, user: str = "postgres") -> str:
        """Return what ``--store`` takes."""
        return f"postgresql://{user}@/{database}?host={self._folder}&pictures={self._folder / database}"

    def new(self, template: str = "store") -> str:
        """Make a database, and return its address: of ``store`` an empty store, of ``postgis`` none yet."""
        name = f"test_{next(self._numbers)}"
        self.run(f'CREATE DATABASE "{name}" TEMPLATE "{template}"')
        return self.address(name)

    def kill(self) -> None:
        """Kill it, and start it again: what was committed is there, and nothing else."""
        first = (self._folder / "data" / "postmaster.pid").read_text().split()[0]
        os.kill(int(first), signal.SIGKILL)
        for _ in range(50):  # what it had started still holds its memory for a moment
            with suppress(subprocess.CalledProcessError):
                self._start()
                return
            time.sleep(0.2)
        raise RuntimeError("the server does not start again")

    def copy(self, address: str) -> str:
        """Make a database like another, which nobody is connected to."""
        return self.new(_database(address))

    def run(self, *statements: str, database: str = "postgres") -> None:
        """Run statements as the administrator."""
        with psycopg.connect(
            host=str(self._folder), dbname=database, user="postgres", autocommit=True
        ) as connection:
            for statement in statements:
                connection.execute(statement)


def _database(address: str) -> str:
    return address.partition("@/")[2].partition("?")[0]


@contextmanager
def running(**settings: str) -> Iterator[Server]:
    """Start a server with the templates ``postgis`` and ``store``.

    Raises
    ------
    FileNotFoundError
        None is installed.
    """
    initdb = _program("initdb")
    if initdb is None or not list(Path("/usr/share/postgresql").glob("*/extension/postgis.control")):
        raise FileNotFoundError(ABSENT)
    # Not pytest's folder: others than its owner, as whom the server has to run, may not enter that.
    folder = Path(tempfile.mkdtemp(prefix="twin-postgres-"))
    data, log = folder / "data", folder / "log"
    as_other = []
    if os.geteuid() == 0:
        shutil.chown(folder, "postgres")
        as_other = ["setpriv", "--reuid=postgres", "--regid=postgres", "--clear-groups"]
    pg_ctl = initdb.with_name("pg_ctl")
    every = {**_SETTINGS, "unix_socket_directories": str(folder), **settings}
    options = " ".join(f"-c {name}='{value}'" for name, value in every.items())

    def call(*command: object) -> None:
        words = [*as_other, *map(str, command)]
        subprocess.run(
            words, check=True, cwd="/", stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=60
        )

    def start() -> None:
        call(pg_ctl, "-D", data, "-w", "-l", log, "-o", options, "start")

    try:
        call(initdb, "-D", data, "--no-sync", "-A", "trust", "-U", "postgres", "-E", "UTF8", "--locale=C")
        start()
        try:
            server = Server(folder, start)
            server.run("CREATE DATABASE postgis")
            server.run("CREATE EXTENSION postgis", database="postgis")
            server.run("CREATE DATABASE store TEMPLATE postgis")
            Store.open(server.address("store")).close()
            yield server
        finally:
            call(pg_ctl, "-D", data, "-m", "immediate", "stop")
    finally:
        shutil.rmtree(folder)


def _program(name: str) -> Path | None:
    """The newest one that is installed; Debian keeps them out of the way."""
    newest = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"), key=lambda path: path.parts[-3])
    found = shutil.which(name)
    return newest[-1] if newest else Path(found) if found else None
