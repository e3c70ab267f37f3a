"""What NVDB said on a day, from the mirror's present states and those that it replaced.

The rule, for each object:

1. A state holds from when NVDB last modified it (``sist_modifisert``), but not from before we saw another
   state in its place, and at the latest from when we fetched it; until the next state holds, or until we
   learnt that the object is gone. Of these states the last that holds by the end of the day counts.
2. Where none holds yet on a day from before the mirror began, we can only assume: the earliest state that we
   know, by its dates of validity. On a later day the object was not in NVDB.
3. Whatever state counts, the day has to lie in its gyldighet: from and including the start date, up to and
   not including the end date. A date that is not known excludes nothing.

Days are UTC. What is not known: objects that were deleted, and states that were replaced, before the mirror
began; and a deletion is dated when we learnt of it. Frequent syncs make all of that small.
"""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Iterator, Sequence

import sqlalchemy as sa

from twin.errors import StoreError
from twin.store import schema
from twin.store.store import Row, Snapshot, Store

Box = tuple[float, float, float, float]

OBSERVED, UNMODIFIED, ASSUMED = "observed", "unmodified", "gyldighet"
"""``basis`` of a row: we had it on the day; NVDB says it is older than the day; by its dates alone."""

_NEVER = "9999"


def mirror_as_of(store: Store, day: dt.date, *, within: Box | None = None) -> tuple[list[Row], list[Row]]:
    """Return what NVDB said on a day.

    Parameters
    ----------
    store : Store
    day : date
        UTC; what was learnt in the course of the day counts.
    within : (min east, min north, max east, max north), optional
        EPSG:25833, metres: only objects whose position on that day lies inside. For a whole country's mirror,
        of which all rows would fill the memory.

    Returns
    -------
    points, plates : lists of rows
        The columns of ``skiltpunkt`` and ``skiltplate`` without ``raw``, ordered by ``nvdb_id``, and
        ``basis``: ``observed`` (we had this state on the day), ``unmodified`` (we had it later, and NVDB has
        not modified it since the day) or ``gyldighet`` (a later state whose dates include the day).

    Raises
    ------
    StoreError
        Nothing was synced.
    """
    with store.snapshot() as view:
        since = _mirrored_since(view)
        if since is None:
            raise StoreError(f"The store {store.name} has no NVDB signs yet: run `twin sync-nvdb` first.")
        points, plates = (
            _as_of(view, schema.MIRROR[type_id], day.isoformat(), since, within) for type_id in (95, 96)
        )
    return points, plates


def _mirrored_since(view: Snapshot) -> str | None:
    """First day of the present area's mirror; None if there is none."""
    facts = view.rows(sa.select(schema.meta.c.value).where(schema.meta.c.key == "mirror"))
    if not facts:
        return None
    since = json.loads(facts[0]["value"]).get("since")
    if since is None:
        # Every state that was ever fetched is still there, among them the first.
        tables = [table for one in schema.MIRROR.values() for table in (one.visible, one.history)]
        firsts = [view.rows(sa.select(sa.func.min(table.c.synced_at).label("at"))) for table in tables]
        since = min((rows[0]["at"] for rows in firsts if rows[0]["at"]), default="9999")
    return _day(since)


def _as_of(
    view: Snapshot, tables: schema.MirrorTables, day: str, since: str, within: Box | None
) -> list[Row]:
    """Apply the rule to every object of a type."""
    visible = [column for column in tables.visible.columns if column.name != "raw"]
    older = [tables.history.c[column.name] for column in visible]
    states: dict[int, list[Row]] = {}
    for row in view.rows(sa.select(*older, tables.history.c.seen_until)):
        states.setdefault(row["nvdb_id"], []).append(row)
    present = sa.select(*visible)
    if within is not None:
        # An object that moved into the box or out of it has a history.
        moved = tables.visible.c.nvdb_id.in_(sa.select(tables.history.c.nvdb_id))
        present = present.where(sa.or_(_inside_box(tables.visible, within), moved))
    for row in view.rows(present):
        states.setdefault(row["nvdb_id"], []).append(row)
    rows = (_state_on(states[nvdb_id], day, since) for nvdb_id in sorted(states))
    return [row for row in rows if row is not None and (within is None or _is_inside(row, within))]


def _inside_box(table: sa.Table, box: Box) -> sa.ColumnElement[bool]:
    return sa.and_(table.c.east_m.between(box[0], box[2]), table.c.north_m.between(box[1], box[3]))


def _is_inside(row: Row, box: Box) -> bool:
    east, north = row["east_m"], row["north_m"]
    if east is None or north is None:
        return False
    return bool(box[0] <= east <= box[2] and box[1] <= north <= box[3])


def _state_on(states: list[Row], day: str, since: str) -> Row | None:
    """The state of one object that counts on a day, with its ``basis``; None if it was not in NVDB."""
    ordered = sorted(states, key=lambda state: (state["synced_at"], state.get("seen_until") or _NEVER))
    held = [state for state, begin in zip(ordered, _begins(ordered), strict=True) if begin <= day]
    if held:
        state = held[-1]
        basis = OBSERVED if _day(state["synced_at"]) <= day else UNMODIFIED
        if _day(state.get("seen_until") or _NEVER) <= day:
            return None
    elif day < since:
        state, basis = ordered[0], ASSUMED
    else:
        return None
    start, end = _day(state["start_date"] or ""), _day(state["end_date"] or _NEVER)
    if not start <= day < end:
        return None
    return {name: value for name, value in state.items() if name != "seen_until"} | {"basis": basis}


def _begins(ordered: Sequence[Row]) -> Iterator[str]:
    """Yield the day from which each state of one object holds."""
    last_fetched, gone = "", _NEVER
    for state in ordered:
        fetched, modified = _instant(state["synced_at"]), _instant(state["last_modified"] or "")
        # A state that was replaced ends after the next was fetched; one that ended before was deleted.
        after = gone if gone < fetched else last_fetched
        yield _day(modified if after < modified <= fetched else fetched)
        last_fetched, gone = fetched, _instant(state.get("seen_until") or _NEVER)


def _day(text: str) -> str:
    return text[:10]


def _instant(text: str) -> str:
    """ISO time to the second, comparable as text; NVDB's documentation says that its times are UTC."""
    return text[:19].replace(" ", "T")
