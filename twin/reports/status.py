"""What the store holds, in numbers."""

from __future__ import annotations

import datetime as dt
import json
from typing import Any

import sqlalchemy as sa

from twin.store import schema
from twin.store.store import Snapshot, Store

_FACTS = ("mirror", "mirror_backfill", "vegnett", "last_match")


def status(store: Store) -> dict[str, Any]:
    """Summarise mirror, drives, estimates and findings: one state of the store, also while a sync is at work.

    Returns
    -------
    dict
        ``mirror`` (area, source, position in the change feed, synced_at, age_hours) or None, ``unfinished``
        (a backfill that was interrupted, and how many objects it has ``kept``) or None, ``vegnett`` (the road
        network) or None, ``skiltpunkt``, ``skiltplate``, ``drives``, ``estimates`` by method, ``verdicts``
        and ``last_match`` (or None).
    """
    drive = schema.drive.c
    with store.snapshot() as view:
        facts = _facts(view)
        return {
            "store": str(store.path),
            "mirror": _with_age(facts.get("mirror")),
            "unfinished": _with_kept(view, facts.get("mirror_backfill")),
            "vegnett": facts.get("vegnett"),
            "skiltpunkt": _count(view, schema.skiltpunkt),
            "skiltplate": _count(view, schema.skiltplate),
            "drives": view.rows(
                sa.select(drive.drive_id, drive.name, drive.length_m, drive.n_annotations).order_by(
                    drive.started_ns
                )
            ),
            "estimates": _counts_by(view, schema.estimate.c.method),
            "verdicts": _counts_by(view, schema.change.c.verdict),
            "last_match": facts.get("last_match"),
        }


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
