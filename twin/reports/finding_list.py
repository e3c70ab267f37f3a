"""The findings of the last match as a list: chosen, in order, a page of them, told to people."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from geoloc.earth.geodesy import geographic_from_utm33
from twin.decisions.findings import (
    Brief,
    FindingStatus,
    Selection,
    drive_days,
    latest_findings,
    select_briefly,
    whole_ids,
)
from twin.errors import ConfigError, StoreError
from twin.matching.news import FACT, news_from
from twin.mirror.names import sign_names
from twin.mirror.roads import Road, roads_of
from twin.reports.drive_list import drive_names
from twin.reports.orders import Order
from twin.store.kinds import Verdict
from twin.store.store import Snapshot, Store
from twin.words import Lang, reason_of, seen_sentence, sign_titles

_ROAD = re.compile(r"(e|ev|r|rv|f|fv|k|kv|p|pv|s|sv)[. ]*(\d.*)", re.IGNORECASE)
_NUMBERS = re.compile(r"(\d+)")
_BY_VERDICT = (
    *(Verdict.MISSING, Verdict.NEW, Verdict.WRONG_TYPE, Verdict.MOVED, Verdict.REVIEW),
    *(Verdict.UNCHANGED, Verdict.NOT_OBSERVABLE),
)


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which findings are listed, and in which order: those that fit every criterion that is given.

    Attributes
    ----------
    selection : Selection
        As for decisions in bulk: what is listed by it is decided by it.
    road : str
        A road or part of its reference, ``FV6680`` or ``FV6680 S1D1``, or a street's name; "" for every.
    kommuner : tuple of int
    text : str
        Part of the id, a sign's name, the road, the street or the reason; "" for every.
    only_new : bool
        Only what the match before did not say (:mod:`twin.matching.news`).
    order : Order
    reverse : bool
    """

    selection: Selection = field(default_factory=lambda: Selection(decisions=()))
    road: str = ""
    kommuner: tuple[int, ...] = ()
    text: str = ""
    only_new: bool = False
    order: Order = Order.VERDICT
    reverse: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingRow:
    """One finding as tables, spreadsheets and maps have it; None where something is not known.

    Attributes
    ----------
    is_new : bool
        Whether the match before did not say this.
    confidence : float
        Probability that the verdict is right.
    sign : str
        Names of the signs that were seen, or, where none was, of NVDB's.
    road, street, kommune : str
        ``FV6680 S1D1 m120``; kommune numbers are parted by commas.
    distance_m, distance_sigma_m : float or None
        From NVDB's position.
    drives : str
        Names of those that saw it, or looked for it.
    east_m, north_m : float
        EPSG:25833.
    longitude_deg, latitude_deg : float
        WGS84.
    seen, reason : str
        When it was seen or looked for, and why the verdict is so.
    """

    change_id: str
    verdict: str
    decision: str
    is_new: bool
    confidence: float
    sign: str
    skiltnummer_seen: str
    skiltnummer_nvdb: str
    road: str
    street: str
    kommune: str
    distance_m: float | None
    distance_sigma_m: float | None
    nvdb_type: int
    nvdb_id: int | None
    drives: str
    n_sightings: int
    east_m: float
    north_m: float
    longitude_deg: float
    latitude_deg: float
    seen: str
    reason: str


@dataclass(frozen=True, slots=True)
class FindingList:
    """A page of the findings that were asked for.

    Attributes
    ----------
    total : int
        All that were asked for.
    start : int
        How many of them stand before the page.
    rows : tuple of FindingRow
    matched_at : str
        When the last match was, UTC.
    is_current : bool
        Whether drives and mirror are still as they were then.
    """

    total: int
    start: int
    rows: tuple[FindingRow, ...]
    matched_at: str
    is_current: bool


def list_findings(
    store: Store, wanted: Wanted, *, start: int = 0, limit: int | None = None, lang: Lang = Lang.EN
) -> FindingList:
    """Return a page of findings, and how many there are.

    Parameters
    ----------
    store : Store
        May be read-only.
    wanted : Wanted
    start : int
        Findings to pass over.
    limit : int, optional
        Findings of a page; by default all.
    lang : Lang
        Of names, times and reasons.

    Raises
    ------
    StoreError
        Nothing was matched yet.
    ConfigError
        A drive is not in the store, an area is no GeoJSON, or nothing is known of what is new.
    """
    with store.snapshot() as view:
        last = view.fact("last_match")
        if last is None:
            raise StoreError(f"The store {store.name} has no findings yet: run `twin match` first.")
        fresh = _fresh(view, wanted.only_new)
        found = [
            one
            for one in select_briefly(view.rows, wanted.selection)
            if not wanted.only_new or one.change_id in fresh
        ]
        by_road = bool(wanted.road or wanted.kommuner or wanted.text or wanted.order is Order.ROAD)
        roads = roads_of(store, found) if by_road else {}
        found = [one for one in found if _is_there(roads.get(one.change_id, Road()), wanted)]
        teller = _Teller(lang, sign_names(store), drive_days(view.rows), drive_names(view), fresh)
        if wanted.text:
            found = _with_text(view, found, roads, wanted.text, teller)
        found.sort(key=_key(wanted.order, roads), reverse=wanted.reverse)
        page = found[start:] if limit is None else found[start : start + limit]
        chosen = {one.change_id: one for one in latest_findings(view.rows, {one.change_id for one in page})}
        if not by_road:
            roads = roads_of(store, page)
        is_current = last["revision"] == view.revision()
    statuses = [chosen[one.change_id] for one in page]
    rows = teller.rows(statuses, roads)
    return FindingList(len(found), start, rows, last["at"], is_current)


def finding_id(view: Snapshot, given: str) -> str | None:
    """Return the id of the finding that is meant by an id or its first digits; None where none is."""
    every = Selection(verdicts=(*Verdict,), decisions=())
    existing = {one.change_id for one in select_briefly(view.rows, every)}
    (meant,) = whole_ids([given], existing)
    return meant if meant in existing else None


def _fresh(view: Snapshot, asked: bool) -> frozenset[str]:
    news = news_from(view.fact(FACT))
    if news is None and asked:
        raise ConfigError("There was only one match, so nothing is new since one before: leave --new out.")
    return frozenset() if news is None else news.change_ids


def _is_there(road: Road, wanted: Wanted) -> bool:
    if wanted.kommuner and not set(wanted.kommuner) & set(road.kommuner):
        return False
    if not wanted.road:
        return True
    asked, reference = road_written(wanted.road).casefold(), road.reference.casefold()
    return f"{reference} ".startswith(f"{asked} ") or road.street.casefold() == wanted.road.strip().casefold()


def road_written(text: str) -> str:
    """Write a road as NVDB does: ``E6``, ``Fv. 6680 S1D1`` → ``EV6``, ``FV6680 S1D1``.

    >>> road_written("fv. 6680")
    'FV6680'
    """
    found = _ROAD.fullmatch(text.strip())
    if found is None:
        return text.strip()
    letter = found[1][0].upper()
    return f"{letter}V{found[2]}"


def _key(order: Order, roads: Mapping[str, Road]) -> Callable[[Brief], Any]:
    def place(one: Brief) -> list[tuple[int, str]]:
        """As people count: m200 before m1000."""
        parts = _NUMBERS.split(roads[one.change_id].reference)
        return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]

    return {
        Order.VERDICT: lambda one: (_BY_VERDICT.index(one.verdict), -one.confidence, one.change_id),
        Order.CONFIDENCE: lambda one: (-one.confidence, one.change_id),
        # What stands beside no known road, or is at no distance, comes last.
        Order.ROAD: lambda one: (not roads[one.change_id].reference, place(one), one.change_id),
        Order.DISTANCE: lambda one: (one.distance_m is None, -(one.distance_m or 0.0), one.change_id),
    }[order]


@dataclass(frozen=True, slots=True)
class _Teller:
    """Tells findings in a language, with the names of signs and drives."""

    lang: Lang
    names: Mapping[str, str]
    days: Mapping[str, Any]
    drives: Mapping[str, str]
    fresh: frozenset[str]

    def rows(self, statuses: Sequence[FindingStatus], roads: Mapping[str, Road]) -> tuple[FindingRow, ...]:
        at = np.array([(s.finding.east_m, s.finding.north_m) for s in statuses]).reshape(-1, 2)
        lat, lon = geographic_from_utm33(*at.T)
        return tuple(
            self.row(status, roads[status.change_id], float(x), float(y))
            for status, x, y in zip(statuses, lon, lat, strict=True)
        )

    def row(self, status: FindingStatus, road: Road, longitude: float, latitude: float) -> FindingRow:
        finding = status.finding
        days = [self.days[drive] for drive in finding.drive_ids if drive in self.days]
        return FindingRow(
            change_id=status.change_id,
            verdict=finding.verdict.value,
            decision=status.decision.value,
            is_new=status.change_id in self.fresh,
            confidence=_chance(finding.confidence),
            sign=sign_titles(finding.skiltnummer_seen or finding.skiltnummer_nvdb, self.names),
            skiltnummer_seen=";".join(finding.skiltnummer_seen),
            skiltnummer_nvdb=";".join(finding.skiltnummer_nvdb),
            road=road.reference,
            street=road.street,
            kommune=",".join(map(str, road.kommuner)),
            distance_m=_rounded(finding.distance_m),
            distance_sigma_m=_rounded(finding.distance_sigma_m),
            nvdb_type=finding.nvdb_type,
            nvdb_id=finding.nvdb_id,
            drives=", ".join(self.drives.get(drive, drive) for drive in finding.drive_ids),
            n_sightings=finding.n_sightings,
            east_m=round(finding.east_m, 3),
            north_m=round(finding.north_m, 3),
            longitude_deg=round(longitude, 7),
            latitude_deg=round(latitude, 7),
            seen=seen_sentence(finding, self.lang, days, alone=False),
            reason=reason_of(finding, self.lang, self.names),
        )


def _chance(value: float) -> float:
    """Four decimals; what is not certain is not rounded to certainty."""
    return min(max(round(value, 4), 1e-4), 1 - 1e-4) if 0.0 < value < 1.0 else value


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def _with_text(
    view: Snapshot, found: Sequence[Brief], roads: Mapping[str, Road], text: str, teller: _Teller
) -> list[Brief]:
    asked = text.casefold()
    whole = {one.change_id: one for one in latest_findings(view.rows, {one.change_id for one in found})}

    def told(one: Brief) -> str:
        row = teller.row(whole[one.change_id], roads[one.change_id], 0.0, 0.0)
        return " ".join((row.change_id, row.sign, row.road, row.street, row.drives, row.seen, row.reason))

    return [one for one in found if asked in told(one).casefold()]
