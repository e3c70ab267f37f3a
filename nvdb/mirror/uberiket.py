"""Signs and their changes from Uberiket V1, which Statens vegvesen's own mirrors use.

Uberiket shows objects bare: enum ids without text (the datakatalog has the texts), ASCII keys, no geometry
but the object's own, no kommune, no road reference, and no pointer from a plate to its point (the points'
``barn`` have to be inverted). So of what API Les V4 gives for the same sign these fields differ here:

===================================  =====================================================================
``kommuner``, ``road_reference``     empty: they are not in Uberiket
``point_id``                         None: the points' ``plate_ids`` say it
``stedfesting[].kortform``           None
``position``                         None where V4 has a point derived from the road network
``last_modified``                    ``sistEndret``, with fractions of a second
``skiltnummer_text``                 the datakatalog's text; of the snapshot often the code alone
===================================  =====================================================================

Versions: ``/vegobjekter/{type}`` may hold several versions of one object. The one that is valid today is
kept (``startdato`` ≤ today < ``sluttdato``); if there is none, the next one to become valid; an object with
neither is closed. No event tells that a day has come, so a mirror asks again for objects whose end date has
passed.

Sources: the OpenAPI document of Uberiket V1 (June 2026); the order *position first, then pages* and the
batches of 100 are those of nvdb-tnits-public.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, date
from typing import Final

from nvdb.area import Area
from nvdb.client.paging import follow
from nvdb.errors import AreaError, HttpStatusError, RequestError, SchemaError
from nvdb.mirror.source import (
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
from nvdb.objects.skilt import Skiltplate, Skiltpunkt
from nvdb.objects.uberiket import skilt_from_uberiket
from nvdb.objects.vegobjekt import RawObject

_BASE: Final = "/uberiket/api/v1"
_FEED: Final = f"{_BASE}/hendelser/vegobjekter"
BOX_MARGIN_M: Final = 100.0
"""The server is asked for this much around a box, since it is not documented whether it looks at a sign's own
geometry or at the road; which signs are inside is decided here."""


class UberiketSource(ApiSource):
    """Skiltpunkt and Skiltplate from Uberiket V1; see :class:`nvdb.mirror.source.Source`.

    Selects the whole country or a box. There is no filter for kommune, fylke or kontraktsområde; and in a box
    only signs with own geometry can be found, since the others have no coordinates in Uberiket (each is named
    in ``problems``).

    Parameters
    ----------
    client : NvdbClient
    page_size : int
        1 to 1000.
    katalog : Datakatalog, optional
        Gives the texts of enum ids: fetch the current one (:func:`nvdb.datakatalog.hent_datakatalog`); the
        snapshot, used if omitted, knows 130 of 642 sign codes.
    clock : callable
        Now, with a time zone; decides which version is valid.
    """

    name = "uberiket"

    def check(self, area: Area) -> None:
        """Raise AreaError for kommuner, fylker and kontraktsområder."""
        if area.is_administrative:
            msg = (
                f"Uberiket cannot select {area.text()}: take the source les-v4, or give a box or the whole "
                "country."
            )
            raise AreaError(msg)

    def first_request(self, type_id: int, area: Area) -> tuple[str, dict[str, str | int]]:
        """Path and parameters of a backfill's first question."""
        sign_types([type_id])
        return _path(type_id), {"inkluder": "alle", **_area_params(area), "antall": self._page_size}

    def head(self) -> str:
        """Give the id of the newest event of both types; ``0`` if there is none yet."""
        return str(max(self._newest(type_id) for type_id in sign_types((95, 96))))

    def count(self, type_id: int, area: Area) -> int | None:
        """Ask API Les V4's ``statistikk``: Uberiket counts nothing. None for a box, where the two differ."""
        self.check(area)
        if area.bbox is not None:
            return None
        return self._counted(type_id, {})

    def pages(self, type_id: int, area: Area, start: str | None = None) -> Iterator[SourcePage]:
        """Yield pages; one may hold no object of the area and still move the cursor on."""
        sign_types([type_id])
        self.check(area)
        params = _area_params(area)
        cursor = start
        for versions, following in follow(lambda at: self._page(type_id, params, at), start, _path(type_id)):
            reading = ReadObjects()
            received = self._read(self._whole(versions, type_id, cursor), type_id, area, reading)
            reading.check_any(type_id)
            # `neste` is left out on the last page; the cursor after its last version ends a resumed backfill.
            cursor = following or f"{versions[-1].get('id')}-{versions[-1].get('versjon')}"
            yield reading.page(type_id, cursor, received)

    def changes(self, type_ids: Sequence[int], since: str) -> Iterator[ChangePage]:
        """Yield the changes after the event `since`.

        Raises
        ------
        FeedTooOldError
            The API says that the event is gone (410). How long events are kept is not documented.
        """
        kinds = sign_types(type_ids)
        if not (since.isascii() and since.isdigit()):
            msg = f"The position {since[:60]!r} is not one of Uberiket's event feed: make a fresh backfill."
            raise RequestError(msg)
        try:
            for page, _ in follow(lambda at: self._feed_page(kinds, at or since), since, _FEED):
                yield page
        except HttpStatusError as error:
            if error.status != 410:
                raise
            msg = (
                f"Uberiket no longer has the event {since} that the mirror stands at: make a fresh backfill."
            )
            raise FeedTooOldError(msg) from error

    def fetch(self, type_id: int, ids: Sequence[int], area: Area) -> FetchResult:
        """Get objects by id. Those that are closed, removed or outside the area are `missing`."""
        sign_types([type_id])
        self.check(area)
        reading = ReadObjects()
        for batch in batches(ids):
            self._read(self._versions(type_id, batch), type_id, area, reading)
        return reading.result(ids)

    def _newest(self, type_id: int) -> int:
        """Id of the newest event of a type; 0 if there is none."""
        path = f"{_FEED}/{type_id}/siste"
        try:
            answer = self._client.get_json(path)
        except HttpStatusError as error:
            if error.status == 404:
                return 0
            raise
        number = answer.get("hendelseId") if isinstance(answer, dict) else None
        if not isinstance(number, int) or isinstance(number, bool):
            msg = f"The newest event of type {type_id} has no hendelseId: update this program."
            raise SchemaError(msg)
        return number

    def _page(
        self, type_id: int, params: Mapping[str, str], cursor: str | None
    ) -> tuple[list[Raw], list[Raw], str | None]:
        query: dict[str, str | int] = {"inkluder": "alle", **params, "antall": self._page_size}
        if cursor is not None:
            query["start"] = cursor
        path = _path(type_id)
        lists, following = page_parts(self._client.get_json(path, query), ["vegobjekter"], path)
        return lists[0], lists[0], following

    def _versions(self, type_id: int, ids: Sequence[int]) -> list[Raw]:
        """All versions of some objects."""
        params = {"ider": ",".join(map(str, ids))}
        pages = follow(lambda at: self._page(type_id, params, at), None, _path(type_id))
        return [raw for page, _ in pages for raw in page]

    def _whole(self, versions: list[Raw], type_id: int, cursor: str | None) -> list[Raw]:
        """Complete an object that the cursor cut in two: which version counts is seen from all of them."""
        split = cursor.partition("-")[0] if cursor else ""
        if not versions or str(versions[0].get("id")) != split:
            return versions
        rest = [raw for raw in versions if str(raw.get("id")) != split]
        return [*self._versions(type_id, [int(split)]), *rest]

    def _read(self, versions: Iterable[Raw], type_id: int, area: Area, reading: ReadObjects) -> int:
        """Read the versions that count; return how many they are, less those outside the area."""
        received = 0
        today = self._clock().astimezone(UTC).date()
        for raw in current_versions(versions, today):
            received += 1
            try:
                skilt = skilt_from_uberiket(raw, type_id, self._katalog)
            except SchemaError as error:
                reading.refuse(raw, error)
                continue
            if not _inside(skilt, area, reading):
                received -= 1
                continue
            reading.objects.append(skilt)
            self._count_unknown(raw, reading)
        return received

    def _count_unknown(self, raw: RawObject, reading: ReadObjects) -> None:
        for key, item in (raw.get("egenskaper") or {}).items():
            kind = self._katalog.egenskapstyper.get(int(key))
            if kind is None:
                reading.unknown[int(key), None] += 1
            elif isinstance(item, Mapping) and item.get("type") == "EnumEgenskap":
                enum_id = item.get("verdi")
                if isinstance(enum_id, int) and enum_id not in kind.verdier:
                    reading.unknown[kind.id, enum_id] += 1

    def _feed_page(self, kinds: Sequence[int], start: str) -> tuple[ChangePage, list[Raw], str | None]:
        query: dict[str, str | int] = {
            "typeIder": ",".join(map(str, kinds)),
            "antall": MAX_PAGE,
            "start": start,
        }
        lists, following = page_parts(self._client.get_json(_FEED, query), ["hendelser"], _FEED)
        changed: dict[int, set[int]] = {}
        newest = int(start)
        for event in lists[0]:
            number, kind, object_id = (
                event.get(name) for name in ("hendelseId", "vegobjektTypeId", "vegobjektId")
            )
            if not (isinstance(number, int) and isinstance(kind, int) and isinstance(object_id, int)):
                msg = (
                    f"An event in {_FEED} has no id, type or vegobjekt ({event!r:.80}): update this program."
                )
                raise SchemaError(msg)
            newest = max(newest, number)
            if kind in kinds:
                changed.setdefault(kind, set()).add(object_id)
        found = {kind: frozenset(ids) for kind, ids in changed.items()}
        return ChangePage(found, str(newest), len(lists[0])), lists[0], following


def current_versions(versions: Iterable[Raw], today: date) -> Iterator[Raw]:
    """Of each object the version valid on a day, else the next one to become valid, else none.

    The order of the objects is kept. A version whose dates cannot be read counts as valid, so that the fault
    is met where it can be told.
    """
    groups: dict[object, list[Raw]] = {}
    for raw in versions:
        groups.setdefault(raw.get("id"), []).append(raw)
    day = today.isoformat()
    for group in groups.values():
        chosen = _chosen(group, day)
        if chosen is not None:
            yield chosen


def _chosen(group: Sequence[Raw], day: str) -> Raw | None:
    spans = [(_date(raw, "startdato", ""), _date(raw, "sluttdato", "9999"), raw) for raw in group]
    valid = [raw for start, end, raw in spans if start <= day < end]
    if valid:
        return max(valid, key=_versjon)
    coming = [(start, raw) for start, end, raw in spans if day < start < end]
    return min(coming, key=lambda pair: pair[0])[1] if coming else None


def _date(raw: RawObject, name: str, default: str) -> str:
    period = raw.get("gyldighetsperiode")
    text = period.get(name) if isinstance(period, Mapping) else None
    return text if isinstance(text, str) and text[:4].isdigit() else default


def _versjon(raw: RawObject) -> int:
    number = raw.get("versjon")
    return number if isinstance(number, int) else 0


def _inside(skilt: Skiltpunkt | Skiltplate, area: Area, reading: ReadObjects) -> bool:
    if area.bbox is None:
        return True
    if skilt.position is None:
        reading.problems.append(
            f"Vegobjekt {skilt.nvdb_id} has no usable geometry of its own, so Uberiket cannot tell whether "
            "it is in the box: take the source les-v4 to have it."
        )
        return False
    min_east, min_north, max_east, max_north = area.bbox
    return min_east <= skilt.position.east_m <= max_east and min_north <= skilt.position.north_m <= max_north


def _area_params(area: Area) -> dict[str, str]:
    """``polygon`` in UTM33 around a box; nothing for the whole country."""
    if area.bbox is None:
        return {}
    west, south = (number - BOX_MARGIN_M for number in area.bbox[:2])
    east, north = (number + BOX_MARGIN_M for number in area.bbox[2:])
    corners = ((west, south), (east, south), (east, north), (west, north), (west, south))
    return {"polygon": ", ".join(f"{x:.3f} {y:.3f}" for x, y in corners)}


def _path(type_id: int) -> str:
    return f"{_BASE}/vegobjekter/{type_id}"
