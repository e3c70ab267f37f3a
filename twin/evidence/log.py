"""The log of crops: added to inside a transaction, never changed."""

from __future__ import annotations

from collections.abc import Sequence

import sqlalchemy as sa

from twin.store import schema
from twin.store.store import utc_now

UNMASKED, FORGOTTEN = "unmasked", "forgotten"


def log(
    connection: sa.Connection, kind: str, by: str, reason: str, n_crops: int, change_ids: Sequence[str]
) -> None:
    """Add an entry inside the caller's transaction."""
    entry = {"kind": kind, "by": by, "reason": reason, "n_crops": n_crops, "change_ids": list(change_ids)}
    connection.execute(sa.insert(schema.crop_log), [{**entry, "at": utc_now()}])
