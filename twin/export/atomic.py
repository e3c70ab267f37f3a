"""Files that are either as they were or completely new, whatever happens in between.

Everything is written inside a private folder ``.twin-export`` in the target folder (so on the same file
system), closed, flushed to the disk, and only then renamed over the old files. A lock in that folder is held
by the operating system and dies with its process: what a killed export left is recognised and removed by the
next one, and two exports at once never mix.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from twin.errors import ExportRefusedError

STAGING = ".twin-export"
_LOCK = "lock"
# What SQLite would replay into a file of this name at its next opening.
_SIDECARS = ("-wal", "-journal")


@contextmanager
def replacing(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Replace files of a folder, all or none.

    Parameters
    ----------
    folder : Path
        Made if it does not exist.
    names : sequence of str
        The files that the body of the ``with`` writes.

    Yields
    ------
    Path
        Where to write them. When the body ends without an exception they take the place of the old files;
        otherwise they are removed and the old files stay.

    Raises
    ------
    ExportRefusedError
        Another export is writing there, or an old file is open in another program.
    OSError
        The folder cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise ExportRefusedError(f"{folder} is a file: give a folder to export to") from error
    staging = folder / STAGING
    staging.mkdir(exist_ok=True)
    lock = _lock(staging)
    try:
        _remove_leftovers(staging)
        for name in names:
            refuse_if_open(folder / name)
        yield staging
        for name in names:
            _flush(staging / name)
            refuse_if_open(folder / name)
        _publish(staging, folder, names)
        _flush_folder(folder)
    finally:
        # The lock first: an open file cannot be removed on Windows.
        lock.close()
        shutil.rmtree(staging, ignore_errors=True)


def refuse_if_open(path: Path) -> None:
    """Raise where replacing a file would damage it: it is a folder, or another program has it open.

    QGIS opens a GeoPackage in write-ahead mode: edits wait in ``FILE-wal``. SQLite would apply such a log to
    whatever file carries the name, so a new file must not appear beside an old log.

    Raises
    ------
    ExportRefusedError
        With the cure.
    """
    if path.is_dir():
        raise ExportRefusedError(f"{path} is a folder: move it away, then export again")
    for suffix in _SIDECARS:
        log = path.with_name(path.name + suffix)
        if log.exists() and log.stat().st_size > 0:
            raise ExportRefusedError(
                f"{log} holds edits that are not yet in {path.name}: close the layer in QGIS "
                "(after a crash, open and close it once), then export again"
            )
    if _is_locked(path):
        raise ExportRefusedError(
            f"{path} is open in another program: close the layer in QGIS, then export again"
        )


def replace_file(path: Path, content: bytes) -> None:
    """Write one small file: as it was or completely new.

    Raises
    ------
    ExportRefusedError
        The folder does not exist or cannot be written, or the disk is full.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(content)
        _flush(temporary)
        temporary.replace(path)
        _flush_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise ExportRefusedError(f"cannot write {path}: {error.strerror or error}") from error


def _is_locked(path: Path) -> bool:
    """Whether another program has an SQLite file open in write-ahead mode, or is writing to it."""
    if not path.with_name(path.name + "-shm").exists() or not path.exists():
        return False
    with closing(sqlite3.connect(path, timeout=0.0, isolation_level=None)) as database:
        try:
            # Needs that nobody else has the file open; ends write-ahead mode and removes -wal and -shm.
            return bool(database.execute("PRAGMA journal_mode=DELETE").fetchone()[0] != "delete")
        except sqlite3.OperationalError:
            return True
        except sqlite3.DatabaseError:
            return False


def _lock(staging: Path) -> sqlite3.Connection:
    """Hold the staging folder until the connection is closed or the process dies."""
    # SQLite's lock is the one lock of the standard library that works alike on Linux, macOS and Windows.
    connection = sqlite3.connect(staging / _LOCK, timeout=0.0, isolation_level=None)
    try:
        connection.execute("BEGIN EXCLUSIVE")
    except sqlite3.OperationalError as error:
        connection.close()
        if error.sqlite_errorcode != sqlite3.SQLITE_BUSY:
            raise
        raise ExportRefusedError(
            f"another export is writing to {staging.parent}: wait until it ends"
        ) from error
    return connection


def _remove_leftovers(staging: Path) -> None:
    for path in staging.iterdir():
        if path.name != _LOCK:
            path.unlink()


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Make renames durable; Windows has no such call and needs none."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _publish(staging: Path, folder: Path, names: Sequence[str]) -> None:
    """Rename the new files over the old ones; where one fails, take back those already done."""
    done: list[str] = []
    try:
        for name in names:
            # A second name for the old file. File systems without hard links go without a way back.
            with suppress(OSError):
                os.link(folder / name, staging / f"old-{name}")
            (staging / name).replace(folder / name)
            done.append(name)
    except OSError:
        for name in done:
            if (staging / f"old-{name}").exists():
                (staging / f"old-{name}").replace(folder / name)
            else:
                (folder / name).unlink()
        raise
