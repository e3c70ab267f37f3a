"""Decide, take back, and bring home what was decided elsewhere: each one transaction."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import sqlalchemy as sa

from twin.decisions.evidence import Ask, Evidence, differences, present_evidence
from twin.decisions.findings import SHORTEST_ID, whole_ids
from twin.decisions.log import (
    BY_TWIN,
    DECIDED,
    OPINION,
    SUPPRESSED,
    UNDONE,
    WITHDRAWN,
    Entry,
    all_entries,
    append,
    asking,
    last_entries,
)
from twin.decisions.reopen import reopen_changed
from twin.decisions.temporary import settle_road_works, temporary_cause
from twin.errors import ConfigError, RefusedError
from twin.store import schema
from twin.store.kinds import Decision
from twin.store.store import Store, utc_now
from twin.words.reasons import Temporary


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
    comment : str or None
        Written beside the decision; None where that was left as it is.
    author : str
        Who was named there; "" where nobody was, or somebody of before.
    """

    decision: str
    evidence: Evidence
    log_position: int
    comment: str | None = None
    author: str = ""


def decide(
    store: Store,
    change_ids: Collection[str],
    decision: str,
    *,
    by: str,
    reason: str = "",
    temporary: bool = False,
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
    temporary : bool
        The signs stand for road works: others of the same works need no decision of their own
        (:mod:`twin.decisions.temporary`). With ``dismiss`` alone.
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
    check(decision, by, temporary=temporary)
    with store.transaction() as connection:
        store.view(connection).matched()
        ask = asking(connection)
        evidence, standing = present_evidence(ask), last_entries(ask)
        change_ids = whole_ids(change_ids, evidence)
        if unknown := sorted(set(change_ids) - evidence.keys()):
            raise ConfigError(
                f"The last match found no change {', '.join(unknown[:5])}: take an id, or at least its first"
                f" {SHORTEST_ID} digits, from `twin findings` or from the column change_id of an export."
            )
        now = utc_now()
        already = {key for key in change_ids if _stands(standing.get(key), decision, reason, temporary)}
        fresh = tuple(sorted(set(change_ids) - already))
        entries = [Entry(key, Decision(decision), reason, by, now, evidence[key]) for key in fresh]
        if temporary:
            entries = [replace(entry, cause=temporary_cause(ask, entry.change_id)) for entry in entries]
        if not dry_run:
            append(connection, entries)
            settle_road_works(connection, now)
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
    check(Decision.OPEN, by)
    if n < 1:
        raise ConfigError(f"{n} commands cannot be taken back: give a number of at least 1.")
    with store.transaction() as connection:
        log = all_entries(asking(connection))
        undone = {entry.undo_of for entry in log if entry.undo_of is not None}
        left = [entry for entry in log if entry.kind == DECIDED and entry.id not in undone]
        batches = sorted({entry.batch for entry in left})[-n:]
        if len(batches) < n:
            raise RefusedError(
                f"The store {store.name} has {len(batches)} command(s) to take back, not {n}: "
                "see `twin explain` for a change's history."
            )
        taken = [entry for entry in log if entry.batch in batches and is_left(entry, undone)]
        take_back(connection, log, taken, by=by, at=utc_now())
    return tuple(sorted({entry.change_id for entry in taken}))


def is_left(entry: Entry, undone: Collection[int]) -> bool:
    """Whether an entry is a person's, to take back: `undone` are those that were taken back before."""
    return entry.kind in (DECIDED, OPINION) and entry.id not in undone


def take_back(
    connection: sa.Connection,
    log: Sequence[Entry],
    taken: Sequence[Entry],
    *,
    by: str,
    at: str,
    session: str = "",
    request: str | None = None,
    only: Collection[str] | None = None,
) -> None:
    """Add the entries that take others back, inside the caller's transaction.

    Parameters
    ----------
    connection : Connection
    log : sequence of Entry
        All of the changes concerned, oldest first.
    taken : sequence of Entry
        To be taken back, oldest first.
    by, at, session, request : str
        Of the new entries.
    only : collection of str, optional
        As :func:`twin.decisions.reopen.reopen_changed`.
    """
    undone = {entry.undo_of for entry in log if entry.undo_of is not None} | {entry.id for entry in taken}
    decided = [entry for entry in taken if entry.kind == DECIDED]
    # A change that several of these commands decided goes back behind the first of them, at once.
    first = {entry.change_id: entry.id for entry in reversed(decided)}
    before = {
        entry.change_id: entry
        for entry in log
        if entry.kind not in BY_TWIN
        and (entry.holds and entry.id not in undone and entry.id < first.get(entry.change_id, 0))
    }
    # What somebody decided later holds, whatever was before it.
    later = {
        entry.change_id
        for entry in log
        if entry.kind == DECIDED
        and entry.id not in undone
        and entry.id > first.get(entry.change_id, entry.id)
    }
    entries = [
        _withdrawn(entry) if entry.kind == OPINION or entry.change_id in later else _back(entry, before)
        for entry in reversed(taken)
    ]
    told = [replace(entry, by=by, at=at, session=session, request=None) for entry in entries]
    append(connection, [replace(told[0], request=request), *told[1:]])
    reopen_changed(connection, at, only)
    settle_road_works(connection, at)


def keep_edits(store: Store, edits: Mapping[str, Edit], *, by: str, reason: str = "") -> tuple[str, ...]:
    """Bring decisions home that were made in an exported file.

    A decision rests on what the file said: where the findings are different by now, it is kept in the log and
    the finding is open again at once. What was brought home before is not brought home twice.

    Parameters
    ----------
    store : Store
    edits : mapping of change_id → Edit
    by, reason : str
        Of edits that name nobody, or give no comment.

    Returns
    -------
    tuple of str
        Changes that were decided anew.

    Raises
    ------
    ConfigError
        Nobody is named.
    """
    check(Decision.OPEN, by)
    if not edits:
        return ()
    with store.transaction() as connection:
        ask = asking(connection)
        evidence, standing, now, entries = present_evidence(ask), last_entries(ask), utc_now(), []
        home = _home(ask, edits)
        for key, edit in sorted(edits.items()):
            last = standing.get(key)
            if key in home or _edit_stands(last, edit):
                continue
            present = evidence.get(key)
            differs = present is None or differences(edit.evidence, present)
            rests_on = edit.evidence if present is None or differs else present
            why = _comment_of(edit, last) or reason
            entries.append(Entry(key, Decision(edit.decision), why, edit.author or by, now, rests_on))
        append(connection, entries)
        if entries:
            reopen_changed(connection, now)
            settle_road_works(connection, now)
    return tuple(entry.change_id for entry in entries)


def check(decision: str, by: str, *, temporary: bool = False) -> None:
    """Refuse what is no decision, or nobody's.

    Raises
    ------
    ConfigError
        The decision is none of those that exist, or is none for being temporary; nobody is named.
    """
    if temporary and decision != Decision.DISMISS:
        raise ConfigError(f"A finding is not {decision} for being temporary: only dismiss takes that.")
    if decision not in set(Decision):
        raise ConfigError(f"{decision!r} is no decision: choose one of {', '.join(Decision)}.")
    if not by.strip():
        raise ConfigError("Nobody is named as the one who decides: give --by, or set TWIN_USER.")


def _stands(last: Entry | None, decision: str, reason: str, temporary: bool = False) -> bool:
    """Whether the decision holds already, with this reason or without a new one, and for the same cause."""
    if last is None:
        return decision == Decision.OPEN
    if last.kind == SUPPRESSED or (temporary and not isinstance(last.cause, Temporary)):
        return False  # a person's word counts for more than what twin made of another's
    return last.decision == decision and reason in ("", last.reason)


def _edit_stands(last: Entry | None, edit: Edit) -> bool:
    """Whether an edit says nothing that does not hold already."""
    if edit.decision == Decision.OPEN and not edit.comment:
        # A name alone, of a finding that nobody has decided, says nothing.
        return last is None or last.decision == Decision.OPEN
    if last is None:
        return False
    same = edit.comment in (None, last.reason) and edit.author in ("", last.by)
    return same and _stands(last, edit.decision, "")


def _comment_of(edit: Edit, last: Entry | None) -> str:
    """What was written; of an edit that only names somebody else, what was written before."""
    if edit.comment is not None:
        return edit.comment
    return last.reason if last is not None and last.decision == edit.decision else ""


def _home(ask: Ask, edits: Mapping[str, Edit]) -> set[str]:
    """Changes whose edit a person's entry, younger than the file, says already."""
    log = schema.decision_log.c
    since = min(edit.log_position for edit in edits.values())
    asked = sa.select(log.id, log.change_id, log.decision, log.reason, log.by)
    younger = ask(asked.where(log.id > since, log.kind == DECIDED))
    return {
        row["change_id"]
        for row in younger
        if (edit := edits.get(row["change_id"])) is not None
        and (row["id"] > edit.log_position and row["decision"] == edit.decision)
        and (edit.comment in (None, "", row["reason"]) and edit.author in ("", row["by"]))
    }


def _back(taken: Entry, before: Mapping[str, Entry]) -> Entry:
    """Make the entry that puts the decision of before back in the place of the one that is taken back."""
    kept = before.get(taken.change_id) or replace(taken, decision=Decision.OPEN, reason="", cause=None)
    return replace(kept, kind=UNDONE, undo_of=taken.id)


def _withdrawn(taken: Entry) -> Entry:
    """Make the entry that takes one back and leaves what is decided as it is."""
    return replace(taken, kind=WITHDRAWN, undo_of=taken.id)
