"""One pole's findings → what API Skriv is to do: which operation for which verdict."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from nvdb.datakatalog import Ansiktsside, Datakatalog
from nvdb.endringssett import (
    Assosiasjon,
    Endring,
    Measured,
    NewPlate,
    Punkt,
    changed_type,
    gone,
    moved,
    new_plates,
    new_sign,
    position_correction,
    skiltnummer_enum,
)
from nvdb.errors import RequestError
from twin.changesets.drive_side import Seen, measured_position, std_in_plan_m
from twin.changesets.nvdb_side import Mirrored
from twin.changesets.places import RoadPlaces
from twin.matching.sites import SKILTPLATE, SKILTPUNKT, Site
from twin.store.kinds import Verdict
from twin.store.records import Finding

BETTER = 0.5
"""Our standard deviation in plan is at most this share of NVDB's where a position is corrected."""
WITHIN_SIGMAS = 3.0
"""A sign within this many of NVDB's own standard deviations is believed unmoved."""
DEFAULT_SIGMA_M = 1.0


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A finding that no change set can bring in; `sentence` says what, which, and the cure."""

    change_id: str
    sentence: str


@dataclass(frozen=True, slots=True)
class Group:
    """What belongs together: the findings about one pole, and the operations that they became."""

    change_ids: tuple[str, ...]
    endringer: tuple[Endring, ...]


@dataclass(frozen=True, slots=True)
class Basis:
    """What operations are made from; `seen` by ``change_id``."""

    mirrored: Mirrored
    seen: Mapping[str, Seen]
    places: RoadPlaces
    katalog: Datakatalog


def is_correction(finding: Finding) -> bool:
    """Whether a sign that stands elsewhere than NVDB says was never moved, but badly measured before.

    NVDB's own standard deviation explains the distance, and ours is much better.
    """
    nvdb_sigma_m = float(finding.terms.get("nvdb_sigma_m") or DEFAULT_SIGMA_M)
    distance_m, ours_m = finding.distance_m, std_in_plan_m(finding)
    if distance_m is None:
        return False
    return ours_m <= BETTER * nvdb_sigma_m and distance_m <= WITHIN_SIGMAS * nvdb_sigma_m


def new_pole(finding: Finding, basis: Basis) -> Group | LeftOut:
    """``registrer`` of a Skiltpunkt and its plates."""
    try:
        seen = _need_seen(finding, basis)
        codes = _codes(finding, basis)
        position = measured_position(finding, seen)
        where = position.east_m, position.north_m, seen.first_day
        side = basis.places.ansiktsside(*where, seen.face_deg)
        plates = [
            NewPlate(skiltnummer=code, ansiktsside=side, plasseringskode=10 * number)
            for number, code in enumerate(codes, start=1)
        ]
        group = new_sign(
            finding.change_id,
            position,
            on_date=seen.first_day,
            stedfesting=basis.places.place(*where, face_deg=seen.face_deg),
            plates=plates,
            katalog=basis.katalog,
        )
    except RequestError as error:
        return _left_out(finding, error)
    return Group((finding.change_id,), group)


def known_pole(site: Site, findings: Sequence[Finding], basis: Basis) -> Iterator[Group | LeftOut]:
    """Everything that was found about one site of NVDB, as one group; what cannot be done is left out."""
    pole = _Pole(site, basis)
    done: list[str] = []
    endringer: list[Endring] = []
    order = {Verdict.MISSING: 0, Verdict.MOVED: 1, Verdict.WRONG_TYPE: 2, Verdict.NEW: 3}
    for finding in sorted(findings, key=lambda one: (order[one.verdict], one.change_id)):
        try:
            endringer += pole.work[finding.verdict](finding)
            done.append(finding.change_id)
        except RequestError as error:
            yield _left_out(finding, error)
    if done:
        yield Group(tuple(done), merged(endringer))


class _Pole:
    """A site of NVDB while its findings become operations."""

    def __init__(self, site: Site, basis: Basis) -> None:
        self.site, self.basis = site, basis
        self.closed: set[int] = set()
        self.place: Punkt | None = None
        self.work: dict[str, Callable[[Finding], Iterable[Endring]]] = {
            Verdict.MISSING: self.missing,
            Verdict.MOVED: self.moved,
            Verdict.WRONG_TYPE: self.wrong_type,
            Verdict.NEW: self.new_plate,
        }

    def missing(self, finding: Finding) -> Iterable[Endring]:
        """``lukk``, of a whole pole with its plates."""
        kind, number = finding.nvdb_type, _id_of(finding)
        if kind == SKILTPLATE and sum(map(bool, finding.skiltnummer_nvdb)) > 1:
            raise RequestError(
                "it is about several plates that have no Skiltpunkt in the mirror: close them in NVDB by hand"
            )
        day = _need_seen(finding, self.basis).last_day
        if kind == SKILTPUNKT:
            for plate in self.site.plates:
                self.basis.mirrored.newer_than((SKILTPLATE, plate.nvdb_id), day)
        endring = gone(self._target(kind, number, day), on_date=day, with_plates=kind == SKILTPUNKT)
        self.closed.add(number)
        return endring

    def moved(self, finding: Finding) -> Iterable[Endring]:
        """A better position (``delvisKorriger``) or a new one (``delvisOppdater``), with the plates."""
        self._need_point("moves with its Skiltpunkt")
        seen, mirrored = _need_seen(finding, self.basis), self.basis.mirrored
        position = measured_position(finding, seen)
        plates = [plate.nvdb_id for plate in self.site.plates if plate.nvdb_id not in self.closed]
        if is_correction(finding):
            point = mirrored.target(SKILTPUNKT, self.site.nvdb_id)
            targets = [mirrored.target(SKILTPLATE, number) for number in plates]
            return position_correction(point, position, plates=targets)
        day = seen.last_day
        point = self._target(SKILTPUNKT, self.site.nvdb_id, day)
        targets = [self._target(SKILTPLATE, number, day) for number in plates]
        place = self.basis.places.place(
            position.east_m, position.north_m, day, face_deg=seen.face_deg, before=self._place_before()
        )
        self.place = place
        return moved(point, position, on_date=day, stedfesting=place, plates=targets)

    def wrong_type(self, finding: Finding) -> Iterable[Endring]:
        """``delvisOppdater`` of the plate."""
        (code,) = _codes(finding, self.basis)
        day = _need_seen(finding, self.basis).last_day
        plate = self._target(SKILTPLATE, _id_of(finding), day)
        return changed_type(plate, code, on_date=day, katalog=self.basis.katalog)

    def new_plate(self, finding: Finding) -> Iterable[Endring]:
        """``registrer`` of the plate, ``delvisOppdater`` of its Skiltpunkt."""
        self._need_point("is registered on its Skiltpunkt")
        seen = _need_seen(finding, self.basis)
        point = self._target(SKILTPUNKT, self.site.nvdb_id, seen.last_day)
        position = measured_position(finding, seen)
        side = self._side(position, seen)
        return new_plates(
            point,
            finding.change_id,
            position,
            on_date=seen.last_day,
            stedfesting=self.place or self.basis.mirrored.place((SKILTPUNKT, self.site.nvdb_id)),
            plates=[NewPlate(skiltnummer=code, ansiktsside=side) for code in _codes(finding, self.basis)],
            katalog=self.basis.katalog,
        )

    def _side(self, position: Measured, seen: Seen) -> Ansiktsside | None:
        """Which traffic a new plate is for; a plate can do without, so no road network is needed."""
        try:
            return self.basis.places.ansiktsside(
                position.east_m, position.north_m, seen.last_day, seen.face_deg
            )
        except RequestError:
            return None

    def _need_point(self, what: str) -> None:
        if self.site.nvdb_type != SKILTPUNKT:
            raise RequestError(
                f"a plate {what}, and the mirror has none for it: sync again, or do it in NVDB by hand"
            )

    def _target(self, kind: int, number: int, day: dt.date) -> Any:
        target = self.basis.mirrored.target(kind, number)
        self.basis.mirrored.newer_than((kind, number), day)
        return target

    def _place_before(self) -> Punkt | None:
        try:
            return self.basis.mirrored.place((SKILTPUNKT, self.site.nvdb_id))
        except RequestError:
            return None


def _codes(finding: Finding, basis: Basis) -> tuple[str, ...]:
    codes = finding.skiltnummer_seen
    if not codes:
        raise RequestError("no sign code was annotated: annotate it and ingest the drive again")
    for code in codes:
        skiltnummer_enum(code, basis.katalog)
    return codes


def _id_of(finding: Finding) -> int:
    if finding.nvdb_id is None:
        raise RequestError("it names no object of NVDB: run `twin match` again")
    return finding.nvdb_id


def _need_seen(finding: Finding, basis: Basis) -> Seen:
    seen = basis.seen[finding.change_id]
    if not seen.drives:
        raise RequestError("the store has none of its drives any more: run `twin match` again")
    return seen


def _left_out(finding: Finding, error: RequestError) -> LeftOut:
    about = finding.nvdb_id or ";".join(finding.skiltnummer_seen) or "without a sign code"
    why = str(error).strip().rstrip(".")
    return LeftOut(finding.change_id, f"{finding.change_id} ({finding.verdict}, {about}) is left out: {why}.")


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
