"""A whole country of generated signs, made page by page while they are served.

Nothing is kept but what has been changed: object number *i* follows from *i* and the seed, so that a million
objects need no memory, and the server is faster than its clients.
"""

from __future__ import annotations

import json
from bisect import bisect_left, insort
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any, Final

from nvdb.datakatalog.ids import SKILTPLATE, SKILTPUNKT
from nvdb.errors import ReplaySourceError
from nvdb.replay.pages import PLACES, QueryError, Record, neste, record_from_raw
from nvdb.replay.uberiket import numbers, page_document, page_size, uberiket_from_les_v4
from nvdb.replay.world import ReplayWorld
from nvdb_country.templates import FIRST_ID, ID_STEP, Item, item_maker

_REFUSED: Final = {*PLACES, "kartutsnitt", "polygon", "dato"}


class GeneratedWorld(ReplayWorld):
    """A world of generated signs; they can be changed, removed and added to like any other's.

    Only the whole country and ``ider`` can be asked for, and pages always have all parts, in UTM33 and in
    the order of ids.

    Parameters
    ----------
    n_points, n_plates : int
        Plates are spread over the points; those of one point stand at its coordinates.
    seed : int
    clock : callable
        Now, with a time zone.
    """

    def __init__(
        self,
        n_points: int,
        n_plates: int,
        seed: int = 0,
        *,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        if n_points < 0 or n_plates < 0 or (n_plates and not n_points):
            msg = f"{n_plates} plates on {n_points} points cannot be generated: plates need points."
            raise ReplaySourceError(msg)
        super().__init__(clock=clock)
        self._n = {SKILTPUNKT: n_points, SKILTPLATE: n_plates}
        self._items = item_maker(n_points, n_plates, seed)
        self._hidden: dict[int, list[int]] = {SKILTPUNKT: [], SKILTPLATE: []}

    def ids(self, type_id: int, stop: int, start: int = 0) -> list[int]:
        """Ids of the generated objects number `start` to `stop` (excluded) of a type."""
        return [FIRST_ID[type_id] + ID_STEP * number for number in range(start, min(stop, self._n[type_id]))]

    def counts(self) -> dict[int, int]:
        """How many objects there are of each type."""
        return {kind: self.count(kind, {}) for kind in sorted(self.types)}

    def count(self, type_id: int, query: Mapping[str, str]) -> int:
        """How many objects there are of a type, or of some ids."""
        with self._lock:
            if "ider" in query:
                return len(self.select(type_id, query))
            _refuse_filters(query)
            return (
                self._n.get(type_id, 0)
                - len(self._hidden.get(type_id, ()))
                + len(self._records.get(type_id, ()))
            )

    def one(self, type_id: int, object_id: int) -> Record | None:
        """The object of a type and id, or None."""
        with self._lock:
            records = self._records.get(type_id, [])
            place = bisect_left(records, object_id, key=lambda record: record.id)
            if place < len(records) and records[place].id == object_id:
                return records[place]
            number = self._number(type_id, object_id)
            if number is None or _holds(self._hidden[type_id], object_id):
                return None
            ((_, _, text),) = self._items("les-v4", type_id, number, number + 1)
            return record_from_raw(json.loads(text), type_id)

    def select(self, type_id: int, query: Mapping[str, str]) -> list[Record]:
        """Objects of some ids; everything else is answered page by page."""
        _refuse_filters(query)
        if "ider" not in query:
            msg = "En generert verden kan bare filtreres på ider"
            raise QueryError(msg)
        found = (self.one(type_id, object_id) for object_id in sorted(set(numbers(query["ider"], "ider"))))
        return [record for record in found if record is not None]

    def versions(self, type_id: int, query: Mapping[str, str]) -> list[Record]:
        """All versions of some ids."""
        with self._lock:
            ids = set(numbers(query.get("ider", ""), "ider"))
            older = [record for number in ids for record in self._older.get(number, ())]
            found = [*self.select(type_id, query), *(r for r in older if r.type_id == type_id)]
        return sorted(found, key=lambda record: (record.id, record.versjon))

    def page_body(self, type_id: int, query: Mapping[str, str], page_url: str) -> bytes:
        """One page of V4, as JSON."""
        if "ider" in query or type_id not in self._n:
            return super().page_body(type_id, query, page_url)
        _refuse_filters(query)
        size, start = page_size(query), query.get("start")
        items = self._page(type_id, _after(start, ":"), self._cut(size), "les-v4")
        metadata: dict[str, Any] = {"returnert": len(items), "sidestørrelse": size}
        if query.get("inkluderAntall", "").lower() == "true":
            metadata["antall"] = self.count(type_id, {})
        cursor = f"{items[-1][0]}:{items[-1][1]}" if items else start
        if cursor is not None:
            metadata["neste"] = neste(page_url, query, cursor)
        return _joined("objekter", items, metadata)

    def uberiket_body(self, type_id: int, query: Mapping[str, str], url: str) -> bytes | None:
        """One page of Uberiket, as JSON; None for questions by id."""
        if "ider" in query or type_id not in self._n:
            return None
        _refuse_filters(query)
        size = page_size(query)
        shown = self._cut(size)
        items = self._page(type_id, _after(query.get("start"), "-"), shown + 1, "uberiket")
        more, items = len(items) > shown, items[:shown]
        cursor = f"{items[-1][0]}-{items[-1][1]}" if more else None
        metadata = page_document("vegobjekter", items, size, cursor, url, query)["metadata"]
        return _joined("vegobjekter", items, metadata)

    def _cut(self, size: int) -> int:
        return min(size, self.page_limit or size)

    def _page(self, type_id: int, after: tuple[int, int], size: int, api: str) -> list[Item]:
        """The next objects after an id and version: generated ones, and between them those changed."""
        with self._lock:
            number = max(0, (after[0] - FIRST_ID[type_id]) // ID_STEP + 1)
            items: list[Item] = []
            while len(items) < size and number < self._n[type_id]:
                stop = min(number + size - len(items), self._n[type_id])
                hidden = self._hidden[type_id]
                made = self._items(api, type_id, number, stop)
                items += [item for item in made if not _holds(hidden, item[0])] if hidden else made
                number = stop
            changed = self._changed_items(type_id, after, size, api)
            if changed:
                items = sorted([*items, *changed])[:size]
            if self.drift is not None:
                items = [(*item[:2], _dumped(self.show(json.loads(item[2]), api))) for item in items]
            return items

    def _changed_items(self, type_id: int, after: tuple[int, int], size: int, api: str) -> list[Item]:
        records = self._records.get(type_id, [])
        place = bisect_left(records, after[0], key=lambda record: record.id)
        found = records[place : place + size + 1]
        if api == "uberiket":
            found = [*found, *(r for old in self._older.values() for r in old if r.type_id == type_id)]
        wanted = [record for record in found if (record.id, record.versjon) > after]
        if api == "les-v4":
            return [(record.id, record.versjon, _dumped(record.raw)) for record in wanted]
        return [
            (record.id, record.versjon, _dumped(uberiket_from_les_v4(record.raw, type_id)))
            for record in wanted
        ]

    def _number(self, type_id: int, object_id: int) -> int | None:
        """Which generated object an id is; None if it is none."""
        if type_id not in self._n:
            return None
        number, rest = divmod(object_id - FIRST_ID[type_id], ID_STEP)
        return number if rest == 0 and 0 <= number < self._n[type_id] else None

    def _put(self, record: Record) -> None:
        self._hide(record)
        super()._put(record)

    def _take(self, record: Record) -> None:
        self._hide(record)
        super()._take(record)

    def _hide(self, record: Record) -> None:
        if self._number(record.type_id, record.id) is None:
            return
        hidden = self._hidden[record.type_id]
        if not _holds(hidden, record.id):
            insort(hidden, record.id)


def _holds(ids: list[int], object_id: int) -> bool:
    place = bisect_left(ids, object_id)
    return place < len(ids) and ids[place] == object_id


def _after(start: str | None, separator: str) -> tuple[int, int]:
    if start is None:
        return 0, 0
    number, _, versjon = start.partition(separator)
    if not (number.isdigit() and versjon.isdigit()):
        msg = f"start: '{start}' er ikke et gyldig startpunkt"
        raise QueryError(msg)
    return int(number), int(versjon)


def _refuse_filters(query: Mapping[str, str]) -> None:
    asked = sorted(_REFUSED & set(query))
    if asked:
        msg = f"En generert verden kan ikke filtreres på {asked[0]}"
        raise QueryError(msg)


def _dumped(document: Mapping[str, Any]) -> str:
    return json.dumps(document, ensure_ascii=False)


def _joined(name: str, items: list[Item], metadata: Mapping[str, Any]) -> bytes:
    objects = ",".join([item[2] for item in items])
    return f'{{"{name}":[{objects}],"metadata":{_dumped(metadata)}}}'.encode()
