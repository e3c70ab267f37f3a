"""The source of a link: opened again where it is lost, and every trouble said once."""

from __future__ import annotations

import errno
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from threading import Event

from geoloc.live.samples import Fix
from twin.live.events import Arrival, Frame
from twin.live.ports import Trouble, TroubleKind
from twin.live.sources.decoders import Decoder
from twin.live.sources.epochs import Epochs
from twin.live.sources.links import Connection, Link

PAUSE_S = 0.05
"""What a receiver says of one epoch comes without a gap of this length."""
SILENT_S = 5.0
"""After so long without a line that can be read a source is lost."""
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 10.0
_TOLD_EVERY_S = 1.0


class StreamSource:
    """What comes over a link.

    Parameters
    ----------
    name : str
        Of its address, without a password.
    link : Link
    decoder : callable
        Makes the decoder of one sender.
    """

    def __init__(self, name: str, link: Link, decoder: Callable[[], Decoder]) -> None:
        self._name, self._link, self._decoder = name, link, decoder
        self._stopped, self._epochs = Event(), Epochs(name)
        self._is_lost = False
        self._heard_s = 0.0

    @property
    def name(self) -> str:
        """Return its address, without a password."""
        return self._name

    def close(self) -> None:
        """End `arrivals`, from another thread."""
        self._stopped.set()

    def arrivals(self) -> Iterator[Arrival | Trouble]:
        """Yield what arrives, and what goes wrong; return when it was closed, or standard input has ended."""
        wait_s = _FIRST_WAIT_S
        while not self._stopped.is_set():
            try:
                connection = self._link.open(self._stopped)
            except (OSError, ValueError) as error:  # a host's name that is none
                yield from self._lost(_reason(error))
            else:
                began_s = self._heard_s = time.monotonic()
                with closing(connection):
                    yield from self._read(connection)
                if self._link.ends:
                    return
                if self._heard_s > began_s:
                    wait_s = _FIRST_WAIT_S
            self._stopped.wait(wait_s)
            wait_s = min(2.0 * wait_s, _LONGEST_WAIT_S)

    def _read(self, connection: Connection) -> Iterator[Arrival | Trouble]:
        """Yield what arrives until the link is lost, or silent, or was closed."""
        decoders: defaultdict[int, Decoder] = defaultdict(self._decoder)
        garbage = _Garbage(self._name)
        while not self._stopped.is_set():
            try:
                pieces = connection.read(PAUSE_S)
            except (OSError, EOFError) as error:
                yield from self._arrived(decoder.pause() for decoder in decoders.values())
                yield from garbage.rest(decoders.values())
                yield from self._gone(error)
                return
            at_ns = time.time_ns()
            readable = sum(decoder.readable for decoder in decoders.values())
            for sender, data in pieces:
                decoder = decoders[sender]
                yield from self._arrived([decoder.feed(data, at_ns) if data else decoder.pause()], at_ns)
            if not pieces:
                yield from self._arrived(decoder.pause() for decoder in decoders.values())
            if sum(decoder.readable for decoder in decoders.values()) > readable:
                yield from self._heard()
            yield from garbage.now(decoders.values())
            for sender, data in pieces:
                if not data:
                    garbage.forget(decoders.pop(sender))
            if time.monotonic() - self._heard_s > SILENT_S:
                yield from self._lost(f"nothing that can be read has come for {SILENT_S:g} s")
                if self._link.asks_again:
                    return

    def _arrived(
        self, found: Iterable[Iterable[Fix | Frame]], at_ns: int | None = None
    ) -> Iterator[Arrival | Trouble]:
        at_ns = time.time_ns() if at_ns is None else at_ns
        for each in found:
            for what in each:
                yield from self._epochs.checked(Arrival(at_ns, what))

    def _heard(self) -> Iterator[Trouble]:
        self._heard_s = time.monotonic()
        if self._is_lost:
            self._is_lost = False
            yield Trouble(time.time_ns(), self._name, TroubleKind.BACK)

    def _gone(self, error: OSError | EOFError) -> Iterator[Trouble]:
        if self._link.ends:
            yield Trouble(time.time_ns(), self._name, TroubleKind.ENDED, detail="Standard input")
        else:
            yield from self._lost(_reason(error))

    def _lost(self, why: str) -> Iterator[Trouble]:
        if not self._is_lost and not self._stopped.is_set():
            self._is_lost = True
            yield Trouble(time.time_ns(), self._name, TroubleKind.LOST, detail=why)


class _Garbage:
    """Counts what cannot be read or is not the car's, and tells it once a second.

    The first line of a sender may be the rest of one that began before twin listened.
    """

    def __init__(self, name: str) -> None:
        self._name, self._told_s = name, -_TOLD_EVERY_S
        self._told: dict[int, int] = {}
        self._count, self._why = 0, ""
        self._refused: Counter[str] = Counter()
        self._told_refused: dict[int, Counter[str]] = {}

    def now(self, decoders: Iterable[Decoder]) -> Iterator[Trouble]:
        """Tell what has come since the last time, at most once a second."""
        for decoder in decoders:
            before = self._told.get(id(decoder), 1)
            if decoder.unreadable > before:
                self._count += decoder.unreadable - before
                self._why = decoder.why
                self._told[id(decoder)] = decoder.unreadable
            if decoder.refused:
                told = self._told_refused.setdefault(id(decoder), Counter())
                self._refused += Counter(decoder.refused) - told
                told.update(Counter(decoder.refused) - told)
        if (self._count or self._refused) and time.monotonic() - self._told_s >= _TOLD_EVERY_S:
            yield from self._tell()

    def rest(self, decoders: Iterable[Decoder]) -> Iterator[Trouble]:
        """Tell what has not been told."""
        yield from self.now(decoders)
        if self._count or self._refused:
            yield from self._tell()

    def forget(self, decoder: Decoder) -> None:
        """Forget a sender that has left."""
        self._told.pop(id(decoder), None)
        self._told_refused.pop(id(decoder), None)

    def _tell(self) -> Iterator[Trouble]:
        if self._count:
            yield Trouble(time.time_ns(), self._name, TroubleKind.GARBAGE, self._count, self._why)
        for why, count in self._refused.items():
            yield Trouble(time.time_ns(), self._name, TroubleKind.REFUSED, count, why)
        self._refused.clear()
        self._count, self._told_s = 0, time.monotonic()


def _reason(error: OSError | EOFError | ValueError) -> str:
    """Why a link was lost; never the address, which may hold a password."""
    if isinstance(error, EOFError):
        return "the other end has hung up"
    if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
        return "another program has this port: end it, or name another port"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) if isinstance(error, ConnectionError | TimeoutError) else type(error).__name__
