"""Receivers and detectors of a car, for tests: what they send, over real sockets, and who listens."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import reduce
from threading import Event, Thread
from types import TracebackType
from typing import Any, Self, TypeVar

from twin.drives.drive import Drive
from twin.drives.frames.stamp_files import NO_STAMP
from twin.live.car import Car
from twin.live.events import Arrival, Fix, Frame
from twin.live.ports import Source, Trouble, TroubleKind

T = TypeVar("T")
MakeCar = Callable[..., Car]
WIDE, ROOF = "C3_tricam120", "gnss50:vehicle"
"""A camera and an antenna of the sample's car."""
PATIENCE_S = 30.0


class Listener:
    """Everything that a source gives, read by a thread of its own.

    Attributes
    ----------
    got : list of Arrival or Trouble
    """

    def __init__(self, source: Source) -> None:
        self.got: list[Arrival | Trouble] = []
        self.source = source
        self._thread = Thread(target=self._listen, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.source.close()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()

    def _listen(self) -> None:
        for one in self.source.arrivals():
            self.got.append(one)

    def ended(self) -> bool:
        """Whether it gives nothing more."""
        return not self._thread.is_alive()

    def fixes(self) -> list[Fix]:
        """Those that have arrived."""
        arrivals = [one for one in list(self.got) if isinstance(one, Arrival)]
        return [one.what for one in arrivals if isinstance(one.what, Fix)]

    def frames(self) -> list[Frame]:
        """Those that have arrived."""
        return [
            one.what for one in list(self.got) if isinstance(one, Arrival) and isinstance(one.what, Frame)
        ]

    def troubles(self, *kinds: TroubleKind) -> list[Trouble]:
        """Those of some kinds, or all."""
        troubles = [one for one in list(self.got) if isinstance(one, Trouble)]
        return [one for one in troubles if not kinds or one.kind in kinds]


def until(holds: Callable[[], T]) -> T:
    """Wait until something is true, and return it."""
    end_s = time.monotonic() + PATIENCE_S
    while not (found := holds()):
        assert time.monotonic() < end_s, "this never came"
        time.sleep(0.01)
    return found


class Sender:
    """A port of this machine that sends what it is given to whoever connects.

    Attributes
    ----------
    port : int
    heard : bytes
        What was sent to it.
    """

    def __init__(self, port: int = 0) -> None:
        self.heard = b""
        self._server = socket.create_server(("127.0.0.1", port))
        self._server.settimeout(PATIENCE_S)
        self.port = int(self._server.getsockname()[1])
        self._client: socket.socket | None = None
        self._connected = Event()
        Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.hang_up()
        self._server.close()

    def send(self, data: bytes) -> None:
        """Send, once somebody listens."""
        assert self._connected.wait(PATIENCE_S)
        assert self._client is not None
        self._client.sendall(data)

    def hang_up(self) -> None:
        """End the connection."""
        if self._client is not None:
            with suppress(OSError):
                self._client.shutdown(socket.SHUT_RDWR)
            self._client.close()

    def _accept(self) -> None:
        with suppress(OSError):
            self._client, _ = self._server.accept()
            self._connected.set()
            while data := self._client.recv(4096):
                self.heard += data


@contextmanager
def connected(port: int) -> Iterator[socket.socket]:
    """Connect to a source that listens, as soon as it does."""

    def one() -> socket.socket | None:
        with suppress(ConnectionRefusedError):
            return socket.create_connection(("127.0.0.1", port))
        return None

    with until(one) as client:
        yield client


def free_port() -> int:
    """A port that nobody has taken a moment ago."""
    with socket.create_server(("127.0.0.1", 0)) as one:
        return int(one.getsockname()[1])


def sentence(body: str) -> bytes:
    """Put dollar, checksum and end around a sentence."""
    checksum = reduce(lambda total, char: total ^ ord(char), body, 0)
    return f"${body}*{checksum:02X}\r\n".encode()


def frame_lines(drive: Drive) -> Iterator[bytes]:
    """What was annotated in a drive, as a detector sends it: feet, a line a frame, in order of time."""
    notes = drive.annotations
    found: dict[tuple[str, int], list[dict[str, Any]]] = {}
    columns = (notes.camera, notes.frame, notes.pixel_px, notes.object, notes.label, notes.skiltnummer)
    for camera, frame, (u, v), name, label, codes in zip(*(one.tolist() for one in columns), strict=True):
        seen = {"foot": [u + 0.5, v + 0.5], "object": name, "label": label, "skiltnummer": codes}
        found.setdefault((camera, frame), []).append(seen)
    stamps = [
        (stamp_ns, camera, frame)
        for camera in sorted(set(notes.camera.tolist()))
        for frame, stamp_ns in enumerate(drive.frame_epoch_ns[camera].tolist())
        if stamp_ns != NO_STAMP
    ]
    for stamp_ns, camera, frame in sorted(stamps):
        line = {"camera": camera, "frame": frame, "stamp_ns": stamp_ns}
        yield json.dumps(line | {"detections": found.get((camera, frame), [])}).encode() + b"\n"
