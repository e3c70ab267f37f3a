"""What has changed since the last match: said by whoever changes drives or the mirror, in his transaction."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

FACT = "touched"
"""Key of the fact: one entry for each revision that no match is of yet."""
_MOST = 1000
"""Of more changes than these one after the other everything counts as changed."""


@dataclass(frozen=True, slots=True)
class Touched:
    """What changed with one revision.

    Attributes
    ----------
    revision : int
        Of the store, after the change.
    drives : tuple of str or None
        The drives that came, went or were read anew; None where anything may have changed.
    """

    revision: int
    drives: tuple[str, ...] | None


def with_one_more(
    fact: Mapping[str, Any] | None, revision: int, drives: Collection[str] | None
) -> dict[str, Any]:
    """Return the fact with what changed with this revision."""
    entries = list((fact or {}).get("since", []))
    if len(entries) >= _MOST:
        entries, drives = [], None
    return {"since": [*entries, [revision, None if drives is None else sorted(drives)]]}


def touched_since(fact: Mapping[str, Any] | None, matched: int, now: int) -> frozenset[str] | None:
    """Return the drives that changed after one revision, up to another; None if anything may have."""
    said = {
        one.revision: one.drives
        for one in (Touched(*entry) for entry in (fact or {}).get("since", []))
        if matched < one.revision <= now
    }
    if said.keys() != set(range(matched + 1, now + 1)):
        return None  # somebody changed something and did not say what
    found: set[str] = set()
    for drives in said.values():
        if drives is None:
            return None
        found |= set(drives)
    return frozenset(found)


def without_those_of(fact: Mapping[str, Any] | None, matched: int) -> dict[str, Any]:
    """Return the fact without what a match of this revision knows."""
    return {"since": [entry for entry in (fact or {}).get("since", []) if entry[0] > matched]}
