"""All findings of a match in memory, so that a list of ten thousand is filtered and ordered at once.

What a match found does not change until the next one: it is read once a match. What people decide does: the
log only grows, so each look reads what was added since the last.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33
from twin.decisions.evidence import Ask
from twin.decisions.log import SILENT
from twin.decisions.opinions import in_disagreement, opinions_of
from twin.mirror.names import sign_names
from twin.review.records import FindingItem, Order, Queue, State, StateCounts
from twin.review.roads import Place, in_order, places_of
from twin.store import schema
from twin.store.kinds import QUIET, Decision, Verdict
from twin.store.records import split_codes
from twin.store.store import Snapshot, Store
from twin.words import Lang, SignNames, sign_titles

NEAR_M = 60.0
"""How far a finding's map reaches."""
_BAND_M = 500.0
"""Findings in order of place follow each other along bands of this width, back and forth."""
_KEPT_QUEUES = 64
_QUEUED = (Verdict.MISSING, Verdict.NEW, Verdict.WRONG_TYPE, Verdict.MOVED, Verdict.REVIEW)
_RANK = {verdict: rank for rank, verdict in enumerate(_QUEUED)}


@dataclass(frozen=True, slots=True)
class NvdbSigns:
    """Places of signs in NVDB, for what stands near a finding: EPSG:25833, and their codes."""

    nvdb_id: list[int]
    east_m: FloatArray
    north_m: FloatArray
    codes: Mapping[int, list[str]]


@dataclass(frozen=True, slots=True)
class Index:
    """The findings of one match that ask for a decision; every column has a row for each.

    Attributes
    ----------
    match : str
        Which match it was.
    change_id, verdict, title : list of str
    confidence, lon, lat, east_m, north_m : float64 (n,)
        WGS84 degrees, and EPSG:25833.
    place : list of Place
    drives : list of frozenset of str
        Ids of the drives that each rests on.
    row : mapping of change_id → row
    names : SignNames
    signs : NvdbSigns
        Around all of them.
    queues : dict
        Queues that were asked for, whatever is decided, in order: every answer asks for one again.
    """

    match: str
    change_id: list[str]
    verdict: list[str]
    title: list[str]
    confidence: FloatArray
    lon: FloatArray
    lat: FloatArray
    east_m: FloatArray
    north_m: FloatArray
    place: list[Place]
    drives: list[frozenset[str]]
    row: Mapping[str, int]
    names: SignNames
    signs: NvdbSigns
    queues: dict[Queue, list[int]] = field(default_factory=dict)

    def item(self, row: int, state: State) -> FindingItem:
        """Return one for a list."""
        return FindingItem(
            self.change_id[row],
            self.verdict[row],
            state,
            float(self.confidence[row]),
            self.title[row],
            self.place[row].reference,
            float(self.lon[row]),
            float(self.lat[row]),
        )

    def ordered(self, queue: Queue) -> list[int]:
        """Return the rows that a queue means whatever is decided of them, in its order."""
        asked = msgspec.structs.replace(queue, state="")
        rows = self.queues.get(asked)
        if rows is None:
            rows = [row for row in range(len(self.change_id)) if self._fits(row, asked)]
            rows.sort(key=lambda row: (*self._key(row, asked.order), self.change_id[row]))
            if len(self.queues) < _KEPT_QUEUES:
                self.queues[asked] = rows
        return rows

    def _fits(self, row: int, queue: Queue) -> bool:
        place = self.place[row]
        return (
            queue.verdict in ("", self.verdict[row])
            and queue.road in ("", place.road)
            and (not queue.drive or queue.drive in self.drives[row])
            and (not queue.kommune or queue.kommune in map(str, place.kommuner))
        )

    def _key(self, row: int, order: Order) -> tuple[object, ...]:
        surest = -self.confidence[row]
        if order is Order.CONFIDENCE:
            return (surest,)
        if order is Order.ROAD:
            # What stands beside no known road comes last.
            reference = self.place[row].reference
            return (not reference, in_order(reference))
        if order is Order.PLACE:
            band = int(self.north_m[row] // _BAND_M)
            return (band, self.east_m[row] if band % 2 else -self.east_m[row])
        return (_RANK[Verdict(self.verdict[row])], surest)


class Findings:
    """The index of the last match and what is decided, kept up to date with the store.

    Parameters
    ----------
    store : Store
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._index: Index | None = None
        self._decided: dict[str, Decision] = {}
        self._read_to = 0

    def index(self, view: Snapshot) -> Index:
        """Return the findings of the last match in a view of the store."""
        last = view.fact("last_match") or {}
        match = f"{last.get('at')} {last.get('revision')}"
        with self._lock:
            if self._index is None or self._index.match != match:
                self._index = _read(self._store, view, match)
            return self._index

    def decided(self, view: Snapshot) -> Mapping[str, Decision]:
        """Return the decisions that hold, by ``change_id``; what has none is open."""
        log = schema.decision_log.c
        with self._lock:
            added = view.rows(
                sa.select(log.id, log.change_id, log.decision)
                .where(log.id > self._read_to, log.kind.not_in(SILENT))
                .order_by(log.id)
            )
            if added:
                self._decided = self._decided | {r["change_id"]: Decision(r["decision"]) for r in added}
                self._read_to = added[-1]["id"]
            return self._decided


@dataclass(frozen=True, slots=True)
class Eyes:
    """What one reviewer may see of what is decided, and in which language.

    Attributes
    ----------
    reviewer : str
    blind : bool
        Whether own opinions count as settled, and those of others do not show.
    lang : Lang
    """

    reviewer: str
    blind: bool
    lang: Lang = Lang.EN


def states(
    ask: Ask, decided: Mapping[str, Decision], eyes: Eyes, only: Sequence[str] | None = None
) -> dict[str, State]:
    """Return the states that are not plainly open, by ``change_id``, as this reviewer may see them.

    Parameters
    ----------
    only : sequence of str, optional
        Findings that are asked for; all of them by default.
    """
    wanted = decided if only is None else {key: decided[key] for key in only if key in decided}
    found: dict[str, State] = {
        key: State(decision) for key, decision in wanted.items() if decision is not Decision.OPEN
    }
    for key, opinions in opinions_of(ask, only).items():
        if key in found:
            continue
        own = next((one for one in opinions if one.by == eyes.reviewer), None)
        if eyes.blind and own is not None:
            found[key] = State(own.decision)
        elif not eyes.blind and in_disagreement(opinions):
            found[key] = State.DISAGREEMENT
    return found


def in_queue(state: State, wanted: str) -> bool:
    """Whether a finding of a state belongs to a queue: open ones by default, and what people differ about."""
    if wanted in ("", State.OPEN):
        return state in (State.OPEN, State.DISAGREEMENT)
    return wanted in ("all", state)


def chunks(rows: Sequence[int], size: int = 25) -> Iterator[Sequence[int]]:
    """Cut a list of rows into pieces."""
    return (rows[start : start + size] for start in range(0, len(rows), size))


def counts(index: Index, known: Mapping[str, State]) -> dict[str, StateCounts]:
    """Count states by verdict, in the order of the queue; people's disagreement is open."""
    there = set(index.verdict)
    counted: dict[str, StateCounts] = {verdict: StateCounts() for verdict in _QUEUED if verdict in there}
    for change_id, verdict in zip(index.change_id, index.verdict, strict=True):
        state = known.get(change_id, State.OPEN)
        name = State.OPEN if state is State.DISAGREEMENT else state
        setattr(counted[verdict], name, getattr(counted[verdict], name) + 1)
    return counted


def _read(store: Store, view: Snapshot, match: str) -> Index:
    change = schema.change.c
    found = view.columns(
        sa.select(
            *(change.change_id, change.verdict, change.confidence, change.nvdb_id, change.drive_ids),
            *(change.skiltnummer_seen, change.skiltnummer_nvdb, change.east_m, change.north_m),
        )
        .where(change.verdict.not_in(QUIET))
        .order_by(change.change_id)
    )
    east, north = (np.array(found[name], dtype=np.float64) for name in ("east_m", "north_m"))
    lat, lon = geographic_from_utm33(east, north)
    names = sign_names(store)
    codes = zip(found["skiltnummer_seen"], found["skiltnummer_nvdb"], strict=True)
    return Index(
        match=match,
        change_id=found["change_id"],
        verdict=found["verdict"],
        title=[sign_titles(split_codes(seen or nvdb), names) for seen, nvdb in codes],
        confidence=np.array(found["confidence"], dtype=np.float64),
        lon=np.round(lon, 7),
        lat=np.round(lat, 7),
        east_m=east,
        north_m=north,
        place=places_of(store, view, found["nvdb_id"], east, north),
        drives=[frozenset((drives or "").split(",")) for drives in found["drive_ids"]],
        row={key: row for row, key in enumerate(found["change_id"])},
        names=names,
        signs=_signs(view, east, north),
    )


def _signs(view: Snapshot, east_m: FloatArray, north_m: FloatArray) -> NvdbSigns:
    if not len(east_m):
        return NvdbSigns([], np.zeros(0), np.zeros(0), {})
    point, plate = schema.skiltpunkt.c, schema.skiltplate.c
    found = view.columns(
        sa.select(point.nvdb_id, point.east_m, point.north_m)
        .where(
            point.own_geometry,
            point.east_m.between(east_m.min() - NEAR_M, east_m.max() + NEAR_M),
            point.north_m.between(north_m.min() - NEAR_M, north_m.max() + NEAR_M),
        )
        .order_by(point.nvdb_id)
    )
    codes: dict[int, list[str]] = {}
    for row in view.rows(
        sa.select(plate.point_id, plate.skiltnummer)
        .where(plate.point_id.is_not(None), plate.skiltnummer != "")
        .order_by(plate.nvdb_id)
    ):
        codes.setdefault(row["point_id"], []).append(row["skiltnummer"])
    east, north = (np.array(found[name], dtype=np.float64) for name in ("east_m", "north_m"))
    return NvdbSigns(found["nvdb_id"], east, north, codes)
