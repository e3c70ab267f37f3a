"""A local server that answers as API Les V4, Uberiket V1 and the datakatalog do.

For the demo, for tests, and for trying things out.

>>> with ReplayServer("recorded_pages") as server:              # doctest: +SKIP
...     client = NvdbClient(server.url)

or ``python -m nvdb.replay recorded_pages --port 8096``.
"""

from __future__ import annotations

import argparse
import logging
import socket
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qsl, urlsplit

from nvdb.datakatalog.katalog import Datakatalog
from nvdb.errors import ReplaySourceError
from nvdb.replay.faults import LOOP_PATH, OF_CONTENT, FaultPlan, Faults, RequestInfo, send_fault
from nvdb.replay.loopback import (
    Answer,
    Loopback,
    LoopbackHandler,
    LoopbackServer,
    serve_until_interrupted,
)
from nvdb.replay.pages import Generated, ReplaySource
from nvdb.replay.routes import Routes, json_answer
from nvdb.replay.world import ReplayWorld

log = logging.getLogger(__name__)

NO_CLIENT: Final = "X-Client må være satt når du kaller API Les V4."
RATE_LIMIT: Final = 200


class ReplayServer(Loopback):
    """Serve recorded or generated objects on loopback until the ``with`` block ends.

    Parameters
    ----------
    source : Path, str, mapping or ReplaySource
        A folder of recorded pages (``*.json``, ``*.ndjson``, also ``.gz``), type → objects in V4's form, or
        a :class:`~nvdb.replay.world.ReplayWorld` that changes while it is served.
    host : str
    port : int
        0 takes a free one.
    faults : iterable or callable, optional
        See :class:`nvdb.replay.faults.FaultPlan`.
    katalog : Datakatalog, optional
        What the datakatalog's addresses say; the shipped snapshot if omitted.

    Raises
    ------
    ReplaySourceError
        Nothing to serve, or the port is taken.
    """

    def __init__(
        self,
        source: Path | str | Generated | ReplaySource,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        faults: Faults | None = None,
        katalog: Datakatalog | None = None,
    ) -> None:
        self._source = source if isinstance(source, ReplaySource) else ReplaySource(source)
        self.routes = Routes(self._source, katalog)
        """What is served; its ``katalog`` may be replaced while the server runs."""
        self._host = host
        self._port = port
        self._plan = FaultPlan(faults)
        self.requests: list[RequestInfo] = []
        """Every request so far, in order of arrival."""

    @property
    def counts(self) -> dict[int, int]:
        """How many objects of each type are served."""
        return self._source.counts()

    def _make_server(self) -> LoopbackServer:
        try:
            return _Server((self._host, self._port), self.routes, self._plan, self.requests)
        except (OSError, OverflowError) as error:
            msg = f"Port {self._port} on {self._host} cannot be used ({error}): take another one, or 0."
            raise ReplaySourceError(msg) from error


class _Server(LoopbackServer):
    """Notes the requests, and plans their faults."""

    request_queue_size = 32

    def __init__(
        self, address: tuple[str, int], routes: Routes, plan: FaultPlan, requests: list[RequestInfo]
    ) -> None:
        self.routes = routes
        self.plan = plan
        self.requests = requests
        self.stopping = threading.Event()
        self._lock = threading.Lock()
        self._open: set[socket.socket] = set()
        super().__init__(address, _Handler)

    def note(self, path: str, query: Mapping[str, str], headers: Mapping[str, str]) -> RequestInfo:
        """Enter a request into the list."""
        with self._lock:
            info = RequestInfo(len(self.requests), path, query, headers)
            self.requests.append(info)
        return info

    def stop(self) -> None:
        """Stop accepting, end the connections that clients keep open, wait for the threads."""
        self.stopping.set()
        self.shutdown()
        with self._lock:
            waiting = list(self._open)
        for connection in waiting:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start a thread for a connection."""
        with self._lock:
            self._open.add(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """End a connection."""
        with self._lock:
            self._open.discard(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002 (signature of the base)
        """A client that has gone is no news; anything else is a fault of this server."""
        if not isinstance(sys.exception(), ConnectionError):
            log.exception("the replay server failed to answer a request")


class _Handler(LoopbackHandler):
    """One connection."""

    protocol_version = "HTTP/1.1"
    server_version = "nvdb-replay"
    sys_version = ""
    wbufsize = -1  # headers and body leave in one piece
    disable_nagle_algorithm = True
    server: _Server

    def do_GET(self) -> None:
        """Answer one GET."""
        parts = urlsplit(self.path)
        query = dict(parse_qsl(parts.query, keep_blank_values=True))
        info = self.server.note(parts.path, query, dict(self.headers.items()))
        fault = self.server.plan.next(info)
        of_content = fault is not None and fault.kind in OF_CONTENT
        world = self.server.routes.source
        if isinstance(world, ReplayWorld) and world.on_request is not None:
            world.on_request(info)
        answer = self._answer(info, fault.kind if fault is not None and of_content else None)
        if fault is None or of_content:
            limits = {"x-ratelimit-remaining": str(RATE_LIMIT)}
            self.send_answer(replace(answer, headers=limits | dict(answer.headers)))
        else:
            send_fault(self, fault, answer.body, self.server.stopping)

    def _answer(self, info: RequestInfo, fault: str | None) -> Answer:
        """The good answer to a request, or one with a fault of its content."""
        if info.path == LOOP_PATH:
            return Answer(302, b"", headers={"Location": LOOP_PATH})
        if not (self.headers.get("X-Client") or "").strip():
            return Answer(400, NO_CLIENT.encode(), "text/plain;charset=UTF-8")
        if info.path in {"", "/", "/status"}:
            return json_answer(200, {"status": "OK", "vegobjekter": self.server.routes.source.counts()})
        base = f"http://{self.headers.get('Host', 'localhost')}"
        return self.server.routes.answer(info.path, info.query, base, fault)


def main(arguments: list[str] | None = None) -> int:
    """Serve until Ctrl-C: ``python -m nvdb.replay FOLDER``."""
    options = _parser().parse_args(arguments)

    def greeting(server: ReplayServer) -> str:
        counts = ", ".join(f"{number} of type {kind}" for kind, number in server.counts.items())
        return f"{server.url} serves {counts}"

    return serve_until_interrupted(
        lambda: ReplayServer(options.folder, host=options.host, port=options.port), greeting
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m nvdb.replay",
        description="Serve recorded signs as API Les V4 and Uberiket V1 would.",
        epilog="Example: python -m nvdb.replay recorded_pages --port 8096",
    )
    parser.add_argument("folder", type=Path, help="folder of recorded pages (*.json, *.json.gz, *.ndjson)")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: %(default)s)")
    parser.add_argument("--port", type=int, default=8096, help="0 takes a free one (default: %(default)s)")
    return parser
