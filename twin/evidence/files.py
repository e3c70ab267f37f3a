"""The files of crops: in one folder, each under the SHA-256 of its content, written before its row.

A file without a row is what a killed run left: the next run deletes it. A row without a file cannot come
about: rows are deleted before files, and written after them.
"""

from __future__ import annotations

import hashlib
import re
from contextlib import suppress
from pathlib import Path

import sqlalchemy as sa

from twin.errors import ConfigError
from twin.store import schema
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder
from twin.store.store import Store

SUFFIX = ".webp"
TASK = "evidence", "work on the crops"
"""What :meth:`Store.alone` locks where files are written or deleted."""
_SHA256 = re.compile(r"[0-9a-f]{64}")


def crop_file(store: Store, sha256: str) -> Path:
    """Return the file of a crop.

    Raises
    ------
    ConfigError
        No crop of the store has this hash.
    """
    if not _SHA256.fullmatch(sha256) or not _is_kept(store, sha256):
        raise ConfigError(f"The store {store.name} has no crop {sha256[:64]!r}.")
    return _path(store.pictures, sha256)


def write_crop(folder: Path, content: bytes) -> tuple[str, bool]:
    """Keep one file; its hash, and whether it is new.

    Raises
    ------
    RefusedError
        It cannot be written.
    """
    sha256 = hashlib.sha256(content).hexdigest()
    path = _path(folder, sha256)
    if path.is_file() and path.stat().st_size == len(content):
        return sha256, False
    make_folder(path.parent)
    replace_file(path, content)
    return sha256, True


def sweep(store: Store) -> int:
    """Delete every file that no row names, and return how many there were; only while `TASK` is locked."""
    folder, n_deleted = store.pictures, 0
    if not folder.is_dir():
        return 0
    kept = {row["sha256"] for row in store.rows(sa.select(schema.crop.c.sha256).distinct())}
    for path in sorted(folder.glob("*/*")):
        if path.stem not in kept and path.is_file():
            path.unlink()
            n_deleted += 1
    with suppress(OSError):  # folders that still hold something
        for part in folder.iterdir():
            if not any(part.iterdir()):
                part.rmdir()
        folder.rmdir()
    return n_deleted


def _path(folder: Path, sha256: str) -> Path:
    return folder / sha256[:2] / f"{sha256}{SUFFIX}"


def _is_kept(store: Store, sha256: str) -> bool:
    return bool(store.rows(sa.select(schema.crop.c.sha256).where(schema.crop.c.sha256 == sha256).limit(1)))
