"""What the store holds, in numbers."""

from __future__ import annotations

import datetime as dt
from typing import Any

import sqlalchemy as sa

from twin import schema
from twin.store import Store


def status(store: Store) -> dict[str, Any]:
    """Summarise mirror, drives, estimates and findings.

    Returns
    -------
    dict
        ``mirror`` (area, source, position in the change feed, synced_at, age_hours) or None, ``unfinished``
        (a backfill that was interrupted) or None, ``vegnett`` (the road network) or None, ``drives``,
        ``estimates`` by method, ``verdicts`` and ``last_match`` (or None).
    """
    change = schema.change.c
    verdicts = store.rows(
        sa.select(change.verdict, sa.func.count().label("n"))
        .group_by(change.verdict)
        .order_by(change.verdict)
    )
    estimate = schema.estimate.c
    estimates = store.rows(
        sa.select(estimate.method, sa.func.count().label("n"))
        .group_by(estimate.method)
        .order_by(estimate.method)
    )
    drives = store.rows(
        sa.select(
            schema.drive.c.drive_id,
            schema.drive.c.name,
            schema.drive.c.length_m,
            schema.drive.c.n_annotations,
        ).order_by(schema.drive.c.started_ns)
    )
    return {
        "store": str(store.path),
        "mirror": _mirror(store),
        "unfinished": store.fact("mirror_backfill"),
        "vegnett": store.fact("vegnett"),
        "skiltpunkt": store.count(schema.skiltpunkt),
        "skiltplate": store.count(schema.skiltplate),
        "drives": drives,
        "estimates": {row["method"]: row["n"] for row in estimates},
        "verdicts": {row["verdict"]: row["n"] for row in verdicts},
        "last_match": store.fact("last_match"),
    }


def _mirror(store: Store) -> dict[str, Any] | None:
    fact = store.fact("mirror")
    if fact is None:
        return None
    age = dt.datetime.now(dt.UTC) - dt.datetime.fromisoformat(fact["synced_at"])
    return {**fact, "age_hours": round(age.total_seconds() / 3600, 1)}
