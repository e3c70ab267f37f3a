"""After a match: what was decided on other evidence is open again, and says what changed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

import sqlalchemy as sa

from twin.decisions.evidence import Evidence, differences, present_evidence, same_place
from twin.decisions.log import (
    CARRIED,
    REOPENED,
    TWIN,
    Entry,
    append,
    asking,
    last_entries,
    last_entries_by_people,
)
from twin.store.kinds import QUIET, Decision
from twin.words import sentence
from twin.words.reasons import Reopened

Object = tuple[int, int | None, str]
"""NVDB's type and id; what NVDB does not know has no id, and is known by its pole."""


def reopen_changed(connection: sa.Connection, at: str, only: Collection[str] | None = None) -> int:
    """Reopen every present finding that was decided on other evidence, inside the caller's transaction.

    A finding may come under another ``change_id`` than before: its verdict or sign code changed, or its
    object was numbered anew. It is told from its forerunner, a decided change of the same object that is no
    longer found; where nothing else changed, it takes over the forerunner's decision. Where the evidence is
    again what it was, the decision of then holds again: a match by another method costs none.

    Parameters
    ----------
    connection : Connection
    at : str
        When, ISO 8601.
    only : collection of str, optional
        Changes to look at, where no other can be concerned: present ones that have entries of their own.

    Returns
    -------
    int
        How many findings were reopened.
    """
    ask = asking(connection)
    by_people, standing = last_entries_by_people(ask, only), last_entries(ask, only)
    if not by_people:
        return 0
    evidence = {key: now for key, now in present_evidence(ask, only).items() if now.verdict not in QUIET}
    absent = _by_object(entry for key, entry in by_people.items() if key not in evidence)
    reopened, carried = [], []
    for key, now in evidence.items():
        last = by_people.get(key) or _forerunner(absent, now)
        if last is None or last.decision == Decision.OPEN:
            continue
        holds = standing.get(key)
        if changes := differences(last.evidence, now):
            cause = Reopened(last.decision.value, last.at, last.by, last.reason, changes)
            told = sentence(cause)
            # Of an entry from before causes were kept the text is all there is.
            if holds is None or (holds.kind, holds.reason) != (REOPENED, told):
                reopened.append(Entry(key, Decision.OPEN, told, TWIN, at, now, REOPENED, cause=cause))
        elif holds is None or holds.kind == REOPENED:
            carried.append(replace(last, change_id=key, kind=CARRIED, undo_of=None, session="", request=None))
    append(connection, [*carried, *reopened])
    return len(reopened)


def _object(evidence: Evidence) -> Object:
    return evidence.nvdb_type, evidence.nvdb_id, "" if evidence.nvdb_id is not None else evidence.pole


def _by_object(entries: Iterable[Entry]) -> dict[Object, list[Entry]]:
    """Group decided changes that are no longer found by their object, the latest decision first."""
    groups: dict[Object, list[Entry]] = {}
    for entry in sorted(entries, key=lambda entry: -entry.id):
        if entry.decision != Decision.OPEN:
            groups.setdefault(_object(entry.evidence), []).append(entry)
    return groups


def _forerunner(absent: Mapping[Object, list[Entry]], now: Evidence) -> Entry | None:
    """Take out the decided change that a finding without a decision of its own follows, if there is one.

    Decisions of before poles were kept with them, and those of some files, do not say which pole they are
    about: such ones are recognised by their place. Rather one whose sign codes are the same.
    """
    candidates = fitting = absent.get(_object(now), [])
    if now.nvdb_id is None and not (now.pole and candidates):
        candidates = absent.get((now.nvdb_type, None, ""), [])
        fitting = [c for c in candidates if same_place(c.evidence, now)]
    if not fitting:
        return None
    forerunner = min(fitting, key=lambda c: c.evidence.skiltnummer_seen != now.skiltnummer_seen)
    candidates.remove(forerunner)
    return forerunner
