"""A drive, its sightings and its estimates into the store, in one transaction."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import sqlalchemy as sa

from twin.errors import RefusedError
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
from twin.store.records import Corrections, Estimate
from twin.store.store import Row, Store, utc_now
from twin.words import why_to_json
from twin.words.reasons import Misfit


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
    drive: Row,
    method: str,
    sightings: Sequence[Row],
    estimates: Sequence[Estimate],
    n_unplaced: int = 0,
    corrections: Corrections | None = None,
    misfits: Sequence[Misfit] = (),
    absence_gap: str = "",
    *,
    annotations_sha256: str = "",
    folder: str = "",
    replace: bool = False,
) -> Saved:
    """Keep one drive's record and its sightings and estimates by `method`, in one transaction.

    The same annotations read again replace their own results; results of another method from files that were
    since changed are of another recording: they go too. Other annotations of the same recording are a set of
    their own: it becomes the current one, and what came of the others is kept. Only a set of a drive that is
    not declared completely annotated does not take the place of one that is, nor does a set without
    annotations of a camera (its file was saved empty, or forgotten) that of one with them.

    Parameters
    ----------
    annotations_sha256 : str
        By which the same annotations are known.
    folder : str
        Where the drive was read from.
    replace : bool
        Whether all other annotation sets of the drive are deleted, also by a drive without annotations.

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
        "misfits": [why_to_json(misfit) for misfit in misfits],
        "absence_gap": absence_gap,
    }
    results: dict[sa.Table, Sequence[Row]] = {
        schema.drive_method: [result],
        schema.sighting: sightings,
        schema.estimate: [estimate.to_row() for estimate in estimates],
    }
    with store.transaction() as connection:
        if not replace:
            _refuse_emptying(store, connection, drive, folder)
        sets = annotation_sets(connection, drive_id)
        before = current_of(sets)
        unseen = tuple(sorted(_annotated_cameras(connection, drive_id) - set(drive["cameras"])))
        read = AnnotationSet(
            drive_id=drive_id,
            number=_number(connection, sets, annotations_sha256, drive),
            annotations_sha256=annotations_sha256,
            read_at=utc_now(),
            folder=folder,
            is_complete=drive["annotations_complete"],
            is_current=True,
            n_annotations=drive["n_annotations"],
            n_sightings=sum(not row["rejected"] for row in sightings),
            n_objects=len(estimates),
        )
        _make_way(connection, sets, read)
        _replace_results(connection, drive, method, results)
        put(connection, read)
        saved = _settle(connection, sets, before, read, unseen, replace=replace)
        if saved.annotation_set.is_current:
            store.touch(connection)
    return saved


def _number(connection: sa.Connection, sets: Sequence[AnnotationSet], sha256: str, drive: Row) -> int:
    """The number of the set that these annotations are; the next one if they are new."""
    same = [one.number for one in sets if one.annotations_sha256 == sha256]
    current = current_of(sets)
    if not same and current is not None and current.annotations_sha256 is None:
        # Of a store of schema 8 the files are known as a whole, not the annotations by themselves.
        stored = sa.select(schema.drive.c.content_sha256).where(schema.drive.c.drive_id == drive["drive_id"])
        if connection.execute(stored).scalar() == drive["content_sha256"]:
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


def _replace_results(
    connection: sa.Connection, drive: Row, method: str, results: dict[sa.Table, Sequence[Row]]
) -> None:
    drive_id = drive["drive_id"]
    stored_sha256 = connection.execute(
        sa.select(schema.drive.c.content_sha256).where(schema.drive.c.drive_id == drive_id)
    ).scalar()
    connection.execute(sa.delete(schema.drive).where(schema.drive.c.drive_id == drive_id))
    connection.execute(sa.insert(schema.drive), [dict(drive)])
    for table, rows in results.items():
        old = sa.delete(table).where(table.c.drive_id == drive_id)
        if stored_sha256 == drive["content_sha256"]:
            old = old.where(table.c.method == method)
        connection.execute(old)
        if rows:
            connection.execute(sa.insert(table), [dict(row) for row in rows])


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


def _refuse_emptying(store: Store, connection: sa.Connection, drive: Row, folder: str) -> None:
    """Refuse a drive without annotations where the store has some of it."""
    asked = sa.select(schema.drive.c.name, schema.drive.c.n_annotations)
    stored = connection.execute(asked.where(schema.drive.c.drive_id == drive["drive_id"])).first()
    if stored is None or not stored.n_annotations or drive["n_annotations"]:
        return
    raise RefusedError(
        f"{folder or drive['name']} has no annotations that can be used, and the store {store.name} has "
        f"{stored.n_annotations:,} of the same recording (drive {stored.name}, {drive['drive_id']}), which "
        "would be lost; nothing was changed: put the annotations into the folder, or give up those in the "
        "store with --replace."
    )
