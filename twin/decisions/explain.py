"""One finding explained: what was found, why, how sure, and who decided what about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import sqlalchemy as sa

from twin.decisions.findings import SHORTEST_ID, findings, whole_ids
from twin.decisions.log import history, standing
from twin.errors import ConfigError
from twin.store import schema
from twin.store.kinds import Decision
from twin.store.store import Store

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ChangeExplained:
    """A finding of the last match.

    Attributes
    ----------
    sentence : str
        Verdict, confidence, reason and decision, for people.
    change : mapping
        Its row, with ``decision`` (:func:`twin.decisions.findings.findings`).
    terms : object
        What the confidence is made of, as matching kept it; None where it kept nothing.
    drives : tuple of mapping
        ``drive_id, name, started_ns`` of the drives that it rests on, in time order.
    history : tuple of mapping
        Entries of the log, oldest first.
    """

    sentence: str
    change: Row
    terms: Any
    drives: tuple[Row, ...]
    history: tuple[Row, ...]

    def as_json(self) -> dict[str, Any]:
        """Return everything in types that JSON has."""
        return asdict(self)


def explain_change(store: Store, change_id: str) -> ChangeExplained:
    """Gather what the store knows of one finding.

    Parameters
    ----------
    store : Store
    change_id : str
        Whole, or its first digits (:func:`twin.decisions.findings.whole_ids`).

    Raises
    ------
    ConfigError
        The last match has no such finding; or several begin so.
    StoreError, RefusedError
        As :meth:`twin.store.store.Store.matched`.
    """
    store.matched()
    with store.snapshot() as view:
        found = {row["change_id"]: dict(row) for row in findings(view.rows)}
        (change_id,) = whole_ids([change_id], {*found, *standing(view.rows)})
        row = found.get(change_id)
        entries = tuple(history(view.rows, change_id))
        if row is None:
            raise ConfigError(_absent(change_id, entries))
        drive = schema.drive.c
        drives = view.rows(
            sa.select(drive.drive_id, drive.name, drive.started_ns)
            .where(drive.drive_id.in_(row["drive_ids"].split(",")))
            .order_by(drive.started_ns, drive.drive_id)
        )
    terms = row.pop("terms", None) or None
    return ChangeExplained(_sentence(row, entries), row, terms, tuple(drives), entries)


def percent(confidence: float) -> str:
    """Write a probability for people; none is a certainty."""
    return "over 99.9%" if confidence >= 0.9995 else f"{confidence:.1%}"


def _sentence(row: Row, entries: tuple[Row, ...]) -> str:
    said = "Nobody has decided yet."
    if entries:
        last = entries[-1]
        why = f" ({last['reason']})" if last["reason"] else ""
        said = f"Decision: {last['decision']}, {last['at'][:10]} by {last['by']}{why}."
    if row["decision"] == Decision.OPEN and entries:
        said = "It is open."
    return (
        f"{row['change_id']} is {row['verdict']}, {percent(row['confidence'])} sure: {row['reason']} {said}"
    )


def _absent(change_id: str, entries: tuple[Row, ...]) -> str:
    if entries:
        last = entries[-1]
        return (
            f"The last match no longer found change {change_id}; the last decision about it is "
            f"{last['decision']}, {last['at'][:10]} by {last['by']}."
        )
    return (
        f"The last match found no change {change_id}: take an id, or its first {SHORTEST_ID} digits, from"
        " `twin match` or from the column change_id of an export."
    )
