"""The process's three streams, whatever they are: closed, a pipe that nobody reads any more, a full disk.

A closed one counts as ``/dev/null``, as in Git: nobody wants to hear. What cannot be written to standard
output ends the command. What cannot be written to standard error does not: progress and messages are lost,
the work is not.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Any, TextIO

# Of a pipe without a reader; Windows says EINVAL.
_NO_READER = (errno.EPIPE, errno.EINVAL) if sys.platform == "win32" else (errno.EPIPE,)


class OutputError(Exception):
    """Standard output cannot be written.

    Not an ``OSError``: libraries take those for their own and end the process.

    Attributes
    ----------
    nobody_reads : bool
        A pipe whose reader has left: it has what it wanted.
    """

    def __init__(self, error: OSError) -> None:
        super().__init__(
            f"Standard output cannot be written ({error.strerror or error}): free space on the disk that it "
            "goes to, or send it elsewhere. What was done so far is kept; only its report is lost."
        )
        self.nobody_reads = error.errno in _NO_READER


class _Watched(io.RawIOBase):
    """A stream that takes what its descriptor does not, once it has failed."""

    def __init__(self, raw: io.RawIOBase, *, must_arrive: bool) -> None:
        self._raw = raw
        self._must_arrive = must_arrive
        self._failed = False

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._raw.fileno()

    def isatty(self) -> bool:
        return self._raw.isatty()

    def write(self, data: Any, /) -> int | None:
        if not self._failed:
            try:
                return self._raw.write(data)
            except OSError as error:
                # What is left in buffers is written again when Python ends: into nothing.
                self._failed = True
                if self._must_arrive:
                    raise OutputError(error) from error
        return memoryview(data).nbytes


def watch_streams() -> None:
    """Open what is closed, and let `OutputError` tell of a standard output that cannot be written."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            # The lowest that is free is taken. Left free, it would be that of some file, to be printed into.
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _watched(sys.stdout, 1, must_arrive=True)
    sys.stderr = _watched(sys.stderr, 2, must_arrive=False)


def _watched(stream: TextIO | None, descriptor: int, *, must_arrive: bool) -> TextIO:
    if stream is None:
        raw: Any = io.FileIO(descriptor, "w", closefd=False)
    else:
        # Unbuffered (python -u) there is no raw stream below.
        raw = getattr(stream.buffer, "raw", stream.buffer)
    # A pipe on Windows is not UTF-8 by itself, and sign texts are Norwegian.
    return io.TextIOWrapper(
        io.BufferedWriter(_Watched(raw, must_arrive=must_arrive)),
        encoding="utf-8",
        errors="replace",
        line_buffering=descriptor == 2 or raw.isatty(),
    )


def unbuffered_output() -> Any:
    """Return what standard output writes its bytes to, for who must not wait for a lock of its buffer."""
    sys.stdout.flush()
    return getattr(sys.stdout.buffer, "raw", sys.stdout.buffer)
