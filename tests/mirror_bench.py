"""A world behind a replay server, and a store that mirrors it."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from nvdb.area import Area
from nvdb.mirror import LesV4Source, Source, SyncReport, UberiketSource, sync
from nvdb.replay import Fault, ReplayWorld, RequestInfo
from twin.mirror.mirror_tables import StoreMirror
from twin.mirror.raw import raw_object
from twin.store import schema
from twin.store.store import Store

COUNTRY = Area()
KINDS: dict[str, Any] = {"les-v4": LesV4Source, "uberiket": UberiketSource}
PLATES = range(501, 510)
Visible = dict[tuple[int, int], dict[str, Any]]


class Clock:
    """A clock that only moves when it is told to."""

    def __init__(self) -> None:
        self.time = datetime(2026, 6, 1, 12, tzinfo=UTC)

    def __call__(self) -> datetime:
        """Now."""
        return self.time

    def text(self) -> str:
        """Now, as the store writes it."""
        return f"{self.time:%Y-%m-%dT%H:%M:%SZ}"


class Bench:
    """A world behind a replay server, and a store that mirrors it through the source in test."""

    def __init__(self, kind: str, api: Any, world: ReplayWorld, clock: Clock, folder: Path) -> None:
        self.kind, self.world, self.clock = kind, world, clock
        self._api, self._folder = api, folder
        self.faults: Callable[[RequestInfo], Fault | None] = lambda info: None
        _, self.server = api.serve(world, self._fault)
        self.store = self.new_store("twin.db")

    def _fault(self, info: RequestInfo) -> Fault | None:
        return self.faults(info)

    def new_store(self, name: str) -> Store:
        """An empty store."""
        store: Store = self._api.keep(Store.open(self._folder / name))
        return store

    def source(self, kind: str = "", page_size: int = 2) -> Source:
        """A source that reads the world."""
        client = self._api.client(self.server.url, attempts=2)
        made: Source = KINDS[kind or self.kind](client, page_size=page_size, clock=self.clock)
        return made

    def sync(self, *, kind: str = "", area: Area = COUNTRY, page_size: int = 2, **options: Any) -> SyncReport:
        """Sync the store in test; a minute later it is over."""
        mirror = StoreMirror(self.store)
        report = sync(self.source(kind, page_size), mirror, area, clock=self.clock, **options)
        self.clock.time += timedelta(minutes=1)
        return report

    def clean(self, kind: str = "", area: Area = COUNTRY) -> Visible:
        """What a first sync into an empty store gives now."""
        hook, self.world.on_request = self.world.on_request, None
        with self.new_store(f"clean-{len(self.server.requests)}.db") as store:
            sync(self.source(kind, 1000), StoreMirror(store), area, clock=self.clock)
            found = visible(store)
        self.world.on_request = hook
        return found

    def position(self) -> str | None:
        """Where the visible mirror stands in the feed."""
        following = StoreMirror(self.store).following()
        return following.position if following else None

    def feed_is_too_old(self) -> None:
        """Make the feed end after the mirror's position."""
        self.clock.time += timedelta(days=40)
        if self.kind == "uberiket":
            start = self.position()
            self.faults = lambda info: (
                Fault("status", status=410)
                if info.path.endswith("/hendelser/vegobjekter") and info.query["start"] == start
                else None
            )


def rows(store: Store, table: sa.Table) -> list[dict[str, Any]]:
    """All rows of a table; the raw object decoded."""
    found = [dict(row) for row in store.rows(sa.select(table))]
    return [row | {"raw": raw_object(row)} for row in found]


def visible(store: Store) -> Visible:
    """The visible mirror, all but when it was fetched."""
    return {
        (kind, row["nvdb_id"]): {name: value for name, value in row.items() if name != "synced_at"}
        for kind, tables in schema.MIRROR.items()
        for row in rows(store, tables.visible)
    }


def visible_at(path: Path) -> Visible:
    """The visible mirror of a store, nothing where there is none; the counts kept beside it must agree."""
    if not path.exists():
        return {}
    with Store.open(path) as store:
        assert StoreMirror(store).counts() == StoreMirror(store).recounted()
        return visible(store)


def history(store: Store) -> list[dict[str, Any]]:
    """States that were replaced, of both types."""
    return [row for tables in schema.MIRROR.values() for row in rows(store, tables.history)]


def is_page(info: RequestInfo) -> bool:
    """Whether a request asks for objects and not by id."""
    return info.path.endswith(("/vegobjekter/95", "/vegobjekter/96")) and "ider" not in info.query


def nine(report: SyncReport) -> tuple[int, int]:
    """Points and plates in the mirror."""
    return report.applied.total[95], report.applied.total[96]


def broken(made: dict[str, Any], api: str) -> dict[str, Any]:
    """Drift: plate 505 has a part of the wrong type."""
    part = {"lokasjon": "nowhere"} if api == "les-v4" else {"stedfesting": "nowhere"}
    return made | (part if made["id"] == 505 else {})
