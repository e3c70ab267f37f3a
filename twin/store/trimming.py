"""What of a store may go once it is old: nothing that a finding, a decision or its evidence rests on."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import sqlalchemy as sa

from twin.errors import ConfigError, RefusedError, StoreError
from twin.store import schema
from twin.store.kinds import JobKind, JobState
from twin.store.sql import each_number, size_of
from twin.store.store import Snapshot, Store

_MIRROR = "mirror"


@dataclass(frozen=True, slots=True)
class Part:
    """What goes of one table.

    Attributes
    ----------
    rows : int
    n_bytes : int
        Of their values, about; indexes come on top.
    """

    rows: int
    n_bytes: int


@dataclass(frozen=True, slots=True)
class Trimmed:
    """What went, or would go.

    Attributes
    ----------
    store : str
    before : str
        What is older than this goes, UTC.
    dry_run : bool
        Whether nothing was changed.
    parts : mapping of str to Part
        Table → what goes, of tables of which something goes.
    kept_room : str or None
        Why the room of what went was not given back.
    """

    store: str
    before: str
    dry_run: bool
    parts: Mapping[str, Part]
    kept_room: str | None = None

    @property
    def n_sets(self) -> int:
        """Annotation sets that can then not be taken back."""
        return self.parts.get(schema.annotation_set.name, Part(0, 0)).rows


def trim_store(store: Store, older_than_days: int, *, dry_run: bool = False, yes: bool = False) -> Trimmed:
    """Drop what is older than some days and no finding rests on, and give its room back.

    Gone are annotation sets that are not current, with what came of them; states that NVDB's objects had and
    have no more, but for objects that were sent; and drives of the queue that are done and that nobody asked
    for since. Everything else stays: drives, sightings, estimates, findings, decisions, what was sent, logs.

    Parameters
    ----------
    older_than_days : int
        At least 1.
    dry_run : bool
        Whether it is only counted.
    yes : bool
        Whether annotation sets may go, which nobody can take back then.

    Raises
    ------
    ConfigError
        Fewer days than 1.
    RefusedError
        Annotation sets would go and `yes` is not said, or a sync is at work; nothing is changed.
    """
    if older_than_days < 1:
        raise ConfigError(f"{older_than_days} days are no age: give at least one.")
    try:
        edge = dt.datetime.now(dt.UTC) - dt.timedelta(days=older_than_days)
    except OverflowError as error:
        raise ConfigError(f"{older_than_days} days reach back before the year 1: give fewer.") from error
    before = f"{edge:%Y-%m-%dT%H:%M:%SZ}".rjust(20, "0")
    if dry_run:
        with store.snapshot() as view:
            return Trimmed(store.name, before, True, _counted(view, before))
    with store.alone("sync", "trim"), store.transaction() as connection:
        view = store.view(connection)
        done = Trimmed(store.name, before, False, _counted(view, before))
        if done.n_sets and not yes:
            raise RefusedError(
                f"{done.n_sets} annotation sets would go, and `twin drives use` could not take them back: "
                "look with --dry-run, then say --yes. Nothing was changed."
            )
        for table, goes in _going(view, before).items():
            connection.execute(sa.delete(table).where(goes))
        mirror = view.fact(_MIRROR)
        if mirror is not None and any(one.history.name in done.parts for one in schema.MIRROR.values()):
            # Of days before this the mirror knows as little as of those before it began.
            store.put_fact(connection, _MIRROR, {**mirror, "since": max(mirror.get("since") or "", before)})
    try:
        store.give_room_back(done.parts)
    except StoreError as error:
        return replace(done, kept_room=str(error))
    return done


def _going(view: Snapshot, before: str) -> dict[sa.Table, sa.ColumnElement[bool]]:
    """Table → which of its rows go, in the order in which they may be deleted."""
    of, job = schema.annotation_set.c, schema.fleet_job.c
    is_old = ~of.is_current & (sa.func.coalesce(of.read_at, "") < before)
    going: dict[sa.Table, sa.ColumnElement[bool]] = {
        kept: sa.exists().where(of.drive_id == kept.c.drive_id, of.number == kept.c.annotation_set, is_old)
        for kept in schema.KEPT.values()
    }
    going[schema.annotation_set] = is_old
    sent = _sent(view)
    for type_id, tables in schema.MIRROR.items():
        past = tables.history.c
        going[tables.history] = (past.seen_until < before) & past.nvdb_id.not_in(
            each_number(sorted(sent.get(type_id, ())))
        )
    # Not the match: that it is in the queue says that drives are to be matched.
    going[schema.fleet_job] = (
        (job.kind == JobKind.INGEST) & (job.state == JobState.DONE) & (job.ended_at < before)
    )
    return going


def _sent(view: Snapshot) -> dict[int, set[int]]:
    """Type → objects that were sent: whether a set was carried out is read off their history."""
    found: dict[int, set[int]] = {}
    for row in view.rows(sa.select(schema.sent.c.objects)):
        for one in row["objects"]:
            if one.get("nvdb_id") is not None:
                found.setdefault(one["type_id"], set()).add(one["nvdb_id"])
    return found


def _counted(view: Snapshot, before: str) -> dict[str, Part]:
    parts = {}
    for table, goes in _going(view, before).items():
        sizes = [sa.func.sum(size_of(column)) for column in table.columns]
        asked: list[sa.ColumnElement[Any]] = [sa.func.count().label("rows")]
        asked.append(sum(sizes[1:], sizes[0]).label("n_bytes"))
        row = view.rows(sa.select(*asked).select_from(table).where(goes))[0]
        if row["rows"]:
            parts[table.name] = Part(row["rows"], int(row["n_bytes"]))
    return parts
