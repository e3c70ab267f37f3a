"""One process at a time, and a second one is told who holds the lock.

The operating system holds the lock: it ends with its process, however that ends.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import lock_descriptor

from twin.errors import FileError, RefusedError
from twin.store.clock import utc_now

_HOLDER_BYTE = 1
"""Where it says who holds the lock: the first byte, which is what Windows locks, nobody else can read."""


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
    FileError
        The lock file cannot be written.
    """
    try:
        file = path.open("a+b", buffering=0)
    except OSError as error:
        raise FileError(_unwritable(path, error)) from error
    with file:
        try:
            is_ours = lock_descriptor(file.fileno(), blocking=False)
        except OSError as error:
            raise RefusedError(
                f"The lock file {path} cannot be locked ({error.strerror}): name a --store on another disk."
            ) from error
        file.seek(_HOLDER_BYTE)
        if not is_ours:
            holder = file.read(500).decode("utf-8", "replace").strip() or "another process"
            raise RefusedError(f"{holder} is at work: wait until it has ended, then run this again.")
        holder = f"A {what} (process {os.getpid()} on {socket.gethostname()}, since {utc_now()})"
        try:
            file.truncate(0)
            file.write(b"\n" + holder.encode())
        except OSError as error:
            raise FileError(
                f"The lock file {path} cannot be written ({error.strerror}): free space on the disk that the "
                "store is on."
            ) from error
        try:
            yield
        finally:
            file.truncate(0)


def _unwritable(path: Path, error: OSError) -> str:
    """Say which: the file, which another user has made (root, by hand), or its folder."""
    try:
        owner = path.owner()
    except (OSError, KeyError, NotImplementedError):  # none there; a number without a name; Windows
        cure = "give this user the right to write in that folder, or name another --store"
    else:
        cure = f"it belongs to {owner}; run this as {owner}, or give the file to this user (chown)"
    return f"The lock file {path} cannot be written ({error.strerror}): {cure}."
