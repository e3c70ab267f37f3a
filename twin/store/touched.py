"""What has changed since the last match: said by whoever changes drives or the mirror, in his transaction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

FACT = "touched"
"""Key of the fact: one entry for each revision that no match is of yet."""
_MOST = 1000
_MOST_PLACES = 20_000
"""Of more changes than these one after the other, or at more places, everything counts as changed."""

Place = tuple[int, int]
"""Easting and northing, whole metres of EPSG:25833."""


@dataclass(frozen=True, slots=True)
class Touched:
    """What changed with some revisions.

    Attributes
    ----------
    drives : frozenset of str
        That came, went or were read anew.
    places : frozenset of (int, int)
        Where NVDB's signs, or what they face, were or are otherwise: EPSG:25833, cut to whole metres.
    """

    drives: frozenset[str] = frozenset()
    places: frozenset[Place] = frozenset()


def with_one_more(fact: Mapping[str, Any] | None, revision: int, what: Touched | None) -> dict[str, Any]:
    """Return the fact with what changed with this revision; None: anything may have."""
    entries = list((fact or {}).get("since", []))
    n_places = sum(len(places) for _, _, places in map(_read, entries))
    if what is not None and (len(entries) >= _MOST or n_places + len(what.places) > _MOST_PLACES):
        entries, what = [], None
    said = [None] if what is None else [sorted(what.drives), sorted(what.places)]
    return {"since": [*entries, [revision, *said]]}


def touched_since(fact: Mapping[str, Any] | None, matched: int, now: int) -> Touched | None:
    """Return what changed after one revision, up to another; None if anything may have."""
    entries = [_read(entry) for entry in (fact or {}).get("since", [])]
    said = {revision: (drives, places) for revision, drives, places in entries if matched < revision <= now}
    if said.keys() != set(range(matched + 1, now + 1)):
        return None  # somebody changed something and did not say what
    found, where = set[str](), set[Place]()
    for drives, places in said.values():
        if drives is None:
            return None
        found |= set(drives)
        where |= set(places)
    return Touched(frozenset(found), frozenset(where))


def without_those_of(fact: Mapping[str, Any] | None, matched: int) -> dict[str, Any]:
    """Return the fact without what a match of this revision knows."""
    return {"since": [entry for entry in (fact or {}).get("since", []) if entry[0] > matched]}


def _read(entry: list[Any]) -> tuple[int, list[str] | None, list[Place]]:
    """Revision, drives (None: anything) and places of an entry."""
    revision, drives, *more = entry
    return revision, drives, [(east, north) for east, north in more[0]] if more else []
