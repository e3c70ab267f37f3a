"""``twin annotate``: the page in which people mark the signs in a drive's pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.cli.options import DEFAULT_STORE, StoreOption
from twin.cli.output import note, warn
from twin.cli.pages import OpenOption, PageLangOption, PortOption, serve_page
from twin.errors import to_type
from twin.store.address import StoreAddress
from twin.words import SignNames

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
    lang: PageLangOption = None,
    open_browser: OpenOption = None,
    port: PortOption = 0,
    store: StoreOption = DEFAULT_STORE,
) -> None:
    """Mark signs in a drive's pictures in the browser: click a foot, confirm the rest. Ctrl-C ends it."""
    from twin.annotate.app import AnnotateOptions, annotate_app
    from twin.annotate.recording import open_recording

    recording = open_recording(drive, cameras=camera, progress=note)
    for notice in recording.notices:
        warn(notice)
    options = AnnotateOptions(by, lang, *_signs(store))
    serve_page(
        lambda address: annotate_app(recording, options, address), port=port, open_browser=open_browser
    )
    following = to_type("twin", "ingest-drive", drive)
    note(f"The annotation page is closed; every mark is in {drive}. Next: {following}")


def _signs(store: StoreAddress) -> tuple[SignNames, frozenset[str]]:
    """Names and codes of signs: the store's where there is one, else those that ship."""
    from twin.errors import TwinError
    from twin.mirror.names import shipped_codes, shipped_names, sign_codes, sign_names
    from twin.store.store import Store

    if store.file is None or store.file.is_file():
        try:
            with Store.open(store, create=False) as opened:
                return sign_names(opened), sign_codes(opened)
        except TwinError as error:
            warn(f"Names of signs are those that ship with twin: {error}")
    return shipped_names(), shipped_codes()
