"""``twin review``: the page in which people look at findings and decide."""

from __future__ import annotations

import sys
import webbrowser
from typing import Annotated

import typer

from twin.cli.options import DEFAULT_STORE, StoreOption
from twin.cli.output import note, warn
from twin.words import Lang

app = typer.Typer()


@app.command("review", epilog="Example: twin review --by kari.  Blind second opinions: twin review --blind")
def review(
    by: Annotated[
        str | None,
        typer.Option(envvar="TWIN_USER", help="Who reviews.  [default: the page asks]", show_default=False),
    ] = None,
    blind: Annotated[
        bool,
        typer.Option("--blind", help="Second opinions: nobody sees another's answer."),
    ] = False,
    read_only: Annotated[
        bool, typer.Option("--read-only", help="For looking: nothing can be answered.")
    ] = False,
    base_map: Annotated[
        bool,
        typer.Option("--base-map", help="Show Kartverket's map, which the browser asks the internet for."),
    ] = False,
    lang: Annotated[
        Lang | None, typer.Option(help="Language of the page.  [default: the browser's]", show_default=False)
    ] = None,
    open_browser: Annotated[
        bool | None,
        typer.Option(
            "--open/--no-open",
            help="Open the browser.  [default: where there is a screen]",
            show_default=False,
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 for any that is free.")] = 0,
    host: Annotated[
        str, typer.Option(help="An address of this machine. Any but 127.0.0.1 lets other machines in.")
    ] = "127.0.0.1",
    store: StoreOption = DEFAULT_STORE,
) -> None:
    """Look at findings one by one in the browser, and settle each by a key. Ctrl-C ends it."""
    from twin.review.app import ReviewOptions, review_app
    from twin.store.store import Store
    from twin.web.serve import listening, may_open_browser, serve

    options = ReviewOptions(by or "", blind, read_only, base_map, lang)
    with Store.open(store, create=False) as opened:
        listener, address = listening(host, port)
        with listener:
            page, token = review_app(opened, options, address)
            url = address.url(token)
            if not address.is_loopback:
                warn(f"Other machines can reach this page at {host}; whoever has its address may decide.")

            def ready() -> None:
                sys.stdout.write(f"{url}\n")
                sys.stdout.flush()
                if may_open_browser() if open_browser is None else open_browser:
                    webbrowser.open(url)

            serve(page, listener, ready=ready)
    note("The review page is closed; every answer is in the store.")
