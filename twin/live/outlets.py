"""A sink behind a thread and a bounded queue of its own: if it blocks, lines are lost, not memory or time."""

from __future__ import annotations

import logging
import time
from threading import Thread

from twin.live.car_state import SinkState
from twin.live.lanes import Unsaid
from twin.live.ports import Said, Sink

_MOST = 2000
BLOCKED_S = 1.0
"""A sink that takes so long for a line is blocked."""
_log = logging.getLogger("twin.live")


class Outlet:
    """One sink.

    Parameters
    ----------
    sink : Sink
    waits : bool
        Whether whoever says something waits where the queue is full, and all lines keep their order: of a
        recorded drive no line is lost that must arrive.
    most : int
        Lines that wait for it at most.
    """

    def __init__(self, sink: Sink, *, waits: bool = False, most: int = _MOST) -> None:
        self.sink, self._waits = sink, waits and sink.must_arrive
        self.error: Exception | None = None
        self._lines = Unsaid(most, overtakes=not self._waits)
        self._since_s = 0.0
        self._lost = 0
        self._thread = Thread(target=self._write_all, name=f"sink {sink.name}", daemon=True)
        self._thread.start()

    @property
    def state(self) -> SinkState:
        """How it does now."""
        since_s = self._since_s
        blocked = not self._waits and since_s > 0.0 and time.monotonic() - since_s > BLOCKED_S
        lost = sum(self._lines.lost) + self._lost
        return SinkState(self.sink.name, blocked, lost, self.error is not None)

    def say(self, said: Said) -> None:
        """Take a line; what it replaces and has not gone yet need not go."""
        if self.error is None:
            self._lines.say(said, waits=self._waits)

    @property
    def waits(self) -> bool:
        """Whether it is waited for."""
        return self._waits

    def hurry(self) -> None:
        """Wait for the sink no more."""
        self._waits = False
        self._lines.hurry()

    def close(self, within_s: float | None) -> None:
        """Let what waits go, for so long (None: as it takes); what has not gone then counts as lost."""
        self._lines.close()
        self._thread.join(within_s)
        if self._thread.is_alive():
            self._lost += len(self._lines)
            self._lines.close(forget=True)

    def _write_all(self) -> None:
        try:
            while (said := self._lines.get()) is not None:
                self._since_s = time.monotonic()
                self.sink.write(said)
                self._since_s = 0.0
            self.sink.close()
        except Exception as error:
            # Whatever a sink dies of, the drive goes on without it, and says so.
            _log.warning("%s: %s", self.sink.name, error)
            self.error = error
            self._lines.close(forget=True)
