"""A road database that a test can change while it is being read.

>>> world = ReplayWorld({95: [point], 96: [plate]})             # doctest: +SKIP
>>> with ReplayServer(world) as server:
...     world.update(7, egenskaper=[...])
...     world.remove(8)

Each change is an event in both feeds (:mod:`nvdb.replay.events`).
"""

from __future__ import annotations

import random
import threading
from bisect import bisect_left, insort
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

from nvdb.datakatalog.ids import SKILTPLATE, SKILTPUNKT
from nvdb.errors import ReplaySourceError
from nvdb.objects.vegobjekt import RawObject
from nvdb.replay.events import Hendelse, Kind, time_text
from nvdb.replay.faults import RequestInfo
from nvdb.replay.pages import Generated, Record, ReplaySource, record_from_raw

Drift = Callable[[dict[str, Any], str], dict[str, Any]]


class ReplayWorld(ReplaySource):
    """Objects in V4's form that can be created, changed, removed and created again.

    Safe to change from any thread, also while the server answers.

    Parameters
    ----------
    objects : mapping, optional
        Object type → objects in V4's form. They are there from the start: no events tell of them.
    clock : callable
        Now, with a time zone. Events never share a time, whatever it says.
    vegnett : sequence, optional
        Segments of the road network in V4's form; it may be replaced while the server runs.

    Attributes
    ----------
    events : list of Hendelse
    page_limit : int or None
        Pages hold at most this many objects, whatever ``antall`` asks: short pages.
    order_seed : int or None
        None: pages are ordered by id; else by a permutation that depends on this number.
    on_request : callable or None
        Called with each request before it is answered: the place to change the world between two pages.
    drift : callable or None
        Called with each object just before it is shown, and ``les-v4`` or ``uberiket``; what it returns is
        shown instead: for new, missing and wrong fields.
    """

    def __init__(
        self,
        objects: Generated | None = None,
        *,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
        vegnett: Sequence[RawObject] | None = None,
    ) -> None:
        super().__init__({SKILTPUNKT: (), SKILTPLATE: (), **(objects or {})})
        self.vegnett = vegnett
        self.clock = clock
        self.page_limit: int | None = None
        self.order_seed: int | None = None
        self.on_request: Callable[[RequestInfo], None] | None = None
        self.drift: Drift | None = None
        self._removed: dict[int, Record] = {}
        self._older: dict[int, list[Record]] = {}
        self._lock = threading.RLock()

    def now(self) -> datetime:
        """What the world's clock says."""
        return self.clock()

    def create(self, type_id: int, raw: RawObject) -> None:
        """Add an object; ReplaySourceError if its id is taken."""
        record = record_from_raw(raw, type_id)
        with self._lock:
            if self.find(record.id) is not None:
                msg = f"Vegobjekt {record.id} is there already: update it, or create another id."
                raise ReplaySourceError(msg)
            self._put(record)
            self._tell("Opprettet", record)

    def update(self, object_id: int, **changes: Any) -> None:
        """Correct an object: the same version with other parts (``egenskaper=…``, ``geometri=…``)."""
        with self._lock:
            record = self._changed(self._need(object_id), changes)
            self._put(record)
            self._tell("Endret", record)

    def new_version(self, object_id: int, startdato: str, **changes: Any) -> None:
        """Give an object a new version from a date on, which is where the old one ends."""
        with self._lock:
            old = self._need(object_id)
            closed = self._with_metadata(old, sluttdato=startdato)
            self._older.setdefault(object_id, []).append(closed)
            self._tell("Endret", closed)
            record = self._changed(old, changes)
            record = self._with_metadata(record, versjon=old.versjon + 1, startdato=startdato)
            self._put(record)
            self._tell("Opprettet", record)

    def close(self, object_id: int, sluttdato: str) -> None:
        """End an object's last version: V4 shows it no more, Uberiket shows when it ended."""
        with self._lock:
            closed = self._with_metadata(self._need(object_id), sluttdato=sluttdato)
            self._older.setdefault(object_id, []).append(closed)
            self._take(closed)
            self._tell("Endret", closed)

    def remove(self, object_id: int) -> None:
        """Remove every version of an object, as if it had never been."""
        with self._lock:
            record = self._need(object_id)
            self._take(record)
            self._removed[object_id] = record
            for version in [*self._older.pop(object_id, []), record]:
                self._tell("Fjernet", version)

    def recreate(self, object_id: int, **changes: Any) -> None:
        """Bring back an object that was removed, as it was but for the changes."""
        with self._lock:
            if object_id not in self._removed:
                msg = f"Vegobjekt {object_id} was not removed: only removed objects can be created again."
                raise ReplaySourceError(msg)
            record = self._changed(self._removed.pop(object_id), changes)
            self._put(record)
            self._tell("Opprettet", record)

    def segment(self, object_id: int) -> None:
        """Say that an object was cut into segments anew, which V4's feed tells."""
        with self._lock:
            self._tell("Segmentert", self._need(object_id))

    def select(self, type_id: int, query: Mapping[str, str]) -> list[Record]:
        """Objects that pass the filters, in the world's order."""
        with self._lock:
            return super().select(type_id, query)

    def versions(self, type_id: int, query: Mapping[str, str]) -> list[Record]:
        """All versions, also those that are closed, ordered by id and version."""
        with self._lock:
            older = [r for records in self._older.values() for r in records if r.type_id == type_id]
            found = [*super().versions(type_id, query), *older]
        return sorted(found, key=lambda record: (record.id, record.versjon))

    def order(self, record_id: int, versjon: int) -> tuple[float, int, int]:
        """Give the sort key of the world's order."""
        if self.order_seed is None:
            return 0.0, record_id, versjon
        # Seeded with an integer, so that the order is the same in every process.
        chance = random.Random(self.order_seed * 1_000_003 + record_id)  # noqa: S311 (no secret: an order)
        return chance.random(), record_id, versjon

    def show(self, made: dict[str, Any], api: str) -> dict[str, Any]:
        """Apply `drift`."""
        return made if self.drift is None else self.drift(made, api)

    def find(self, object_id: int) -> Record | None:
        """The object of an id, of any type."""
        for type_id in self.types:
            record = self.one(type_id, object_id)
            if record is not None:
                return record
        return None

    def _need(self, object_id: int) -> Record:
        record = self.find(object_id)
        if record is None:
            msg = f"There is no vegobjekt {object_id} to change: create it first."
            raise ReplaySourceError(msg)
        return record

    def _put(self, record: Record) -> None:
        records = self._records.setdefault(record.type_id, [])
        place = bisect_left(records, record.id, key=lambda other: other.id)
        if place < len(records) and records[place].id == record.id:
            records[place] = record
        else:
            insort(records, record, key=lambda other: other.id)

    def _take(self, record: Record) -> None:
        records = self._records.get(record.type_id, [])
        place = bisect_left(records, record.id, key=lambda other: other.id)
        if place < len(records) and records[place].id == record.id:
            del records[place]

    def _changed(self, record: Record, changes: Mapping[str, Any]) -> Record:
        made = record_from_raw({**record.raw, **changes}, record.type_id)
        return made if "metadata" in changes else self._with_metadata(made)

    def _with_metadata(self, record: Record, **changes: Any) -> Record:
        """Give a record other metadata, and the time of the change."""
        before = record.raw.get("metadata")
        metadata = {
            **(before if isinstance(before, Mapping) else {}),
            "sist_modifisert": time_text(self._next_time()),
            **changes,
        }
        versjon = metadata.get("versjon", record.versjon)
        return replace(record, raw={**record.raw, "metadata": metadata}, versjon=versjon)

    def _next_time(self) -> datetime:
        """Now, or just after the last event if the clock stands still."""
        now = self.clock()
        last = self.events[-1].tidspunkt if self.events else None
        return now if last is None or now > last else last + timedelta(microseconds=1)

    def _tell(self, kind: Kind, record: Record) -> None:
        metadata = record.raw.get("metadata")
        dates = metadata if isinstance(metadata, Mapping) else {}
        self.events.append(
            Hendelse(
                len(self.events) + 1,
                kind,
                record.type_id,
                record.id,
                record.versjon,
                self._next_time(),
                dates.get("startdato"),
                dates.get("sluttdato"),
            )
        )

    def touch(self, object_ids: Iterable[int]) -> None:
        """Tell of a change of each object that changes nothing but its time."""
        for object_id in object_ids:
            self.update(object_id)
