"""Faults that the replay server can show on a real socket."""

from __future__ import annotations

import gzip
import socket
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from typing import Final, Literal

FaultKind = Literal[
    "status",
    "truncate",
    "cut",
    "html_200",
    "drip",
    "redirect_loop",
    "repeat_cursor",
    "repeat_page",
    "empty_page",
    "garbage",
    "damaged_gzip",
    "disconnect",
]

OF_CONTENT: Final = frozenset({"repeat_cursor", "repeat_page", "empty_page"})
"""Faults of what a page says, and not of how it comes over the wire."""

LOOP_PATH: Final = "/replay/redirect-loop"
HTML: Final = b"<!DOCTYPE html><html><body><h1>Service temporarily unavailable</h1></body></html>"


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes
    ----------
    kind : str
        ``status``: `status` with `headers` and `body`.
        ``truncate``: the right ``Content-Length``, half of the body, end of connection.
        ``cut``: no ``Content-Length``, half of the body, end of connection.
        ``html_200``: status 200 with an HTML page.
        ``drip``: the right answer, one byte and then `pause_s` of silence at a time.
        ``redirect_loop``: a redirect to an address that redirects to itself.
        ``repeat_cursor``: a good page whose cursor leads back to itself.
        ``repeat_page``: the first page's objects again, under the cursor of the page that was asked for.
        ``empty_page``: a page of vegobjekter without any, whose cursor leads on to those that it should hold
        (in worlds without an `order_seed`).
        ``garbage``: status 200 with random-looking bytes, declared as JSON.
        ``damaged_gzip``: the right answer, compressed, with bytes changed on the way.
        ``disconnect``: end of connection without any answer.
    """

    kind: FaultKind
    status: int = 503
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""
    pause_s: float = 0.02


@dataclass(frozen=True, slots=True)
class RequestInfo:
    """A request as it came in: `number` counts from 0; of a repeated parameter the last value is kept."""

    number: int
    path: str
    query: Mapping[str, str]
    headers: Mapping[str, str]


Faults = Iterable[Fault | None] | Callable[[RequestInfo], Fault | None]


class FaultPlan:
    """Which request meets which fault; safe to ask from several threads.

    Parameters
    ----------
    faults : iterable or callable, optional
        One entry a request, in order of arrival, None for a good answer (also after the last); or a
        function of the request. A redirect that is followed is a request too.
    """

    def __init__(self, faults: Faults | None) -> None:
        self._ask = faults if callable(faults) else None
        self._rest = iter(()) if faults is None or callable(faults) else iter(faults)
        self._lock = threading.Lock()

    def next(self, request: RequestInfo) -> Fault | None:
        """The fault for this request, or None."""
        with self._lock:
            return self._ask(request) if self._ask is not None else next(self._rest, None)


def send_fault(handler: BaseHTTPRequestHandler, fault: Fault, body: bytes, stopping: threading.Event) -> None:
    """Answer with a fault.

    Parameters
    ----------
    handler : BaseHTTPRequestHandler
    fault : Fault
        Any kind but those of `OF_CONTENT`, which are not a matter of the wire.
    body : bytes
        The good answer, which some faults damage.
    stopping : threading.Event
        Set when the server closes: a drip ends then.
    """
    handler.close_connection = True
    if fault.kind == "status":
        _head(handler, fault.status, {"Content-Length": str(len(fault.body)), **fault.headers})
        handler.wfile.write(fault.body)
    elif fault.kind == "truncate":
        _head(handler, 200, {"Content-Length": str(len(body))})
        handler.wfile.write(body[: len(body) // 2])
    elif fault.kind == "cut":
        _head(handler, 200, {})
        handler.wfile.write(body[: len(body) // 2])
    elif fault.kind == "drip":
        _head(handler, 200, {"Content-Length": str(len(body))})
        _drip(handler, body, fault.pause_s, stopping)
    elif fault.kind == "redirect_loop":
        _head(handler, HTTPStatus.FOUND, {"Location": LOOP_PATH, "Content-Length": "0"})
    elif fault.kind == "disconnect":
        handler.connection.shutdown(socket.SHUT_RDWR)
    else:
        headers, wrong = _wrong_body(fault.kind, body)
        _head(handler, 200, {**headers, "Content-Length": str(len(wrong))})
        handler.wfile.write(wrong)


def _wrong_body(kind: FaultKind, body: bytes) -> tuple[dict[str, str], bytes]:
    if kind == "html_200":
        return {"Content-Type": "text/html; charset=utf-8"}, HTML
    if kind == "damaged_gzip":
        packed = bytearray(gzip.compress(body, mtime=0))
        middle = len(packed) // 2
        packed[middle : middle + 8] = b"\xff" * 8
        return {"Content-Encoding": "gzip"}, bytes(packed)
    return {}, bytes((number * 151 + 7) % 256 for number in range(400))


def _head(handler: BaseHTTPRequestHandler, status: int, headers: Mapping[str, str]) -> None:
    handler.send_response(status)
    for name, value in {"Content-Type": "application/json", "Connection": "close", **headers}.items():
        handler.send_header(name, value)
    handler.end_headers()


def _drip(handler: BaseHTTPRequestHandler, body: bytes, pause_s: float, stopping: threading.Event) -> None:
    for number in range(len(body)):
        handler.wfile.write(body[number : number + 1])
        handler.wfile.flush()
        if stopping.wait(pause_s):
            return
