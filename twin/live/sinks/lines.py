"""Lines of GeoJSON on a stream, one feature each."""

from __future__ import annotations

from typing import TextIO

from twin.live.estimates import Estimate
from twin.live.ports import Said


class Lines:
    """Writes to a stream, usually standard output.

    Parameters
    ----------
    stream : TextIO
    name : str
    final : bool
        Whether only estimates that are final go there, and nothing else.
    """

    def __init__(self, stream: TextIO, *, name: str = "Standard output", final: bool = False) -> None:
        self._stream, self._name, self._final = stream, name, final

    must_arrive = True

    @property
    def name(self) -> str:
        """Return what it is called."""
        return self._name

    def write(self, said: Said) -> None:
        """Write a line, at once."""
        if self._final and not (isinstance(said, Estimate) and said.lasts):
            return
        self._stream.write(said.line() + "\n")
        self._stream.flush()

    def close(self) -> None:
        """Nothing waits: each line has gone."""
