"""Listen, say where, and serve until Ctrl-C."""

from __future__ import annotations

import errno
import ipaddress
import os
import socket
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from twin.errors import ConfigError, RefusedError
from twin.web.guard import Address

if TYPE_CHECKING:
    import uvicorn
    from starlette.types import ASGIApp

LOOPBACK = "127.0.0.1"
_LONGEST_MESSAGE = 4096
"""What a page may say over WebSocket: pages of twin listen."""
_PATIENCE_S = 2
"""How long answers under way may take after Ctrl-C."""


def listening(host: str = LOOPBACK, port: int = 0) -> tuple[socket.socket, Address]:
    """Take a port, so that its number is known before anything is served.

    Parameters
    ----------
    host : str
        One address of this machine, as others will write it.
    port : int
        0 for any that is free.

    Raises
    ------
    ConfigError
        The host is every address at once, or none of this machine's.
    RefusedError
        The port is taken, or this user may not take it.
    """
    if _is_every_address(host):
        raise ConfigError(
            f"{host or 'An empty host'} would listen on every network of this machine: name the one address"
            " that others will write in their browser."
        )
    try:
        resolved = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_STREAM)[0][4]
    except OSError as error:
        raise ConfigError(f"{host} is no address of this machine ({error.strerror}).") from error
    # Named as TCP's own, it sends what it has at once: asyncio asks for that only where the protocol is said.
    taken = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if os.name == "posix":
            # A server that has just ended leaves its port in TIME_WAIT; on Windows this would share a port.
            taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(resolved)
        taken.listen(128)
    except OSError as error:
        taken.close()
        if error.errno == errno.EADDRNOTAVAIL:
            raise ConfigError(f"{host} is no address of this machine ({error.strerror}).") from error
        raise RefusedError(
            f"The port {port} of {host} cannot be used ({error.strerror}): name another, "
            "or 0 for one that is free."
        ) from error
    return taken, Address(host, int(taken.getsockname()[1]))


def serve(app: ASGIApp, listener: socket.socket, *, ready: Callable[[], None]) -> None:
    """Serve until Ctrl-C or SIGTERM.

    Parameters
    ----------
    app : ASGIApp
    listener : socket
        Of :func:`listening`; closed at the end.
    ready : callable
        Called once, when requests wait to be answered.
    """
    with listener:
        ready()
        try:
            server_of(app).run(sockets=[listener])
        except KeyboardInterrupt:
            # Uvicorn ends in order and then raises it again: this is how a server is ended.
            return


def server_of(app: ASGIApp, *, websockets: bool = False) -> uvicorn.Server:
    """Make the server that :func:`serve` runs: it says little, and trusts no header about who asks.

    Parameters
    ----------
    app : ASGIApp
    websockets : bool
        Whether it speaks WebSocket, by the library of that name.
    """
    import uvicorn

    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        lifespan="off",
        ws="websockets-sansio" if websockets else "none",
        ws_max_size=_LONGEST_MESSAGE,
        # It would cost a car's processor more than it saves on the way to a browser beside it.
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=_PATIENCE_S,
    )
    return uvicorn.Server(config)


def may_open_browser() -> bool:
    """Whether a browser of this machine would be seen: somebody sits at a terminal and has a screen."""
    has_screen = sys.platform in {"darwin", "win32"} or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return has_screen and sys.stderr.isatty()


def _is_every_address(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return not host
