"""What stands before every route: who may ask, from where, how much, and what a page may load.

The server speaks to one machine. A page of a stranger in the same browser can send requests to it all the
same, under the address or, by DNS rebinding, under a name of its own that leads here. So a request needs

- a ``Host`` that is this server's own (against rebinding),
- the cookie of a browser that has shown the token of the URL printed at the start,
- no ``Origin`` but this server's, and one at all where it changes something (against forged requests).

No answer carries a CORS header, so no other origin reads any. A WebSocket needs the same, of a page with its
``Origin``; a program, which has none, shows the token in the address.
"""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import RedirectResponse, Response

from twin.web.messages import refusal
from twin.web.sessions import Sessions

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_BODY_BYTES = 64 * 1024
"""An answer with a long comment is 2 kB."""
_SAFE = frozenset({"GET", "HEAD"})
_OWN_SITE = frozenset({"same-origin", "none"})
_STRANGER = (
    "This browser has not shown the token: open the whole address that the command printed, with its ?token=…"
)


@dataclass(frozen=True, slots=True)
class Address:
    """Where the server listens.

    Attributes
    ----------
    host : str
        Name or number, as people write it in a browser.
    port : int
    """

    host: str
    port: int

    @property
    def hosts(self) -> frozenset[str]:
        """What ``Host`` may say; on loopback also by its name."""
        names = {self.host, "localhost"} if self.is_loopback else {self.host}
        return frozenset(f"{name}:{self.port}" for name in names)

    @property
    def origins(self) -> frozenset[str]:
        """What ``Origin`` may say."""
        return frozenset(f"http://{host}" for host in self.hosts)

    @property
    def is_loopback(self) -> bool:
        """Whether no other machine can reach it."""
        return self.host in {"127.0.0.1", "localhost"}

    def url(self, token: str) -> str:
        """Return the address that opens the door."""
        return f"http://{self.host}:{self.port}/?token={token}"


@dataclass(frozen=True, slots=True)
class Outside:
    """Another host that pages may ask for pictures: what a base map needs, and nothing else does.

    Attributes
    ----------
    origins : sequence of str
        ``https://cache.kartverket.no``.
    """

    origins: Sequence[str] = ()

    def policy(self) -> str:
        """Write the Content-Security-Policy."""
        outside = "".join(f" {origin}" for origin in self.origins)
        return "; ".join(
            (
                "default-src 'self'",
                f"img-src 'self' data: blob:{outside}",
                f"connect-src 'self'{outside}",
                # MapLibre's worker: from its own file, or from the blob that it makes of it.
                "worker-src 'self' blob:",
                "object-src 'none'",
                "base-uri 'none'",
                "form-action 'self'",
                "frame-ancestors 'none'",
            )
        )


class Guard:
    """ASGI middleware that lets own pages in, and nobody else.

    Parameters
    ----------
    app : ASGIApp
    sessions : Sessions
    address : Address
    outside : Outside
    name : str
        Of the page: its cookie is named after it and the port, for several servers share a host's cookies.
    """

    def __init__(
        self, app: ASGIApp, sessions: Sessions, address: Address, outside: Outside, name: str
    ) -> None:
        self._app = app
        self._sessions = sessions
        self._address = address
        self._cookie = f"twin_{name}_{address.port}"
        self._headers = {
            "Content-Security-Policy": outside.policy(),
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or hand on to the routes with the session in the request's state."""
        if scope["type"] == "websocket":
            await self._websocket(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        request = Request(scope)
        answered = self._refused(request) or self._token_shown(request)
        if answered is None:
            session = self._sessions.get(request.cookies.get(self._cookie))
            if session is None:
                answered = refusal(HTTPStatus.FORBIDDEN, _STRANGER)
            else:
                scope.setdefault("state", {})["session"] = session
        app = self._app if answered is None else answered
        await app(scope, _limited(receive), self._with_headers(send))

    async def _websocket(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a browser's own page listen that has the cookie, or a program that shows the token."""
        asked = HTTPConnection(scope)
        origin = asked.headers.get("origin")
        session = self._sessions.get(asked.cookies.get(self._cookie))
        # Browsers always say whose page asks, and no stranger's page knows the token.
        is_program = origin is None and self._sessions.is_token(asked.query_params.get("token", ""))
        is_own_page = origin in self._address.origins and session is not None
        if asked.headers.get("host", "") in self._address.hosts and (is_program or is_own_page):
            scope.setdefault("state", {})["session"] = session
            await self._app(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 1008})

    def _refused(self, request: Request) -> Response | None:
        headers = request.headers
        if headers.get("host", "") not in self._address.hosts:
            return refusal(HTTPStatus.FORBIDDEN, "This server is not known by that name.")
        origin = headers.get("origin")
        changes = request.method not in _SAFE
        if (origin is None and changes) or (origin is not None and origin not in self._address.origins):
            return refusal(HTTPStatus.FORBIDDEN, "Requests of other pages are refused.")
        # Another port of this machine is the same site to a cookie, but not the same origin.
        is_visit = request.url.path == "/" and headers.get("sec-fetch-mode") == "navigate"
        if headers.get("sec-fetch-site", "none") not in _OWN_SITE and not is_visit:
            return refusal(HTTPStatus.FORBIDDEN, "Requests of other pages are refused.")
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > MAX_BODY_BYTES:
            return refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "The request is too large.")
        return None

    def _token_shown(self, request: Request) -> Response | None:
        """Let a browser in that shows the token: it gets a cookie, and an address without the token."""
        token = request.query_params.get("token")
        if request.url.path != "/" or token is None:
            return None
        if not self._sessions.is_token(token):
            return refusal(
                HTTPStatus.FORBIDDEN, "This token is not of this run: open the address printed last."
            )
        answer = RedirectResponse("/", HTTPStatus.SEE_OTHER)
        if self._sessions.get(request.cookies.get(self._cookie)) is None:
            answer.set_cookie(
                self._cookie, self._sessions.begin(), httponly=True, samesite="strict", path="/"
            )
        return answer

    def _with_headers(self, send: Send) -> Send:
        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers[name] = value
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        return sent


def _limited(receive: Receive) -> Receive:
    """Cut off a body that is longer than it said, or did not say its length."""
    taken = 0

    async def limited() -> MutableMapping[str, Any]:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        return {"type": "http.disconnect"} if taken > MAX_BODY_BYTES else message

    return limited
