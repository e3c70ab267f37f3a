"""NVDB's road network → the store: fetched page by page, visible in one step.

The network is not followed event by event as the signs are: it is fetched anew, beside the old one, which
stays visible until the last page of the new one is in.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import sqlalchemy as sa

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.errors import HttpStatusError, NvdbError, SchemaError
from nvdb.mirror import (
    FEW_DELETED,
    MAX_DELETED_SHARE,
    MIN_RECEIVED_SHARE,
    MassDeletionError,
    ShortBackfillError,
)
from nvdb.vegnett import SEGMENTERT, Vegnett, hent_vegnett
from twin.mirror.vegnett.network import FACT, differs_aside, insert_aside
from twin.mirror.vegnett.touched import places_beside_changes
from twin.store import schema
from twin.store.sql import swap
from twin.store.store import Store, utc_now

Progress = Callable[[str, int, int | None], None]

_FETCH = "vegnett_fetch"
_MAX_LISTED = 100
"""Unreadable links that are named; the rest is counted."""
_MAX_RESUME_AGE = dt.timedelta(days=1)
"""Nothing tells what changed between the pages of an old fetch and those of today."""


@dataclass(frozen=True, slots=True)
class _Fetch:
    """A fetch that has begun: how far it came, and what it met."""

    area: str
    url: str
    begun_at: str
    expected: int | None
    cursor: str | None = None
    ended: bool = False
    received: int = 0
    n_rejected: int = 0
    rejected: tuple[str, ...] = ()


def sync_vegnett(
    store: Store,
    area: Area,
    *,
    client: NvdbClient,
    confirm_deletions: bool = False,
    progress: Progress | None = None,
) -> int:
    """Fetch the segmented road network of an area, also links that are no longer valid, into the store.

    Each page is kept aside together with its cursor: a fetch that was interrupted less than a day ago goes
    on where it stopped. Readers see the old network until the new one is whole.

    Parameters
    ----------
    store : Store
    area : Area
    client : NvdbClient
        Of API Les V4.
    confirm_deletions : bool
        Whether the new network may have more than 5 % fewer links than the old one of the same area.
    progress : callable, optional
        Called with ``veglenker``, how many have come, and how many are expected (or None).

    Returns
    -------
    int
        Links in the store's network now.

    Raises
    ------
    NvdbError
        The API did not answer as it should; the network is unchanged, the fetch can be resumed.
    ShortBackfillError
        Fewer links came than the API counts; the network is unchanged.
    SchemaError
        More than 5 % of the links cannot be read; the network is unchanged.
    MassDeletionError
        More than 5 % of the links would go; the network is unchanged.
    RefusedError
        Another process fetches the network into this store.
    StoreError
        The store could not be written.
    """
    with store.alone("vegnett", "sync of the road network"):
        fetch = _resumed(store, area, client) or _begun(store, area, client)
        if not fetch.ended:
            fetch = _fill(store, area, client, fetch, progress)
        problem = _problem(store, fetch) or (None if confirm_deletions else _too_few(store, fetch))
        if problem is not None:
            # Its cursor is at the end: taken up again it would be refused again, whatever the API says.
            with store.transaction() as connection:
                connection.execute(sa.delete(schema.veglenke_aside))
                store.drop_fact(connection, _FETCH)
            raise problem
        return _publish(store, fetch)


def _resumed(store: Store, area: Area, client: NvdbClient) -> _Fetch | None:
    """A fetch of the same network that was interrupted not long ago."""
    fact = store.fact(_FETCH)
    if fact is None:
        return None
    fetch = _Fetch(**{**fact, "rejected": tuple(fact["rejected"])})
    age = dt.datetime.fromisoformat(utc_now()) - dt.datetime.fromisoformat(fetch.begun_at)
    same = (fetch.area, fetch.url) == (area.text(), client.api_url)
    return fetch if same and age < _MAX_RESUME_AGE else None


def _begun(store: Store, area: Area, client: NvdbClient) -> _Fetch:
    fetch = _Fetch(area.text(), client.api_url, utc_now(), _expected(client, area))
    with store.transaction() as connection:
        connection.execute(sa.delete(schema.veglenke_aside))
        store.put_fact(connection, _FETCH, asdict(fetch))
    return fetch


def _expected(client: NvdbClient, area: Area) -> int | None:
    """Links that the API counts in the area; None if it does not count them."""
    query: dict[str, str | int] = {
        "srid": "5973",
        "antall": 1,
        "historisk": "true",
        "inkluderAntall": "true",
        **area.params(),
    }
    try:
        answer = client.get_json(SEGMENTERT, query)
    except HttpStatusError as error:
        if error.status != 400:
            raise
        return None
    metadata = answer.get("metadata") if isinstance(answer, dict) else None
    count = metadata.get("antall") if isinstance(metadata, dict) else None
    return count if isinstance(count, int) and not isinstance(count, bool) else None


def _fill(store: Store, area: Area, client: NvdbClient, fetch: _Fetch, progress: Progress | None) -> _Fetch:
    """Keep page after page aside, each with its cursor."""
    for page in hent_vegnett(client, area, historisk=True, start=fetch.cursor):
        nett = Vegnett.from_les_v4(page.objects)
        fetch = replace(
            fetch,
            cursor=page.next_cursor,
            ended=page.next_cursor is None,
            received=fetch.received + len(page.objects),
            n_rejected=fetch.n_rejected + len(nett.rejected),
            rejected=(*fetch.rejected, *nett.rejected)[:_MAX_LISTED],
        )
        with store.transaction() as connection:
            insert_aside(connection, nett)
            store.put_fact(connection, _FETCH, asdict(fetch))
        if progress is not None:
            progress("veglenker", fetch.received, fetch.expected)
    return fetch


def _problem(store: Store, fetch: _Fetch) -> NvdbError | None:
    """What is wrong with a fetch that lacks much of what the API counts, or that cannot be read."""
    kept = store.count(schema.veglenke_aside)
    if fetch.expected is not None and fetch.received < MIN_RECEIVED_SHARE * fetch.expected:
        return ShortBackfillError(
            f"{fetch.url} counts {fetch.expected:,} veglenker and sent {fetch.received:,}: the road network "
            "stays as it was; run the sync again, and report it to NVDB if that does not help."
        )
    if kept < MIN_RECEIVED_SHARE * (kept + fetch.n_rejected):
        return SchemaError(
            f"{fetch.n_rejected:,} of {kept + fetch.n_rejected:,} veglenker of {fetch.url} cannot be read, "
            f"so the road network stays as it was: upgrade twin. The first: {fetch.rejected[0]}"
        )
    return None


def _too_few(store: Store, fetch: _Fetch) -> NvdbError | None:
    """What is wrong with a fetch that would empty the network, by the measure of the mirror of signs."""
    fact = store.fact(FACT)
    if fact is None or fact["area"] != fetch.area:
        return None
    before, after = int(fact["count"]), store.count(schema.veglenke_aside)
    if before - after <= max(min(FEW_DELETED, before / 2), MAX_DELETED_SHARE * before):
        return None
    return MassDeletionError(
        f"This sync would delete {before - after:,} of {before:,} veglenker from the road network, more "
        f"than {MAX_DELETED_SHARE:.0%}: check the source, or confirm the deletions."
    )


def _publish(store: Store, fetch: _Fetch) -> int:
    """Swap the tables and note what the network is, in one transaction."""
    with store.transaction() as connection:
        count = connection.execute(sa.select(sa.func.count()).select_from(schema.veglenke_aside)).scalar_one()
        before = store.view(connection).fact(FACT) or {}
        day = before.get("fetched_at", "")[:10]
        places = places_beside_changes(connection, day, fetch.begun_at[:10]) if day else None
        if places or differs_aside(connection):
            store.touch(connection, places=places)
        swap(connection, schema.veglenke, schema.veglenke_aside)
        store.drop_fact(connection, _FETCH)
        fact = {
            "area": fetch.area,
            "url": fetch.url,
            "fetched_at": fetch.begun_at,
            "count": count,
            "n_rejected": fetch.n_rejected,
            "rejected": fetch.rejected,
        }
        store.put_fact(connection, FACT, fact)
    return int(count)
