"""A drive, its sightings and its estimates into the store, in one transaction."""

from __future__ import annotations

from collections.abc import Sequence

import sqlalchemy as sa

from twin.errors import RefusedError
from twin.store import schema
from twin.store.records import Corrections, Estimate
from twin.store.store import Row, Store


def save_drive(
    store: Store,
    drive: Row,
    method: str,
    sightings: Sequence[Row],
    estimates: Sequence[Estimate],
    n_unplaced: int = 0,
    corrections: Corrections | None = None,
    misfits: Sequence[str] = (),
    absence_gap: str = "",
    *,
    folder: str = "",
    replace: bool = False,
) -> None:
    """Replace one drive's record and its sightings and estimates by `method`, in one transaction.

    Results of another method from files that were since changed are of another recording: they go too.

    Parameters
    ----------
    folder : str
        Where the drive was read from, for messages.
    replace : bool
        Whether a drive without annotations may take the place of one that has some.

    Raises
    ------
    RefusedError
        The drive has no annotations, and the store has some of it; nothing is changed.
    """
    drive_id = drive["drive_id"]
    result = {
        "drive_id": drive_id,
        "method": method,
        "n_unplaced": n_unplaced,
        "corrections": {} if corrections is None else corrections.to_json(),
        "misfits": list(misfits),
        "absence_gap": absence_gap,
    }
    with store.transaction() as connection:
        if not replace:
            _refuse_emptying(store, connection, drive, folder)
        stored_sha256 = connection.execute(
            sa.select(schema.drive.c.content_sha256).where(schema.drive.c.drive_id == drive_id)
        ).scalar()
        connection.execute(sa.delete(schema.drive).where(schema.drive.c.drive_id == drive_id))
        connection.execute(sa.insert(schema.drive), [dict(drive)])
        results = {
            schema.drive_method: [result],
            schema.sighting: sightings,
            schema.estimate: [estimate.to_row() for estimate in estimates],
        }
        for table, rows in results.items():
            old = sa.delete(table).where(table.c.drive_id == drive_id)
            if stored_sha256 == drive["content_sha256"]:
                old = old.where(table.c.method == method)
            connection.execute(old)
            if rows:
                connection.execute(sa.insert(table), [dict(row) for row in rows])
        store.touch(connection)


def _refuse_emptying(store: Store, connection: sa.Connection, drive: Row, folder: str) -> None:
    """Refuse a drive without annotations where the store has some of it."""
    asked = sa.select(schema.drive.c.name, schema.drive.c.n_annotations)
    stored = connection.execute(asked.where(schema.drive.c.drive_id == drive["drive_id"])).first()
    if stored is None or not stored.n_annotations or drive["n_annotations"]:
        return
    raise RefusedError(
        f"{folder or drive['name']} has no annotations that can be used, and the store {store.path} has "
        f"{stored.n_annotations:,} of the same recording (drive {stored.name}, {drive['drive_id']}), which "
        "would be lost; nothing was changed: put the annotations into the folder, or give up those in the "
        "store with --replace."
    )
