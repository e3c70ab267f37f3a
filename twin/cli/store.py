"""``twin store``: a store as a whole, into another database."""

from __future__ import annotations

from typing import Annotated

import typer

from twin.cli.options import JsonOption
from twin.cli.output import note, print_json, print_pairs, steps, warn
from twin.store.address import StoreAddress

app = typer.Typer()

SourceArgument = Annotated[
    StoreAddress, typer.Argument(parser=StoreAddress.of, help="The store to copy.", metavar="FROM")
]
TargetArgument = Annotated[
    StoreAddress,
    typer.Argument(parser=StoreAddress.of, help="A new store, or an empty one.", metavar="TO"),
]


@app.command(
    "copy", epilog="Example: twin store copy twin.db postgresql://twin@db/twin?pictures=/srv/twin/pictures"
)
def copy(source: SourceArgument, target: TargetArgument, json_output: JsonOption = False) -> None:
    """Copy all that a store holds into another: from SQLite into PostgreSQL, back, or into a second one.

    Drives, findings, decisions, what was sent, the mirror and the pictures; whole, or not at all. Others may
    use the first store meanwhile: what they change after the beginning is not in the copy.
    """
    from twin.store.copying import copy_store

    with steps(quiet=json_output) as say:
        done = copy_store(source, target, progress=say)
    if json_output:
        print_json(done)
        return
    print_pairs(f"{done.source} in {done.target}", {name: f"{n:,} rows" for name, n in done.rows.items()})
    if done.n_pictures:
        note(f"Pictures: {done.n_pictures:,}.")
    if done.n_lost:
        warn(f"Pictures without a file: {done.n_lost:,}. `twin evidence` makes them again.")
