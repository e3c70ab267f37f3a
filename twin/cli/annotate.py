"""``twin annotate``: the page in which people mark the signs in a drive's pictures."""

from __future__ import annotations

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from twin.cli.options import DEFAULT_STORE, StoreOption
from twin.cli.output import note, warn
from twin.words import Lang, SignNames

app = typer.Typer()


@app.command(
    "annotate", epilog="Example: twin annotate my-drive --by kari.  Then: twin ingest-drive my-drive"
)
def annotate(
    drive: Annotated[Path, typer.Argument(help="The drive's folder, with its pictures.", show_default=False)],
    by: Annotated[
        str, typer.Option(envvar="TWIN_USER", help="Who annotates; kept in the files.", show_default=False)
    ] = "",
    camera: Annotated[
        list[str] | None,
        typer.Option(help="Only this camera; may be repeated.  [default: all]", show_default=False),
    ] = None,
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
    store: StoreOption = DEFAULT_STORE,
) -> None:
    """Mark signs in a drive's pictures in the browser: click a foot, confirm the rest. Ctrl-C ends it."""
    from twin.annotate.app import AnnotateOptions, annotate_app
    from twin.annotate.recording import open_recording
    from twin.web.serve import listening, may_open_browser, serve

    recording = open_recording(drive, cameras=camera, progress=note)
    for notice in recording.notices:
        warn(notice)
    listener, address = listening(port=port)
    with listener:
        page, token = annotate_app(recording, AnnotateOptions(by, lang, _names(store)), address)
        url = address.url(token)

        def ready() -> None:
            sys.stdout.write(f"{url}\n")
            sys.stdout.flush()
            if may_open_browser() if open_browser is None else open_browser:
                webbrowser.open(url)

        serve(page, listener, ready=ready)
    note(f"The annotation page is closed; every mark is in {drive}. Next: twin ingest-drive {drive}")


def _names(store: Path) -> SignNames:
    """Names of signs: the store's where there is one, else those that ship."""
    from twin.errors import TwinError
    from twin.mirror.names import shipped_names, sign_names
    from twin.store.store import Store

    if not store.is_file():
        return shipped_names()
    try:
        with Store.open(store, create=False) as opened:
            return sign_names(opened)
    except TwinError as error:
        warn(f"Names of signs are those that ship with twin: {error}")
        return shipped_names()
