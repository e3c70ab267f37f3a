"""``twin config``: which settings hold, and where each comes from."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import typer

from twin.cli.command import check_value
from twin.cli.journal import PASSWORD, without_secrets
from twin.cli.options import DEFAULT_STORE, JsonOption, StoreOption
from twin.cli.output import print_json, print_table, warn
from twin.cli.settings import SETTINGS, Held, Setting, held_settings, is_there, store_file, user_file

app = typer.Typer()


@dataclass(frozen=True, slots=True)
class SettingInForce:
    """One line of ``twin config``, and of the list ``settings`` of its ``--json``.

    Attributes
    ----------
    key : str
    value : str, bool, int, float or None
        None where nothing is set and there is no default.
    source : str
        ``option``, ``environment``, ``file`` or ``default``.
    where : str or None
        Name of the option or of the environment variable, or path of the file.
    what : str
        What the key means.
    """

    key: str
    value: str | float | bool | None
    source: str
    where: str | None
    what: str


@app.command("config", epilog="Example: twin config --store my-area/twin.db")
def config(ctx: typer.Context, store: StoreOption = DEFAULT_STORE, json_output: JsonOption = False) -> None:
    """Say which settings hold, where each comes from, and where twin.toml is looked for.

    An option stands above the environment, that above twin.toml beside the store, that above your own.
    Passwords stay out of both: keep API Skriv's in the environment, or in the keyring.
    """
    held = held_settings(store, warn)
    settings = [_in_force(ctx, setting, held) for setting in SETTINGS]
    beside, own = store_file(store), user_file()
    files = {"your own": own} if beside is None else {"beside the store": beside, "your own": own}
    password = bool(os.environ.get(PASSWORD))
    if json_output:
        print_json(
            {
                "files": [
                    {"what": what, "path": str(path.absolute()), "exists": is_there(path)}
                    for what, path in files.items()
                ],
                "settings": [asdict(one) for one in settings],
                "password": {"variable": PASSWORD, "is_set": password},
            }
        )
        return
    found = [(what, path.absolute(), "yes" if is_there(path) else "no") for what, path in files.items()]
    print_table("Files, the upper above the lower", ["twin.toml", "path", "exists"], found, right_from=3)
    rows = [(one.key, _shown(one.value), _source(one), one.what) for one in settings]
    rows.append(
        ("", "set, not shown" if password else None, f"environment {PASSWORD}", "password of API Skriv")
    )
    print_table("Settings", ["key", "value", "from", "meaning"], rows, right_from=4)


def _in_force(ctx: Any, setting: Setting, held: Mapping[str, Held]) -> SettingInForce:
    value, source = _told(ctx, setting, held.get(setting.key))
    kind, where = {
        "COMMANDLINE": ("option", f"--{setting.key.replace('_', '-')}"),
        "ENVIRONMENT": ("environment", setting.variable),
        "DEFAULT_MAP": ("file", str(held[setting.key].file.absolute()) if setting.key in held else None),
    }.get(source, ("default", None))
    return SettingInForce(setting.key, _plain(value), kind, where, setting.what)


def _told(ctx: Any, setting: Setting, held: Held | None) -> tuple[Any, str]:
    """A setting's value and the parser's name for its source, asked of an option that it stands for."""
    context = _speaks_for(ctx, setting)
    option = _option(context, setting)
    if held is not None:
        check_value(context, option, setting.key, held)
    if option.name in context.params:  # of `twin` itself, or of this command
        value, source = context.params[option.name], context.get_parameter_source(option.name)
    else:
        value, source = option.consume_value(context, {})
    if source.name == "DEFAULT" and held is not None:
        return held.value, "DEFAULT_MAP"
    return value, source.name


def _option(context: Any, setting: Setting) -> Any:
    return next((one for one in context.command.params if one.envvar == setting.variable), None)


def _speaks_for(ctx: Any, setting: Setting) -> Any:
    """The command that runs or `twin` itself, if it has the option; else one whose option has a default."""
    have = [each for each in _contexts(ctx) if _option(each, setting) is not None]
    return next(
        (each for each in have if each in (ctx, ctx.parent) or _option(each, setting).default is not None),
        have[0],
    )


def _contexts(ctx: Any) -> Iterator[Any]:
    """The command that runs, `twin` itself, and then every other command."""
    yield ctx
    yield ctx.parent
    yield from _below(ctx.parent)


def _below(group: Any) -> Iterator[Any]:
    for name in group.command.list_commands(group):
        command = group.command.get_command(group, name)
        if hasattr(command, "list_commands"):
            yield from _below(typer.Context(command, parent=group, info_name=name))
        else:
            yield typer.Context(command, parent=group, info_name=name)


def _plain(value: Any) -> str | float | bool | None:
    """A value for JSON, without what is secret in an address."""
    if isinstance(value, str | Path):
        return without_secrets(str(value))
    return value if isinstance(value, int | float) else None


def _shown(value: str | float | bool | None) -> str | None:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return None if value is None else str(value)


def _source(one: SettingInForce) -> str:
    return one.source if one.where is None else f"{one.source} {one.where}"
