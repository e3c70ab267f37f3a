"""Values of ``drive.toml``: each of the type that its key has, or refused in a sentence."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from twin.drives.epochs import credible
from twin.errors import DriveError

SETTINGS_FILE = "drive.toml"
_LARGEST_NUMBER = 1e15
_INSTANT = 'an instant with its zone, "2026-06-10T07:59:59.123Z"'
_BARE = re.compile(r"\s*([\w.-]{1,80})\s*=\s*([^\W\d][\w./\\:# -]{0,80}?|[\w./-]{1,80}\.[A-Za-z]\w{0,9})\s*$")
"""A key with a word, or a file's name, that has no quotation marks."""


def document_of(content: bytes) -> dict[str, Any]:
    """Parse ``drive.toml``.

    Raises
    ------
    DriveError
        If it is not TOML in UTF-8; so do the others where a value is not what it must be.
    """
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise DriveError(f"{SETTINGS_FILE} is not UTF-8 text: save it as UTF-8.") from error
    except (ValueError, RecursionError) as error:  # not TOML, or a number of thousands of digits
        cure = _unquoted(content, str(error)) or "correct that line"
        raise DriveError(f"{SETTINGS_FILE} is not valid TOML ({error}): {cure}.") from error


def _unquoted(content: bytes, error: str) -> str:
    """What to write where the line that TOML stumbles over gives a bare word; "" for another slip."""
    at = re.search(r"at line ([0-9]{1,9}),", error)
    lines = content.decode("utf-8-sig", errors="replace").split("\n")
    if at is None or int(at[1]) > len(lines):
        return ""
    bare = _BARE.match(lines[int(at[1]) - 1])
    return "" if bare is None else f'a text needs quotation marks, {bare[1]} = "{bare[2]}"'


def refuse_unknown(table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Refuse a key that nothing reads, with the nearest that something does."""
    for key in table:
        if key not in known:
            nearest = difflib.get_close_matches(key, list(known), n=1, cutoff=0.0)[0]
            raise DriveError(
                f"{SETTINGS_FILE} has the unknown key {where}{key}: the nearest known one is"
                f" {where}{nearest}."
            )


def wrong_value(key: str, value: object, wanted: str) -> DriveError:
    """Make the sentence for a value that a key cannot have."""
    try:
        shown = repr(value)
    except ValueError:  # a hexadecimal number of thousands of digits
        shown = "a very long number"
    return DriveError(f"{SETTINGS_FILE} gives {key:.80} = {shown:.80}: it must be {wanted}.")


def table_of(parent: Mapping[str, Any], key: str, name: str = "") -> Mapping[str, Any]:
    """Return a table; an empty one where the key is absent."""
    table = parent.get(key, {})
    if not isinstance(table, dict):
        raise wrong_value(name or key, table, "a table of keys and values")
    return table


def text_of(table: Mapping[str, Any], key: str, name: str = "") -> str | None:
    """Return a text; None where the key is absent."""
    value = table.get(key)
    if value is not None and (not isinstance(value, str) or not value.strip()):
        raise wrong_value(name or key, value, "a text in quotation marks")
    return value


def flag_of(table: Mapping[str, Any], key: str) -> bool:
    """Return true or false; false where the key is absent."""
    value = table.get(key, False)
    if not isinstance(value, bool):
        raise wrong_value(key, value, "true or false")
    return value


def choice_of(table: Mapping[str, Any], key: str, choices: tuple[str, ...]) -> str:
    """Return one of the choices; the first where the key is absent."""
    value = table.get(key, choices[0])
    if value not in choices:
        raise wrong_value(key, value, " or ".join(f'"{choice}"' for choice in choices))
    return str(value)


def number_of(value: object, key: str) -> float:
    """Return a number that is finite and not absurd."""
    # The comparison is false for NaN too, and whole numbers may be larger than any float.
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST_NUMBER:
        raise wrong_value(key, value, "a number")
    return float(value)


def names_of(parent: Mapping[str, Any], key: str, name: str) -> dict[str, str]:
    """Return a table of file names; an empty one where the key is absent."""
    table = table_of(parent, key, name)
    for sensor, file in table.items():
        if not isinstance(file, str) or not file.strip():
            raise wrong_value(f"{name}.{sensor}", file, "a file name in quotation marks")
    return dict(table)


def moment_of(value: object, name: str, or_else: str = "") -> int:
    """Return the epoch of an instant, as TOML's own type or as text; its zone must be said.

    Parameters
    ----------
    or_else : str
        What the key may be besides, for the message.
    """
    wanted = f"{or_else} or {_INSTANT}" if or_else else _INSTANT
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value)
        except ValueError as error:
            raise wrong_value(name, value, wanted) from error
    if not isinstance(value, datetime) or value.tzinfo is None:
        raise wrong_value(name, str(value), wanted)
    whole_s = (value.replace(microsecond=0) - datetime.fromtimestamp(0, UTC)) // timedelta(seconds=1)
    epoch_ns = whole_s * 1_000_000_000 + value.microsecond * 1000
    if not credible(epoch_ns):
        raise wrong_value(name, str(value), "an instant in the years 2000–2099")
    return epoch_ns
