"""Decide, take back, and bring home what was decided elsewhere: each one transaction."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from twin.decisions.evidence import Evidence, changes_with_nvdb, differences
from twin.decisions.findings import SHORTEST_ID, whole_ids
from twin.decisions.log import (
    DECIDED,
    REOPENED,
    UNDONE,
    Ask,
    Entry,
    append,
    asking,
    standing,
)
from twin.decisions.reopen import reopen_changed
from twin.errors import ConfigError, RefusedError
from twin.store import schema
from twin.store.kinds import Decision
from twin.store.store import Store, utc_now

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Decided:
    """What a call of :func:`decide` did.

    Attributes
    ----------
    change_ids : tuple of str
        Changes that got the decision now.
    already : tuple of str
        Changes that had it.
    """

    change_ids: tuple[str, ...]
    already: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Edit:
    """A decision made in an exported file.

    Attributes
    ----------
    decision : str
    evidence : Evidence
        What the file says of the change: what the person saw.
    log_position : int
        How far the log had come when the file was written.
    """

    decision: str
    evidence: Evidence
    log_position: int


def decide(
    store: Store,
    change_ids: Collection[str],
    decision: str,
    *,
    by: str,
    reason: str = "",
    dry_run: bool = False,
) -> Decided:
    """Decide about findings of the last match.

    Parameters
    ----------
    store : Store
        Matched, and neither synced nor ingested into since.
    change_ids : collection of str
        Whole, or their first digits (:func:`twin.decisions.findings.whole_ids`).
    decision : str
        ``accept``, ``dismiss``, ``defer``, or ``open`` to take a decision back.
    by : str
        Who decides.
    reason : str, optional
    dry_run : bool
        Only say what would be decided.

    Raises
    ------
    ConfigError
        A change is not among the findings, or several begin so; the decision is none of those that exist;
        nobody is named.
    StoreError, RefusedError
        As :meth:`twin.store.store.Store.matched`.
    """
    _check(decision, by)
    store.matched()
    with store.transaction() as connection:
        ask = asking(connection)
        change_ids = whole_ids(
            change_ids, [row["change_id"] for row in ask(sa.select(schema.change.c.change_id))]
        )
        present, said = _present(ask, change_ids), standing(ask)
        if unknown := sorted(set(change_ids) - present.keys()):
            raise ConfigError(
                f"The last match found no change {', '.join(unknown[:5])}: take an id, or its first"
                f" {SHORTEST_ID} digits, from `twin match` or from the column change_id of an export."
            )
        now = utc_now()
        already = {key for key in change_ids if _stands(said.get(key), decision, reason)}
        fresh = tuple(sorted(set(change_ids) - already))
        entries = [Entry(key, decision, reason, by, now, present[key]) for key in fresh]
        append(connection, [] if dry_run else entries)
    return Decided(fresh, tuple(sorted(already)))


def undo(store: Store, n: int = 1, *, by: str) -> tuple[str, ...]:
    """Take back what the last `n` commands decided; the changes have the decisions of before again.

    What was taken back before is not counted again. Entries are added, none is removed. A decision of before
    that rested on other evidence is not restored: its finding is open, and says what changed.

    Returns
    -------
    tuple of str
        The changes.

    Raises
    ------
    ConfigError
        `n` is not positive, or nobody is named.
    RefusedError
        Fewer than `n` commands are left to take back.
    """
    _check(Decision.OPEN, by)
    if n < 1:
        raise ConfigError(f"{n} commands cannot be taken back: give a number of at least 1.")
    with store.transaction() as connection:
        log = asking(connection)(sa.select(schema.decision_log).order_by(schema.decision_log.c.id))
        undone = {row["undo_of"] for row in log if row["undo_of"] is not None}
        left = [row for row in log if row["kind"] == DECIDED and row["id"] not in undone]
        batches = sorted({row["batch"] for row in left})[-n:]
        if len(batches) < n:
            raise RefusedError(
                f"The store {store.path} has {len(batches)} command(s) to take back, not {n}: "
                "see `twin explain` for a change's history."
            )
        taken = [row for row in left if row["batch"] in batches]
        undone |= {row["id"] for row in taken}
        # A change that several of these commands decided goes back behind the first of them, at once.
        first = {row["change_id"]: row for row in reversed(taken)}
        before = {
            row["change_id"]: row
            for row in log
            if row["kind"] != REOPENED
            and row["id"] not in undone
            and row["id"] < first.get(row["change_id"], {"id": 0})["id"]
        }
        now = utc_now()
        append(connection, [_back(row, before.get(row["change_id"]), by, now) for row in reversed(taken)])
        reopen_changed(connection, now)
    return tuple(sorted(first))


def keep_edits(store: Store, edits: Mapping[str, Edit], *, by: str, reason: str = "") -> tuple[str, ...]:
    """Bring decisions home that were made in an exported file.

    A decision rests on what the file said: where the findings are different by now, it is kept in the log and
    the finding is open again at once. What was brought home before is not brought home twice.

    Returns
    -------
    tuple of str
        Changes that were decided anew.

    Raises
    ------
    ConfigError
        Nobody is named.
    """
    _check(Decision.OPEN, by)
    if not edits:
        return ()
    with store.transaction() as connection:
        ask = asking(connection)
        present, said, now, entries = _present(ask, edits), standing(ask), utc_now(), []
        home = _home(ask, edits)
        for key, edit in sorted(edits.items()):
            if key in home or _stands(said.get(key), edit.decision, ""):
                continue
            found = present.get(key)
            same = found is not None and not differences(edit.evidence, found)
            evidence = found if same and found is not None else edit.evidence
            entries.append(Entry(key, edit.decision, reason, by, now, evidence))
        append(connection, entries)
        if entries:
            reopen_changed(connection, now)
    return tuple(entry.change_id for entry in entries)


def _check(decision: str, by: str) -> None:
    if decision not in set(Decision):
        raise ConfigError(f"{decision!r} is no decision: choose one of {', '.join(Decision)}.")
    if not by.strip():
        raise ConfigError("Nobody is named as the one who decides: give --by, or set TWIN_USER.")


def _present(ask: Ask, change_ids: Collection[str]) -> dict[str, Evidence]:
    """Return the evidence of those changes that the last match found."""
    wanted = set(change_ids)
    rows = (row for row in ask(changes_with_nvdb()) if row["change_id"] in wanted)
    return {row["change_id"]: Evidence.from_row(row) for row in rows}


def _stands(said: Row | None, decision: str, reason: str) -> bool:
    """Whether the decision holds already, with this reason or without a new one."""
    if said is None:
        return decision == Decision.OPEN
    return bool(said["decision"] == decision and reason in ("", said["reason"]))


def _home(ask: Ask, edits: Mapping[str, Edit]) -> set[str]:
    """Changes whose edit a person's entry, younger than the file, says already."""
    log = schema.decision_log.c
    since = min(edit.log_position for edit in edits.values())
    younger: Sequence[Row] = ask(
        sa.select(log.id, log.change_id, log.decision).where(log.id > since, log.kind == DECIDED)
    )
    return {
        row["change_id"]
        for row in younger
        if (edit := edits.get(row["change_id"])) is not None
        and (row["id"] > edit.log_position and row["decision"] == edit.decision)
    }


def _back(row: Row, before: Row | None, by: str, at: str) -> Entry:
    """Make the entry that puts the decision of before back in the place of `row`."""
    kept = before or {"decision": Decision.OPEN, "reason": "", "evidence": row["evidence"]}
    evidence = Evidence.from_json(kept["evidence"])
    return Entry(
        row["change_id"], kept["decision"], kept["reason"], by, at, evidence, UNDONE, undo_of=row["id"]
    )
