"""The table of messages: a key and a language → a text, with facts put in as the language writes them."""

from __future__ import annotations

import datetime as dt
import tomllib
from collections.abc import Iterable, Mapping
from enum import StrEnum
from functools import cache
from importlib.resources import files
from string import Formatter


class Lang(StrEnum):
    """Languages that every message has."""

    EN = "en"
    NB = "nb"


Text = str | Mapping[str, str]
"""A text with ``{facts}``; or one for ``n = 1`` and one for every other ``n``: ``one`` and ``other``."""
Fact = str | int | float | dt.date

NUMBER, DAY = "w", "day"
"""How a text asks for a number in words and for a day: ``{n:w}``, ``{first:day}``."""


def say(lang: Lang, key: str, **facts: Fact) -> str:
    """Return a message of the table with its facts.

    Parameters
    ----------
    lang : Lang
    key : str
        ``file.name`` of the message in ``messages/file.toml``.
    **facts : str, int, float or date
        What stands in braces in the text. Floats get the language's decimal sign; `n` chooses between one and
        several.

    Raises
    ------
    KeyError
        There is no such message, or a fact is missing.
    """
    text = _table()[key][lang]
    if not isinstance(text, str):
        text = text["one" if facts["n"] == 1 else "other"]
    parts = _parsed(text)
    if len(parts) == 1 and parts[0][1] is None:
        return parts[0][0]
    written = []
    for literal, name, form in parts:
        written.append(literal)
        if name is not None:
            written.append(_written(lang, facts[name], form))
    return "".join(written)


def messages(lang: Lang, prefix: str) -> dict[str, str]:
    """Return the texts without facts put in, of all keys that begin with a prefix, for the pages.

    Of one that tells one from several both are there: ``KEY.one`` and ``KEY.other``.
    """
    chosen: dict[str, str] = {}
    for key, texts in _table().items():
        if not key.startswith(prefix):
            continue
        text = texts[lang]
        if isinstance(text, str):
            chosen[key] = text
        else:
            chosen.update({f"{key}.{number}": one for number, one in text.items()})
    return chosen


def language_from(accepted: str) -> Lang:
    """Choose by a browser's ``Accept-Language``, or a locale's name: Norwegian of any kind, else English.

    >>> language_from("nn-NO,nn;q=0.9,en;q=0.5").value, language_from("de,en;q=0.9").value
    ('nb', 'en')
    """
    for part in accepted.split(","):
        primary = part.partition(";")[0].strip().replace("_", "-").partition("-")[0].lower()
        if primary in {"nb", "nn", "no"}:
            return Lang.NB
        if primary == "en":
            return Lang.EN
    return Lang.EN


def number_text(lang: Lang, text: str) -> str:
    """Write a number's text, as Python formats it, the way the language does.

    >>> number_text(Lang.NB, "1,234.50")
    '1 234,50'
    """
    if lang is Lang.EN:
        return text
    return text.replace(",", "\N{NO-BREAK SPACE}").replace(".", ",").replace("%", "\N{NO-BREAK SPACE}%")


def day_text(lang: Lang, day: dt.date) -> str:
    """``12 June 2026``, ``12. juni 2026``."""
    months = _listed("time.months", lang)
    return say(lang, "time.day", number=day.day, month=months[day.month - 1], year=day.year)


def table() -> Mapping[str, Mapping[Lang, Text]]:
    """Return every message in every language."""
    return _table()


def facts_of(text: Text) -> frozenset[str]:
    """Return the names of the facts that a text puts in."""
    texts: Iterable[str] = (text,) if isinstance(text, str) else text.values()
    return frozenset(name for one in texts for _, name, _ in _parsed(one) if name is not None)


@cache
def _table() -> Mapping[str, Mapping[Lang, Text]]:
    found: dict[str, Mapping[Lang, Text]] = {}
    for file in files("twin.words").joinpath("messages").iterdir():
        if file.name.endswith(".toml"):
            found.update(_messages(file.name.removesuffix(".toml"), tomllib.loads(file.read_text("utf-8"))))
    return found


def _messages(key: str, document: Mapping[str, object]) -> dict[str, Mapping[Lang, Text]]:
    """Read a part of a file: what has a language is a message, what has none holds messages."""
    found: dict[str, Mapping[Lang, Text]] = {}
    for name, part in document.items():
        if not isinstance(part, Mapping):
            msg = f"{key}.{name} in the table of messages is neither a message nor a group of them"
            raise TypeError(msg)
        if Lang.EN in part:
            found[f"{key}.{name}"] = {Lang(lang): text for lang, text in part.items()}
        else:
            found.update(_messages(f"{key}.{name}", part))
    return found


@cache
def _parsed(text: str) -> tuple[tuple[str, str | None, str], ...]:
    """A text as literals, each with the fact behind it and how that is written."""
    return tuple((literal, name, form or "") for literal, name, form, _ in Formatter().parse(text))


def _written(lang: Lang, value: Fact, form: str) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, dt.date):
        return day_text(lang, value)
    if form == NUMBER:
        words = _listed("time.numbers", lang)
        return words[int(value)] if 0 <= value < len(words) else number_text(lang, f"{value:,}")
    return number_text(lang, format(value, form)) if form else number_text(lang, str(value))


@cache
def _listed(key: str, lang: Lang) -> list[str]:
    text = _table()[key][lang]
    return str(text).split()
