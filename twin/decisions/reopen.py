"""After a match: what was decided on other evidence is open again, and says what changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa

from twin.decisions.evidence import Evidence, changes_with_nvdb, differences, same_place
from twin.decisions.log import (
    CARRIED,
    REOPENED,
    TWIN,
    Entry,
    append,
    asking,
    by_people,
    standing,
)
from twin.store.kinds import QUIET, Decision

Row = Mapping[str, Any]

_DONE = {Decision.ACCEPT: "Accepted", Decision.DISMISS: "Dismissed", Decision.DEFER: "Deferred"}


def reopen_changed(connection: sa.Connection, at: str) -> int:
    """Reopen every present finding that was decided on other evidence, inside the caller's transaction.

    A finding may come under another ``change_id`` than before: its verdict or sign code changed, or its
    object was numbered anew. It is told from its forerunner, a decided change of the same object that is no
    longer found; where nothing else changed, it takes over the forerunner's decision. Where the evidence is
    again what it was, the decision of then holds again: a match by another method costs none.

    Returns
    -------
    int
        How many findings were reopened.
    """
    ask = asking(connection)
    said, held = by_people(ask), standing(ask)
    if not said:
        return 0
    present = {row["change_id"]: row for row in ask(changes_with_nvdb()) if row["verdict"] not in QUIET}
    absent = _by_object([row for key, row in said.items() if key not in present])
    reopened, carried = [], []
    for key, row in present.items():
        if key not in said and (row["nvdb_type"], row["nvdb_id"]) not in absent:
            continue
        now = Evidence.from_row(row)
        last = said.get(key) or _forerunner(absent.get(_object(now), []), now)
        if last is None or last["decision"] == Decision.OPEN:
            continue
        then, holds = Evidence.from_json(last["evidence"]), held.get(key)
        if changes := differences(then, now):
            told = _told(last, changes)
            if holds is None or (holds["kind"], holds["reason"]) != (REOPENED, told):
                reopened.append(Entry(key, Decision.OPEN, told, TWIN, at, now, REOPENED))
        elif holds is None or holds["kind"] == REOPENED:
            who = (last["decision"], last["reason"], last["by"], last["at"])
            carried.append(Entry(key, *who, then, CARRIED))
    append(connection, [*carried, *reopened])
    return len(reopened)


def _object(evidence: Evidence) -> tuple[int, int | None]:
    return evidence.nvdb_type, evidence.nvdb_id


def _by_object(rows: Sequence[Row]) -> dict[tuple[int, int | None], list[tuple[Row, Evidence]]]:
    """Group decided changes that are no longer found by their object, the latest decision first.

    What NVDB does not know has no id: such changes stand together under None.
    """
    groups: dict[tuple[int, int | None], list[tuple[Row, Evidence]]] = {}
    for row in sorted(rows, key=lambda row: -int(row["id"])):
        if row["decision"] != Decision.OPEN:
            evidence = Evidence.from_json(row["evidence"])
            groups.setdefault(_object(evidence), []).append((row, evidence))
    return groups


def _forerunner(candidates: list[tuple[Row, Evidence]], now: Evidence) -> Row | None:
    """Take out the decided change that a finding without a decision of its own follows, if there is one.

    What NVDB does not know is recognised by its place, and rather by one whose sign codes are the same.
    """
    fitting = [c for c in candidates if now.nvdb_id is not None or same_place(c[1], now)]
    if not fitting:
        return None
    found = min(fitting, key=lambda c: c[1].skiltnummer_seen != now.skiltnummer_seen)
    candidates.remove(found)
    return found[0]


def _told(said: Row, changes: Sequence[str]) -> str:
    why = f" ({said['reason']})" if said["reason"] else ""
    return (
        f"{_DONE[said['decision']]} {said['at'][:10]} by {said['by']}{why}; since then {', '.join(changes)}."
    )
