"""The store as :class:`nvdb.mirror.states.MirrorStore`: what readers see is always a whole mirror."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any

import sqlalchemy as sa

from nvdb.mirror import Applied, Backfill, FetchResult, Following, Ids, SourcePage
from nvdb.objects import Skiltplate, Skiltpunkt
from twin.mirror.counts import Counts, Kind, counted, counts_from_document, document_from_counts
from twin.mirror.raw import same_object
from twin.mirror.rows import mirror_row
from twin.mirror.touched import MOST, Changed, changed_ids, gone_ids, places_of
from twin.store import schema
from twin.store.sql import bulk_insert, inserting, swap, taking_place
from twin.store.store import Store, utc_now
from twin.store.touched import Place

_FACT = "mirror"
_BACKFILL = "mirror_backfill"
_ENDS = "mirror_ends"
"""Type → the first end date in the visible mirror: to look for it at every sync would read all of it."""
_COUNTS = "mirror_counts"
"""The visible mirror's :data:`twin.mirror.counts.Counts`."""
_TABLES = tuple(schema.MIRROR.items())
_ID_CHUNK = 500
"""Ids in one statement: SQLite of some systems takes no more than 999 parameters."""


class StoreMirror:
    """The mirror inside a store.

    Three tables a type: the visible one, one *aside* for a backfill or a round of changes that is not whole
    yet, and a history of states that were replaced. ``synced_at`` of an object is when its present state was
    first fetched: an object that did not change keeps it.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def following(self) -> Following | None:
        """The visible mirror."""
        fact = self._store.fact(_FACT)
        if fact is None:
            return None
        return Following(fact["source"], fact["area"], fact["position"], _ids(fact["unread"]))

    def backfill(self) -> Backfill | None:
        """A backfill that was interrupted."""
        fact = self._store.fact(_BACKFILL)
        if fact is None:
            return None
        cursors = {int(type_id): cursor for type_id, cursor in fact["cursors"].items()}
        return Backfill(fact["source"], fact["area"], fact["position"], cursors, _ids(fact["unread"]))

    def count(self, type_id: int, ids: Iterable[int] | None = None) -> int:
        """Objects in the visible mirror."""
        if ids is None:
            return self.counts()[type_id].total()
        table = schema.MIRROR[type_id].visible
        chosen = (sa.select(sa.func.count().label("n")).where(table.c.nvdb_id.in_(c)) for c in _chunks(ids))
        return sum(self._store.rows(statement)[0]["n"] for statement in chosen)

    def counts(self) -> dict[int, Counter[Kind]]:
        """Objects in the visible mirror by type and kind."""
        fact = self._store.fact(_COUNTS)
        if fact is not None:
            return counts_from_document(fact)
        counts = self.recounted()  # a store from before counts were kept
        with self._store.transaction() as connection:
            self._store.put_fact(connection, _COUNTS, document_from_counts(counts))
        return counts

    def recounted(self) -> dict[int, Counter[Kind]]:
        """What :meth:`counts` says, from the objects themselves: reads the whole mirror."""
        with self._store.transaction() as connection:
            return {type_id: counted(connection, t.visible) for type_id, t in _TABLES}

    def count_aside(self, type_id: int) -> int:
        """Objects kept aside."""
        return self._store.count(schema.MIRROR[type_id].aside)

    def ended(self, type_id: int, day: str) -> frozenset[int]:
        """Ids in the visible mirror whose end date has come."""
        first = (self._store.fact(_ENDS) or {}).get(str(type_id))
        if first is None or day < first:
            return frozenset()
        table = schema.MIRROR[type_id].visible
        rows = self._store.rows(sa.select(table.c.nvdb_id).where(table.c.end_date <= day))
        return frozenset(row["nvdb_id"] for row in rows)

    def begin_backfill(self, backfill: Backfill) -> None:
        """Empty what is aside and note the position."""
        with self._store.transaction() as connection:
            self._empty_aside(connection)
            self._store.put_fact(connection, _BACKFILL, _document(backfill))

    def save_page(self, page: SourcePage) -> None:
        """Keep a page and its cursor aside, in one transaction."""
        begun = self.backfill()
        if begun is None:
            msg = "save_page comes after begin_backfill"
            raise RuntimeError(msg)
        cursors = {**begun.cursors, page.type_id: page.next_cursor}
        read = {skilt.nvdb_id for skilt in page.objects}
        unread = (begun.unread.get(page.type_id, frozenset()) | page.unreadable) - read
        now = replace(begun, cursors=cursors, unread={**begun.unread, page.type_id: unread})
        with self._store.transaction() as connection:
            _insert(connection, page.type_id, page.objects)
            self._store.put_fact(connection, _BACKFILL, _document(now))

    def drop_aside(self, gone: Ids) -> None:
        """Take objects out of what is kept aside."""
        with self._store.transaction() as connection:
            for type_id, ids in gone.items():
                aside = schema.MIRROR[type_id].aside
                for chunk in _chunks(ids):
                    connection.execute(sa.delete(aside).where(aside.c.nvdb_id.in_(chunk)))

    def keep_visible(self, ids: Ids) -> None:
        """Copy visible states aside, of objects that are not aside."""
        with self._store.transaction() as connection:
            for type_id, wanted in ids.items():
                tables = schema.MIRROR[type_id]
                for chunk in _chunks(wanted):
                    states = sa.select(*tables.visible.columns).where(tables.visible.c.nvdb_id.in_(chunk))
                    insert = inserting(connection, tables.aside)
                    anew = insert.from_select(tables.visible.columns.keys(), states)
                    connection.execute(anew.on_conflict_do_nothing())

    def publish(self, following: Following) -> Applied:
        """Swap the visible tables for those aside."""
        now = utc_now()
        before, after = self.counts(), {}
        created, changed, deleted = {}, {}, {}
        with self._store.transaction() as connection:
            for type_id, tables in _TABLES:
                if before[type_id]:
                    _settle_spelling(connection, tables)
            other = {type_id: changed_ids(connection, t) | gone_ids(connection, t) for type_id, t in _TABLES}
            places = None if not any(before.values()) else _places(connection, other)
            for type_id, tables in _TABLES:
                after[type_id] = counted(connection, tables.aside)
                n_both = changed[type_id] = 0
                if before[type_id]:
                    n_both, changed[type_id] = _compare(connection, tables)
                    _keep_history(connection, tables, now)
                    _keep_fetch_time(connection, tables)
                created[type_id] = after[type_id].total() - n_both
                deleted[type_id] = before[type_id].total() - n_both
                swap(connection, tables.visible, tables.aside)
            self._store.drop_fact(connection, _BACKFILL)
            applied = Applied(created, changed, deleted, _totals(after))
            self._publish_facts(connection, following, after, now)
            self._touch(connection, applied, other, places)
            ends = {str(type_id): _first_end(connection, t.visible) for type_id, t in _TABLES}
            self._store.put_fact(connection, _ENDS, ends)
        return applied

    def begin_changes(self) -> None:
        """Empty what is aside and forget an interrupted backfill."""
        with self._store.transaction() as connection:
            self._empty_aside(connection)
            self._store.drop_fact(connection, _BACKFILL)

    def save_changes(self, result: FetchResult) -> None:
        """Keep changed objects aside."""
        by_type: dict[int, list[Skiltpunkt | Skiltplate]] = {95: [], 96: []}
        for skilt in result.objects:
            by_type[96 if isinstance(skilt, Skiltplate) else 95].append(skilt)
        with self._store.transaction() as connection:
            for type_id, objects in by_type.items():
                _insert(connection, type_id, objects)

    def apply(self, following: Following, deleted: Ids) -> Applied:
        """Bring changes in and take deleted objects out, in one transaction."""
        now = utc_now()
        counts = self.counts()
        created, changed, removed = {}, {}, {}
        with self._store.transaction() as connection:
            coming = {type_id: _first_end(connection, t.aside) for type_id, t in _TABLES}
            for _, tables in _TABLES:
                _settle_spelling(connection, tables)
            other = {
                type_id: changed_ids(connection, t) | deleted.get(type_id, frozenset())
                for type_id, t in _TABLES
            }
            places = _places(connection, other)
            for type_id, tables in _TABLES:
                n_both, changed[type_id] = _compare(connection, tables)
                gone = _delete(connection, tables, deleted.get(type_id, frozenset()), now)
                new = counted(connection, tables.aside)
                created[type_id], removed[type_id] = new.total() - n_both, gone.total()
                counts[type_id].subtract(gone)
                counts[type_id].subtract(counted(connection, tables.visible, _is_aside(tables)))
                counts[type_id].update(new)
                _keep_changed_history(connection, tables, now)
                _keep_fetch_time(connection, tables)
                _upsert_aside(connection, tables)
            self._note_ends(connection, coming, now[:10])
            applied = Applied(created, changed, removed, _totals(counts))
            self._publish_facts(connection, following, counts, now)
            self._touch(connection, applied, other, places)
        return applied

    def _note_ends(self, connection: sa.Connection, coming: dict[int, str | None], today: str) -> None:
        """Keep the first end dates up to date with what came; those in the past are looked for anew."""
        ends = self._store.fact(_ENDS) or {}
        for type_id, tables in _TABLES:
            days = (ends.get(str(type_id)), coming[type_id])
            first = min((day for day in days if day is not None), default=None)
            late = first is not None and first <= today
            ends[str(type_id)] = _first_end(connection, tables.visible) if late else first
        self._store.put_fact(connection, _ENDS, ends)

    def _publish_facts(
        self, connection: sa.Connection, following: Following, counts: Counts, now: str
    ) -> None:
        before = self._store.fact(_FACT) or {}
        # From when on this area's states were observed; before it only their own dates speak.
        since = before.get("since", now) if before.get("area") == following.area else now
        fact = {**_document(following), "since": since, "synced_at": now}
        self._store.put_fact(connection, _FACT, fact)
        self._store.put_fact(connection, _COUNTS, document_from_counts(counts))

    def _touch(
        self, connection: sa.Connection, applied: Applied, other: Changed, before: frozenset[Place] | None
    ) -> None:
        """Say where signs are otherwise now than they were, if any are."""
        if any((*applied.created.values(), *applied.changed.values(), *applied.deleted.values())):
            now = None if before is None else _places(connection, other)
            self._store.touch(connection, places=None if before is None or now is None else before | now)

    def _empty_aside(self, connection: sa.Connection) -> None:
        for tables in schema.MIRROR.values():
            connection.execute(sa.delete(tables.aside))


def _places(connection: sa.Connection, changed: Changed) -> frozenset[Place] | None:
    """Where these objects are; None of more than can be told."""
    return None if sum(map(len, changed.values())) > MOST else places_of(connection, changed)


def _document(state: Backfill | Following) -> dict[str, Any]:
    """JSON form of a state."""
    unread = {str(type_id): sorted(ids) for type_id, ids in state.unread.items() if ids}
    return {**asdict(state), "unread": unread}


def _ids(document: dict[str, list[int]]) -> dict[int, frozenset[int]]:
    return {int(type_id): frozenset(ids) for type_id, ids in document.items()}


def _first_end(connection: sa.Connection, table: sa.Table) -> str | None:
    first = connection.execute(sa.select(sa.func.min(table.c.end_date))).scalar()
    return None if first is None else str(first)


def _chunks(ids: Iterable[int]) -> Iterator[list[int]]:
    wanted = sorted(ids)
    for start in range(0, len(wanted), _ID_CHUNK):
        yield wanted[start : start + _ID_CHUNK]


def _totals(counts: Counts) -> dict[int, int]:
    return {type_id: kinds.total() for type_id, kinds in counts.items()}


def _insert(connection: sa.Connection, type_id: int, objects: Sequence[Skiltpunkt | Skiltplate]) -> None:
    now = utc_now()
    rows = [mirror_row(skilt, now) for skilt in objects]
    bulk_insert(connection, schema.MIRROR[type_id].aside, rows, replace=True)


def _in_both(tables: schema.MirrorTables) -> sa.Join:
    """Aside and visible states of the objects that are in both.

    SQLite looks up the inner table's rows by id, and takes the outer one as it is written: a round of changes
    must not read the whole mirror.
    """
    return tables.aside.join(tables.visible, tables.aside.c.nvdb_id == tables.visible.c.nvdb_id)


def _is_aside(tables: schema.MirrorTables) -> sa.ColumnElement[bool]:
    """Whether a visible object is aside too: looked up by the ids aside, however SQLite likes to join."""
    return tables.visible.c.nvdb_id.in_(sa.select(tables.aside.c.nvdb_id))


def _settle_spelling(connection: sa.Connection, tables: schema.MirrorTables) -> None:
    """Let an object aside that is only written differently take the visible one's text: it did not change."""
    a, v = tables.aside, tables.visible
    both = sa.select(a.c.nvdb_id, a.c.raw, v.c.raw).select_from(_in_both(tables))
    differing = connection.execute(both.where(a.c.raw != v.c.raw))
    same = [nvdb_id for nvdb_id, ours, theirs in differing if same_object(ours, theirs)]
    for chunk in _chunks(same):
        take = sa.update(a).values(raw=v.c.raw).where(a.c.nvdb_id == v.c.nvdb_id)
        connection.execute(take.where(a.c.nvdb_id.in_(chunk)))


def _compare(connection: sa.Connection, tables: schema.MirrorTables) -> tuple[int, int]:
    """Count what is both aside and visible, and what of it differs."""
    differs = sa.func.count().filter(tables.aside.c.raw != tables.visible.c.raw)
    statement = sa.select(sa.func.count(), differs).select_from(_in_both(tables))
    n_both, n_changed = connection.execute(statement).one()
    return int(n_both), int(n_changed)


def _keep_history(connection: sa.Connection, tables: schema.MirrorTables, now: str) -> None:
    """Put visible states that are about to go (changed or not aside) into the history."""
    a, v = tables.aside, tables.visible
    other = sa.or_(a.c.nvdb_id.is_(None), a.c.raw != v.c.raw)
    going = sa.select(*v.columns, sa.literal(now)).select_from(v.outerjoin(a, a.c.nvdb_id == v.c.nvdb_id))
    _into_history(connection, tables, going.where(other))


def _keep_changed_history(connection: sa.Connection, tables: schema.MirrorTables, now: str) -> None:
    a, v = tables.aside, tables.visible
    going = sa.select(*v.columns, sa.literal(now)).select_from(_in_both(tables))
    _into_history(connection, tables, going.where(a.c.raw != v.c.raw))


def _into_history(connection: sa.Connection, tables: schema.MirrorTables, states: sa.Select[Any]) -> None:
    names = [*tables.visible.columns.keys(), "seen_until"]
    # Of two states that end in the same second the first is kept: the other was visible for less than that.
    insert = inserting(connection, tables.history).from_select(names, states)
    connection.execute(insert.on_conflict_do_nothing())


def _keep_fetch_time(connection: sa.Connection, tables: schema.MirrorTables) -> None:
    """An object that did not change was fetched when it was first fetched."""
    a, v = tables.aside, tables.visible
    same = sa.and_(a.c.nvdb_id == v.c.nvdb_id, a.c.raw == v.c.raw)
    connection.execute(sa.update(a).values(synced_at=v.c.synced_at).where(same))


def _delete(
    connection: sa.Connection, tables: schema.MirrorTables, ids: frozenset[int], now: str
) -> Counter[Kind]:
    """Take objects out, into the history; return how many there were of which kind."""
    v, gone = tables.visible, Counter[Kind]()
    for chunk in _chunks(ids):
        chosen = v.c.nvdb_id.in_(chunk)
        gone.update(counted(connection, v, chosen))
        _into_history(connection, tables, sa.select(*v.columns, sa.literal(now)).where(chosen))
        connection.execute(sa.delete(v).where(chosen))
    return gone


def _upsert_aside(connection: sa.Connection, tables: schema.MirrorTables) -> None:
    states = sa.select(*tables.aside.columns).where(sa.true())  # else SQLite takes ON CONFLICT for a join's
    insert = taking_place(connection, tables.visible)
    connection.execute(insert.from_select(tables.visible.columns.keys(), states))
    connection.execute(sa.delete(tables.aside))
