"""Signs of road works: one that a person dismissed as temporary speaks for the others of the same works.

Near it, findings of signs that stand for road works alone, and that NVDB does not have, are dismissed by twin
for as long as the works last; ``docs/matching.md`` says how far and how long. Everything is in the log: what
twin dismissed is open again as soon as its ground is gone.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from nvdb.datakatalog import sign_family
from twin.decisions.evidence import Ask, Evidence, present_evidence
from twin.decisions.log import (
    BY_TWIN,
    LIFTED,
    SUPPRESSED,
    TWIN,
    UNDONE,
    Entry,
    append,
    asking,
    last_entries,
    last_entries_by_people,
)
from twin.errors import ConfigError
from twin.store import schema
from twin.store.kinds import Decision, Verdict
from twin.store.records import split_codes
from twin.words import sentence
from twin.words.reasons import NearTemporary, Temporary, WorksOver

ROAD_WORKS = frozenset({"110", "112", "940", "942"})
"""Families of codes that stand for road works alone: Vegarbeid, Steinsprut, Trafikkjegle, Trafikksylinder.

Numbers and names are those of the regulations of signs (skiltforskriften); the part of the datakatalog that
ships with twin has none of the four.
"""
_PLATES_BELOW = "8"
"""How the codes of underskilt begin, which hang below any other sign."""
NEAR_M = 300.0
"""As far as works are announced ahead of themselves, and no further: works along a road are several."""
LAST_DAYS = 90
"""Signs that are first seen so long after all others of the works were last seen are those of new works."""
_UNTOUCHED = (UNDONE, Decision.OPEN)
"""The entry of one whose only decision was taken back: as if nobody had ever decided."""


@dataclass(frozen=True, slots=True)
class _Sign:
    """A present finding of a sign of road works."""

    key: str
    evidence: Evidence
    first: dt.date
    last: dt.date


def temporary_cause(ask: Ask, change_id: str) -> Temporary:
    """Return the cause for dismissing a present finding as temporary, with the day it was last seen.

    Raises
    ------
    ConfigError
        NVDB has the sign: then it stands for good, and the finding says something else of it.
    """
    change = schema.change.c
    rows = ask(sa.select(change.nvdb_id, change.terms).where(change.change_id == change_id))
    if rows and rows[0]["nvdb_id"] is not None:
        raise ConfigError(
            f"The finding {change_id} is about a sign that NVDB has, so it is not there for road works only:"
            " dismiss it without --temporary."
        )
    seen = _seen(rows[0]["terms"]) if rows else None
    return Temporary("" if seen is None else seen[1].isoformat())


def settle_road_works(connection: sa.Connection, at: str) -> int:
    """Dismiss what belongs to road works that a person dismissed; open again what no longer does.

    Inside the caller's transaction. What a person has decided, or opened, is never touched.

    Returns
    -------
    int
        How many findings changed.
    """
    ask = asking(connection)
    if not _any(ask):
        return 0
    by_people = last_entries_by_people(ask)
    anchors = [
        entry
        for entry in by_people.values()
        if isinstance(entry.cause, Temporary) and entry.decision == Decision.DISMISS
    ]
    standing = last_entries(ask)
    suppressed = {key for key, entry in standing.items() if entry.kind == SUPPRESSED}
    if not anchors and not suppressed:
        return 0
    settled = {key for key, entry in by_people.items() if (entry.kind, entry.decision) != _UNTOUCHED}
    signs = [sign for sign in _signs(ask) if sign.key not in settled]
    ground = _ground(anchors, signs)
    entries = []
    evidence = {sign.key: sign.evidence for sign in signs}
    for key, anchor in ground.items():
        if key not in suppressed:
            near = NearTemporary(anchor.change_id, anchor.at, anchor.by)
            entries.append(
                Entry(key, Decision.DISMISS, sentence(near), TWIN, at, evidence[key], SUPPRESSED, cause=near)
            )
    present = present_evidence(ask) if suppressed - ground.keys() else {}
    for key in sorted(suppressed - ground.keys()):
        # One that is no longer found needs no entry: nothing of it remains in any list.
        if key in present and key not in settled:
            over = WorksOver()
            entries.append(
                Entry(key, Decision.OPEN, sentence(over), TWIN, at, present[key], LIFTED, cause=over)
            )
    append(connection, entries)
    return len(entries)


def _any(ask: Ask) -> bool:
    """Whether anything was ever dismissed as temporary: most stores are done with that."""
    log = schema.decision_log.c
    of_person = log.kind.not_in(BY_TWIN) & log.cause.is_not(None)
    return bool(ask(sa.select(log.id).where(of_person | (log.kind == SUPPRESSED)).limit(1)))


def _signs(ask: Ask) -> list[_Sign]:
    """Findings of signs of road works that NVDB does not have, by the day on which they were first seen."""
    table = schema.change.c
    rows = ask(
        sa.select(table.change_id, table.terms, table.skiltnummer_seen)
        .where(table.nvdb_id.is_(None), table.verdict.in_([Verdict.NEW.value, Verdict.REVIEW.value]))
        .order_by(table.change_id)
    )
    seen = {
        row["change_id"]: days
        for row in rows
        if is_of_road_works(split_codes(row["skiltnummer_seen"]))
        and (days := _seen(row["terms"])) is not None
    }
    evidence = present_evidence(ask) if seen else {}
    found = [_Sign(key, evidence[key], *days) for key, days in seen.items()]
    return sorted(found, key=lambda sign: (sign.first, sign.key))


def is_of_road_works(codes: tuple[str, ...]) -> bool:
    """Whether a pole shows road works and nothing that may stand for longer."""
    main = [code for code in codes if not code.startswith(_PLATES_BELOW)]
    return bool(main) and all(sign_family(code) in ROAD_WORKS for code in main)


def _ground(anchors: list[Entry], signs: list[_Sign]) -> dict[str, Entry]:
    """Each sign that belongs to dismissed works, with the entry that speaks for it."""
    found: dict[str, Entry] = {}
    for anchor in anchors:
        until = _day(anchor.cause.last_seen) if isinstance(anchor.cause, Temporary) else None
        for sign in signs:
            if until is None or _apart_m(anchor.evidence, sign.evidence) > NEAR_M:
                continue
            if abs((sign.first - until).days) <= LAST_DAYS or sign.first <= until <= sign.last:
                found.setdefault(sign.key, anchor)
                until = max(until, sign.last)
    return found


def _apart_m(one: Evidence, other: Evidence) -> float:
    return math.hypot(one.east_m - other.east_m, one.north_m - other.north_m)


def _seen(terms: Mapping[str, Any] | None) -> tuple[dt.date, dt.date] | None:
    seen = (terms or {}).get("seen") or {}
    first, last = (_day(seen.get(name) or "") for name in ("first", "last"))
    return None if first is None or last is None else (first, last)


def _day(text: str) -> dt.date | None:
    return dt.date.fromisoformat(text[:10]) if text else None
