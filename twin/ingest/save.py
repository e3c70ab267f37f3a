"""A drive, its sightings and its estimates into the store, in one transaction."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import sqlalchemy as sa

from twin.errors import RefusedError
from twin.ingest.located import LocatedDrive
from twin.store import schema
from twin.store.annotation_sets import (
    AnnotationSet,
    annotation_sets,
    current_of,
    forget,
    put,
    put_aside,
    take_back,
)
from twin.store.sql import as_values, bulk_insert
from twin.store.store import Row, Store, utc_now


@dataclass(frozen=True, slots=True)
class Saved:
    """As which annotation set a drive was saved.

    Attributes
    ----------
    annotation_set : AnnotationSet
        What was saved.
    other : AnnotationSet or None
        The set that was current before it, or that is current instead of it; None if that is the same one,
        or is not kept.
    deleted : tuple of int
        Numbers of the drive's other sets, which were deleted because that was asked for.
    unseen : tuple of str
        Cameras of which `other` has annotations and what was saved has none.
    """

    annotation_set: AnnotationSet
    other: AnnotationSet | None = None
    deleted: tuple[int, ...] = ()
    unseen: tuple[str, ...] = ()

    def sentence(self) -> str:
        """Say what became of the sets; "" if there is nothing to say."""
        now, other = self.annotation_set, self.other
        if self.deleted:
            numbers = ", ".join(map(str, self.deleted))
            return f"Deleted as asked for: what came of earlier annotations of this drive (set {numbers})."
        if other is None:
            return ""
        if now.is_current:
            return (
                f"These are other annotations than the store had of this recording: {now.n_objects} objects "
                f"count now (set {now.number}), not the {other.n_objects} of before, which are kept as set "
                f"{other.number}; back: `twin drives use {now.drive_id} {other.number}`."
            )
        why = (
            f"they have nothing of {', '.join(self.unseen)}, and set {other.number} does"
            if self.unseen
            else f"they are not of a completely annotated drive, and those of set {other.number} are"
        )
        return (
            f"These annotations do not count: {why} ({other.n_objects} objects); they are kept as set "
            f"{now.number} ({now.n_objects} objects); to let them count: "
            f"`twin drives use {now.drive_id} {now.number}`, or --replace, which deletes the other sets."
        )


def save_drive(
    store: Store,
    located: LocatedDrive,
    *,
    replace: bool = False,
    also: Callable[[sa.Connection], None] | None = None,
) -> Saved:
    """Keep one drive's record and its sightings and estimates, in one transaction: whole or not at all.

    The same annotations read again replace their own results; results of another method from files that were
    since changed are of another recording: they go too. Where the store has all of it already, to the last
    bit, nothing is written and findings stay as fresh as they were. Other annotations of the same recording
    are a set of their own: it becomes the current one, and what came of the others is kept. Only a set of a
    drive that is not declared completely annotated does not take the place of one that is, nor does a set
    without annotations of a camera (its file was saved empty, or forgotten) that of one with them.

    Parameters
    ----------
    store : Store
    located : LocatedDrive
    replace : bool
        Whether all other annotation sets of the drive are deleted, also by a drive without annotations.
    also : callable, optional
        Called with the connection at the end of the transaction: what is kept with the drive or not at all.

    Raises
    ------
    RefusedError
        The drive has no annotations, and the store has some of it; nothing is changed.
    """
    drive = located.drive
    with store.transaction() as connection:
        if not replace:
            _refuse_emptying(store, connection, located)
        sets = annotation_sets(connection, drive.drive_id)
        before = current_of(sets)
        unseen = tuple(sorted(_annotated_cameras(connection, drive.drive_id) - set(drive.cameras)))
        read = AnnotationSet(
            drive_id=drive.drive_id,
            number=_number(connection, sets, located),
            annotations_sha256=located.annotations_sha256,
            read_at=utc_now(),
            folder=located.folder,
            is_complete=drive.annotations_complete,
            is_current=True,
            n_annotations=drive.n_annotations,
            n_sightings=located.sightings.n_located,
            n_objects=len(located.estimates),
        )
        _make_way(connection, sets, read)
        is_new = _replace_results(connection, located) or before is None or before.number != read.number
        put(connection, read)
        saved = _settle(connection, sets, before, read, unseen, replace=replace)
        if saved.annotation_set.is_current and is_new:
            store.touch(connection, [drive.drive_id])
        if also is not None:
            also(connection)
    return saved


def _number(connection: sa.Connection, sets: Sequence[AnnotationSet], located: LocatedDrive) -> int:
    """The number of the set that these annotations are; the next one if they are new."""
    drive = located.drive
    same = [one.number for one in sets if one.annotations_sha256 == located.annotations_sha256]
    current = current_of(sets)
    if not same and current is not None and current.annotations_sha256 is None:
        # Of a store of schema 8 the files are known as a whole, not the annotations by themselves.
        stored = sa.select(schema.drive.c.content_sha256).where(schema.drive.c.drive_id == drive.drive_id)
        if connection.execute(stored).scalar() == drive.content_sha256:
            same = [current.number]
    return same[0] if same else max((one.number for one in sets), default=0) + 1


def _annotated_cameras(connection: sa.Connection, drive_id: str) -> set[str]:
    """Cameras of the current set."""
    stored = sa.select(schema.drive.c.cameras).where(schema.drive.c.drive_id == drive_id)
    return set(connection.execute(stored).scalar() or ())


def _make_way(connection: sa.Connection, sets: Sequence[AnnotationSet], read: AnnotationSet) -> None:
    """Let the tables hold what the store has of the annotations that were read, and nothing of others."""
    current = current_of(sets)
    if current is None or current.number == read.number:
        return
    put_aside(connection, current)
    if not current.n_annotations:
        forget(connection, current)
    for one in sets:
        if one.number == read.number:
            take_back(connection, one)


def _replace_results(connection: sa.Connection, located: LocatedDrive) -> bool:
    """Write the drive and what the method gave; False where all of it is there already."""
    drive_id, method = located.drive.drive_id, located.result.method
    drive = located.drive.to_row()
    results = {
        schema.drive_method: [located.result.to_row(drive_id)],
        schema.estimate: [estimate.to_row() for estimate in located.estimates],
        schema.sighting: located.sightings.to_rows(drive_id, method),
    }
    of_drive = schema.drive.c.drive_id == drive_id
    if _has(connection, schema.drive, of_drive, [drive]) and all(
        _has(connection, table, (table.c.drive_id == drive_id) & (table.c.method == method), rows)
        for table, rows in results.items()
    ):
        return False
    stored_sha256 = connection.execute(sa.select(schema.drive.c.content_sha256).where(of_drive)).scalar()
    connection.execute(sa.delete(schema.drive).where(of_drive))
    connection.execute(sa.insert(schema.drive), [drive])
    for table, rows in results.items():
        old = sa.delete(table).where(table.c.drive_id == drive_id)
        if stored_sha256 == located.drive.content_sha256:
            old = old.where(table.c.method == method)
        connection.execute(old)
        bulk_insert(connection, table, as_values(table, rows))
    return True


def _has(
    connection: sa.Connection, table: sa.Table, which: sa.ColumnElement[bool], rows: Sequence[Row]
) -> bool:
    """Whether the table's rows of which this holds are these, whatever their order."""
    key, names = [column.name for column in table.primary_key], [column.name for column in table.columns]
    stored = connection.execute(sa.select(table).where(which)).mappings()
    of_key = {tuple(row[name] for name in key): row for row in rows}
    n_same = 0
    for found in stored:
        row = of_key.get(tuple(found[name] for name in key), {})
        if any(found[name] != row.get(name) for name in names):
            return False
        n_same += 1
    return n_same == len(rows)


def _settle(
    connection: sa.Connection,
    sets: Sequence[AnnotationSet],
    before: AnnotationSet | None,
    read: AnnotationSet,
    unseen: tuple[str, ...],
    *,
    replace: bool,
) -> Saved:
    """Delete the other sets if that was asked for; else let the newest complete one count.

    `unseen` are the cameras that were annotated before and are not now.
    """
    if replace:
        others = [one for one in sets if one.number != read.number]
        for one in others:
            forget(connection, one)
        return Saved(read, deleted=tuple(one.number for one in others))
    if before is None or before.number == read.number or not before.n_annotations:
        return Saved(read)
    if not unseen and (read.is_complete or not before.is_complete):
        return Saved(read, before)
    put_aside(connection, read)
    take_back(connection, before)
    return Saved(dataclasses.replace(read, is_current=False), before, unseen=unseen)


def _refuse_emptying(store: Store, connection: sa.Connection, located: LocatedDrive) -> None:
    """Refuse a drive without annotations where the store has some of it."""
    drive = located.drive
    asked = sa.select(schema.drive.c.name, schema.drive.c.n_annotations)
    stored = connection.execute(asked.where(schema.drive.c.drive_id == drive.drive_id)).first()
    if stored is None or not stored.n_annotations or drive.n_annotations:
        return
    raise RefusedError(
        f"{located.folder or drive.name} has no annotations that can be used, and the store {store.name} has "
        f"{stored.n_annotations:,} of the same recording (drive {stored.name}, {drive.drive_id}), which "
        "would be lost; nothing was changed: put the annotations into the folder, or give up those in the "
        "store with --replace."
    )
