"""Which camera or antenna the name of a file or folder speaks of."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable


def plain(name: str) -> str:
    """Spell a sensor or file name so that both compare: lower case, ``_`` for all that is no letter or digit.

    File systems refuse the colons of ``camera:front:120`` and of ``gnss50:vehicle``.
    """
    return re.sub(r"[\W_]+", "_", name.casefold()).strip("_")


def named_in(text: str, names: Iterable[str]) -> list[str]:
    """Those of `names` that stand as a whole in `text`; of names within one another only the longest."""
    padded = f"_{plain(text)}_"
    named = [name for name in names if plain(name) and f"_{plain(name)}_" in padded]
    return [
        name
        for name in named
        if not any(f"_{plain(name)}_" in f"_{plain(other)}_" and other != name for other in named)
    ]


def which_camera(name: str, cameras: Iterable[str]) -> str:
    """List the cameras that there are, and the one with the most similar name, as one clause."""
    return which_of("cameras", name, cameras)


def which_of(what: str, name: str, names: Iterable[str]) -> str:
    """The same of anything that is called by names: ``columns``, ``signals``."""
    by_plain_name = {one.casefold(): one for one in names}
    near = difflib.get_close_matches(name.casefold(), by_plain_name, n=1)
    nearest = f"; the nearest is {by_plain_name[near[0]]}" if near else ""
    return f"its {what}: {', '.join(by_plain_name.values()) or 'none':.300}{nearest}"
