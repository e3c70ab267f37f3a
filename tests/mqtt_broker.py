"""An MQTT broker for tests: MQTT 3.1.1, as far as publishers and listeners of one topic need it."""

from __future__ import annotations

import socketserver
import struct
from contextlib import suppress
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Self

_CONNECT, _PUBLISH, _SUBSCRIBE, _PINGREQ, _DISCONNECT = 1, 3, 8, 12, 14


class Broker:
    """Takes what is published, acknowledges it, and hands it to whoever has subscribed to anything.

    Attributes
    ----------
    port : int
    published : list of (topic, payload)
        In the order in which it came, what was sent again left out.
    reads : Event
        While it is not set, nothing that is sent is read.
    """

    def __init__(self, port: int = 0) -> None:
        self.published: list[tuple[str, bytes]] = []
        self.reads = Event()
        self.reads.set()
        self._lock = Lock()
        self._listeners: list[socketserver.StreamRequestHandler] = []
        self._open: list[socketserver.StreamRequestHandler] = []
        broker = self

        class Connection(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                broker._open.append(self)
                with suppress(OSError, struct.error, IndexError):
                    while broker._took(self):
                        broker.reads.wait()

        class Server(socketserver.ThreadingTCPServer):
            allow_reuse_address, daemon_threads = True, True

        self._server = Server(("127.0.0.1", port), Connection)
        self.port = int(self._server.server_address[1])
        Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Hang up on everybody."""
        self.reads.set()
        self._server.shutdown()
        self._server.server_close()
        for one in self._open:
            with suppress(OSError):
                one.connection.shutdown(2)

    def _took(self, one: socketserver.StreamRequestHandler) -> bool:
        """Read one packet and answer it; False at the end."""
        first = one.rfile.read(1)
        if not first:
            return False
        kind, flags = first[0] >> 4, first[0] & 15
        body = one.rfile.read(_length(one))
        if kind == _CONNECT:
            one.wfile.write(b"\x20\x02\x00\x00")
        elif kind == _SUBSCRIBE:
            with self._lock:
                self._listeners.append(one)
            one.wfile.write(b"\x90\x03" + body[:2] + b"\x00")
        elif kind == _PINGREQ:
            one.wfile.write(b"\xd0\x00")
        elif kind == _PUBLISH:
            self._publish(one, body, qos=flags >> 1 & 3, again=bool(flags & 8))
        return kind != _DISCONNECT

    def _publish(self, one: socketserver.StreamRequestHandler, body: bytes, *, qos: int, again: bool) -> None:
        (n,) = struct.unpack(">H", body[:2])
        topic, rest = body[2 : 2 + n], body[2 + n :]
        if qos:
            one.wfile.write(b"\x40\x02" + rest[:2])
            rest = rest[2:]
        with self._lock:
            message = (topic.decode(), rest)
            if not (again and message in self.published):
                self.published.append(message)
            packet = struct.pack(">H", n) + topic + rest
            for listener in self._listeners:
                with suppress(OSError, ValueError):
                    listener.wfile.write(b"\x30" + _written(len(packet)) + packet)


def _length(one: socketserver.StreamRequestHandler) -> int:
    length = shift = 0
    while True:
        (byte,) = one.rfile.read(1)
        length |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return length


def _written(length: int) -> bytes:
    found = bytearray()
    while True:
        length, digit = divmod(length, 128)
        found.append(digit | (128 if length else 0))
        if not length:
            return bytes(found)
