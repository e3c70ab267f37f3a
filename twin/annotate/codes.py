"""Search in sign codes and their names."""

from __future__ import annotations

from twin.annotate.records import CodeItem
from twin.words import SignNames, sign_title

_MOST = 12


def search(names: SignNames, asked: str) -> list[CodeItem]:
    """Return the codes that begin with what was typed, then those whose name has all words of it.

    >>> [item.title for item in search({"142": "Barn", "202": "Vikeplikt"}, "vike")]
    ['202 – Vikeplikt']
    """
    typed = asked.strip().casefold()
    words = typed.split()
    if not words:
        return []
    ranked = []
    for code, name in names.items():
        text = name.casefold()
        if code.casefold().startswith(typed):
            ranked.append((0, len(code), code))
        elif all(word in text for word in words):
            ranked.append((1 if text.startswith(typed) else 2, len(text), code))
    return [CodeItem(code, sign_title(code, names)) for _, _, code in sorted(ranked)[:_MOST]]
