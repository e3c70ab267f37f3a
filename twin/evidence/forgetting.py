"""Crops that are no longer needed: deleted with their files, and logged."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass

import sqlalchemy as sa

from twin.evidence.files import TASK, sweep
from twin.evidence.log import FORGOTTEN, log
from twin.store import schema
from twin.store.store import Store


@dataclass(frozen=True, slots=True)
class Forgotten:
    """What was deleted.

    Attributes
    ----------
    before : str
        ISO 8601 day, UTC: pictures that were taken before it.
    n_crops, n_files : int
    change_ids : tuple of str
        Of the findings that lost crops.
    drives : tuple of str
        Names of the drives whose pictures they were.
    """

    before: str
    n_crops: int
    n_files: int
    change_ids: tuple[str, ...]
    drives: tuple[str, ...]


def forget(store: Store, before: dt.date, *, by: str = "", reason: str = "") -> Forgotten:
    """Delete the crops of pictures that were taken before a day.

    Parameters
    ----------
    store : Store
    before : date
        UTC.
    by, reason : str
        Kept in the log.

    Raises
    ------
    RefusedError
        Another run is at work on the crops.
    """
    crop, drive = schema.crop.c, schema.drive.c
    midnight = dt.datetime.combine(before, dt.time(), tzinfo=dt.UTC)
    is_old = crop.epoch_ns < int(midnight.timestamp()) * 1_000_000_000
    with store.alone(*TASK):
        with store.transaction() as connection:
            rows = connection.execute(sa.select(crop.change_id, crop.drive_id).where(is_old)).all()
            ids = sorted({row.drive_id for row in rows})
            named = connection.execute(sa.select(drive.name).where(drive.drive_id.in_(ids))).scalars()
            drives = tuple(sorted(set(named)))
            change_ids = tuple(sorted({row.change_id for row in rows}))
            connection.execute(sa.delete(schema.crop).where(is_old))
            if rows:
                why = reason or f"pictures taken before {before.isoformat()}"
                log(connection, FORGOTTEN, by, why, len(rows), change_ids)
        n_files = sweep(store)
    return Forgotten(before.isoformat(), len(rows), n_files, change_ids, drives)
