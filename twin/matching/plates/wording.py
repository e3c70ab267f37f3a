"""What is written on a plate, compared as people read it: not letter by letter."""

from __future__ import annotations

import math
import re
import unicodedata
from difflib import SequenceMatcher
from functools import lru_cache

_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_DASHES = str.maketrans("‐‑‒–—−", "------")
_NUMBER = re.compile(r"\d+(?:[.:]\d+)?")
_FILLERS = frozenset({"n/a", "na", "ukjent"})
"""What stands in NVDB, or in an annotation, where nobody knows the text."""


@lru_cache(maxsize=65_536)
def normalised(text: str) -> str:
    """Bring a text to the form in which it is compared: no case, no blanks, a decimal point, one dash.

    ``ø`` and ``o`` stay two letters: they tell places apart. "" for what says nothing (``.``, ``N/A``).
    """
    plain = unicodedata.normalize("NFKC", text).casefold().translate(_DASHES)
    plain = "".join(_DECIMAL_COMMA.sub(".", plain).split())
    return "" if plain in _FILLERS or not any(map(str.isalnum, plain)) else plain


@lru_cache(maxsize=65_536)
def similarity(seen: str, known: str) -> float:
    """How alike two texts are, from 0 to 1; NaN where one of them says nothing.

    1 if they are the same once normalised, 0 if their numbers contradict each other (``200 m`` and ``300 m``
    share most of their letters, and are two signs), else Ratcliff and Obershelp's ratio as
    :class:`difflib.SequenceMatcher` gives it. A number that only one of them has contradicts nothing.
    """
    a, b = normalised(seen), normalised(known)
    if not a or not b:
        return math.nan
    if a == b:
        return 1.0
    numbers, others = _numbers(a), _numbers(b)
    if numbers and others and numbers != others:
        return 0.0
    return SequenceMatcher(None, a, b, autojunk=False).ratio()


def _numbers(text: str) -> set[float]:
    """``08.00-17:30`` → 8.0 and 17.3: the same in whichever way hours are written."""
    return {float(number.replace(":", ".")) for number in _NUMBER.findall(text)}
