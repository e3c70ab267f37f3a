"""A world that has changed since a store was synced, and what faults may make of the next sync."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mirror_bench import Visible, visible_at
from nvdb_country import GeneratedWorld

from nvdb.area import Area
from nvdb.errors import NvdbError
from nvdb.replay import Fault, ReplayServer, ReplayWorld, RequestInfo
from twin.cli.exit_codes import exit_code
from twin.errors import TwinError
from twin.mirror.sync import SyncResult, sync_nvdb
from twin.store.store import Store

N_POINTS, N_PLATES, PAGE = 8, 24, 7
GENERATED = GeneratedWorld(N_POINTS, N_PLATES, seed=11)
PLATES = GENERATED.ids(96, N_PLATES)


def new_world() -> ReplayWorld:
    """Generated signs in pages of five; one plate has been removed."""
    records = {kind: [GENERATED.one(kind, i) for i in GENERATED.ids(kind, 99)] for kind in (95, 96)}
    world = ReplayWorld({kind: [r.raw for r in found if r] for kind, found in records.items()})
    world.page_limit = PAGE
    world.remove(PLATES[20])
    return world


@dataclass
class Scene:
    """A world that has changed since `path` was synced by `source`."""

    source: str
    world: ReplayWorld
    path: Path
    old: Visible = field(default_factory=dict)
    server: ReplayServer = field(init=False)
    then: Scene | None = None
    faults: Callable[[RequestInfo], Fault | None] = lambda _: None
    asked: int = 0

    def fault_now(self, info: RequestInfo) -> Fault | None:
        """The fault of the scene that the server belongs to at present."""
        return (self.then or self).fault(info)

    def fault(self, info: RequestInfo) -> Fault | None:
        """The fault of a request; the datakatalog is asked without."""
        if "datakatalog" in info.path:
            return None
        self.asked += 1
        return self.faults(info)

    def sync(self, path: Path | None = None, **options: Any) -> SyncResult:
        """``twin sync-nvdb``."""
        self.asked = 0
        with Store.open(path or self.path) as store:
            return sync_nvdb(store, Area(), api_url=self.server.url, source=self.source, **options)

    def attempt(self, **options: Any) -> Exception | None:
        """Sync; return the error, which must be one with a sentence and an exit code of its own."""
        failed: Exception | None = None
        try:
            self.sync(**options)
        except (NvdbError, TwinError) as error:
            failed = error
        assert failed is None or (exit_code(failed) in {3, 4, 5} and str(failed).endswith("."))
        return failed

    def new(self) -> Visible:
        """What a first sync gives now."""
        hook, self.world.on_request = self.world.on_request, None
        clean = self.path.with_name(f"clean-{len(self.server.requests)}.db")
        self.sync(clean)
        self.world.on_request = hook
        return visible_at(clean)

    def stays_old(self) -> None:
        """The visible mirror is the old one."""
        assert visible_at(self.path) == self.old

    def gets_new(self, **options: Any) -> None:
        """Without faults the next sync brings the new mirror."""
        self.faults = lambda _: None
        self.sync(**options)
        assert visible_at(self.path) == self.new() != self.old
