"""What was sent to API Skriv: kept in the store before each request, so that no finding is sent twice.

Rules, in which "held" means that neither an export nor ``twin submit`` takes a finding up:

- a finding is held from the moment that its set is to be registered until that set has ended;
- refused, cancelled or never arrived, it is free again;
- carried out, it is held until the mirror shows it, and then a match has the say;
- what registered an object is free again when a set that we sent has removed that object;
- a pole that NVDB does not know is also told by its place, whatever its finding is called by now.

Each API has findings of its own: what went to the test environment did not go to NVDB.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import sqlalchemy as sa

from nvdb.client.client import LOOPBACK
from nvdb.skriv import SKRIV_URL
from twin.changesets.kontekst import digest_of
from twin.changesets.operations import Group
from twin.changesets.sent_objects import SentObject, Shown, objects_of
from twin.decisions.evidence import Ask
from twin.decisions.log import asking, position
from twin.errors import ConfigError, RefusedError
from twin.matching.sites import SKILTPUNKT
from twin.store import schema
from twin.store.kinds import Sending
from twin.store.records import Finding
from twin.store.store import Row, Snapshot, Store, utc_now

SAME_PLACE_M: Final = 1.0
"""Two poles that NVDB does not know are one within this distance: a drive that is ingested anew moves them
by centimetres, and no two poles stand so close."""
Place = tuple[float, float]
"""EPSG:25833 east and north."""
_DEFAULT_PORT: Final = {"https": 443, "http": 80}
_SAME_API: Final = {"https://www.vegvesen.no/nvdb/apiskriv": SKRIV_URL}
"""The address in API Skriv's documentation, and that of the same API today."""
OPEN: Final = frozenset({Sending.REGISTERING, Sending.UNDER_WAY})


def target_of(api_url: str) -> str:
    """Name the API Skriv of an address, however that is spelt: case, slashes, the port that is usual.

    Raises
    ------
    ConfigError
        It is no http(s) address.
    """
    try:
        parts = urlsplit(api_url)
        host, number = (parts.hostname or "").rstrip("."), parts.port
    except ValueError:
        host, number = "", None
    if not host or parts.scheme not in _DEFAULT_PORT:
        raise ConfigError(f"The API URL {api_url!r} is not an http(s) address: give one such as {SKRIV_URL}.")
    host = "localhost" if host in LOOPBACK else host
    port = "" if number in {None, _DEFAULT_PORT[parts.scheme]} else f":{number}"
    path = "/".join(part for part in parts.path.split("/") if part)
    url = f"{parts.scheme}://{host}{port}" + (f"/{path}" if path else "")
    return _SAME_API.get(url, url)


@dataclass(frozen=True, slots=True)
class SentFinding:
    """One finding of one set that was sent: a row of ``sent``.

    Attributes
    ----------
    tag : str
        Of the set: its ``eksternRef``.
    change_id : str
        Of a set that names no finding the SHA-256 of its XML.
    state : Sending
    set_id : str or None
    digest : str
        Of the operations; "" of a set whose operations are not known.
    objects : tuple of SentObject
        Empty of a set that names no finding and removes nothing.
    file : str
        That it was sent from; "" where another store sent it.
    """

    tag: str
    change_id: str
    state: Sending
    set_id: str | None
    digest: str
    objects: tuple[SentObject, ...]
    file: str

    @classmethod
    def from_row(cls, row: Row) -> SentFinding:
        """Take it from a row."""
        return cls(
            tag=row["tag"],
            change_id=row["change_id"],
            state=Sending(row["state"]),
            set_id=row["set_id"],
            digest=row["digest"],
            objects=tuple(map(SentObject.from_json, row["objects"])),
            file=row["file"],
        )


@dataclass(frozen=True, slots=True)
class SentSet:
    """The findings of one set that was sent."""

    findings: tuple[SentFinding, ...]

    @property
    def tag(self) -> str:
        """Its ``eksternRef``."""
        return self.findings[0].tag

    @property
    def set_id(self) -> str | None:
        """API Skriv's own, once it is known."""
        return self.findings[0].set_id

    @property
    def state(self) -> Sending:
        """How far it is."""
        return self.findings[0].state

    @property
    def file(self) -> str:
        """That it was sent from."""
        return self.findings[0].file

    @property
    def digests(self) -> Mapping[str, str]:
        """Finding → SHA-256 of what was to be done about it."""
        return {one.change_id: one.digest for one in self.findings}


@dataclass(frozen=True, slots=True)
class Basis:
    """What a set was made from: the last match, and the states of drives, mirror and decisions."""

    match: Mapping[str, Any] | None
    revision: int
    log_position: int


class SentLog:
    """What a store has sent to one API Skriv.

    Parameters
    ----------
    store : Store
    api_url : str
        In any spelling.
    """

    def __init__(self, store: Store, api_url: str) -> None:
        self._store = store
        self.api = target_of(api_url)

    @staticmethod
    def apis_of(store: Store) -> list[str]:
        """Every API that a store has sent to."""
        column = schema.sent.c.api
        return [row["api"] for row in store.rows(sa.select(column).distinct().order_by(column))]

    def unfinished(self) -> list[SentSet]:
        """Sets that are not known to have ended, the oldest first."""
        every: dict[str, list[SentFinding]] = {}
        for one in self._every(self._store.rows):
            if one.state in OPEN:
                every.setdefault(one.tag, []).append(one)
        return [SentSet(tuple(findings)) for findings in every.values()]

    def oldest_open(self) -> str | None:
        """When the oldest set that is not known to have ended was sent; None if there is none."""
        t = schema.sent.c
        asked = sa.select(sa.func.min(t.at).label("at")).where(t.api == self.api, t.state.in_(OPEN))
        at: str | None = self._store.rows(asked)[0]["at"]
        return at

    def tags_and_ids(self) -> frozenset[str]:
        """Every ``eksternRef`` and every id of a set that the store knows."""
        every = self._every(self._store.rows)
        return frozenset(name for one in every for name in (one.tag, one.set_id) if name is not None)

    def held(self) -> dict[str, SentFinding]:
        """Findings, by ``change_id``, that are not to be sent again now."""
        with self._store.snapshot() as view:
            return {one.change_id: one for one in self._held(view.rows)}

    def is_free_but_for(self, sent: SentSet) -> bool:
        """Whether no other set holds one of its findings."""
        with self._store.snapshot() as view:
            others = [one for one in self._held(view.rows) if one.tag != sent.tag]
        return not any(one.change_id in sent.digests for one in others)

    def holding(self, findings: Iterable[Finding]) -> dict[str, SentFinding]:
        """Of these findings, those that are held, also where they are called otherwise by now."""
        held = self.held()
        poles = _Poles(held.values())
        found = {}
        for finding in findings:
            one = held.get(finding.change_id)
            if one is None and finding.nvdb_id is None and finding.nvdb_type == SKILTPUNKT:
                one = poles.at((finding.east_m, finding.north_m))
            if one is not None:
                found[finding.change_id] = one
        return found

    def basis(self) -> Basis:
        """What sets would be made from now; read it before them."""
        with self._store.snapshot() as view:
            return _basis_of(view)

    def begin(self, tag: str, groups: Sequence[Group], file: Path, basis: Basis | None) -> None:
        """Keep that a set is about to be registered.

        Parameters
        ----------
        tag : str
        groups : sequence of Group
        file : Path
        basis : Basis or None
            What the groups were compared with; None where they are of no findings.

        Raises
        ------
        RefusedError
            Meanwhile one of the findings was sent, or decided anew, or the store was matched again.
        """
        with self._store.transaction() as connection:
            view = self._store.view(connection)
            ask = view.rows
            now = _basis_of(view)
            wanted = {key for group in groups for key in group.change_ids}
            is_stale = basis is not None and basis != now
            if is_stale or any(one.change_id in wanted for one in self._held(ask)):
                raise RefusedError(
                    f"The store {self._store.name} has changed meanwhile: run `twin submit` again."
                )
            for group in groups:
                about = digest_of(group), objects_of(group.endringer, ask), str(file.resolve())
                rows = [SentFinding(tag, key, Sending.REGISTERING, None, *about) for key in group.change_ids]
                self._add(connection, rows)

    def registered(self, tag: str, set_id: str) -> None:
        """Keep the id that API Skriv gave a set."""
        with self._store.transaction() as connection:
            self._change(connection, tag, state=Sending.UNDER_WAY, set_id=set_id)

    def adopt(self, findings: Sequence[SentFinding]) -> None:
        """Keep findings of a set that this store did not send, or of which it kept no record."""
        with self._store.transaction() as connection:
            self._add(connection, findings)

    def ended(self, sent: SentSet, state: Sending, nvdb_ids: Mapping[str, int] | None = None) -> None:
        """Keep what became of a set.

        Parameters
        ----------
        sent : SentSet
        state : Sending
        nvdb_ids : mapping of tempId → nvdbId, optional
            What its new objects became.
        """
        given = nvdb_ids or {}
        with self._store.transaction() as connection:
            for one in sent.findings:
                objects = [
                    replace(item, nvdb_id=given.get(item.temp_id or "", item.nvdb_id)) for item in one.objects
                ]
                document = [asdict(item) for item in objects]
                self._change(connection, one.tag, change_id=one.change_id, state=state, objects=document)
            if state == Sending.CARRIED_OUT:
                gone = {item.nvdb_id for one in sent.findings for item in one.objects if item.removed}
                self._free(connection, gone)

    def _free(self, connection: sa.Connection, removed: set[int | None]) -> None:
        """Free the findings that registered what is removed now."""
        for one in self._every(asking(connection)):
            made = {item.nvdb_id for item in one.objects if item.temp_id is not None}
            if one.state == Sending.CARRIED_OUT and made & removed - {None}:
                self._change(connection, one.tag, change_id=one.change_id, state=Sending.UNDONE)

    def _every(self, ask: Ask) -> list[SentFinding]:
        t = schema.sent
        return [
            SentFinding.from_row(row) for row in ask(sa.select(t).where(t.c.api == self.api).order_by(t.c.id))
        ]

    def _held(self, ask: Ask) -> list[SentFinding]:
        every = self._every(ask)
        done = [one for one in every if one.state == Sending.CARRIED_OUT]
        shown = Shown.of([item for one in done for item in one.objects], ask)
        return [
            one
            for one in every
            if one.state in OPEN or (one.state == Sending.CARRIED_OUT and not shown.of_set(one.objects))
        ]

    def _add(self, connection: sa.Connection, findings: Sequence[SentFinding]) -> None:
        rows = [{**asdict(one), "api": self.api, "at": utc_now()} for one in findings]
        if rows:
            connection.execute(sa.insert(schema.sent), rows)

    def _change(
        self, connection: sa.Connection, tag: str, *, change_id: str | None = None, **values: Any
    ) -> None:
        t = schema.sent.c
        which = [t.tag == tag, t.api == self.api, *([] if change_id is None else [t.change_id == change_id])]
        connection.execute(sa.update(schema.sent).where(*which).values(**values, at=utc_now()))


def _basis_of(view: Snapshot) -> Basis:
    return Basis(view.fact("last_match"), view.revision(), position(view.rows))


class _Poles:
    """Poles that were sent, by the square of `SAME_PLACE_M` that they stand in."""

    def __init__(self, findings: Iterable[SentFinding]) -> None:
        self._squares: dict[tuple[int, int], list[tuple[Place, SentFinding]]] = {}
        for one in findings:
            for item in one.objects:
                if item.place is not None:
                    self._squares.setdefault(_square(item.place), []).append((item.place, one))

    def at(self, place: Place) -> SentFinding | None:
        """Find one that stands there; None if there is none."""
        column, row = _square(place)
        near = itertools.product((column - 1, column, column + 1), (row - 1, row, row + 1))
        candidates = (pair for square in near for pair in self._squares.get(square, ()))
        return next((one for at, one in candidates if math.dist(at, place) <= SAME_PLACE_M), None)


def _square(place: Place) -> tuple[int, int]:
    return math.floor(place[0] / SAME_PLACE_M), math.floor(place[1] / SAME_PLACE_M)
