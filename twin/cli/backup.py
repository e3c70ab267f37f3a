"""``twin backup`` and ``twin restore``: a copy of the store and its pictures, and the way back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import DEFAULT_STORE, StoreOption
from twin.cli.output import note, warn
from twin.errors import ConfigError
from twin.store.address import StoreAddress

if TYPE_CHECKING:
    from twin.store.backup import Copied

app = typer.Typer()


@app.command("backup", epilog="Example: twin backup /backup/twin.db")
def backup(
    file: Annotated[
        Path, typer.Argument(help="The copy; a former one stays until this one is whole.", metavar="FILE")
    ],
    store: StoreOption = DEFAULT_STORE,
) -> None:
    """Copy the store to a file, and its pictures to the folder beside it, while others may use the store."""
    from twin.store.backup import back_up

    done = back_up(_file(store), file)
    note(f"{store} is copied to {file}{_with_pictures(done)}.")
    _warn_of_lost(done)


@app.command("restore", epilog="Example: twin restore /backup/twin.db --store twin.db")
def restore(
    file: Annotated[Path, typer.Argument(help="A copy that twin backup has made.", metavar="FILE")],
    store: StoreOption = DEFAULT_STORE,
) -> None:
    """Put a copy in the place of the store, with its pictures; the store that stood there is set aside.

    Nothing else may use the store meanwhile.
    """
    from twin.store.backup import restore as put_back

    done = put_back(_file(store), file)
    note(f"{store} is now what {file} holds{_with_pictures(done)}.")
    if done.aside is not None:
        note(f"The store that stood there is {done.aside}: delete it when nothing is missed.")
    _warn_of_lost(done)


def _file(store: StoreAddress) -> Path:
    if store.file is None:
        raise ConfigError(
            f"The store {store} is a database: copy it with pg_dump, bring it back with pg_restore, and copy "
            "the folder of its pictures (twin help operations)."
        )
    return store.file


def _with_pictures(done: Copied) -> str:
    return f", with its pictures ({done.n_pictures})" if done.n_pictures else ""


def _warn_of_lost(done: Copied) -> None:
    if done.n_lost:
        warn(f"Pictures without a file: {done.n_lost}. `twin evidence` makes them again.")
