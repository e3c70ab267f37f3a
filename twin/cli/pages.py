"""What the commands share that serve a page: their options, and serving it until Ctrl-C."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.output import warn
from twin.words import Lang

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from twin.web import Address

PageLangOption = Annotated[
    Lang | None,
    typer.Option(
        "--lang",
        envvar="TWIN_LANG",
        help="Language of the page.  [default: the browser's]",
        show_default=False,
    ),
]
OpenOption = Annotated[
    bool | None,
    typer.Option(
        "--open/--no-open", help="Open the browser.  [default: where there is a screen]", show_default=False
    ),
]
PortOption = Annotated[int, typer.Option("--port", min=0, max=65535, help="0 for any that is free.")]
LOOPBACK = "127.0.0.1"


def serve_page(
    make: Callable[[Address], tuple[Starlette, str]],
    *,
    host: str = LOOPBACK,
    port: int = 0,
    open_browser: bool | None = None,
) -> None:
    """Serve a page until Ctrl-C; its address goes to stdout when it waits to be asked.

    Parameters
    ----------
    make : callable
        Makes the page's application, and the token that opens it, for where it will listen.
    host : str
        An address of this machine; a warning is told for any that other machines reach.
    port : int
        0 for any that is free.
    open_browser : bool, optional
        By default where somebody sits before a screen.
    """
    from twin.web.serve import listening, may_open_browser, serve

    listener, address = listening(host, port)
    with listener:
        page, token = make(address)
        url = address.url(token)
        if not address.is_loopback:
            warn(f"Other machines can reach this page at {host}; whoever has its address may use it.")

        def ready() -> None:
            sys.stdout.write(f"{url}\n")
            sys.stdout.flush()
            if may_open_browser() if open_browser is None else open_browser:
                webbrowser.open(url)

        serve(page, listener, ready=ready)
