"""Lines of GeoJSON on a stream, one feature each."""

from __future__ import annotations

from typing import Protocol

from twin.live.estimates import Estimate
from twin.live.features import line_of
from twin.live.ports import Said


class Unbuffered(Protocol):
    """A stream of bytes that holds nothing back, and no lock while it blocks."""

    def write(self, data: memoryview, /) -> int | None:
        """Write what it takes, and return how much that is."""


class Lines:
    """Writes to a stream, usually standard output.

    Parameters
    ----------
    stream : Unbuffered
        One with a buffer would keep its lock while nobody reads, and the process could not end.
    final : bool
        Whether only estimates that are final go there, and nothing else.
    """

    must_arrive = True

    def __init__(self, stream: Unbuffered, *, final: bool = False) -> None:
        self._stream, self._final = stream, final

    @property
    def name(self) -> str:
        """Return what it is called."""
        return "Standard output"

    def write(self, said: Said) -> None:
        """Write a line, at once."""
        if self._final and not (isinstance(said, Estimate) and said.lasts):
            return
        left = memoryview(f"{line_of(said)}\n".encode())
        while left:
            left = left[self._stream.write(left) or 0 :]

    def close(self) -> None:
        """Nothing waits: each line has gone."""
