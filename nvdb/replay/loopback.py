"""What the replay servers share: a server on loopback that runs as long as its ``with`` block."""

from __future__ import annotations

import logging
import os
import socketserver
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler
from types import TracebackType
from typing import Any, Self, TypeVar

from nvdb.errors import NvdbError, ReplaySourceError

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Answer:
    """What goes back over the wire."""

    status: int
    body: bytes
    content_type: str = "application/json"
    headers: Mapping[str, str] = field(default_factory=dict)


class LoopbackServer(socketserver.ThreadingTCPServer):
    """TCPServer and not HTTPServer, which asks the name service for its own name before it starts."""

    # On Windows the same option would let two servers share one port.
    allow_reuse_address = os.name == "posix"
    daemon_threads = False  # threads are joined on closing, so that no socket outlives the server

    def stop(self) -> None:
        """Stop accepting, wait for the threads."""
        self.shutdown()
        self.server_close()


class LoopbackHandler(BaseHTTPRequestHandler):
    """One connection."""

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 (signature of the base)
        """Log instead of writing to stderr."""
        log.debug("%s " + format, self.address_string(), *args)

    def send_answer(self, answer: Answer) -> None:
        """Send an answer with its headers."""
        self.send_response(answer.status)
        self.send_header("Content-Type", answer.content_type)
        self.send_header("Content-Length", str(len(answer.body)))
        for name, value in answer.headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(answer.body)


class Loopback(ABC):
    """A server's thread, started and ended by a ``with`` block."""

    _host = "127.0.0.1"
    _server: LoopbackServer | None = None
    _thread: threading.Thread | None = None

    @abstractmethod
    def _make_server(self) -> LoopbackServer:
        """Bind the address; from here on connections wait."""

    @property
    def url(self) -> str:
        """Base URL, ``http://127.0.0.1:43211``; only while the server runs."""
        if self._server is None:
            msg = "The replay server is not running: use it in a with block."
            raise ReplaySourceError(msg)
        return f"http://{self._host}:{self._server.server_address[1]}"

    def __enter__(self) -> Self:
        self._server = self._make_server()
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._server is not None and self._thread is not None:
            self._server.stop()
            self._thread.join()
        self._server = self._thread = None


LoopbackT = TypeVar("LoopbackT", bound=Loopback)


def serve_until_interrupted(make: Callable[[], LoopbackT], greeting: Callable[[LoopbackT], str]) -> int:
    """Serve until Ctrl-C, and return the exit code: 4 where there is nothing to serve or no port.

    Parameters
    ----------
    make : callable
        Makes the server.
    greeting : callable
        What stands on stdout when requests wait to be answered.
    """
    try:
        # Ctrl-C may come at any moment once the address is out, so it is not the wait alone that expects it.
        with suppress(KeyboardInterrupt), make() as server:
            sys.stdout.write(f"{greeting(server)}; Ctrl-C ends it.\n")
            sys.stdout.flush()
            threading.Event().wait()
    except NvdbError as error:
        sys.stderr.write(f"{error}\n")
        return 4
    return 0
