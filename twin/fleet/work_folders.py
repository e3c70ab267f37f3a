"""Folders for fetched drives, which go also where the process that made them was killed."""

from __future__ import annotations

import getpass
import os
import shutil
import tempfile
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import lock_descriptor

from twin.errors import CURES, FileError

_LOCK = ".lock"
_MADE_S = 60.0
"""A younger lock file may be one that its process has made and not locked yet."""


@contextmanager
def work_folder() -> Iterator[Path]:
    """Give an empty folder that is gone after the block, and remove those that killed processes left.

    They stand together in the system's temporary folder (``TMPDIR``), each beside a lock file that its
    process holds: the system lets go of it when the process dies.

    Raises
    ------
    FileError
        The temporary folder cannot be written.
    """
    home = Path(tempfile.gettempdir()) / f"twin-fleet-{getpass.getuser()}"
    folder = home / uuid.uuid4().hex
    try:
        home.mkdir(mode=0o700, exist_ok=True)
        if os.name != "nt" and home.stat().st_uid != os.getuid():
            raise FileError(f"The work folder {home} is another user's: name another place by TMPDIR.")
        _sweep(home)
        lock = folder.with_suffix(_LOCK).open("xb")
        lock_descriptor(lock.fileno(), blocking=False)
        folder.mkdir()
    except OSError as error:
        cure = CURES.get(error.errno or 0, "name another place by TMPDIR")
        raise FileError(f"The work folder {home} cannot be written ({error.strerror}): {cure}.") from error
    with lock:
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            folder.with_suffix(_LOCK).unlink(missing_ok=True)


def _sweep(home: Path) -> None:
    """Remove folders whose processes are gone."""
    for path in home.glob(f"*{_LOCK}"):
        # Removed by its own process meanwhile, or by another sweeper.
        with suppress(OSError), path.open("rb") as lock:
            is_old = time.time() - path.stat().st_mtime > _MADE_S
            if is_old and lock_descriptor(lock.fileno(), blocking=False):
                shutil.rmtree(path.with_suffix(""), ignore_errors=True)
                path.unlink()
