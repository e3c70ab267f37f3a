"""What the store holds, in numbers."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from twin import schema
from twin.store import Store


def status(store: Store) -> dict[str, Any]:
    """Summarise mirror, drives, estimates and findings.

    Returns
    -------
    dict
        ``mirror`` (area, source, synced_at, counts) or None, ``drives``, ``estimates`` by method,
        ``verdicts`` and ``last_match`` (or None).
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
        "mirror": store.fact("mirror"),
        "skiltpunkt": store.count(schema.skiltpunkt),
        "skiltplate": store.count(schema.skiltplate),
        "drives": drives,
        "estimates": {row["method"]: row["n"] for row in estimates},
        "verdicts": {row["verdict"]: row["n"] for row in verdicts},
        "last_match": store.fact("last_match"),
    }
