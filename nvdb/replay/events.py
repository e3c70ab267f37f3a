"""The change feeds of a replayed world: ``endringer`` of API Les V4 and ``hendelser`` of Uberiket V1.

Both are views of one list of events, as in NVDB itself.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final, Literal

from nvdb.replay.pages import MAX_PAGE, QueryError, neste
from nvdb.replay.uberiket import numbers, page_document, page_size

Kind = Literal["Opprettet", "Endret", "Fjernet", "Segmentert"]

FEED_REACH: Final = timedelta(days=30)
"""API Les V4 gives the changes of the last 30 days."""

_LISTS: Final[Mapping[Kind, str]] = {
    "Endret": "vegobjektVersjonerEndret",
    "Fjernet": "vegobjektVersjonerFjernet",
    "Segmentert": "vegobjektVersjonerSegmentert",
    "Opprettet": "vegobjektVersjonerOpprettet",
}
_START = re.compile(r"(?P<time>[^,]+)(?:,(?P<id>\d{1,18}),(?P<versjon>\d{1,9}))?")


@dataclass(frozen=True, slots=True)
class Hendelse:
    """One event: what became of one version of an object.

    `hendelse_id` counts from 1 in order of `tidspunkt`. ``Segmentert`` is known to V4 only.
    """

    hendelse_id: int
    kind: Kind
    type_id: int
    vegobjekt_id: int
    versjon: int
    tidspunkt: datetime
    startdato: str | None = None
    sluttdato: str | None = None

    @property
    def place(self) -> tuple[datetime, int, int]:
        """Where it stands in V4's feed."""
        return self.tidspunkt, self.vegobjekt_id, self.versjon


def endringer_page(
    events: Sequence[Hendelse], types: set[int], query: Mapping[str, str], url: str, now: datetime
) -> dict[str, Any]:
    """One page of V4's feed.

    The page takes the next ``antall`` events and then merges those of one version into the newest, so that
    it may name fewer. The end is an empty page that repeats the token. Events that are older than 30 days
    are gone without a word.
    """
    start, size = query.get("start"), _antall(query)
    started = _started(start)
    rest = [
        event
        for event in events
        if event.type_id in types and event.tidspunkt >= now - FEED_REACH and started(event)
    ]
    if "ider" in query:
        ids = set(numbers(query["ider"], "ider"))
        rest = [event for event in rest if event.vegobjekt_id in ids]
    if "slutt" in query:
        end = _time(query["slutt"], "slutt")
        rest = [event for event in rest if event.tidspunkt < end]
    taken = sorted(rest, key=lambda event: event.place)[:size]
    newest = {(event.vegobjekt_id, event.versjon): event for event in taken}
    page: dict[str, Any] = {name: [] for name in _LISTS.values()}
    for event in newest.values():
        page[_LISTS[event.kind]].append(_endring(event))
    page["metadata"] = {"returnert": len(newest), "sidestørrelse": size}
    token = _token(taken[-1]) if taken else start
    if token is not None:
        page["metadata"]["neste"] = neste(url, query, token)
    return page


def hendelser_page(
    events: Sequence[Hendelse], types: set[int] | None, query: Mapping[str, str], url: str
) -> dict[str, Any]:
    """One page of Uberiket's feed: events after the id ``start``, or from ``startDato`` on."""
    rest = [event for event in events if event.kind != "Segmentert"]
    if types is not None:
        rest = [event for event in rest if event.type_id in types]
    if "start" in query:
        after = numbers(query["start"], "start")[0]
        rest = [event for event in rest if event.hendelse_id > after]
    if "startDato" in query:
        begin = _time(query["startDato"], "startDato")
        rest = [event for event in rest if event.tidspunkt >= begin]
    if "sluttDato" in query:
        end = _time(query["sluttDato"], "sluttDato")
        rest = [event for event in rest if event.tidspunkt < end]
    if "vegobjektId" in query:
        ids = set(numbers(query["vegobjektId"], "vegobjektId"))
        rest = [event for event in rest if event.vegobjekt_id in ids]
    size = page_size(query)
    page = rest[:size]
    cursor = str(page[-1].hendelse_id) if len(rest) > size else None
    return page_document("hendelser", [hendelse(event) for event in page], size, cursor, url, query)


def newest(events: Sequence[Hendelse], type_id: int) -> dict[str, Any] | None:
    """``/siste``: the newest event of a type, None if there is none."""
    found = [event for event in events if event.type_id == type_id and event.kind != "Segmentert"]
    return hendelse(found[-1]) if found else None


def hendelse(event: Hendelse) -> dict[str, Any]:
    """One event as Uberiket shows it, without the optional ``data``."""
    return {
        "hendelseId": event.hendelse_id,
        "hendelseType": f"VegobjektVersjon{event.kind}",
        "vegobjektId": event.vegobjekt_id,
        "vegobjektTypeId": event.type_id,
        "vegobjektVersjon": event.versjon,
        "tidspunkt": time_text(event.tidspunkt),
    }


def time_text(moment: datetime) -> str:
    """UTC with microseconds, ``2025-05-02T15:29:57.864360Z``."""
    return moment.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def _endring(event: Hendelse) -> dict[str, Any]:
    made: dict[str, Any] = {
        "id": event.vegobjekt_id,
        "versjon": event.versjon,
        "type": event.type_id,
        "tidspunkt": time_text(event.tidspunkt),
    }
    if event.kind in {"Endret", "Opprettet"}:
        dates = {"startdato": event.startdato, "sluttdato": event.sluttdato}
        made.update({name: day for name, day in dates.items() if day is not None})
    return made


def _token(event: Hendelse) -> str:
    return f"{time_text(event.tidspunkt)},{event.vegobjekt_id},{event.versjon}"


def _started(start: str | None) -> Callable[[Hendelse], bool]:
    """Whether an event comes after a start token."""
    if start is None:
        return lambda event: True  # noqa: ARG005 (every event)
    match = _START.fullmatch(start)
    if match is None:
        msg = f"start: '{start}' er ikke et gyldig startpunkt"
        raise QueryError(msg)
    moment = _time(match["time"], "start")
    if match["id"] is None:
        return lambda event: event.tidspunkt >= moment
    place = moment, int(match["id"]), int(match["versjon"])
    return lambda event: event.place > place


def _time(text: str, name: str) -> datetime:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        msg = f"{name}: '{text}' er ikke en dato eller et tidspunkt med tidssone"
        raise QueryError(msg) from None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


def _antall(query: Mapping[str, str]) -> int:
    return min(page_size({"antall": query["antall"]} if "antall" in query else {}), MAX_PAGE)
