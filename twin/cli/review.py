"""``twin review``: the page in which people look at findings and decide."""

from __future__ import annotations

from typing import Annotated

import typer

from twin.cli.options import DEFAULT_STORE, StoreOption
from twin.cli.output import note
from twin.cli.pages import LOOPBACK, OpenOption, PageLangOption, PortOption, serve_page
from twin.words import Lang, say

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
        typer.Option(
            "--base-map/--no-base-map",
            envvar="TWIN_BASE_MAP",
            help="Show Kartverket's map, which the browser asks the internet for.",
        ),
    ] = False,
    lang: PageLangOption = None,
    open_browser: OpenOption = None,
    port: PortOption = 0,
    host: Annotated[
        str, typer.Option(help="An address of this machine. Any but 127.0.0.1 lets other machines in.")
    ] = LOOPBACK,
    store: StoreOption = DEFAULT_STORE,
) -> None:
    """Look at findings one by one in the browser, and settle each by a key. Ctrl-C ends it."""
    from twin.review.app import ReviewOptions, review_app
    from twin.store.store import Store

    options = ReviewOptions(by or "", blind, read_only, base_map, lang)
    with Store.open(store, create=False) as opened:
        serve_page(
            lambda address: review_app(opened, options, address),
            host=host,
            port=port,
            open_browser=open_browser,
        )
        read_only = read_only or opened.read_only is not None
    closed = "review.closed_read_only" if read_only else "review.closed"
    note(say(lang or Lang.EN, closed))
