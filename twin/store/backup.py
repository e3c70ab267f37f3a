"""A copy of a store and its pictures, while others work on it; and that copy put back in its place."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from twin.errors import CURES, ConfigError, FileError, RefusedError, StoreError
from twin.store.atomic_files import replace_file, replacing
from twin.store.lock import exclusive

_BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
_ASIDE = ".before-restore"


@dataclass(frozen=True, slots=True)
class Copied:
    """What a backup or a restore has put in place.

    Attributes
    ----------
    file : Path
        The new store, or the copy of one.
    n_pictures : int
        Crops of pictures in the folder beside it.
    n_lost : int
        Crops that the store names and whose files are not there: made after the copy, or lost before.
    aside : Path or None
        Where the store lies that stood there before; only of a restore.
    """

    file: Path
    n_pictures: int
    n_lost: int
    aside: Path | None = None


def back_up(store: Path, file: Path) -> Copied:
    """Copy a store to a file, and its pictures beside it; others may read and write the store meanwhile.

    A former copy stays until the new one is whole. Pictures that both have are not copied again.

    Raises
    ------
    StoreError
        There is no store, or it is damaged.
    FileError
        The folder of the copy is not there, or cannot be written.
    RefusedError
        What stands in the place of the copy is no store, or is in use.
    """
    _need_store(store)
    if file.resolve() == store.resolve():
        raise ConfigError(f"{file} is the store itself: name another file for its copy.")
    if not file.parent.is_dir():
        # Not made: it may be a disk that is not mounted.
        raise FileError(f"The folder {file.parent} for the copy does not exist: make or mount it first.")
    if file.exists():
        _refuse_other(file)
    with _file_errors(file), replacing(file.parent, [file.name]) as staging:
        hashes = _copy_database(store, staging / file.name, "DELETE")
        shutil.copymode(store, staging / file.name)
        source, target = _pictures(store), _pictures(file)
        for sha256 in sorted(hashes):
            copy_picture(source, target, sha256)
    for path in sorted(target.glob("??/*")):
        if path.stem not in hashes:
            path.unlink()
    return _copied(file, hashes)


def restore(store: Path, file: Path) -> Copied:
    """Put a copy of a store in its place, and its pictures; what stood there is set aside, not lost.

    Until the new store is whole beside it, the old one stays as it is; where something fails after that, it
    is put back. A process killed between the renames leaves no store at all, and the old one set aside.

    Raises
    ------
    StoreError
        There is no such copy, or it is damaged.
    FileError
        The folder of the store cannot be written.
    RefusedError
        Another process has the store open, or the store of an earlier restore is still set aside.
    """
    _need_store(file)
    if file.resolve() == store.resolve():
        raise ConfigError(f"{file} is the store itself: name its copy.")
    if not store.parent.is_dir():
        raise FileError(f"The folder of the store {store} does not exist: make it first.")
    aside = _beside(store, _ASIDE)
    with ExitStack() as held, _file_errors(store):
        for end in (".sync-lock", ".evidence-lock"):
            held.enter_context(exclusive(_beside(store, end), f"restore of {store.name}"))
        _refuse_open(store)
        if any(path.exists() for path in (aside, _pictures(aside))):
            raise RefusedError(f"{aside} is still there from an earlier restore: move or delete it first.")
        staging = _beside(store, ".restoring")
        shutil.rmtree(staging, ignore_errors=True)  # what a killed restore left
        staging.mkdir()
        held.callback(shutil.rmtree, staging, ignore_errors=True)
        new = staging / store.name
        hashes = _copy_database(file, new, "WAL")
        for sha256 in sorted(hashes):
            copy_picture(_pictures(file), _pictures(new), sha256)
        stood = store.exists()
        _exchange(store, new, aside)
    return Copied(*_counts(store, hashes), aside if stood else None)


def _exchange(store: Path, new: Path, aside: Path) -> None:
    """Rename the old store away and the new one into its place; all of it, or take it back."""
    # SQLite would replay a log into whatever file has its name: it goes with its own store.
    moves = [(_beside(store, end), _beside(aside, end)) for end in ("-wal", "", ".evidence")]
    moves += [(_pictures(new), _pictures(store)), (new, store)]
    _beside(store, "-shm").unlink(missing_ok=True)
    if not store.exists():
        _beside(store, "-wal").unlink(missing_ok=True)
    done: list[tuple[Path, Path]] = []
    try:
        for old, target in moves:
            if old.exists():
                old.rename(target)
                done.append((old, target))
    except BaseException:
        for old, target in reversed(done):
            target.rename(old)
        raise


def _copied(file: Path, hashes: set[str]) -> Copied:
    return Copied(*_counts(file, hashes))


def _counts(file: Path, hashes: set[str]) -> tuple[Path, int, int]:
    there = {path.stem for path in _pictures(file).glob("??/*")}
    return file, len(there & hashes), len(hashes - there)


def _beside(path: Path, end: str) -> Path:
    return path.with_name(f"{path.name}{end}")


def _pictures(store: Path) -> Path:
    return _beside(store, ".evidence")


def copy_picture(source: Path, target: Path, sha256: str) -> None:
    """Copy the file of one crop, unless it is there; its name is the hash of what it holds."""
    for path in (source / sha256[:2]).glob(f"{sha256}.*"):
        copy = target / sha256[:2] / path.name
        if not copy.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            replace_file(copy, path.read_bytes())


def _need_store(path: Path) -> None:
    if not path.is_file():
        raise StoreError(f"There is no store at {path}: nothing was changed.")


def _refuse_other(file: Path) -> None:
    """Raise where a file is no store, or others use it as one."""
    try:
        with closing(_reading(file)) as database:
            _crops(database, file)
    except StoreError as error:
        raise RefusedError(f"{file} is there and no copy of a store: name another file.") from error
    log = _beside(file, "-wal")
    if log.exists() and log.stat().st_size:
        raise RefusedError(f"{file} is in use as a store ({log.name}): name another file for the copy.")


def _refuse_open(store: Path) -> None:
    """Raise where another process has the store open; else what its log holds is in the store then."""
    if not store.exists():
        return
    with closing(sqlite3.connect(store, timeout=0.0, isolation_level=None)) as database:
        try:
            # Leaving write-ahead mode needs that nobody else has the file open.
            database.execute("PRAGMA journal_mode=DELETE").fetchone()
            database.execute("PRAGMA journal_mode=WAL").fetchone()
        except sqlite3.DatabaseError as error:
            if error.sqlite_errorcode & 0xFF in _BUSY:
                raise RefusedError(
                    f"Another process has the store {store} open: end that first (perhaps `twin review`)."
                ) from error
            # What is damaged is set aside as it is.


def _reading(path: Path) -> sqlite3.Connection:
    """Connect to read only. Where SQLite cannot keep its index beside the file, it is taken as nobody's."""
    address = path.absolute().as_uri()
    database = sqlite3.connect(f"{address}?mode=ro", uri=True)
    try:
        database.execute("SELECT 1 FROM sqlite_master").fetchone()
    except sqlite3.OperationalError as error:
        database.close()
        log = _beside(path, "-wal")
        if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_CANTOPEN or (log.exists() and log.stat().st_size):
            raise _store_error(path, error) from error
        return sqlite3.connect(f"{address}?immutable=1", uri=True)
    except sqlite3.DatabaseError as error:
        database.close()
        raise _store_error(path, error) from error
    return database


def _copy_database(source: Path, target: Path, mode: Literal["DELETE", "WAL"]) -> set[str]:
    """Copy one state of a store, look that it is whole, and return the hashes of its crops.

    With the journal of mode ``DELETE`` the copy is one file also while it is read, on any medium.
    """
    try:
        with closing(_reading(source)) as database, closing(sqlite3.connect(target)) as copy:
            database.backup(copy)
            told = str(copy.execute("PRAGMA integrity_check").fetchone()[0])
            if told != "ok":
                told = told.splitlines()[0]
                raise StoreError(f"The store {source} is damaged ({told}): nothing was changed.")
            copy.execute(f"PRAGMA journal_mode={mode}").fetchone()
            return _crops(copy, source)
    except sqlite3.DatabaseError as error:
        raise _store_error(source, error) from error


def _crops(database: sqlite3.Connection, path: Path) -> set[str]:
    """Return the hashes of a store's crops; a store of an older twin may have none."""
    names = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if "meta" not in names:
        raise StoreError(f"{path} is not a twin store: name another file.")
    if "crop" not in names:
        return set()
    return {sha256 for (sha256,) in database.execute("SELECT DISTINCT sha256 FROM crop")}


def _store_error(path: Path, error: sqlite3.Error) -> StoreError:
    return StoreError(f"The store {path} cannot be copied ({error}): nothing was changed.")


@contextmanager
def _file_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        cure = CURES.get(error.errno or 0, "name another place")
        raise FileError(f"{path} cannot be written ({error.strerror or error}): {cure}.") from error
