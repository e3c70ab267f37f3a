"""Signs and their changes from API Les V4.

Objects come from ``/vegobjekter/{type}``, changes from ``/vegobjekter/endringer``. The feed reaches back 30
days and says what became of *versions*: changed, removed, created, segmented anew. All four count; the
published example of an incremental client forgets the created ones. A feed page may name fewer changes than
``antall``, since changes of one version on one page are merged into the newest.

Sources: the V4 models ``VegobjektEndringerSide``, ``VegobjektVersjon*`` and ``SideMetadata``, and the
parameters of ``getVegobjektEndringerForTyper``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from typing import Final

from nvdb.area import Area
from nvdb.client.paging import RawObject, follow, iter_pages
from nvdb.datakatalog.ids import SKILTPLATE, SKILTPUNKT
from nvdb.errors import RequestError, SchemaError
from nvdb.mirror.source import (
    FEW_UNREADABLE,
    MAX_PAGE,
    ApiSource,
    ChangePage,
    FeedTooOldError,
    FetchResult,
    Raw,
    ReadObjects,
    SourcePage,
    batches,
    page_parts,
    sign_types,
)
from nvdb.objects.les_v4 import skilt_from_les_v4

FEED_REACH: Final = timedelta(days=30)
"""How far back the feed goes."""

HEAD_OVERLAP: Final = timedelta(days=1)
"""How long before now a first position lies. The API has no way to ask for the newest change, so the position
is a time of this machine's clock; a day of changes read again is cheap, and a clock that is hours ahead would
lose changes without a word."""

_REACH_MARGIN: Final = timedelta(hours=1)
_FEED: Final = "/vegobjekter/endringer"
_LISTS: Final = (
    "vegobjektVersjonerEndret",
    "vegobjektVersjonerFjernet",
    "vegobjektVersjonerSegmentert",
    "vegobjektVersjonerOpprettet",
)
_PARAMS: Final = {"inkluder": "alle", "srid": "5973"}


class LesV4Source(ApiSource):
    """Skiltpunkt and Skiltplate from API Les V4; see :class:`nvdb.mirror.source.Source`.

    Parameters
    ----------
    client : NvdbClient
    page_size : int
        1 to 1000; pages may still come shorter.
    katalog : Datakatalog, optional
        Only to count ids that it does not know; the snapshot if omitted.
    clock : callable
        Now, with a time zone.
    """

    name = "les-v4"

    def check(self, area: Area) -> None:
        """Les V4 can select every area."""

    def first_request(self, type_id: int, area: Area) -> tuple[str, dict[str, str | int]]:
        """Path and parameters of a backfill's first question."""
        sign_types([type_id])
        return f"/vegobjekter/{type_id}", {**_PARAMS, **area.params(), "antall": self._page_size}

    def head(self) -> str:
        """Give the time one day ago (`HEAD_OVERLAP`): every later change is read again."""
        return _time_text(self._clock() - HEAD_OVERLAP)

    def count(self, type_id: int, area: Area) -> int | None:
        """Ask ``statistikk``; None where it has no count to give, since no sync depends on it."""
        return self._counted(type_id, area.params())

    def pages(self, type_id: int, area: Area, start: str | None = None) -> Iterator[SourcePage]:
        """Yield pages of objects without an end date, in the area."""
        path, params = self.first_request(type_id, area)
        for page in iter_pages(self._client, path, params, start):
            reading = ReadObjects()
            left_out = self._read(page.objects, type_id, area, reading)
            reading.check_any(type_id)
            _check_selection(left_out, reading, area)
            cursor = page.next_cursor or _cursor(page.objects[-1])
            yield reading.page(type_id, cursor, len(page.objects))

    def changes(self, type_ids: Sequence[int], since: str) -> Iterator[ChangePage]:
        """Yield the changes after `since`: a time, or ``time,id,version`` as a page names it.

        The last page may be empty: it moves a position forward that a quiet feed left behind, so that it does
        not grow too old without any change.

        Raises
        ------
        FeedTooOldError
            `since` lies further back than the feed.
        """
        kinds = sign_types(type_ids)
        now = self._clock()
        _check_reach(since, now)
        position = since
        pages = follow(lambda start: self._feed_page(kinds, start or since), since, _FEED)
        for (changed, n_events), following in pages:
            position = following or position
            yield ChangePage(changed, position, n_events)
        if _position_time(position) < now - HEAD_OVERLAP:
            yield ChangePage({}, _time_text(now - HEAD_OVERLAP), 0)

    def fetch(self, type_id: int, ids: Sequence[int], area: Area) -> FetchResult:
        """Get objects by id. Those that are closed, removed or outside the area are `missing`."""
        sign_types([type_id])
        reading = ReadObjects()
        for batch in batches(ids):
            params: dict[str, str | int] = {**_PARAMS, **area.params(), "antall": MAX_PAGE}
            params["ider"] = ",".join(map(str, batch))
            for page in iter_pages(self._client, f"/vegobjekter/{type_id}", params):
                self._read(page.objects, type_id, area, reading)
        return reading.result(ids)

    def _read(
        self, objects: Sequence[RawObject], type_id: int, area: Area, reading: ReadObjects
    ) -> list[RawObject]:
        """Read objects; return those left out since they say that they lie outside the area."""
        left_out = []
        for raw in objects:
            try:
                skilt = skilt_from_les_v4(raw, type_id)
            except SchemaError as error:
                reading.refuse(raw, error)
                continue
            if area.is_administrative and area.excludes(raw.get("lokasjon")):
                left_out.append(raw)
                continue
            reading.objects.append(skilt)
            for item in raw.get("egenskaper") or ():
                number, enum_id = item["id"], item.get("enum_id")
                if (number, enum_id) in self._known:
                    continue
                if self._katalog.is_unknown(number, enum_id):
                    known = number in self._katalog.egenskapstyper
                    reading.unknown[number, enum_id if known else None] += 1
                else:
                    self._known.add((number, enum_id))
        return left_out

    def _feed_page(
        self, kinds: Sequence[int], start: str
    ) -> tuple[tuple[dict[int, frozenset[int]], int], list[Raw], str | None]:
        """One feed page: ids by type and the number of changes, the changes as received, next cursor."""
        body = self._client.get_json(
            _FEED, {"typeIder": ",".join(map(str, kinds)), "start": start, "antall": MAX_PAGE}
        )
        lists, following = page_parts(body, _LISTS, _FEED)
        events = [item for items in lists for item in items]
        changed: dict[int, set[int]] = {}
        for item in events:
            kind, object_id = item.get("type"), item.get("id")
            if not isinstance(kind, int) or not isinstance(object_id, int):
                msg = f"A change in {_FEED} has no type or no id ({item!r:.80}): update this program."
                raise SchemaError(msg)
            if kind in {SKILTPUNKT, SKILTPLATE}:
                changed.setdefault(kind, set()).add(object_id)
        page = {kind: frozenset(found) for kind, found in changed.items()}
        return (page, len(events)), events, following or (_after(events) if events else None)


def _check_selection(left_out: Sequence[RawObject], reading: ReadObjects, area: Area) -> None:
    """Name the objects of a page that lie outside the area; raise if there are no others."""
    if len(left_out) >= FEW_UNREADABLE and not reading.objects:
        msg = (
            f"The API was asked for {area.text()} and sent signs that all lie elsewhere: check the area's "
            "number or name, or take another way to say it (kommune, fylke, box)."
        )
        raise SchemaError(msg)
    reading.problems += [
        f"Vegobjekt {raw.get('id')} came for {area.text()}, but says that it lies elsewhere: left out."
        for raw in left_out
    ]


def _cursor(raw: RawObject) -> str:
    """Cursor after an object, for a page that names none."""
    metadata = raw.get("metadata")
    versjon = metadata.get("versjon") if isinstance(metadata, dict) else None
    return f"{raw.get('id')}:{versjon if isinstance(versjon, int) else 1}"


def _after(events: Sequence[Raw]) -> str:
    """Position after the last event of a page that names none: the newest of its times."""
    last = max(events, key=lambda item: _position_time(str(item.get("tidspunkt"))))
    return f"{last.get('tidspunkt')},{last.get('id')},{last.get('versjon')}"


def _check_reach(since: str, now: datetime) -> None:
    moment = _position_time(since)
    if moment < now - FEED_REACH + _REACH_MARGIN:
        msg = (
            f"The mirror's position in the change feed is from {moment:%Y-%m-%d %H:%M} UTC, and API Les V4 "
            f"keeps changes for {FEED_REACH.days} days only: make a fresh backfill."
        )
        raise FeedTooOldError(msg)


def _position_time(position: str) -> datetime:
    """Time in a position (``2025-06-01``, ``2025-06-01T12:00:00Z``, ``2025-06-01T12:00:00Z,12345,1``)."""
    text = position.split(",", 1)[0]
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        msg = f"The position {position[:60]!r} is not one of API Les V4's change feed: make a fresh backfill."
        raise RequestError(msg) from None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


def _time_text(moment: datetime) -> str:
    return moment.astimezone(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
