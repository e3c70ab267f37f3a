"""Several findings about one pole → one operation for each object version."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from nvdb.endringssett import Assosiasjon, Endring


def merged(endringer: Iterable[Endring]) -> tuple[Endring, ...]:
    """Put changes of the same object together; new objects stay as they are.

    A closed object is only closed. A correction beside an update goes into the update: the new version says
    what the correction would have said, and the old one stays as it was.
    """
    found: dict[object, Endring] = {}
    for endring in endringer:
        key: object = endring.temp_id if endring.nvdb_id is None else (endring.type_id, endring.nvdb_id)
        found[key] = _both(found[key], endring) if key in found else endring
    return tuple(found.values())


def _both(one: Endring, other: Endring) -> Endring:
    for closed in (one, other):
        if closed.operasjon == "lukk":
            return closed
    updates = [endring for endring in (one, other) if endring.operasjon == "delvisOppdater"]
    base = max(updates, key=lambda e: (e.startdato is not None, e.startdato)) if updates else one
    values = {e.type_id: e for endring in (one, other) for e in endring.egenskaper}
    return replace(
        base,
        egenskaper=tuple(values.values()),
        assosiasjoner=_children([*one.assosiasjoner, *other.assosiasjoner]),
        stedfesting=other.stedfesting or one.stedfesting,
    )


def _children(assosiasjoner: Iterable[Assosiasjon]) -> tuple[Assosiasjon, ...]:
    found: dict[int, Assosiasjon] = {}
    for item in assosiasjoner:
        before = found.get(item.type_id)
        found[item.type_id] = replace(item, dotre=(*(before.dotre if before else ()), *item.dotre))
    return tuple(found.values())
