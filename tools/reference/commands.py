"""Every command with its arguments, options, defaults and example."""

from __future__ import annotations

import inspect
import re
from typing import Any

from typer.main import get_command

from reference.markdown import code, page, table
from twin.cli.app import app
from twin.cli.help import command_names
from twin.cli.usage import wanted

_STATED_DEFAULT = re.compile(r"\s*\[default: ([^\]]*)\]")
HELP_OPTION = "help"
"""Of every command; said once."""


def commands() -> dict[str, Any]:
    """Return name → command, groups left out."""
    group = get_command(app)
    found: dict[str, Any] = {}
    for name in command_names(group):
        command: Any = group
        for word in name.split():
            command = command.get_command(None, word)
        if not hasattr(command, "list_commands"):
            found[name] = command
    return found


def commands_page() -> str:
    """Return docs/reference/commands.md."""
    found = commands()
    return page(
        "Commands",
        "`twin --help` lists them, and `twin COMMAND --help` says the same as this page. Where a variable of"
        " the environment is named, it holds unless the option says otherwise.",
        " · ".join(f"[{name}](#twin-{name.replace(' ', '-')})" for name in found),
        _section("", get_command(app)),
        *(_section(f" {name}", command) for name, command in found.items()),
    )


def _section(name: str, command: Any) -> str:
    parameters = [parameter for parameter in command.params if parameter.name != HELP_OPTION]
    rows = [
        [
            " ".join(code(text) for text in _names(parameter)),
            _takes(parameter, command),
            _default(parameter),
            _meaning(parameter),
        ]
        for parameter in parameters
    ]
    about = inspect.cleandoc(command.help or "").replace("\n\n", "\n").replace("\n", " ")
    example = " ".join((command.epilog or "").split())
    return "\n\n".join(
        [
            f"## twin{name}",
            about,
            table(["option", "takes", "default", "meaning"], rows),
            example,
        ]
    )


def _names(parameter: Any) -> list[str]:
    if parameter.param_type_name == "argument":
        return [parameter.metavar or parameter.name.upper()]
    return [*parameter.opts, *parameter.secondary_opts]


def _takes(parameter: Any, command: Any) -> str:
    if getattr(parameter, "is_flag", False):
        return ""
    takes = wanted(parameter, command)
    many = " (several)" if parameter.multiple or parameter.nargs == -1 else ""
    # An argument is called by what it takes.
    return "" if takes in _names(parameter) else f"{takes}{many}"


def _default(parameter: Any) -> str:
    stated = _STATED_DEFAULT.search(parameter.help or "")
    if stated:
        return stated[1]
    if parameter.required:
        return "needed"
    default = parameter.default
    if default in (None, False, [], ()):
        return ""
    return code(str(getattr(default, "value", default)))


def _meaning(parameter: Any) -> str:
    variable = f" Environment: {code(parameter.envvar)}." if parameter.envvar else ""
    return _STATED_DEFAULT.sub("", " ".join((parameter.help or "").split())) + variable
