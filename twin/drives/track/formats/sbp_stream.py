"""SwiftNav SBP as a receiver sends it → fixes, by what :mod:`twin.drives.track.formats.sbp` knows of it."""

from __future__ import annotations

from twin.drives.track.fixes import Fix
from twin.drives.track.formats.nmea import MOST_WAITING
from twin.drives.track.formats.sbp import ANTENNA_FIRST, Log, rows_of, said_of
from twin.drives.track.formats.sbp_messages import MessageStream


class SbpStream:
    """Bytes as a receiver sends them → fixes of its antenna, each as soon as its epoch is complete.

    Of the four kinds of positions the first of `ANTENNA_FIRST` that has come is read, of the sender that it
    came from first.
    """

    def __init__(self) -> None:
        self._messages, self._log = MessageStream(), Log()
        self._tow_ms: float | None = None
        self._waiting = 0
        self._from: tuple[int, int] | None = None

    @property
    def readable(self) -> int:
        """Frames so far."""
        return self._messages.readable

    @property
    def unreadable(self) -> int:
        """Stretches of bytes that are no frame."""
        return self._messages.unreadable

    def feed(self, data: bytes) -> list[Fix]:
        """Take what has come."""
        fixes: list[Fix] = []
        for message in self._messages.feed(data):
            tow_ms = message.field["tow"]
            if tow_ms != self._tow_ms or self._waiting >= MOST_WAITING:
                fixes += self.pause()
                self._tow_ms = tow_ms
            self._log.take(message)
            self._waiting += 1
        return fixes

    def pause(self) -> list[Fix]:
        """Return what waits: nothing more has come for a moment."""
        log, clock, rows = self._log, self._log.clock(), list[Fix]()
        for kind, by_sender in log.positions.items():
            for sender in by_sender:
                if self._from is None or ANTENNA_FIRST.index(kind) < ANTENNA_FIRST.index(self._from[0]):
                    self._from = kind, sender
        if self._from is not None and clock is not None:
            kind, sender = self._from
            positions = log.positions[kind].get(sender, [])
            rows = rows_of(positions, said_of(log.motions.get(sender), kind), clock, log.faults)
        log.forget()
        self._waiting = 0
        return rows
