"""Objects that were sent to NVDB, and whether the mirror shows by now what was done about them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import sqlalchemy as sa

from nvdb.endringssett import Endring
from nvdb.objects import point_from_wkt
from twin.decisions.evidence import Ask
from twin.matching.sites import SKILTPUNKT
from twin.store import schema
from twin.store.store import Row


@dataclass(frozen=True, slots=True)
class SentObject:
    """One object that an operation is about.

    Attributes
    ----------
    type_id : int
    nvdb_id : int or None
        None for a new one that NVDB has given no id yet.
    temp_id : str or None
        Name of a new object in its set.
    before : (version, time of change) or None
        As the mirror had it when it was sent; None for a new one.
    place : (east, north) or None
        EPSG:25833, of a new Skiltpunkt.
    removed : bool
        Whether the operation takes it away.
    """

    type_id: int
    nvdb_id: int | None
    temp_id: str | None = None
    before: tuple[int | None, str | None] | None = None
    place: tuple[float, float] | None = None
    removed: bool = False

    @classmethod
    def from_json(cls, document: Row) -> SentObject:
        """Take it back from the store."""
        before, place = document["before"], document["place"]
        return cls(
            **{
                **document,
                "before": None if before is None else (before[0], before[1]),
                "place": None if place is None else (place[0], place[1]),
            }
        )


@dataclass(frozen=True, slots=True)
class Shown:
    """What the mirror has of some objects, by type and id.

    Attributes
    ----------
    states : mapping
        Version and time of change of those that are there now.
    earlier : set
        Those that were there once.
    """

    states: Mapping[tuple[int, int], tuple[int | None, str | None]]
    earlier: frozenset[tuple[int, int]]

    @classmethod
    def of(cls, objects: Iterable[SentObject], ask: Ask) -> Shown:
        """Read it."""
        wanted: dict[int, set[int]] = {}
        for item in objects:
            if item.nvdb_id is not None and item.type_id in schema.MIRROR:
                wanted.setdefault(item.type_id, set()).add(item.nvdb_id)
        states, earlier = {}, set()
        for kind, ids in wanted.items():
            now, before = schema.MIRROR[kind].visible.c, schema.MIRROR[kind].history.c
            for some in _chunks(sorted(ids)):
                for row in ask(
                    sa.select(now.nvdb_id, now.version, now.last_modified).where(now.nvdb_id.in_(some))
                ):
                    states[kind, row["nvdb_id"]] = (row["version"], row["last_modified"])
                gone = ask(sa.select(before.nvdb_id).where(before.nvdb_id.in_(some)).distinct())
                earlier |= {(kind, row["nvdb_id"]) for row in gone}
        return cls(states, frozenset(earlier))

    def state(self, item: SentObject) -> tuple[int | None, str | None]:
        """Version and time of change; neither where the mirror has no such object."""
        return self.states.get((item.type_id, item.nvdb_id or 0), (None, None))

    def of_set(self, objects: Sequence[SentObject]) -> bool:
        """Whether it shows what a set did that was carried out."""
        return bool(objects) and all(self._shows(item) for item in objects)

    def _shows(self, item: SentObject) -> bool:
        """A new object has been in the mirror; a changed one is not there as it was."""
        if item.removed or item.nvdb_id is None:
            return False
        if item.before is not None:
            return self.state(item) != item.before
        key = (item.type_id, item.nvdb_id)
        return key in self.states or key in self.earlier


def objects_of(endringer: Iterable[Endring], ask: Ask) -> tuple[SentObject, ...]:
    """Say what operations are about, and how the mirror has it now."""
    objects = [
        SentObject(
            type_id=endring.type_id,
            nvdb_id=endring.nvdb_id,
            temp_id=endring.temp_id,
            place=_place(endring) if endring.operasjon == "registrer" else None,
            removed=endring.operasjon == "fjern",
        )
        for endring in endringer
    ]
    shown = Shown.of(objects, ask)
    return tuple(
        item if item.nvdb_id is None else replace(item, before=shown.state(item)) for item in objects
    )


def _chunks(ids: Sequence[int]) -> Iterator[Sequence[int]]:
    """SQLite of some systems takes no more than 999 parameters."""
    return (ids[start : start + 500] for start in range(0, len(ids), 500))


def _place(endring: Endring) -> tuple[float, float] | None:
    geometri = next((item.geometri for item in endring.egenskaper if item.geometri is not None), None)
    if geometri is None or endring.type_id != SKILTPUNKT:
        return None
    return point_from_wkt(geometri.wkt)[:2]
