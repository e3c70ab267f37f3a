"""One process at a time, and a second one is told who holds the lock.

The operating system holds the lock: it ends with its process, however that ends.
"""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from twin.errors import RefusedError
from twin.store.store import utc_now

_LOCKED_BYTE = 1 << 20
"""Far behind the text, so that others can read who holds the lock also where locks are mandatory."""


@contextmanager
def exclusive(path: Path, what: str) -> Iterator[None]:
    """Hold a lock file for the length of the block.

    Parameters
    ----------
    path : Path
        The lock file; it stays behind, empty of meaning.
    what : str
        What this process does, for the message to others: ``sync of twin.db``.

    Raises
    ------
    RefusedError
        Another process holds the lock; the message says which.
    """
    try:
        file = path.open("a+b")
    except OSError as error:
        raise RefusedError(
            f"The lock file {path} cannot be written ({error.strerror}): give this user the right to write "
            "in that folder, or name another --store."
        ) from error
    with file:
        if not try_lock(file):
            file.seek(0)
            holder = file.read(500).decode("utf-8", "replace").strip() or "another process"
            raise RefusedError(f"{holder} is at work: wait until it has ended, then run this again.")
        file.seek(0)
        file.truncate()
        file.write(f"A {what} (process {os.getpid()} on {socket.gethostname()}, since {utc_now()})".encode())
        file.flush()
        try:
            yield
        finally:
            file.truncate(0)
            _unlock(file)


if sys.platform == "win32":  # pragma: no cover
    import msvcrt

    def try_lock(file: BinaryIO) -> bool:
        """Lock an open file for this process, or return False if another one has it."""
        file.seek(_LOCKED_BYTE)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _unlock(file: BinaryIO) -> None:
        file.seek(_LOCKED_BYTE)
        msvcrt.locking(file.fileno(), msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def try_lock(file: BinaryIO) -> bool:
        """Lock an open file for this process, or return False if another one has it."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def _unlock(file: BinaryIO) -> None:
        fcntl.flock(file, fcntl.LOCK_UN)
