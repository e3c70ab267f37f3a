"""The findings of a match into the store, in one transaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sqlalchemy as sa

from twin.decisions.reopen import reopen_changed
from twin.decisions.temporary import settle_road_works
from twin.matching.kept import Kept
from twin.matching.news import FACT, News, known_findings, news_of
from twin.matching.poles.keys import Mark
from twin.store import schema
from twin.store.records import Finding
from twin.store.sql import inserting
from twin.store.store import Row, Store, utc_now


def save_changes(
    store: Store,
    findings: Sequence[Finding],
    pole_keys: Mapping[str, str],
    run: Row,
    marks: Mapping[str, Mark] | None = None,
    kept: Kept | None = None,
) -> News | None:
    """Replace the findings of the last match, in one transaction.

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

    Returns
    -------
    News or None
        What differs from the findings that stood before, which :data:`twin.matching.news.FACT` keeps too;
        None of the first match.
    """
    with store.transaction() as connection:
        view = store.view(connection)
        last, before = view.fact("last_match"), known_findings(view)
        connection.execute(sa.delete(schema.change))
        if findings:
            connection.execute(sa.insert(schema.change), [finding.to_row() for finding in findings])
        connection.execute(sa.delete(schema.pole_key))
        if pole_keys:
            keys = [{"member": member, "pole": pole} for member, pole in pole_keys.items()]
            connection.execute(sa.insert(schema.pole_key), keys)
        _remember(connection, pole_keys, marks or {})
        if kept is not None:
            kept.save(connection)
        now = utc_now()
        reopen_changed(connection, now)
        settle_road_works(connection, now)
        store.put_fact(connection, "last_match", {"revision": view.revision(), **run})
        if last is None:
            return None
        news = news_of(last.get("at", ""), before, known_findings(view))
        store.put_fact(connection, FACT, news.to_row())
        return news


def _remember(connection: sa.Connection, pole_keys: Mapping[str, str], marks: Mapping[str, Mark]) -> None:
    """Keep by what each pole is known again; one that is absent now is not forgotten."""
    rows = [
        {
            "drive_id": mark.drive_id,
            "clicks": mark.clicks,
            "pole": pole_keys[member],
            "east_m": mark.east_m,
            "north_m": mark.north_m,
            "skiltnummer": ";".join(mark.codes),
        }
        for member, mark in marks.items()
    ]
    if not rows:
        return
    insert = inserting(connection, schema.known_mark)
    fresh = {name: insert.excluded[name] for name in ("east_m", "north_m", "skiltnummer")}
    same = ["drive_id", "clicks", "pole"]
    connection.execute(insert.on_conflict_do_update(index_elements=same, set_=fresh), rows)
