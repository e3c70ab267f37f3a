"""NVDB's signs of an area → the store's mirror: a backfill once, then the changes only."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

from nvdb.area import Area
from nvdb.client import Json, NvdbClient, Params
from nvdb.datakatalog import Datakatalog, hent_datakatalog, katalog_from_document, snapshot
from nvdb.datakatalog.diff import diff
from nvdb.errors import AreaError, BodyError, HttpStatusError, SchemaError, TransportError
from nvdb.mirror import (
    MAX_DELETED_SHARE,
    SKILT_TYPES,
    LesV4Source,
    Source,
    SyncProgress,
    SyncReport,
    UberiketSource,
    can_resume,
    identity,
    reaches,
    sync,
)
from nvdb.mirror.areas import refuse_unknown
from twin.errors import RefusedError
from twin.mirror.counts import Counts, by_accuracy, by_capture_method, without_own_geometry
from twin.mirror.mirror_tables import StoreMirror
from twin.mirror.names import KATALOG_FACT
from twin.store.address import StoreAddress
from twin.store.store import Store

log = logging.getLogger("nvdb.sync")


@dataclass(frozen=True, slots=True)
class SyncResult:
    """What a sync did, and what the mirror holds now.

    Attributes
    ----------
    area, source, url, mode : str
        In words; ``les-v4`` or ``uberiket``; the API's address; ``backfill``, ``resumed`` or ``changes``.
    skiltpunkt, skiltplate : int
        Objects in the mirror now.
    expected : dict
        Type → the API's own count, None where it gave none or was not asked.
    created, changed, deleted : int
        Objects, of both types.
    n_events : int
        Events of the change feed since the last sync.
    without_own_geometry : int
        Only placed on the road's centre line.
    by_accuracy, by_capture_method : dict
        Stated accuracy in cm, and datafangstmetode → objects with own geometry.
    n_problems : int
        Objects and values that could not be used.
    problems : tuple of str
        The first of them, one sentence each.
    unknown : dict
        "property" or "property=enum" → how often; ids that the datakatalog at hand does not know.
    datakatalog : str
        Version of the datakatalog that was used.
    datakatalog_news : tuple of str
        What changed in it since the last sync, one clause each.
    """

    area: str
    source: str
    url: str
    mode: str
    synced_at: str
    skiltpunkt: int
    skiltplate: int
    expected: dict[int, int | None]
    created: int
    changed: int
    deleted: int
    n_events: int
    without_own_geometry: int
    by_accuracy: dict[str, int]
    by_capture_method: dict[str, int]
    n_problems: int
    problems: tuple[str, ...]
    unknown: dict[str, int]
    datakatalog: str
    datakatalog_news: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SyncPlan:
    """What a sync would do and ask first.

    Attributes
    ----------
    source, area : str
        ``les-v4`` or ``uberiket``; in words.
    mode : str
        ``backfill``, ``resumed`` or ``changes``.
    position : str or None
        In the change feed; None for a ``backfill``.
    first_url : str
    expected : dict
        Type → the API's own count, None where it gives none.
    """

    source: str
    area: str
    mode: str
    position: str | None
    first_url: str
    expected: dict[int, int | None]


def area_from_options(
    store: StoreAddress | Path | str,
    *,
    kommune: str | None = None,
    fylke: str | None = None,
    kontraktsomrade: str | None = None,
    bbox: str | None = None,
    everything: bool = False,
) -> Area:
    """Read the ways to name an area; with none of them it is the one that the store mirrors.

    Parameters
    ----------
    store : StoreAddress, Path or str
        Asked for the area of its mirror, or of its unfinished backfill, if no other option is given.
    kommune, fylke, kontraktsomrade, bbox : str, optional
        As typed: values with commas between.
    everything : bool
        The whole country.

    Raises
    ------
    AreaError
        More than one was given, it cannot be read, or none was given and there is no mirror yet.
    """
    readers = (
        (kommune, Area.from_kommuner_text),
        (fylke, Area.from_fylker_text),
        (kontraktsomrade, Area.from_kontraktsomrader_text),
        (bbox, Area.from_bbox_text),
    )
    named = [read(text) for text, read in readers if text is not None] + [Area()] * everything
    area = named[0] if named else _mirrored_area(store)
    if len(named) > 1 or area is None:
        raise AreaError(
            "Say which signs: one of --kommune 5001, --fylke 50, --kontraktsomrade NAME, "
            "--bbox minE,minN,maxE,maxN (UTM33) or --all."
        )
    return area


def _mirrored_area(named: StoreAddress | Path | str) -> Area | None:
    """The area of a store's mirror, or of its unfinished backfill."""
    if not Store.exists(named):
        return None  # a sync would make the store there
    with Store.open(named, create=False) as store:
        mirror = StoreMirror(store)
        state = mirror.following() or mirror.backfill()
    return None if state is None else Area.from_text(state.area)


def sync_nvdb(
    store: Store,
    area: Area,
    *,
    api_url: str,
    source: str = "les-v4",
    contact: str | None = None,
    replace: bool = False,
    fresh: bool = False,
    confirm_deletions: bool = False,
    progress: Callable[[str, int, int | None], None] | None = None,
) -> SyncResult:
    """Bring the store's mirror up to date. Readers see the old mirror until the new one is whole.

    Parameters
    ----------
    store : Store
    area : Area
    api_url : str
        Base address of NVDB's APIs.
    source : {"les-v4", "uberiket"}
        Which of them the mirror follows.
    contact : str, optional
        Sent as ``X-Kontaktperson``.
    replace : bool
        Whether a mirror of another area may be replaced.
    fresh : bool
        Fetch everything although the changes would do.
    confirm_deletions : bool
        Whether more than 5 % of the mirror may be deleted.
    progress : callable, optional
        Called with what is being fetched, how many have come and how many are expected (or None).

    Raises
    ------
    AreaError
        NVDB has no such kommune or fylke.
    NvdbError
        The API did not answer as it should; the mirror is unchanged, a backfill can be resumed.
    RefusedError
        The store mirrors another area, or another sync is at work.
    StoreError
        The store could not be written.
    """
    with store.alone("sync", "sync"), NvdbClient(api_url=api_url, contact=contact) as client:
        _check_area(store, area, replace, client)
        return _sync(client, source, store, area, fresh, confirm_deletions, progress)


def dry_run(
    area: Area,
    *,
    api_url: str,
    source: str = "les-v4",
    contact: str | None = None,
    store: Store | None = None,
    replace: bool = False,
    fresh: bool = False,
) -> SyncPlan:
    """Say what :func:`sync_nvdb` would do and ask first, and how many signs there are; nothing is written.

    Parameters
    ----------
    area, api_url, source, contact, replace, fresh
        As :func:`sync_nvdb` takes them.
    store : Store, optional
        The one that would be synced; None if it would be a new one.

    Raises
    ------
    NvdbError
        The API did not answer as it should.
    RefusedError
        The store mirrors another area.
    """
    with NvdbClient(api_url=api_url, contact=contact) as client, _Asking(api_url) as asking:
        if store is not None:
            _check_area(store, area, replace, client)
        followed = _source(source, client, snapshot())
        followed.check(area)
        refuse_unknown(client, area)
        mode, position, cursor = _plan(followed, area, store, fresh)
        asked = _source(source, asking, snapshot())
        if mode == "changes":
            url = _first_url(lambda: asked.changes(SKILT_TYPES, position or ""))
        else:
            url = _first_url(lambda: asked.pages(SKILT_TYPES[0], area, cursor))
        return SyncPlan(
            source=followed.name,
            area=area.text(),
            mode=mode,
            position=position,
            first_url=url,
            expected={type_id: followed.count(type_id, area) for type_id in SKILT_TYPES},
        )


def _plan(source: Source, area: Area, store: Store | None, fresh: bool) -> tuple[str, str | None, str | None]:
    """Mode, position in the feed and cursor with which :func:`nvdb.mirror.sync` would begin."""
    mirror = None if store is None else StoreMirror(store)
    following = mirror and mirror.following()
    begun = mirror and mirror.backfill()
    if begun and can_resume(source, area, begun):
        return "resumed", begun.position, begun.cursors.get(SKILT_TYPES[0])
    ours = following and (following.source, following.area) == (identity(source), area.text())
    if following and ours and not begun and not fresh and reaches(source, following.position):
        return "changes", following.position, None
    return "backfill", None, None


class _AskedError(Exception):
    """Carries the address of a question that was not sent."""


class _Asking(NvdbClient):
    """Sends nothing: a source's first question is known by what it would ask."""

    def get_json(self, path_or_url: str, params: Params | None = None) -> Json:
        raise _AskedError(f"{self.api_url}{path_or_url}?{urlencode(params or {}, safe=',')}")


def _first_url(ask: Callable[[], Iterator[object]]) -> str:
    try:
        next(ask(), None)
    except _AskedError as asked:
        return str(asked)
    msg = "a source asked nothing"
    raise RuntimeError(msg)


def sync_roads(
    store: Store,
    area: Area,
    *,
    api_url: str,
    contact: str | None = None,
    confirm_deletions: bool = False,
    progress: Callable[[str, int, int | None], None] | None = None,
) -> int:
    """Fetch the area's road network into the store (:func:`twin.mirror.vegnett.sync_vegnett`).

    Parameters and errors are those of :func:`sync_nvdb`; whatever happens, the mirror of the signs stays.

    Returns
    -------
    int
        Links in the store's network now.
    """
    from twin.mirror.vegnett import sync_vegnett

    with NvdbClient(api_url=api_url, contact=contact) as client:
        return sync_vegnett(
            store, area, client=client, confirm_deletions=confirm_deletions, progress=progress
        )


def _sync(
    client: NvdbClient,
    source: str,
    store: Store,
    area: Area,
    fresh: bool,
    confirm_deletions: bool,
    progress: Callable[[str, int, int | None], None] | None,
) -> SyncResult:
    def tell(now: SyncProgress) -> None:
        if progress is not None:
            progress(now.what, now.done, now.expected)

    mirror = StoreMirror(store)
    following = mirror.following()
    if following is None or following.area != area.text():
        refuse_unknown(client, area)
    katalog, news = _katalog(client, store)
    report = sync(
        _source(source, client, katalog),
        mirror,
        area,
        fresh=fresh,
        confirm_deletions=confirm_deletions,
        max_deleted_share=MAX_DELETED_SHARE,
        progress=tell,
    )
    # Also without news: what was fetched is whole, what ships with this program is not.
    document = katalog.to_document()
    if katalog is not snapshot() and document != store.fact(KATALOG_FACT):
        with store.transaction() as connection:
            store.put_fact(connection, KATALOG_FACT, document)
    return _result(store, mirror.counts(), report, katalog, news)


def _source(name: str, client: NvdbClient, katalog: Datakatalog) -> Source:
    source = UberiketSource if name == "uberiket" else LesV4Source
    return source(client, katalog=katalog)


def _katalog(client: NvdbClient, store: Store) -> tuple[Datakatalog, list[str]]:
    """Fetch the datakatalog and say what changed; the known one, where the API has none to give."""
    fact = store.fact(KATALOG_FACT)
    last = katalog_from_document(fact) if fact else snapshot()
    try:
        fetched = hent_datakatalog(client)
    except (HttpStatusError, BodyError, SchemaError) as error:
        log.info("The datakatalog could not be fetched (%s); version %s is used.", error, last.version)
        return last, []
    return fetched, diff(last, fetched)


def _check_area(store: Store, area: Area, replace: bool, client: NvdbClient) -> None:
    mirror = StoreMirror(store)
    following = mirror.following()
    # A mirror without a sign is of an area that was named wrongly: nothing is lost with it.
    if (
        following is not None
        and following.area != area.text()
        and not replace
        and not area.contains(Area.from_text(following.area))
        and any(mirror.count(t) for t in SKILT_TYPES)
    ):
        with suppress(TransportError):  # a number that does not exist is no reason to replace anything
            refuse_unknown(client, area)
        raise RefusedError(
            f"The store {store.name} mirrors {following.area}, not {area.text()}: name another --store, or "
            "both areas where they are of one kind (--kommune 5001,5031), or let --replace put the new "
            "mirror in the old one's place: drives and decisions stay, and `twin match` then compares anew."
        )


def _result(
    store: Store, counts: Counts, report: SyncReport, katalog: Datakatalog, news: list[str]
) -> SyncResult:
    fact = store.fact("mirror") or {}
    applied = report.applied
    return SyncResult(
        area=report.area,
        source=report.source,
        url=report.url,
        mode=report.mode,
        synced_at=str(fact.get("synced_at", "")),
        skiltpunkt=applied.total[95],
        skiltplate=applied.total[96],
        expected=report.expected,
        created=sum(applied.created.values()),
        changed=sum(applied.changed.values()),
        deleted=sum(applied.deleted.values()),
        n_events=report.n_events,
        without_own_geometry=without_own_geometry(counts),
        by_accuracy=by_accuracy(counts),
        by_capture_method=by_capture_method(counts),
        n_problems=report.n_problems,
        problems=report.problems,
        unknown={_unknown(key): n for key, n in sorted(report.unknown.items(), key=str)},
        datakatalog=katalog.version,
        datakatalog_news=tuple(news),
    )


def _unknown(key: tuple[int, int | None]) -> str:
    return str(key[0]) if key[1] is None else f"{key[0]}={key[1]}"
