"""A drive's annotations, set by set: one is current, what came of the others is kept and can be taken back.

The tables of :mod:`twin.store.schema` that everybody reads hold the current set alone; its rows change
places with those of ``schema.KEPT`` when another one becomes current.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import sqlalchemy as sa

from twin.errors import ConfigError
from twin.store import schema
from twin.store.store import Store


@dataclass(frozen=True, slots=True)
class AnnotationSet:
    """One version of a drive's annotations.

    Attributes
    ----------
    number : int
        From 1, in the order in which the sets of a drive first came.
    annotations_sha256 : str or None
        As of :class:`twin.drives.drive.Drive`; None where the store did not keep it yet.
    read_at : str or None
        UTC, when it was last read; None likewise.
    folder : str
        That it was read from; "" where that is not known.
    is_complete : bool
        Whether the drive was declared completely annotated.
    is_current : bool
        Whether matches, exports and reports see it.
    n_annotations, n_sightings, n_objects : int
        Annotations; of these, and of their objects, those with a position, by the method read last.
    """

    drive_id: str
    number: int
    annotations_sha256: str | None
    read_at: str | None
    folder: str
    is_complete: bool
    is_current: bool
    n_annotations: int
    n_sightings: int
    n_objects: int


_COLUMNS = [schema.annotation_set.c[field.name] for field in fields(AnnotationSet)]


def annotation_sets(connection: sa.Connection, drive_id: str) -> list[AnnotationSet]:
    """Return the sets of one drive by number, inside the caller's transaction."""
    table = schema.annotation_set
    asked = sa.select(*_COLUMNS).where(table.c.drive_id == drive_id).order_by(table.c.number)
    return [AnnotationSet(*row) for row in connection.execute(asked)]


def current_of(sets: Sequence[AnnotationSet]) -> AnnotationSet | None:
    """Return the one that is current; None where there is none."""
    return next((one for one in sets if one.is_current), None)


def put_aside(connection: sa.Connection, one: AnnotationSet) -> None:
    """Keep what came of the current set; its drive is then in no table that others read."""
    for table, kept in schema.KEPT.items():
        names, mine = [c.name for c in table.columns], table.c.drive_id == one.drive_id
        rows = sa.select(*table.columns, sa.literal(one.number)).where(mine)
        connection.execute(sa.insert(kept).from_select([*names, kept.c.annotation_set.name], rows))
        connection.execute(sa.delete(table).where(mine))
    _mark(connection, one, is_current=False)


def take_back(connection: sa.Connection, one: AnnotationSet) -> None:
    """Make a kept set current again, where no other one is."""
    for table, kept in schema.KEPT.items():
        mine = (kept.c.drive_id == one.drive_id) & (kept.c.annotation_set == one.number)
        rows = sa.select(*(kept.c[c.name] for c in table.columns)).where(mine)
        connection.execute(sa.insert(table).from_select([c.name for c in table.columns], rows))
        connection.execute(sa.delete(kept).where(mine))
    _mark(connection, one, is_current=True)


def forget(connection: sa.Connection, one: AnnotationSet) -> None:
    """Delete a set; of the current one the rows that others read stay."""
    for kept in schema.KEPT.values():
        mine = (kept.c.drive_id == one.drive_id) & (kept.c.annotation_set == one.number)
        connection.execute(sa.delete(kept).where(mine))
    connection.execute(sa.delete(schema.annotation_set).where(_is(one)))


def put(connection: sa.Connection, one: AnnotationSet) -> None:
    """Write what is known of a set, in place of what was."""
    connection.execute(sa.delete(schema.annotation_set).where(_is(one)))
    row = {column.name: getattr(one, column.name) for column in _COLUMNS}
    connection.execute(sa.insert(schema.annotation_set), [row])


@dataclass(frozen=True, slots=True)
class NamedSet:
    """An annotation set, and its drive's name."""

    drive: str
    annotation_set: AnnotationSet


def all_annotation_sets(store: Store) -> list[NamedSet]:
    """Return the sets of every drive: drives by time, sets by number."""
    sets, drive = schema.annotation_set, schema.drive
    asked = (
        sa.select(drive.c.name.label("drive"), *_COLUMNS)
        .join(drive, drive.c.drive_id == sets.c.drive_id)
        .order_by(drive.c.started_ns, drive.c.drive_id, sets.c.number)
    )
    return [
        NamedSet(row["drive"], AnnotationSet(**{column.name: row[column.name] for column in _COLUMNS}))
        for row in store.rows(asked)
    ]


def use_annotation_set(store: Store, drive: str, number: int) -> tuple[AnnotationSet, AnnotationSet]:
    """Make one of a drive's annotation sets the current one; findings of another one are then stale.

    Parameters
    ----------
    drive : str
        Its id, or the name of one of its folders where no other drive has it.
    number : int

    Returns
    -------
    before, now : AnnotationSet
        The sets that were and are current: the same one where nothing had to be done.

    Raises
    ------
    ConfigError
        The store has no such drive, several of that name, or no such set.
    """
    with store.transaction() as connection:
        sets = annotation_sets(connection, _drive_id(connection, drive))
        before, now = current_of(sets), next((one for one in sets if one.number == number), None)
        if before is None or now is None:
            numbers = ", ".join(str(one.number) for one in sets)
            raise ConfigError(f"The drive {drive} has no annotation set {number}, only {numbers or 'none'}.")
        if now.number != before.number:
            put_aside(connection, before)
            take_back(connection, now)
            store.touch(connection, [now.drive_id])
    return before, now


def _drive_id(connection: sa.Connection, drive: str) -> str:
    tables = (schema.drive.c, schema.KEPT[schema.drive].c)  # a copy of the folder may have another name
    named = [sa.select(t.drive_id).where((t.drive_id == drive) | (t.name == drive)) for t in tables]
    ids = sorted(connection.execute(sa.union(*named)).scalars())
    if not ids:
        raise ConfigError(f"The store has no drive {drive}: `twin drives` lists its drives.")
    if len(ids) > 1:
        raise ConfigError(f"Several drives are called {drive}: say which by its id ({', '.join(ids)}).")
    return str(ids[0])


def _is(one: AnnotationSet) -> sa.ColumnElement[bool]:
    table = schema.annotation_set.c
    return (table.drive_id == one.drive_id) & (table.number == one.number)


def _mark(connection: sa.Connection, one: AnnotationSet, *, is_current: bool) -> None:
    connection.execute(sa.update(schema.annotation_set).where(_is(one)).values(is_current=is_current))
