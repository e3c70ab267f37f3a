"""``twin store``: a store as a whole, into another database; and what PostgreSQL adds to it."""

from __future__ import annotations

from typing import Annotated

import typer

from twin.cli.options import DEFAULT_STORE, JsonOption, LangOption, StoreOption
from twin.cli.output import note, print_json, print_pairs, print_table, steps, warn
from twin.store.address import StoreAddress
from twin.words import Lang

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


@app.command("init-roles", epilog="Example: twin store init-roles --store postgresql://twin@db/twin")
def init_roles(
    store: StoreOption = DEFAULT_STORE,
    print_only: Annotated[
        bool, typer.Option("--print", help="Only print the statements, for an administrator to run.")
    ] = False,
) -> None:
    """Make the roles twin_reader, twin_reviewer, twin_ingester and twin_owner, of a store in PostgreSQL.

    A reader reads; a reviewer decides too, here and in QGIS; an ingester does all else that fills the store,
    and cannot change a log; the owner upgrades it. Put logins into them: GRANT twin_reviewer TO kari. Run it
    again at any time.
    """
    from twin.store.roles import Role, roles

    if print_only:
        typer.echo("".join(f"{statement};\n" for statement in roles()), nl=False)
        return
    from twin.store.postgres import init_roles as init

    init(store)
    note(f"The store {store} has roles now: let kari decide by GRANT {Role.REVIEWER} TO kari.")


@app.command("qgis", epilog="Example: twin store qgis --store postgresql://twin@db/twin")
def qgis(store: StoreOption = DEFAULT_STORE, lang: LangOption = Lang.EN) -> None:
    """Put the styles of the live layers into a database of PostgreSQL, for everybody who opens them in QGIS.

    Once, and again after an upgrade of twin or for another language. The layers themselves are there with the
    store, in the schema twin_qgis.
    """
    from twin.export.qgis.live import write_styles
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        names = write_styles(opened, lang)
    note(f"QGIS finds {', '.join(names)} in the schema twin_qgis of {store}, with their styles.")


@app.command("trim", epilog="Example: twin store trim --older-than 365 --dry-run")
def trim(
    older_than: Annotated[
        int, typer.Option(help="What nothing has needed for so long goes.", metavar="DAYS", min=1)
    ],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only count.")] = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="Also annotation sets, which nobody can take back then.")
    ] = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Drop what is old and no finding rests on, and give its room back.

    Gone are annotation sets that are not current, what NVDB's objects were before, and drives of the queue
    that are done. Sightings, estimates, findings, decisions, what was sent and the logs stay.
    """
    from twin.store.store import Store
    from twin.store.trimming import trim_store

    with Store.open(store, create=False) as opened:
        done = trim_store(opened, older_than, dry_run=dry_run, yes=yes)
    if json_output:
        print_json(done)
        return
    rows = [(name, part.rows, round(part.n_bytes / 1e6, 2)) for name, part in done.parts.items()]
    title = f"{'Would go' if dry_run else 'Gone'}: older than {done.before}"
    print_table(title, ["table", "rows", "MB, about"], rows)
    if dry_run and done.n_sets:
        note(f"{done.n_sets:,} annotation sets could not be taken back any more: that needs --yes.")
    if done.kept_room is not None:
        warn(f"The rows are gone, their room was not given back: {done.kept_room}")
