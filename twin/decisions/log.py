"""The log of decisions: added to inside a transaction, never changed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from twin.decisions.evidence import Ask, Evidence, Row
from twin.store import schema
from twin.store.kinds import Decision
from twin.words import NO_NAMES, Lang, SignNames, sentence, why_to_json
from twin.words.reasons import Cause, Temporary, cause_from_json

DECIDED, UNDONE, REOPENED, CARRIED = "decided", "undone", "reopened", "carried"
"""Kinds of entries: by a person; taking one back; the evidence changed; it is that of then again, or the same
finding has another id."""
OPINION, WITHDRAWN = "opinion", "withdrawn"
"""Kinds of entries that settle nothing, and leave what holds as it is: what one of several people who do not
see each other's answers said; and taking back an opinion, or a decision that another has followed since."""
SILENT = (OPINION, WITHDRAWN)
SUPPRESSED, LIFTED = "suppressed", "lifted"
"""Kinds of entries that twin makes of signs of road works: dismissed with others, and open again."""
BY_TWIN = (REOPENED, SUPPRESSED, LIFTED)
"""Kinds of entries that are nobody's decision."""
TWIN = "twin"
"""Who reopens what has changed: no person."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One decision about one change: a row of ``decision_log``.

    Attributes
    ----------
    at : str
        ISO 8601, UTC.
    evidence : Evidence
        What was known of the finding when it was decided.
    kind : str
        How it came: `DECIDED`, `UNDONE`, `REOPENED`, `CARRIED`, `SUPPRESSED`, `LIFTED`, `OPINION` or
        `WITHDRAWN`.
    undo_of : int or None
        The ``id`` of the entry that this one takes back.
    session : str
        Of the page in which it was answered; "" of commands and matches.
    request : str or None
        By which the page knows its request again, where it gave one.
    cause : Cause or None
        Why twin made it; that the sign is temporary, of one that was dismissed for it.
    id, batch : int
        Given by the log: its place in it, and of what one command or one match decided; 0 until then.
    """

    change_id: str
    decision: Decision
    reason: str
    by: str
    at: str
    evidence: Evidence
    kind: str = DECIDED
    undo_of: int | None = None
    cause: Cause | None = None
    id: int = 0
    batch: int = 0
    session: str = ""
    request: str | None = None

    @property
    def holds(self) -> bool:
        """Whether it says what is decided, until the next such entry."""
        return self.kind not in SILENT

    @classmethod
    def from_row(cls, row: Row) -> Entry:
        """Take it from a row of the log."""
        typed = {
            "decision": Decision(row["decision"]),
            "evidence": Evidence.from_json(row["evidence"]),
            "cause": None if row["cause"] is None else cause_from_json(row["cause"]),
        }
        return cls(**{**row, **typed})

    def as_json(self) -> dict[str, Any]:
        """Return it with the names and in the order of the log's columns."""
        columns = {column.name: getattr(self, column.name) for column in schema.decision_log.columns}
        cause = None if self.cause is None else why_to_json(self.cause)
        return {**columns, "evidence": self.evidence.as_json(), "cause": cause}

    def told(self, lang: Lang, names: SignNames = NO_NAMES) -> str:
        """What a person wrote; of what twin made, why."""
        if self.cause is None or (isinstance(self.cause, Temporary) and self.reason):
            return self.reason
        return sentence(self.cause, lang, names)


def asking(connection: sa.Connection) -> Ask:
    """Make the function that runs queries inside the caller's transaction."""
    return lambda statement: [dict(row) for row in connection.execute(statement).mappings()]


def append(connection: sa.Connection, entries: Sequence[Entry]) -> None:
    """Add entries, as one batch, inside the caller's transaction; one at most carries a request's key."""
    if not entries:
        return
    log = schema.decision_log
    batch = (connection.execute(sa.select(sa.func.max(log.c.batch))).scalar() or 0) + 1
    rows = [{**entry.as_json(), "batch": batch} for entry in entries]
    for row in rows:
        del row["id"]  # given by the database
    connection.execute(sa.insert(log), rows)


def last_entries(ask: Ask, only: Collection[str] | None = None) -> dict[str, Entry]:
    """Return the last entry that holds of every change, or of those named, that has one, by ``change_id``."""
    said = schema.decision
    asked = sa.select(said) if only is None else sa.select(said).where(said.c.change_id.in_(only))
    return {row["change_id"]: Entry.from_row(row) for row in ask(asked.order_by(said.c.id))}


def last_entries_by_people(ask: Ask, only: Collection[str] | None = None) -> dict[str, Entry]:
    """Return people's last decision of every change, or of those named, whatever twin reopened since."""
    log = schema.decision_log
    asked = sa.select(log).where(log.c.kind.not_in((*BY_TWIN, *SILENT))).order_by(log.c.id)
    rows = ask(asked if only is None else asked.where(log.c.change_id.in_(only)))
    return {row["change_id"]: Entry.from_row(row) for row in rows}


def all_entries(ask: Ask, only: Collection[str] | None = None) -> list[Entry]:
    """Return the whole log, or that of the changes named, oldest entry first."""
    log = schema.decision_log
    asked = sa.select(log).order_by(log.c.id)
    rows = ask(asked if only is None else asked.where(log.c.change_id.in_(only)))
    return [Entry.from_row(row) for row in rows]


def position(ask: Ask) -> int:
    """Return the ``id`` of the newest entry, 0 for an empty log."""
    return int(ask(sa.select(sa.func.max(schema.decision_log.c.id).label("id")))[0]["id"] or 0)


def history(ask: Ask, change_id: str) -> list[Entry]:
    """Return every entry of one change, oldest first."""
    return all_entries(ask, (change_id,))
