"""What the command line does not understand, said in one sentence: what, where, and the cure.

The sentence follows from the kind of the error, and from parameter, value and declaration of the command; the
text of the parser's own message is never read.
"""

from __future__ import annotations

import datetime as dt
import inspect
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from enum import StrEnum
from typing import Any, get_args, get_origin, get_type_hints

import typer

from twin.store.address import FORM, StoreAddress

UsageError: Any = typer.BadParameter.__base__
"""Base of the parser's errors of usage, of which typer hands on this one child."""


def usage_sentence(error: Any, group: Any, arguments: Sequence[str]) -> str:
    """Return one sentence for an error of usage; "" where nothing was asked, so that the help was shown.

    Parameters
    ----------
    error : UsageError
    group : click.Group
        The command ``twin``.
    arguments : sequence of str
        All that followed ``twin``.
    """
    context, given = _command_of(group, arguments)
    command, path = context.command, context.command_path
    parameter, option = getattr(error, "param", None), getattr(error, "option_name", None)
    if parameter is not None:
        return _value_sentence(parameter, context, given)
    if option is not None:
        return _option_sentence(option, context, arguments)
    if not hasattr(command, "list_commands"):
        extra = command.make_parser(context).parse_args(list(given))[1]
        return f"`{path}` takes no {' '.join(extra)!r}: see `{path} --help`."
    if not given:
        return ""
    perhaps = _perhaps(given[0], command.list_commands(context))
    return f"There is no command `{path} {given[0]}`{perhaps}: see `{path} --help`."


def _command_of(group: Any, arguments: Sequence[str]) -> tuple[Any, Sequence[str]]:
    """The context of the command that was meant, and the arguments that follow its name."""
    context = group.make_context("twin", [], resilient_parsing=True)
    while hasattr(context.command, "get_command"):
        # A group takes options of its own before the name of its command.
        rest = context.command.make_parser(context).parse_args(list(arguments))[1]
        command = context.command.get_command(context, rest[0]) if rest else None
        if command is None:
            return context, rest
        context = command.make_context(rest[0], [], parent=context, resilient_parsing=True)
        arguments = rest[1:]
    return context, arguments


def _option_sentence(option: str, context: Any, arguments: Sequence[str]) -> str:
    command, path = context.command, context.command_path
    options = {name: each for each in command.params for name in (*each.opts, *each.secondary_opts)}
    if option not in options:
        above = context.find_root()
        if context is above and (name := _taker(option, context, arguments)):
            return f"{option} stands after the command: `{path} {name} {option}`."
        for each in above.command.params:
            if option in (*each.opts, *each.secondary_opts):
                written = option if each.is_flag else f"{option} {each.metavar}"
                rest = path.removeprefix(f"{above.command_path} ")
                return f"{option} stands before the command: `{above.command_path} {written} {rest}`."
        return f"`{path}` has no option {option}{_perhaps(option, options)}: see `{path} --help`."
    if options[option].is_flag:
        return f"{option} takes no value: write it alone."
    return f"{option} needs a value: write {wanted(options[option], command)}."


def _taker(option: str, context: Any, arguments: Sequence[str]) -> str | None:
    """The command among these words, where it takes the option that stands before its name."""
    for word in arguments:
        command = context.command.get_command(context, word)
        if command is not None:
            return word if any(option in each.opts for each in command.params) else None
    return None


def _value_sentence(parameter: Any, context: Any, given: Sequence[str]) -> str:
    options = context.command.make_parser(context).parse_args(list(given))[0]
    value, source = parameter.consume_value(context, options)
    name = parameter.metavar if parameter.param_type_name == "argument" else parameter.opts[0]
    if value is None or value in ((), []):
        return f"`{context.command_path}` needs {name}: see `{context.command_path} --help`."
    if source.name == "ENVIRONMENT":
        name = parameter.envvar
    if isinstance(value, list | tuple):
        choices = _choices(_declared(parameter, context.command)[0])
        value = next((one for one in value if one not in choices), value[0])
    return f"{name} is {value or 'empty'}: write {wanted(parameter, context.command)}."


def wanted(parameter: Any, command: Any) -> str:
    """What a parameter takes: ``one of new, moved``, ``a number from 1 to 130``."""
    kind, info = _declared(parameter, command)
    if choices := _choices(kind):
        return f"one of {', '.join(choices)}"
    if kind is bool:
        return "true or false"
    if kind is dt.datetime:
        return f"a day as {dt.date(2026, 6, 1):{info.formats[0]}}"
    if kind in (int, float):
        number = "a whole number" if kind is int else "a number"
        if info.min is not None and info.max is not None:
            return f"{number} from {info.min:g} to {info.max:g}"
        return number if info.min is None else f"{number} of at least {info.min:g}"
    named = f"a path, or {FORM}" if kind is StoreAddress else info.metavar
    return named or ("a path" if kind is not str else "a text")


def _declared(parameter: Any, command: Any) -> tuple[Any, Any]:
    """Type of a parameter, or of one of its values where it takes several, and its ``typer.Option``."""
    hints = get_type_hints(inspect.unwrap(command.callback), include_extras=True)
    kind, info = get_args(hints[parameter.name])
    kinds = [part for part in get_args(kind) if part is not type(None)]
    kind = kinds[0] if kinds else kind
    return (get_args(kind)[0] if get_origin(kind) is list else kind), info


def _choices(kind: Any) -> list[str]:
    return [choice.value for choice in kind] if issubclass(kind, StrEnum) else []


def _perhaps(name: str, names: Iterable[str]) -> str:
    return "".join(f" (perhaps {near})" for near in get_close_matches(name, list(names), n=1))
