"""What every command does before its own work: take settings from files, open the log."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from twin.cli import journal
from twin.cli.flags import without_type_of_flags
from twin.cli.settings import AREA_KEYS, AREA_LISTS, BY_KEY, BY_VARIABLE, Held, chosen_store, held_settings
from twin.errors import ConfigError

_MENDERS = ("config", "help")


class Command(TyperCommand):
    """A command whose options have the values of ``twin.toml`` where nothing else gives one."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return options and arguments as the help shows them."""
        return without_type_of_flags(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put what files hold between environment and built-in defaults."""
        if not ctx.resilient_parsing and not set(args) & set(ctx.help_option_names):
            args = self._joined(args)
            given = self.make_parser(ctx).parse_args(list(args))[0]
            journal.manner.command = ctx.command_path.removeprefix("twin ")
            held = self._held(given.get("store"))
            ctx.default_map = self._defaults(held, given, ctx)
            _open_log(held, journal.manner.command)
        return super().parse_args(ctx, args)

    def _held(self, store: str | None) -> Mapping[str, Held]:
        """What files hold. A wrong one does not stop the commands that help to mend it."""
        try:
            return held_settings(chosen_store(store))
        except ConfigError:
            if self.name not in _MENDERS:
                raise
            return {}

    def _joined(self, args: list[str]) -> list[str]:
        """Make one list of each option of an area that stands there several times.

        The parser would take the last of them without a word.
        """
        lists = {name for one in self.params if one.envvar and one.name in AREA_LISTS for name in one.opts}
        places: dict[str, int] = {}
        joined: list[str] = []
        rest = iter(args)
        for arg in rest:
            name, written, value = arg.partition("=")
            following = next(rest, None) if name in lists and not written else value
            if name not in lists or following is None:
                joined.append(arg)
            elif name in places:
                joined[places[name]] += f",{following}"
            else:
                places[name] = len(joined)
                joined.append(f"{name}={following}")
            if arg == "--":
                joined.extend(rest)
        return joined

    def _defaults(self, held: Mapping[str, Held], given: Mapping[str, Any], ctx: Any) -> dict[str, Any]:
        """Values of files by parameter; ConfigError for one that the option does not take."""
        defaults: dict[str, Any] = {}
        for parameter in self.params:
            setting = BY_VARIABLE.get(str(parameter.envvar))
            one = held.get(setting.key) if setting is not None else None
            if setting is None or one is None:
                continue
            if setting.key in AREA_KEYS and self._names_an_area(given):
                continue
            check_value(ctx, parameter, setting.key, one)
            defaults[str(parameter.name)] = one.value
        return defaults

    def _names_an_area(self, given: Mapping[str, Any]) -> bool:
        """Whether options or the environment say which area."""
        asked = any(given.get(name) for name in (*AREA_KEYS, "everything"))
        return asked or any(os.environ.get(BY_KEY[key].variable) for key in AREA_KEYS)


def check_value(ctx: Any, parameter: Any, key: str, one: Held) -> None:
    """Refuse a file's value that an option does not take.

    Parameters
    ----------
    ctx : typer.Context
        Of the command that the option belongs to.
    parameter : TyperOption
    key : str
        Of the setting.
    one : Held

    Raises
    ------
    ConfigError
        It names the file and the key.
    """
    from twin.cli.usage import UsageError, wanted

    said = f"{one.file} sets {key} to {one.value}"
    try:
        parameter.process_value(ctx, one.value)
    except UsageError as error:
        raise ConfigError(f"{said}: write {wanted(parameter, ctx.command)}.") from error
    if key in AREA_KEYS:
        from nvdb.area import READERS
        from nvdb.errors import AreaError

        try:
            READERS[key](str(one.value))
        except AreaError as error:
            raise ConfigError(f"{said}. {error}") from error


def _open_log(held: Mapping[str, Held], command: str) -> None:
    path = journal.manner.log_file
    if path is None and "log_file" in held:
        path = Path(str(held["log_file"].value))
    journal.begin(command, path)
