"""Where signs may face otherwise after a new road network: a match looks only there."""

from __future__ import annotations

from collections.abc import Iterable

import sqlalchemy as sa

from twin.mirror.touched import MOST, places_of
from twin.store import schema
from twin.store.sql import from_json
from twin.store.touched import Place

MOST_LINKS = 2000
"""Of more links that changed everything counts as changed."""
_BESIDE_M = 51.0
"""A sign is set beside a road that is at most 50 m away (:func:`twin.mirror.vegnett.facing`)."""
_ROWS_AT_ONCE = 50_000

Link = tuple[int, bytes]
"""Its sequence, and its line as WKB."""


def places_beside_changes(connection: sa.Connection, day: str, now: str) -> frozenset[Place] | None:
    """Places of signs that the network aside may set beside another road than the visible one does.

    That is near links that differ, or that are valid on one of two days alone, and where NVDB itself sets a
    sign on their sequences.

    Parameters
    ----------
    connection : Connection
        In the transaction in which the network aside becomes visible, before that.
    day, now : str
        ISO dates on which the visible network was fetched, and the one aside.

    Returns
    -------
    frozenset of places or None
        None of more than can be told.
    """
    links = _changed(connection, min(day, now), max(day, now))
    if len(links) > MOST_LINKS:
        return None
    if not links:
        return frozenset()
    found = {95: _near(connection, schema.skiltpunkt, links), 96: _near(connection, schema.skiltplate, links)}
    found[96] |= _set_on(connection, {sequence for sequence, _ in links})
    if sum(map(len, found.values())) > MOST:
        return None
    return places_of(connection, {type_id: frozenset(ids) for type_id, ids in found.items()})


def _changed(connection: sa.Connection, first: str, last: str) -> set[Link]:
    """Links that are in one of the networks alone, or that began or ended between two days."""
    old, new = schema.veglenke, schema.veglenke_aside
    found = set[Link]()
    for one, other in ((old, new), (new, old)):
        odd = sa.except_(sa.select(*one.columns), sa.select(*other.columns)).limit(MOST_LINKS + 1)
        rows = connection.execute(odd).mappings()
        found |= {(row["veglenkesekvensid"], bytes(row["geometri"])) for row in rows}
    begun, ended = ((new.c[name] > first) & (new.c[name] <= last) for name in ("startdato", "sluttdato"))
    asked = sa.select(new.c.veglenkesekvensid, new.c.geometri).where(begun | ended).limit(MOST_LINKS + 1)
    return found | {(sequence, bytes(line)) for sequence, line in connection.execute(asked)}


def _near(connection: sa.Connection, table: sa.Table, links: Iterable[Link]) -> set[int]:
    """Signs in the boxes about links."""
    import shapely

    found = set[int]()
    for west, south, east, north in shapely.bounds(shapely.from_wkb([line for _, line in links])).tolist():
        inside = sa.and_(
            table.c.east_m.between(west - _BESIDE_M, east + _BESIDE_M),
            table.c.north_m.between(south - _BESIDE_M, north + _BESIDE_M),
        )
        found |= set(connection.execute(sa.select(table.c.nvdb_id).where(inside)).scalars())
    return found


def _set_on(connection: sa.Connection, sequences: set[int]) -> set[int]:
    """Plates that NVDB itself sets on one of these sequences of links: reads where every plate is."""
    plate = schema.skiltplate.c
    asked = sa.select(plate.nvdb_id, sa.type_coerce(plate.stedfesting, sa.Text))
    found = set[int]()
    with connection.execute(asked, execution_options={"yield_per": _ROWS_AT_ONCE}) as rows:
        for nvdb_id, said in rows:
            if any(place.get("veglenkesekvensid") in sequences for place in from_json(said)):
                found.add(nvdb_id)
    return found
