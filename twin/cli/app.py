"""Which module holds which command of ``twin``; it is loaded when the command is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any, ClassVar, get_args, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_group
from typer.models import ParameterInfo

from twin.cli.flags import without_type_of_flags
from twin.cli.journal import set_manner

_SETTINGS: Any = {
    "no_args_is_help": True,
    "rich_markup_mode": "rich",
    "context_settings": {"help_option_names": ["-h", "--help"]},
}


class _LazyGroup(TyperGroup):
    """Commands that are declared in modules of :mod:`twin.cli`, each loaded when it is first asked for."""

    modules: ClassVar[Mapping[str, str]]
    """Command → module, in the order of the help."""

    def get_params(self, ctx: Any) -> list[Any]:
        return without_type_of_flags(super().get_params(ctx))

    def list_commands(self, ctx: Any) -> list[str]:
        return [*self.modules, *(name for name in super().list_commands(ctx) if name not in self.modules)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in self.modules and cmd_name not in self.commands:
            from twin.cli.command import Command

            declared = _declared(self.modules[cmd_name])
            _leave_reading_to_readers(declared)
            for info in declared.registered_commands:
                info.cls = Command
            self.commands = {**self.commands, **get_group(declared).commands}
        return super().get_command(ctx, cmd_name)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        # It shows names and first lines: what each command takes need not be worked out for that.
        for module in set(self.modules.values()):
            for info in _declared(module).registered_commands:
                self.commands[str(info.name)] = TyperCommand(info.name, help=getdoc(info.callback))
        super().format_help(ctx, formatter)


def _declared(module: str) -> typer.Typer:
    declared: typer.Typer = import_module(f"twin.cli.{module}").app
    return declared


def _leave_reading_to_readers(declared: typer.Typer) -> None:
    """Let whoever reads a file say that it cannot be read: the parser would call it a wrong value."""
    for info in declared.registered_commands:
        for hint in get_type_hints(info.callback, include_extras=True).values():
            for parameter in get_args(hint)[1:]:
                if isinstance(parameter, ParameterInfo):
                    parameter.readable = False


class _Commands(_LazyGroup):
    modules: ClassVar[Mapping[str, str]] = {
        "sync-nvdb": "mirror",
        "init": "init",
        "ingest-drive": "drives",
        "drives": "drives",
        "inspect": "drives",
        "trajectory": "drives",
        "locate": "locate",
        "live": "live",
        "objects": "objects",
        "match": "findings",
        "findings": "list_findings",
        "explain": "explain",
        "decide": "findings",
        "evidence": "evidence",
        "review": "review",
        "annotate": "annotate",
        "export": "export",
        "qgis": "export",
        "submit": "submit",
        "evaluate": "reports",
        "reproduce": "reproduce",
        "show": "show",
        "status": "reports",
        "backup": "backup",
        "restore": "backup",
        "config": "config",
        "confidence": "reports",
        "belief": "belief",
        "simulate": "samples",
        "demo": "samples",
        "help": "help",
    }


class _CalibrateCommands(_LazyGroup):
    modules: ClassVar[Mapping[str, str]] = {
        "print-board": "calibrate_prints",
        "coverage": "calibrate_coverage",
        "intrinsics": "calibrate",
        "example": "calibrate",
        "print-yard": "calibrate_prints",
        "print-tags": "calibrate_prints",
        "extrinsics": "calibrate_rig",
        "example-yard": "calibrate_rig",
        "verify": "calibrate_rig",
        "from-drives": "calibrate_rig",
        "diff": "calibrate_diff",
    }


class _FleetCommands(_LazyGroup):
    modules: ClassVar[Mapping[str, str]] = dict.fromkeys(("ingest", "work", "status", "retry"), "fleet")


class _StoreCommands(_LazyGroup):
    modules: ClassVar[Mapping[str, str]] = dict.fromkeys(("copy", "trim", "init-roles", "qgis"), "store")


app = typer.Typer(
    cls=_Commands,
    name="twin",
    pretty_exceptions_enable=False,
    help="Keep the road-sign layer of Norway's digital twin true: "
    "a recorded drive and NVDB in, change sets for QGIS and the road database out.",
    epilog="Order of work: sync-nvdb, ingest-drive, match, export.  Try it all on the sample: twin demo",
    **_SETTINGS,
)
app.add_typer(
    typer.Typer(
        cls=_CalibrateCommands,
        name="calibrate",
        help="Calibrate the car's cameras from pictures, and check that they still are.",
        epilog="Try it: twin calibrate example board",
        **_SETTINGS,
    )
)
app.add_typer(
    typer.Typer(
        cls=_FleetCommands,
        name="fleet",
        help="Ingest many drives by many processes or machines, from folders or object storage.",
        epilog="Try it: twin fleet ingest data/trip_trondheim data/trip_trondheim_2 --workers 2",
        **_SETTINGS,
    )
)
app.add_typer(
    typer.Typer(
        cls=_StoreCommands,
        name="store",
        help="A store as a whole: into PostgreSQL and back, without what is old; roles; styles for QGIS.",
        epilog="Try it: twin store copy demo-out/twin.db copy.db",
        **_SETTINGS,
    )
)


def _version(show: bool) -> None:
    if show:
        from twin import __version__

        typer.echo(f"twin {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
    verbose: Annotated[
        bool,
        typer.Option("--verbose", "-v", help="Say what is done when, and what is asked of NVDB."),
    ] = False,
    quiet: Annotated[
        bool,
        typer.Option(
            "--quiet",
            "-q",
            help="Say only what was asked for, what has changed, warnings and errors: for cron.",
        ),
    ] = False,
    log_file: Annotated[
        Path | None,
        typer.Option(envvar="TWIN_LOG_FILE", help="Add to this log, one JSON object a line.", metavar="FILE"),
    ] = None,
) -> None:
    """Take what holds for every command, and stands before it."""
    del version  # its callback has done it
    set_manner(quiet=quiet, verbose=verbose, log_file=log_file)
