"""Files each of which is either as it was or completely new, whatever happens in between.

Everything is written inside a private folder ``.twin-export`` in the target folder (so on the same file
system), closed, flushed to the disk, and only then renamed over the old files, one after the other. No system
renames several files at once: a kill or a power cut between two renames leaves the first files new and the
others old.

A lock in that folder is held by the operating system and dies with its process: what a killed export left is
recognised and removed by the next one, and two exports at once never mix.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from filelock import lock_descriptor

from twin.errors import CURES, ExportRefusedError, TwinError

STAGING = ".twin-export"
_LOCK = "lock"
# How often an export may find the folder removed under it by others that end, before it gives up.
_ATTEMPTS = 20
# What SQLite would replay into a file of this name at its next opening.
_SIDECARS = ("-wal", "-journal")


@contextmanager
def replacing(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Replace files of a folder: none of them before all are complete on the disk.

    Parameters
    ----------
    folder : Path
        Made if it does not exist.
    names : sequence of str
        The files that the body of the ``with`` writes. They are renamed in this order: what is derived from
        another file goes last, so that it is never newer than its source.

    Yields
    ------
    Path
        Where to write them. When the body ends without an exception they take the place of the old files;
        otherwise they are removed and the old files stay.

    Raises
    ------
    ExportRefusedError
        Another export is writing there, or an old file is open in another program: the old files are as they
        were. Or a rename failed and those before it could not be taken back: the message says which files
        are new.
    OSError
        The folder cannot be made or written; the old files are as they were.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise ExportRefusedError(f"{folder} is a file: give a folder to export to") from error
    staging = folder / STAGING
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
        _release(staging, lock)


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
    """Write one small file: as it was or completely new. Into a device or pipe it is written as it is.

    Raises
    ------
    TwinError
        The folder does not exist: ExportRefusedError if it cannot be written, or the disk is full.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        if path.exists() and not path.is_file():
            # A new file in its place would take away the device itself, such as /dev/full for root.
            path.write_bytes(content)
            return
        temporary.write_bytes(content)
        _flush(temporary)
        temporary.replace(path)
        _flush_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        cure = f": {CURES[error.errno]}." if error.errno in CURES else ""
        # A folder that is missing is no refusal: nothing would be lost.
        kind = TwinError if isinstance(error, FileNotFoundError) else ExportRefusedError
        raise kind(f"cannot write {path}: {error.strerror or error}{cure}") from error


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


def _lock(staging: Path) -> BinaryIO:
    """Make the staging folder and hold it until :func:`_release` or until the process dies."""
    for _ in range(_ATTEMPTS):
        # Not exist_ok=True, which fails where the folder is removed right after it was found to exist.
        with suppress(FileExistsError):
            staging.mkdir()
        lock = _try_lock(staging / _LOCK)
        if lock is not None:
            return lock
    raise ExportRefusedError(f"other exports keep writing to {staging.parent}: wait until they end")


def _try_lock(path: Path) -> BinaryIO | None:
    """Make and lock a file; None where an export that ended has removed it meanwhile."""
    with ExitStack() as stack, suppress(FileNotFoundError):
        file = stack.enter_context(path.open("ab"))
        if not lock_descriptor(file.fileno(), blocking=False):
            raise ExportRefusedError(f"another export is writing to {path.parent.parent}: wait until it ends")
        # Whoever holds the lock may remove its file. A lock on a removed file keeps nobody out.
        if os.path.samestat(os.fstat(file.fileno()), path.stat()):
            stack.pop_all()
            return file
    return None


def _release(staging: Path, lock: BinaryIO) -> None:
    """Leave the folder empty, give it free and, if nobody else has begun there, remove it."""
    with suppress(OSError):
        _remove_leftovers(staging)
    # POSIX: removed while held, so that it is never a newcomer's lock that is removed. Windows cannot remove
    # an open file: there the lock ends first, and one that a newcomer has opened stays.
    if sys.platform == "win32":
        lock.close()
    with suppress(OSError):
        (staging / _LOCK).unlink()
        staging.rmdir()
    lock.close()


def _remove_leftovers(staging: Path) -> None:
    for path in staging.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name != _LOCK:
            path.unlink()


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Make renames durable, where the system can: Windows and some network file systems cannot."""
    if os.name == "nt":
        return
    # The files are in place already: a failure here must not be told as one to replace them.
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _publish(staging: Path, folder: Path, names: Sequence[str]) -> None:
    """Rename the new files over the old ones; where one fails, take back those that have a way back.

    Raises
    ------
    OSError
        A rename failed; every file is as it was.
    ExportRefusedError
        A rename failed and some files stay new.
    """
    done: list[str] = []
    try:
        for name in names:
            # A second name for the old file. File systems without hard links go without a way back.
            with suppress(OSError):
                os.link(folder / name, staging / f"old-{name}")
            (staging / name).replace(folder / name)
            done.append(name)
    except OSError as error:
        new = [name for name in done if not _take_back(staging / f"old-{name}", folder / name)]
        if not new:
            raise
        others = [name for name in names if name not in new]
        raise ExportRefusedError(
            f"cannot replace {folder / names[len(done)]}: {error.strerror or error}; in {folder} "
            f"{' and '.join(new)} {'is' if len(new) == 1 else 'are'} already new, "
            f"{' and '.join(others)} as before: close the programs that use them, then export again"
        ) from error


def _take_back(backup: Path, path: Path) -> bool:
    """Put the old file back; False where that is impossible: the new one, which is whole, then stays."""
    try:
        backup.replace(path)
    except OSError:
        return False
    return True
