"""What API Skriv has of our findings: asked before a set is registered, and again before it is started.

It is how a set is found whose registration was not heard of, and what another copy of the store has sent.
API Skriv tells a user of his own sets alone.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from nvdb.skriv import FINAL, IKKE_STARTET, WITHOUT_EFFECT, EndringssettStatus, SkrivClient
from twin.changesets.kontekst import finding_of_name, findings_named
from twin.changesets.read_exported import ExportedSet
from twin.changesets.receipts import Receipt, receipts_in
from twin.changesets.sent import SentFinding, SentLog
from twin.changesets.sent_objects import SentObject, objects_of
from twin.matching.sites import SKILTPLATE, SKILTPUNKT
from twin.store.kinds import Sending
from twin.store.store import Store

LOOK_BACK: Final = dt.timedelta(days=1)
"""How long before the last sync a set may have come whose result that sync did not show."""
OF_RECEIPT: Final = "receipt-"
"""Before the SHA-256 of a set that an earlier version of twin sent: the tag of it."""


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """A set at the API that names findings and that this store did not send."""

    set_id: str
    fremdrift: str
    change_ids: frozenset[str]


def look_up(store: Store, log: SentLog, client: SkrivClient) -> dict[str, Elsewhere]:
    """Find sets that we do not know the id of, and adopt what others have carried out.

    A set that is about to be registered and is not there never arrived: its findings are free again.

    Returns
    -------
    dict
        Finding → the set of another copy of the store that is on the way with it.
    """
    unheard = {sent.tag: sent for sent in log.unfinished() if sent.state == Sending.REGISTERING}
    on_the_way: dict[str, Elsewhere] = {}
    for tag, item in _unknown(store, log, client):
        if tag in unheard:
            log.registered(tag, item.set_id)
            del unheard[tag]
        elif item.fremdrift not in FINAL:
            on_the_way |= dict.fromkeys(item.change_ids, item)
        else:
            _adopt(log, item, client.status(item.set_id))
    for sent in unheard.values():
        log.ended(sent, Sending.WITHOUT_EFFECT)
    return on_the_way


def rival_of(
    store: Store, log: SentLog, client: SkrivClient, set_id: str, change_ids: Collection[str]
) -> Elsewhere | None:
    """Find a set of another copy of the store that goes before one that is registered and not yet started.

    Whoever registered first goes on, and the other cancels: both ask after they have registered, so at least
    one of them sees the other.
    """
    is_earlier = True
    for _, item in _unknown(store, log, client, until=set_id):
        if item.set_id == set_id:
            is_earlier = False
            continue
        may_go_before = is_earlier or item.fremdrift != IKKE_STARTET
        is_about_them = not item.change_ids.isdisjoint(change_ids)
        if may_go_before and is_about_them and not _held_by(client, item).isdisjoint(change_ids):
            return item
    return None


def _held_by(client: SkrivClient, item: Elsewhere) -> frozenset[str]:
    """Findings that no other set may bring in now.

    Of a set that has ended only what it registered: NVDB guards the rest, and a dry run has done nothing.
    """
    if item.fremdrift not in FINAL:
        return item.change_ids
    return frozenset(_registered(client.status(item.set_id)))


def adopt_receipts(
    store: Store, log: SentLog, client: SkrivClient, path: Path, exported: Collection[ExportedSet]
) -> None:
    """Take over what an earlier version of twin kept beside the sets that it sent."""
    by_sha = {item.sha256: item for item in exported}
    known = log.tags_and_ids()
    folder = path if path.is_dir() else path.parent
    for receipt in receipts_in(folder):
        if receipt.api == log.api and receipt.set_id not in known:
            _adopt_receipt(store, log, client, receipt, folder, by_sha.get(receipt.sha256))


def _unknown(
    store: Store, log: SentLog, client: SkrivClient, *, until: str | None = None
) -> Iterator[tuple[str | None, Elsewhere]]:
    """Tag and findings of each set at the API that may still matter and that the store has not heard of.

    The set `until` is given too, so that one can tell what came before it.
    """
    known = log.tags_and_ids()
    unheard = {sent.tag for sent in log.unfinished() if sent.set_id is None}
    for listed in client.sets_since(_since(store, log)):
        if listed.set_id == until:
            yield None, Elsewhere(listed.set_id, listed.fremdrift, frozenset())
        if listed.set_id in known or listed.fremdrift in WITHOUT_EFFECT:
            continue
        content = client.content(listed.set_id)
        found = Elsewhere(listed.set_id, listed.fremdrift, findings_named(content))
        # Of a set that came after it was given up: nobody starts it.
        if content.ekstern_ref not in known or content.ekstern_ref in unheard:
            yield content.ekstern_ref, found


def _since(store: Store, log: SentLog) -> dt.datetime:
    """Since when a set matters: what was carried out before the last sync stands in the mirror."""
    mirror = store.fact("mirror") or {}
    known = [text for text in (mirror.get("synced_at"), log.oldest_open()) if text]
    return min([dt.datetime.now(dt.UTC), *map(dt.datetime.fromisoformat, known)]) - LOOK_BACK


def _adopt(log: SentLog, item: Elsewhere, status: EndringssettStatus) -> None:
    """Keep what another set registered. Changes of known objects need no guard: NVDB takes none twice."""
    registered = _registered(status)
    log.adopt(
        [
            SentFinding(f"set-{item.set_id}", key, Sending.CARRIED_OUT, item.set_id, "", objects, "")
            for key, objects in registered.items()
        ]
    )


def _registered(status: EndringssettStatus) -> dict[str, tuple[SentObject, ...]]:
    """Finding → the new objects of a set that are named after it.

    Carried out, a dry run has none: its objects got no ids.
    """
    found: dict[str, tuple[SentObject, ...]] = {}
    for item in status.objekter:
        key = finding_of_name(item.temp_id or "")
        if key is not None and (item.nvdb_id is not None or not status.accepted):
            kind = SKILTPLATE if "#" in (item.temp_id or "") else SKILTPUNKT
            found[key] = (*found.get(key, ()), SentObject(kind, item.nvdb_id, item.temp_id))
    return found


def _adopt_receipt(
    store: Store,
    log: SentLog,
    client: SkrivClient,
    receipt: Receipt,
    folder: Path,
    exported: ExportedSet | None,
) -> None:
    """Ask what became of a set. One that was not started is cancelled: its findings are sent anew."""
    tag = f"{OF_RECEIPT}{receipt.sha256}"
    status = client.status(receipt.set_id)
    if status.fremdrift == IKKE_STARTET:
        client.cancel(receipt.set_id)
    if status.accepted:
        state = Sending.CARRIED_OUT
    elif status.fremdrift in {IKKE_STARTET, *WITHOUT_EFFECT}:
        state = Sending.WITHOUT_EFFECT
    else:
        state = Sending.UNDER_WAY
    about: dict[str, tuple[SentObject, ...]] = {receipt.sha256: (), **_registered(status)}
    if exported is not None:
        new = [item for item in objects_of(exported.sett.endringer, store.rows) if item.temp_id is not None]
        if new:
            # Until these are shown; what the set changes beside them NVDB takes no second time.
            about |= dict.fromkeys(exported.listed, _with_ids(new, status))
    file = str((folder / receipt.file).resolve())
    log.adopt(
        [SentFinding(tag, key, state, receipt.set_id, "", objects, file) for key, objects in about.items()]
    )


def _with_ids(objects: Collection[SentObject], status: EndringssettStatus) -> tuple[SentObject, ...]:
    given = status.nvdb_ids
    return tuple(replace(item, nvdb_id=given.get(item.temp_id or "", item.nvdb_id)) for item in objects)
