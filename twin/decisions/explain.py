"""One finding explained: what was found, why, how sure, and who decided what about it."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import sqlalchemy as sa

from twin.decisions.evidence import Ask
from twin.decisions.findings import SHORTEST_ID, FindingStatus, latest_findings, whole_ids
from twin.decisions.log import Entry, history, last_entries
from twin.errors import ConfigError
from twin.store import schema
from twin.store.kinds import Decision
from twin.store.store import Store
from twin.words import (
    NO_NAMES,
    Lang,
    SignNames,
    chance_text,
    decision_title,
    reason_of,
    say,
    verdict_title,
)


@dataclass(frozen=True, slots=True)
class DriveOfFinding:
    """A drive that a finding rests on."""

    drive_id: str
    name: str
    started_ns: int

    @property
    def day(self) -> dt.date:
        """UTC."""
        return dt.datetime.fromtimestamp(self.started_ns / 1e9, tz=dt.UTC).date()


@dataclass(frozen=True, slots=True)
class ChangeExplained:
    """A finding of the last match.

    Attributes
    ----------
    change : FindingStatus
        The finding, and what is decided about it.
    drives : tuple of DriveOfFinding
        That it rests on, in time order.
    history : tuple of Entry
        Of the log, oldest first.
    """

    change: FindingStatus
    drives: tuple[DriveOfFinding, ...]
    history: tuple[Entry, ...]

    @property
    def sentence(self) -> str:
        """Verdict, confidence, reason and decision, in English."""
        return self.in_words()

    def in_words(self, lang: Lang = Lang.EN, names: SignNames = NO_NAMES) -> str:
        """Verdict, confidence, reason and decision, for people."""
        finding = self.change.finding
        return say(
            lang,
            "explain.sentence",
            change=finding.change_id,
            verdict=verdict_title(finding.verdict, lang),
            sure=chance_text(finding.confidence, lang),
            reason=reason_of(finding, lang, names),
            decided=self._decided(lang),
        )

    def _decided(self, lang: Lang) -> str:
        held = [entry for entry in self.history if entry.holds]
        if not held:
            return say(lang, "explain.nobody_decided")
        if self.change.decision == Decision.OPEN:
            return say(lang, "explain.is_open")
        last = held[-1]
        why = f" ({last.reason})" if last.reason else ""
        decision = decision_title(last.decision, lang)
        return say(lang, "explain.decided", decision=decision, day=last.at[:10], by=f"{last.by}{why}")

    @property
    def terms(self) -> Mapping[str, Any]:
        """What the confidence is made of, as matching kept it; empty where it kept nothing."""
        return self.change.finding.terms

    def as_json(self) -> dict[str, Any]:
        """Return everything in types that JSON has."""
        change = self.change.as_json()
        return {
            "sentence": self.sentence,
            "change": change,
            "terms": change.pop("terms") or None,
            "drives": [asdict(drive) for drive in self.drives],
            "history": [entry.as_json() for entry in self.history],
        }


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
    with store.snapshot() as view:
        view.matched()
        changes = {change.change_id: change for change in latest_findings(view.rows)}
        (change_id,) = whole_ids([change_id], {*changes, *last_entries(view.rows)})
        change = changes.get(change_id)
        entries = tuple(history(view.rows, change_id))
        if change is None:
            raise ConfigError(_absent(change_id, entries))
        drives = _drives(view.rows, change.finding.drive_ids)
    return ChangeExplained(change, drives, entries)


def _drives(ask: Ask, drive_ids: Sequence[str]) -> tuple[DriveOfFinding, ...]:
    drive = schema.drive.c
    rows = ask(
        sa.select(drive.drive_id, drive.name, drive.started_ns)
        .where(drive.drive_id.in_(drive_ids))
        .order_by(drive.started_ns, drive.drive_id)
    )
    return tuple(DriveOfFinding(**row) for row in rows)


def _absent(change_id: str, entries: Sequence[Entry]) -> str:
    if held := [entry for entry in entries if entry.holds]:
        last = held[-1]
        return (
            f"The last match no longer found change {change_id}; the last decision about it is "
            f"{last.decision}, {last.at[:10]} by {last.by}."
        )
    return (
        f"The last match found no change {change_id}: take an id, or its first {SHORTEST_ID} digits, from"
        " `twin findings` or from the column change_id of an export."
    )
