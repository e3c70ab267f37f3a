"""What is said of a drive, to pages in browsers: over WebSocket, behind the guard of twin's other pages.

Each message is one line: first what holds now, then what changes. A program may listen too, at
``ws://HOST:PORT/live?token=…``.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock, Thread
from typing import TYPE_CHECKING

from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocketDisconnect

from twin.errors import MissingExtraError
from twin.live.features import line_of
from twin.live.lanes import Unsaid
from twin.live.ports import Said
from twin.web import Address, Outside, Sessions, web_app
from twin.web.serve import server_of

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.websockets import WebSocket

PAGE = Path(__file__).parent.parent / "page"
"""Files of the page that shows a drive on a map."""
NAME = "live"
_MOST_PRESENT, _MOST_WAITING, _MOST_CLIENTS = 2000, 3000, 32
_TRY_LATER = 1013
"""Close code of a server that has too many clients."""


class _Client:
    """One browser: lines that wait for it, which never block whoever says them."""

    def __init__(self, present: list[Said]) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting = Unsaid(_MOST_WAITING, overtakes=True)
        self._awake = asyncio.Event()
        self.is_over = False
        for said in present:
            # What holds goes first, in the order in which it was said.
            self._waiting.put(said, 0)

    def say(self, said: Said) -> None:
        """Take a line, from any thread."""
        self._waiting.say(said)
        self._wake()

    def end(self) -> None:
        """Say no more."""
        self.is_over = True
        self._wake()

    def _wake(self) -> None:
        with suppress(RuntimeError):  # its server has ended
            self._loop.call_soon_threadsafe(self._awake.set)

    async def send_all(self, websocket: WebSocket) -> None:
        """Send what is said, as fast as the browser takes it, until the end."""
        while not self.is_over:
            self._awake.clear()
            await self._send_waiting(websocket)
            if not self.is_over:
                await self._awake.wait()
        await self._send_waiting(websocket)

    async def _send_waiting(self, websocket: WebSocket) -> None:
        for said in self._waiting.drained():
            await websocket.send_text(line_of(said))


class Hub:
    """What holds now, and the browsers that listen."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._present: dict[tuple[type, str], Said] = {}
        self._clients: set[_Client] = set()

    def say(self, said: Said) -> None:
        """Tell every browser, and those that come later."""
        with self._lock:
            key = type(said), said.id
            self._present.pop(key, None)
            self._present[key] = said
            if len(self._present) > _MOST_PRESENT:
                del self._present[next(iter(self._present))]
            for client in self._clients:
                client.say(said)

    def end(self) -> None:
        """Say no more to anybody."""
        with self._lock:
            for client in self._clients:
                client.end()

    async def listen(self, websocket: WebSocket) -> None:
        """Tell one browser what holds and what changes, until it leaves or the drive ends."""
        with self._lock:
            client = _Client(list(self._present.values()))
            is_full = len(self._clients) >= _MOST_CLIENTS
            if not is_full:
                self._clients.add(client)
        if is_full:
            await websocket.close(_TRY_LATER)
            return
        await websocket.accept()
        sending = asyncio.create_task(client.send_all(websocket))
        leaving = asyncio.create_task(_gone(websocket))
        try:
            await asyncio.wait({sending, leaving}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            with self._lock:
                self._clients.discard(client)
            for task in (sending, leaving):
                task.cancel()
            await asyncio.gather(sending, leaving, return_exceptions=True)
        if client.is_over:
            with suppress(RuntimeError, WebSocketDisconnect):
                await websocket.close()


async def _gone(websocket: WebSocket) -> None:
    """Wait until a browser leaves; what it says meanwhile is nothing to us."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass


def live_app(
    hub: Hub,
    sessions: Sessions,
    address: Address,
    outside: Outside | None = None,
    routes: Sequence[BaseRoute] = (),
) -> Starlette:
    """Put the page of a drive together.

    Parameters
    ----------
    hub : Hub
    sessions : Sessions
    address : Address
    outside : Outside, optional
        The host of a base map.
    routes : sequence of BaseRoute
        What the page asks for beside.
    """
    every = [WebSocketRoute("/live", hub.listen), *routes]
    return web_app(every, PAGE, name=NAME, sessions=sessions, address=address, outside=outside)


class Pages:
    """A server for browsers, in a thread of its own.

    Parameters
    ----------
    listener : socket
        Of `twin.web.listening`.
    address : Address
    outside : Outside, optional
    routes : sequence of BaseRoute
        What the page asks for beside: :func:`twin.live.sinks.session.session_route`.

    Raises
    ------
    MissingExtraError
        Without a library that speaks WebSocket.
    """

    must_arrive = False

    def __init__(
        self,
        listener: socket.socket,
        address: Address,
        outside: Outside | None = None,
        routes: Sequence[BaseRoute] = (),
    ) -> None:
        try:
            import websockets  # noqa: F401
        except ImportError as error:
            raise MissingExtraError("--serve", "websockets", "live") from error
        self._address, self._hub, self._sessions = address, Hub(), Sessions()
        app = live_app(self._hub, self._sessions, address, outside, routes)
        self._server = server_of(app, websockets=True)
        self._listener = listener
        self._thread = Thread(target=self._serve, name="pages", daemon=True)
        self._thread.start()

    @property
    def name(self) -> str:
        """Return its address, without the token."""
        return f"http://{self._address.host}:{self._address.port}"

    @property
    def url(self) -> str:
        """Return the address that opens the door."""
        return self._address.url(self._sessions.token)

    def write(self, said: Said) -> None:
        """Tell the browsers; does not wait for any."""
        self._hub.say(said)

    def close(self) -> None:
        """Send browsers what waits for them, and end."""
        self._hub.end()
        self._server.should_exit = True
        self._thread.join()

    def _serve(self) -> None:
        with self._listener:
            self._server.run(sockets=[self._listener])
