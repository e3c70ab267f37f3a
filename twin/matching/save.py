"""The findings of a match into the store, in one transaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from typing import NamedTuple

import sqlalchemy as sa

from twin.decisions.reopen import reopen_changed
from twin.decisions.temporary import settle_road_works
from twin.matching.kept import Kept, NotSure
from twin.matching.news import FACT, News, known_findings, known_of, news_of
from twin.matching.poles.keys import Mark
from twin.matching.poles.seen_in import keys_held, marks_named
from twin.store import schema
from twin.store.records import Finding
from twin.store.sql import as_values, bulk_insert, each_text
from twin.store.store import Row, Snapshot, Store, utc_now
from twin.store.touched import FACT as TOUCHED
from twin.store.touched import without_those_of


class Part(NamedTuple):
    """What findings of a part of the store replace.

    Attributes
    ----------
    gone : list of str
        Ids of the findings of before.
    members_gone : frozenset of str
        Estimates (``drive:object``) of which nothing is left.
    last_match : JSON object or None
        The fact of the match that left the rest.
    """

    gone: Sequence[str]
    members_gone: Set[str]
    last_match: Row | None


def save_changes(
    store: Store,
    findings: Sequence[Finding],
    pole_keys: Mapping[str, str],
    run: Row,
    marks: Mapping[str, Mark] | None = None,
    kept: Kept | None = None,
    part: Part | None = None,
) -> News | None:
    """Replace the findings of the last match, or a part of them, in one transaction.

    Findings that were decided on other evidence are open again (:mod:`twin.decisions.reopen`).

    Parameters
    ----------
    findings : sequence of Finding
    pole_keys : mapping of estimate (``drive:object``) to the key of its pole
    run : JSON object
        Facts of the match, with the store's ``revision`` that it is of; without one it is that of now.
    marks : mapping of estimate to its mark, optional
        By which later matches know the poles again.
    kept : Kept, optional
        What the next match need not work out again.
    part : Part, optional
        What these findings replace; all by default.

    Returns
    -------
    News or None
        What differs from the findings that stood before, which :data:`twin.matching.news.FACT` keeps too;
        None of the first match.

    Raises
    ------
    NotSure
        Another match was saved since the one whose findings are to stay.
    """
    with store.transaction() as connection:
        view = store.view(connection)
        last = view.fact("last_match")
        if part is not None and part.last_match != last:
            raise NotSure
        gone = None if part is None else part.gone
        before = known_findings(view, gone)
        _delete(connection, schema.change, schema.change.c.change_id, gone)
        bulk_insert(connection, schema.change, as_values(schema.change, [one.to_row() for one in findings]))
        _put_keys(connection, view, pole_keys, part)
        _remember(connection, view, pole_keys, marks or {})
        if kept is not None:
            kept.save(connection, rest_goes=part is None)
        now = utc_now()
        reopen_changed(connection, now)
        settle_road_works(connection, now)
        of = {"revision": view.revision(), **run}
        store.put_fact(connection, "last_match", of)
        store.put_fact(connection, TOUCHED, without_those_of(view.fact(TOUCHED), of["revision"]))
        if last is None:
            return None
        news = news_of(last.get("at", ""), before, [known_of(finding) for finding in findings])
        store.put_fact(connection, FACT, news.to_row())
        return news


def _delete(
    connection: sa.Connection, table: sa.Table, name: sa.ColumnElement[str], gone: Sequence[str] | None
) -> None:
    """Delete some rows, or all of them."""
    if gone is None:
        connection.execute(sa.delete(table))
    elif gone:
        connection.execute(sa.delete(table).where(name.in_(each_text(gone))))


def _put_keys(
    connection: sa.Connection, view: Snapshot, pole_keys: Mapping[str, str], part: Part | None
) -> None:
    t, fresh = schema.pole_key, dict(pole_keys)
    if part is None:
        connection.execute(sa.delete(t))
    else:
        before = keys_held(view, pole_keys)
        fresh = {member: key for member, key in fresh.items() if before.get(member) != key}
        _delete(connection, t, t.c.member, sorted({*part.members_gone, *(fresh.keys() & before.keys())}))
    bulk_insert(connection, t, list(fresh.items()))


def _remember(
    connection: sa.Connection, view: Snapshot, pole_keys: Mapping[str, str], marks: Mapping[str, Mark]
) -> None:
    """Keep by what each pole is known again; one that is absent now is not forgotten."""
    t = schema.known_mark
    now = {
        (mark.drive_id, mark.clicks, pole_keys[member]): {
            "east_m": mark.east_m,
            "north_m": mark.north_m,
            "skiltnummer": ";".join(mark.codes),
        }
        for member, mark in marks.items()
    }
    known = marks_named(view, now.keys())
    moved = [
        {"number": row["id"], **now[name]}
        for name, row in known.items()
        if any(row[column] != value for column, value in now[name].items())
    ]
    if moved:
        connection.execute(sa.update(t).where(t.c.id == sa.bindparam("number")), moved)
    columns = ("drive_id", "clicks", "pole")
    fresh = [dict(zip(columns, name, strict=True)) | row for name, row in now.items() if name not in known]
    if fresh:
        connection.execute(sa.insert(t), fresh)
