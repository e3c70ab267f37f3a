"""What the store holds, in numbers."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from twin.store import schema
from twin.store.store import Row, Snapshot, Store

_FACTS = ("mirror", "mirror_backfill", "vegnett", "last_match")


@dataclass(frozen=True, slots=True)
class Status:
    """What a store holds.

    Attributes
    ----------
    store : str
        Its path.
    mirror : mapping or None
        Fact of the mirror: area, source, position in the change feed, synced_at, age_hours.
    unfinished : mapping or None
        Fact of a backfill that was interrupted, and how many objects of which type it has ``kept``.
    vegnett : mapping or None
        Fact of the road network: area, fetched_at, count.
    skiltpunkt, skiltplate : int
        Objects in the mirror.
    drives : list of rows
        drive_id, name, length_m, n_annotations; in order of time.
    estimates, verdicts : dict
        Method → estimates; verdict → findings.
    last_match : mapping or None
        Fact of the last match.
    """

    store: str
    mirror: Mapping[str, Any] | None
    unfinished: Mapping[str, Any] | None
    vegnett: Mapping[str, Any] | None
    skiltpunkt: int
    skiltplate: int
    drives: list[Row]
    estimates: dict[str, int]
    verdicts: dict[str, int]
    last_match: Mapping[str, Any] | None


def status(store: Store) -> Status:
    """Summarise mirror, drives, estimates and findings: one state, also while a sync is at work."""
    drive = schema.drive.c
    with store.snapshot() as view:
        facts = _facts(view)
        return Status(
            store=str(store.path),
            mirror=_with_age(facts.get("mirror")),
            unfinished=_with_kept(view, facts.get("mirror_backfill")),
            vegnett=facts.get("vegnett"),
            skiltpunkt=_count(view, schema.skiltpunkt),
            skiltplate=_count(view, schema.skiltplate),
            drives=view.rows(
                sa.select(drive.drive_id, drive.name, drive.length_m, drive.n_annotations).order_by(
                    drive.started_ns
                )
            ),
            estimates=_counts_by(view, schema.estimate.c.method),
            verdicts=_counts_by(view, schema.change.c.verdict),
            last_match=facts.get("last_match"),
        )


def _facts(view: Snapshot) -> dict[str, Any]:
    kept = schema.meta.c
    rows = view.rows(sa.select(kept.key, kept.value).where(kept.key.in_(_FACTS)))
    return {row["key"]: json.loads(row["value"]) for row in rows}


def _count(view: Snapshot, table: sa.Table) -> int:
    return int(view.rows(sa.select(sa.func.count().label("n")).select_from(table))[0]["n"])


def _counts_by(view: Snapshot, column: sa.Column[Any]) -> dict[str, int]:
    rows = view.rows(sa.select(column, sa.func.count().label("n")).group_by(column).order_by(column))
    return {row[column.name]: row["n"] for row in rows}


def _with_age(mirror: dict[str, Any] | None) -> dict[str, Any] | None:
    if mirror is None:
        return None
    age = dt.datetime.now(dt.UTC) - dt.datetime.fromisoformat(mirror["synced_at"])
    return {**mirror, "age_hours": round(age.total_seconds() / 3600, 2)}


def _with_kept(view: Snapshot, backfill: dict[str, Any] | None) -> dict[str, Any] | None:
    if backfill is None:
        return None
    kept = {t.visible.name.capitalize(): _count(view, t.aside) for t in schema.MIRROR.values()}
    return {**backfill, "kept": kept}
