"""The log of decisions: added to inside a transaction, never changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from twin.decisions.evidence import Evidence
from twin.store import schema

Row = Mapping[str, Any]
Ask = Callable[[sa.Select[Any]], list[Row]]
"""Runs a query: :meth:`twin.store.store.Store.rows`, or that of a snapshot or of :func:`asking`."""

DECIDED, UNDONE, REOPENED, CARRIED = "decided", "undone", "reopened", "carried"
"""Kinds of entries: by a person; taking one back; the evidence changed; it is that of then again, or the same
finding has another id."""
TWIN = "twin"
"""Who reopens what has changed: no person."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One decision about one change.

    Attributes
    ----------
    decision : str
        A :class:`twin.store.kinds.Decision`.
    at : str
        ISO 8601, UTC.
    evidence : Evidence
        What was known of the finding when it was decided.
    kind : str
        How it came: `DECIDED`, `UNDONE`, `REOPENED` or `CARRIED`.
    undo_of : int or None
        The ``id`` of the entry that this one takes back.
    """

    change_id: str
    decision: str
    reason: str
    by: str
    at: str
    evidence: Evidence
    kind: str = DECIDED
    undo_of: int | None = None


def asking(connection: sa.Connection) -> Ask:
    """Make the function that runs queries inside the caller's transaction."""
    return lambda statement: [dict(row) for row in connection.execute(statement).mappings()]


def append(connection: sa.Connection, entries: Sequence[Entry]) -> None:
    """Add entries, as one batch, inside the caller's transaction."""
    if not entries:
        return
    log = schema.decision_log
    batch = (connection.execute(sa.select(sa.func.max(log.c.batch))).scalar() or 0) + 1
    names = ("change_id", "decision", "reason", "by", "at", "kind", "undo_of")
    rows = [
        {**{name: getattr(e, name) for name in names}, "evidence": e.evidence.as_json(), "batch": batch}
        for e in entries
    ]
    connection.execute(sa.insert(log), rows)


def standing(ask: Ask) -> dict[str, Row]:
    """Return the last entry of every change that has one, by ``change_id``."""
    return {row["change_id"]: row for row in ask(sa.select(schema.decision))}


def by_people(ask: Ask) -> dict[str, Row]:
    """Return the last entry of every change that a person has decided about, whatever twin reopened since."""
    log = schema.decision_log
    rows = ask(sa.select(log).where(log.c.kind != REOPENED).order_by(log.c.id))
    return {row["change_id"]: row for row in rows}


def position(ask: Ask) -> int:
    """Return the ``id`` of the newest entry, 0 for an empty log."""
    return int(ask(sa.select(sa.func.max(schema.decision_log.c.id).label("id")))[0]["id"] or 0)


def history(ask: Ask, change_id: str) -> list[Row]:
    """Return every entry of one change, oldest first."""
    log = schema.decision_log
    return ask(sa.select(log).where(log.c.change_id == change_id).order_by(log.c.id))
