"""Ways by which bytes come: each is opened, read with a short patience and closed, by one thread."""

from __future__ import annotations

import os
import select
import selectors
import socket
import time
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, Queue
from threading import Event, Thread
from typing import NamedTuple, Protocol

_CHUNK = 65_536
_CONNECT_S, _LOOK_S = 5.0, 0.1
_MOST_SENDERS = 32
_ONLY = 0


class Piece(NamedTuple):
    """Bytes of one sender; none where it has left."""

    sender: int
    data: bytes


class Connection(Protocol):
    """An open link."""

    def read(self, patience_s: float) -> list[Piece]:
        """Return what has come; empty if nothing has for so long.

        Raises
        ------
        OSError, EOFError
            If it has ended.
        """

    def close(self) -> None:
        """Close it."""


class Link(Protocol):
    """A way by which bytes come."""

    @property
    def ends(self) -> bool:
        """Whether its end is the end: standard input, which nobody opens again."""

    @property
    def asks_again(self) -> bool:
        """Whether it is opened anew where nothing comes for long: a connection whose other end has died."""

    def open(self, stopped: Event, /) -> Connection:
        """Open it.

        Raises
        ------
        OSError
            If that cannot be now.
        """


@dataclass(frozen=True, slots=True)
class TcpLink:
    """A connection to a host, which may be greeted."""

    host: str
    port: int
    greeting: bytes = b""
    ends: bool = False
    asks_again: bool = True

    def open(self, stopped: Event) -> Connection:
        """Connect, for at most five seconds to each address of the host."""
        failure: OSError = ConnectionError("no address")
        for family, kind, protocol, _, place in socket.getaddrinfo(
            self.host, self.port, type=socket.SOCK_STREAM
        ):
            one = socket.socket(family, kind, protocol)
            try:
                _connect(one, place, stopped)
                one.sendall(self.greeting)
            except OSError as error:
                one.close()
                failure = error
            else:
                return _Stream(one)
        raise failure


def _connect(one: socket.socket, place: tuple[object, ...], stopped: Event) -> None:
    """Connect in short steps, so that whoever closes the source does not wait."""
    one.setblocking(False)
    until_s = time.monotonic() + _CONNECT_S
    with suppress(BlockingIOError):
        one.connect(place)
    while not select.select([], [one], [one], _LOOK_S)[1]:
        if stopped.is_set() or time.monotonic() > until_s:
            raise TimeoutError("no answer")
    if code := one.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
        raise OSError(code, os.strerror(code))
    one.setblocking(True)


@dataclass(frozen=True, slots=True)
class _Stream:
    socket: socket.socket

    def read(self, patience_s: float) -> list[Piece]:
        if not select.select([self.socket], [], [], patience_s)[0]:
            return []
        data = self.socket.recv(_CHUNK)
        if not data:
            raise EOFError
        return [Piece(_ONLY, data)]

    def close(self) -> None:
        self.socket.close()


@dataclass(frozen=True, slots=True)
class ListeningLink:
    """A port of this machine to which others connect, several at once."""

    host: str
    port: int
    ends: bool = False
    asks_again: bool = False

    def open(self, _stopped: Event) -> Connection:
        """Listen."""
        listener = socket.create_server((self.host, self.port), backlog=_MOST_SENDERS)
        listener.setblocking(False)
        return _Listening(listener)


class _Listening:
    def __init__(self, listener: socket.socket) -> None:
        self._selector = selectors.DefaultSelector()
        self._listener, self._senders = listener, dict[socket.socket, int]()
        self._count = 0
        self._selector.register(listener, selectors.EVENT_READ)

    def read(self, patience_s: float) -> list[Piece]:
        ready = [key.fileobj for key, _ in self._selector.select(patience_s)]
        left = self._accept() if self._listener in ready else []
        return left + [
            Piece(self._senders[one], self._read(one)) for one in list(self._senders) if one in ready
        ]

    def _read(self, one: socket.socket) -> bytes:
        try:
            data = one.recv(_CHUNK)
        except OSError:
            data = b""
        if not data:
            self._leave(one)
        return data

    def close(self) -> None:
        for one in list(self._senders):
            self._leave(one)
        self._listener.close()
        self._selector.close()

    def _leave(self, one: socket.socket) -> None:
        self._selector.unregister(one)
        del self._senders[one]
        one.close()

    def _accept(self) -> list[Piece]:
        """Take a sender; where there are too many, the first, which may have died without a word, leaves."""
        try:
            one, _ = self._listener.accept()
        except OSError:
            return []  # it has left already
        left = []
        if len(self._senders) >= _MOST_SENDERS:
            first = next(iter(self._senders))
            left.append(Piece(self._senders[first], b""))
            self._leave(first)
        one.setblocking(False)
        self._count += 1
        self._senders[one] = self._count
        self._selector.register(one, selectors.EVENT_READ)
        return left


@dataclass(frozen=True, slots=True)
class UdpLink:
    """A port of this machine to which others send; `lines`: a datagram holds whole ones."""

    host: str
    port: int
    lines: bool = True
    ends: bool = False
    asks_again: bool = False

    def open(self, _stopped: Event) -> Connection:
        """Take the port."""
        one = socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET, socket.SOCK_DGRAM)
        try:
            one.bind((self.host, self.port))
        except OSError:
            one.close()
            raise
        return _Datagrams(one, self.lines)


@dataclass(frozen=True, slots=True)
class _Datagrams:
    socket: socket.socket
    lines: bool

    def read(self, patience_s: float) -> list[Piece]:
        if not select.select([self.socket], [], [], patience_s)[0]:
            return []
        data = self.socket.recv(_CHUNK)
        return [Piece(_ONLY, data + b"\n" if self.lines and not data.endswith(b"\n") else data)]

    def close(self) -> None:
        self.socket.close()


@dataclass(frozen=True, slots=True)
class StdinLink:
    """Standard input, or another open file of the process."""

    descriptor: int = 0
    ends: bool = True
    asks_again: bool = False

    def open(self, _stopped: Event) -> Connection:
        """Begin to read."""
        return _Pumped(self.descriptor)


class _Pumped:
    """Read by a thread: no system lets one wait for a pipe, a file and a terminal alike."""

    _MOST_WAITING = 64

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: Queue[bytes] = Queue(self._MOST_WAITING)
        Thread(target=self._pump, name="standard input", daemon=True).start()

    def read(self, patience_s: float) -> list[Piece]:
        try:
            data = self._waiting.get(timeout=patience_s)
        except Empty:
            return []
        if not data:
            raise EOFError
        return [Piece(_ONLY, data)]

    def close(self) -> None:
        """Leave it: the thread ends with the process."""

    def _pump(self) -> None:
        with suppress(OSError):
            while data := os.read(self._descriptor, _CHUNK):
                self._waiting.put(data)
        self._waiting.put(b"")
