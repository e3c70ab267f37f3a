"""How many signs of which kind the mirror holds: kept beside it, and changed by what changes.

A sync says how many signs there are, how accurate they claim to be and how they were captured. To count them
at every sync would read the whole mirror, also when nothing is new.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import sqlalchemy as sa

Kind = tuple[bool, float | None, str | None]
"""``own_geometry``, ``accuracy_cm``, ``capture_method``."""
Counts = Mapping[int, Counter[Kind]]
"""Type → kind → objects."""


def counted(
    connection: sa.Connection,
    table: sa.Table,
    where: sa.ColumnElement[bool] | None = None,
) -> Counter[Kind]:
    """Count the objects of a mirror's table by kind.

    Parameters
    ----------
    connection : Connection
    table : Table
    where : ColumnElement, optional
        Which rows count; all, if omitted.
    """
    kind = table.c.own_geometry, table.c.accuracy_cm, table.c.capture_method
    statement = sa.select(*kind, sa.func.count())
    if where is not None:
        statement = statement.where(where)
    rows = connection.execute(statement.group_by(*kind))
    return Counter({(own, accuracy, method): n for own, accuracy, method, n in rows})


def document_from_counts(counts: Counts) -> dict[str, Any]:
    """JSON form."""
    return {
        str(type_id): sorted(([*kind, n] for kind, n in kinds.items() if n), key=str)
        for type_id, kinds in counts.items()
    }


def counts_from_document(document: Mapping[str, Any]) -> dict[int, Counter[Kind]]:
    """Read what :func:`document_from_counts` wrote."""
    return {
        int(type_id): Counter({(own, accuracy, method): n for own, accuracy, method, n in rows})
        for type_id, rows in document.items()
    }


def without_own_geometry(counts: Counts) -> int:
    """How many objects are only placed on the road's centre line."""
    return sum(n for (own, _, _), n in _kinds(counts) if not own)


def by_accuracy(counts: Counts) -> dict[str, int]:
    """Stated accuracy in cm → objects with own geometry, most frequent first."""
    return _tally(
        (accuracy, n) for kinds in counts.values() for (own, accuracy, _), n in kinds.items() if own
    )


def by_capture_method(counts: Counts) -> dict[str, int]:
    """``datafangstmetode`` → objects with own geometry, most frequent first."""
    return _tally((method, n) for (own, _, method), n in _kinds(counts) if own)


def _kinds(counts: Counts) -> Iterator[tuple[Kind, int]]:
    return (item for kinds in counts.values() for item in kinds.items())


def _tally(pairs: Iterable[tuple[object, int]]) -> dict[str, int]:
    sums: Counter[str] = Counter()
    for value, n in pairs:
        sums["not stated" if value is None else str(value)] += n
    return dict(sorted(((key, n) for key, n in sums.items() if n), key=lambda item: (-item[1], item[0])))
