"""What a mirror must survive. After each fault the visible mirror is the old or the new one, nothing else."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from mirror_bench import Visible, visible_at
from nvdb_country import GeneratedWorld

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.client.client import RETRY_AFTER_CAP_S
from nvdb.errors import NvdbError, PagingError, SchemaError, TransportError
from nvdb.mirror import MassDeletionError, ShortBackfillError
from nvdb.objects import in_norway
from nvdb.replay import Fault, ReplayServer, ReplayWorld, RequestInfo
from twin.cli.exit_codes import exit_code
from twin.errors import RefusedError, StoreError, TwinError
from twin.mirror.sync import SyncResult, sync_nvdb
from twin.store.store import Store

N_POINTS, N_PLATES, PAGE = 8, 24, 7
GENERATED = GeneratedWorld(N_POINTS, N_PLATES, seed=11)
PLATES = GENERATED.ids(96, N_PLATES)
CLIENT_DEFAULTS: dict[str, Any] = NvdbClient.__init__.__kwdefaults__ or {}
Raw = dict[str, Any]


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


@pytest.fixture(scope="module", params=["les-v4", "uberiket"])
def synced(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    """Both sources in turn: a store that mirrors a world, before anything happens."""
    made = Scene(request.param, new_world(), tmp_path_factory.mktemp("synced") / "twin.db")
    with ReplayServer(made.world, faults=made.fault_now) as made.server:
        made.sync()
        made.old = visible_at(made.path)
        yield made


@pytest.fixture
def scene(synced: Scene, tmp_path: Path, no_waiting: None) -> Scene:
    """Three plates changed, one removed and one made again since the store was synced."""
    world = new_world()
    synced.server.routes.source = world
    made = Scene(synced.source, world, Path(shutil.copy(synced.path, tmp_path)), synced.old)
    made.server, synced.then = synced.server, made
    world.touch(PLATES[3:6])
    world.remove(PLATES[9])
    world.recreate(PLATES[20])
    return made


def wire_fault(scene: Scene, fault: Fault, error: type[Exception]) -> None:
    """A fault that lasts leaves the old mirror, wherever it sets in; one that passes does no harm."""
    for fresh, first in ((False, 0), (True, 4)):
        scene.faults = lambda _, first=first: fault if scene.asked > first else None  # type: ignore[misc]
        assert isinstance(scene.attempt(fresh=fresh), error)
        scene.stays_old()
    scene.faults = lambda info: fault if info.number % 3 == 0 else None
    assert scene.attempt() is None
    scene.gets_new()


@pytest.mark.parametrize("kind", ["truncate", "cut", "damaged_gzip", "disconnect"])
def test_truncated_and_close_delimited_bodies(scene: Scene, kind: Any) -> None:
    """Half a body, with or without a declared length, is never half a page."""
    wire_fault(scene, Fault(kind), TransportError)


def test_html_with_200(scene: Scene) -> None:
    """A gateway's page of HTML is no answer."""
    wire_fault(scene, Fault("html_200"), TransportError)


@pytest.mark.parametrize("status", [429, 503])
def test_429_and_503_with_every_form_of_retry_after(
    scene: Scene, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seconds, dates and absurd values: the client waits, but never beyond its cap, and then goes on."""
    waits: list[float] = []
    monkeypatch.setitem(CLIENT_DEFAULTS, "sleep", waits.append)
    forms = [
        *("0", "7", "2.5", "99999999999", "-5", "soon", "", "1e9", "\u00e6"),
        *("Wed, 21 Oct 2015 07:28:00 GMT", "Fri, 31 Dec 9999 23:59:59 GMT", "Fri, 99 Foo 2026 99:99:99 GMT"),
    ]
    answers = [Fault("status", status, headers={"Retry-After": form}) for form in forms]
    lasting = Fault("status", status, headers={"Retry-After": "86400"})
    scene.faults = lambda _: lasting
    assert isinstance(scene.attempt(fresh=True), TransportError)
    scene.stays_old()
    # Every other request fails, each time in another form.
    scene.faults = lambda info: answers[info.number // 2 % len(answers)] if info.number % 2 else None
    for _ in range(2):
        assert scene.attempt(fresh=True) is None
    assert max(waits) == RETRY_AFTER_CAP_S
    assert any(7 <= wait < 10 for wait in waits)
    scene.gets_new()


def test_slow_drip_past_the_deadline(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer that never ends is given up."""
    monkeypatch.setitem(CLIENT_DEFAULTS, "deadline_s", 0.2)
    for fresh in (False, True):
        scene.faults = lambda _: Fault("drip", pause_s=0.05) if scene.asked == 2 else None
        assert isinstance(scene.attempt(fresh=fresh), TransportError)
        scene.stays_old()
    monkeypatch.undo()
    scene.gets_new()


def test_redirect_loops(scene: Scene) -> None:
    """A redirect to itself is not followed for ever."""
    for fresh in (False, True):
        scene.faults = lambda _: Fault("redirect_loop") if scene.asked > 1 else None
        assert isinstance(scene.attempt(fresh=fresh), TransportError)
        scene.stays_old()
    scene.gets_new()


@pytest.mark.parametrize("kind", ["repeat_page", "repeat_cursor"])
def test_repeated_page_and_repeated_cursor(scene: Scene, kind: Any) -> None:
    """A page that comes again hides another: an error, and not the end of the pages."""

    def again(info: RequestInfo) -> Fault | None:
        return Fault(kind) if "start" in info.query and "/96" in info.path else None

    scene.faults = again
    for _ in range(3):  # also when it is resumed from the page where it stopped
        assert isinstance(scene.attempt(fresh=True), PagingError | ShortBackfillError | MassDeletionError)
        scene.stays_old()
    scene.gets_new(fresh=True)


@pytest.mark.parametrize("size", [1, 11])
def test_short_page(scene: Scene, size: int) -> None:
    """A page that is shorter than asked for is not the last."""
    scene.world.page_limit = size
    scene.gets_new(fresh=True)


def test_empty_page_in_the_middle(scene: Scene) -> None:
    """An empty page looks like the end; the count of the API tells that it is not."""
    name = "objekter" if scene.source == "les-v4" else "vegobjekter"
    empty = Fault("status", 200, body=json.dumps({name: [], "metadata": {"returnert": 0}}).encode())
    scene.faults = lambda info: empty if "start" in info.query and "/96" in info.path else None
    assert isinstance(scene.attempt(fresh=True), ShortBackfillError)
    scene.stays_old()
    scene.gets_new(fresh=True)


def test_page_order_changing_between_runs(scene: Scene) -> None:
    """A backfill that is resumed in another order begins anew as soon as it lacks anything."""
    for seed in (1, 2, 3):
        scene.world.order_seed = seed
        scene.faults = lambda _: Fault("status", 403) if scene.asked > 6 else None
        assert scene.attempt(fresh=True) is not None
        scene.stays_old()
    scene.world.order_seed = 4
    scene.faults = lambda _: None
    scene.sync()
    scene.world.order_seed = None
    assert visible_at(scene.path) == scene.new() != scene.old


def test_object_changed_between_two_pages(scene: Scene) -> None:
    """What happens behind the cursor and before it is in the new mirror."""
    changed: list[str] = []

    def interfere(info: RequestInfo) -> None:
        after = re.match(r"\d+", info.query.get("start", ""))
        if "/96" in info.path and after is not None and int(after[0]) > PLATES[10]:
            scene.world.on_request = None
            changed.append(info.path)
            scene.world.touch([PLATES[0], PLATES[23]])
            scene.world.remove(PLATES[1])
            scene.world.remove(PLATES[22])
            scene.world.recreate(PLATES[9])

    scene.world.on_request = interfere
    scene.sync(fresh=True)
    assert changed
    assert visible_at(scene.path) == scene.new() != scene.old


@pytest.mark.parametrize("drift", ["new", "missing", "null"])
def test_schema_drift_of_fields(scene: Scene, drift: str) -> None:
    """New fields are kept with the object, and missing ones leave what depends on them empty."""

    def change(made: Raw, api: str) -> Raw:
        if drift == "new":
            return {**made, "nyttFelt": {"dypt": [1, {"nede": None}]}}
        kept = {"id", "versjon", "typeId", "gyldighetsperiode", "metadata"}
        return {
            name: part if name in kept else None
            for name, part in made.items()
            if drift == "null" or name in kept
        }

    scene.world.drift = change
    scene.sync()
    changed = visible_at(scene.path)[96, PLATES[3]]
    assert ("nyttFelt" in changed["raw"]) == (drift == "new")
    assert (changed["east_m"] is None) == (drift != "new")


def test_schema_drift_of_a_type(scene: Scene) -> None:
    """One object in a broken form keeps its old state and is named; a page of them stops the sync."""
    odd = {PLATES[3]}
    scene.world.drift = lambda made, api: {**made, "egenskaper": 7} if made["id"] in odd else made
    for fresh in (False, True):
        result = scene.sync(fresh=fresh)
        assert any(str(PLATES[3]) in problem for problem in result.problems)
        assert visible_at(scene.path)[96, PLATES[3]] == scene.old[96, PLATES[3]]
    before = visible_at(scene.path)
    odd |= set(PLATES)
    assert isinstance(scene.attempt(fresh=True), SchemaError)
    assert visible_at(scene.path) == before
    scene.world.drift = None
    scene.gets_new()


def moved(made: Raw, wkt: str, srid: object = None) -> Raw:
    """An object with other coordinates, in either API's form."""
    text = json.dumps(made)
    copy: Raw = json.loads(text)
    holders = [copy.get("geometri"), *(e.get("verdi") for e in dict_values(copy)), *dict_values(copy)]
    for holder in holders:
        if isinstance(holder, dict):
            for name in ("wkt", "verdi"):
                if isinstance(holder.get(name), str) and holder[name].startswith("POINT"):
                    holder[name] = wkt
                    if srid is not None:
                        holder["srid"] = srid
    return copy


def dict_values(made: Raw) -> list[Raw]:
    """The properties of an object, in either API's form."""
    found = made.get("egenskaper") or []
    return list(found.values()) if isinstance(found, dict) else list(found)


ABSURD = (
    ("POINT Z (7040000 270000 50)", None),  # swapped axes
    ("POINT Z (63.4 10.4 50)", None),  # degrees where metres should be
    ("POINT Z (1e300 7040000 50)", None),
    ("POINT Z (-270000 -7040000 50)", None),
    ("POINT Z (NaN 7040000 50)", None),
    ("POINT EMPTY", None),
    ("POINT Z (270000 7040000 50)", 3857),  # a system that NVDB does not have
    ("POINT Z (270000 7040000 50)", "utm"),
)


def test_swapped_axes_and_absurd_coordinates_and_wrong_srid(scene: Scene) -> None:
    """A sign whose coordinates cannot be is kept without a position, and said; it never stands elsewhere."""
    odd = dict(zip(PLATES, ABSURD, strict=False))
    scene.world.drift = lambda made, api: moved(made, *odd[made["id"]]) if made["id"] in odd else made
    scene.world.touch(odd)
    result = scene.sync()
    rows = visible_at(scene.path)
    assert rows == scene.new()
    for (_, number), row in rows.items():
        if number in odd:
            assert (row["east_m"], row["north_m"]) == (None, None)
            assert any(f"Vegobjekt {number}: " in problem for problem in result.problems)
        elif row["east_m"] is not None:
            assert in_norway(row["east_m"], row["north_m"])


def test_two_syncs_at_once(scene: Scene) -> None:
    """The second says who holds the lock and asks nothing; its exit code is 5."""
    refused: list[Exception] = []

    def second(info: RequestInfo) -> None:
        scene.world.on_request = None
        try:
            with Store.open(scene.path) as store:
                sync_nvdb(store, Area(), api_url=scene.server.url, source=scene.source)
        except RefusedError as error:
            refused.append(error)

    scene.world.on_request = second
    scene.sync(fresh=True)
    (error,) = refused
    assert exit_code(error) == 5
    assert f"A sync of twin.db (process {os.getpid()} on " in str(error)
    assert visible_at(scene.path) == scene.new()


@pytest.mark.skipif(not hasattr(os, "seteuid"), reason="folders are not made read-only by chmod here")
def test_read_only_folder(scene: Scene) -> None:
    """A user who may read and not write is told so, and nothing changes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = Path(shutil.copy(scene.path, folder / "twin.db"))
        path.chmod(0o444)
        folder.chmod(0o555)
        user, scene.path = os.geteuid(), path
        if user == 0:
            os.seteuid(65534)
        try:
            error = scene.attempt(fresh=True)
        finally:
            os.seteuid(user)
        assert isinstance(error, StoreError | RefusedError)
        assert "give this user the right to write" in str(error)
        folder.chmod(0o755)
        path.chmod(0o644)
        scene.stays_old()
        scene.gets_new()


def test_disk_full(scene: Scene) -> None:
    """Wherever the space runs out, while pages are kept or when they are published, the old mirror stays."""
    n_failed, spare_pages = 0, 0

    def limit(connection: Any, _record: Any) -> None:
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        connection.execute(f"PRAGMA max_page_count={pages + spare_pages}")

    failed: Exception | None = StoreError()
    while failed is not None:
        failed = None
        with Store.open(scene.path) as store:
            sa.event.listen(store._engine, "connect", limit)
            store._engine.dispose()  # connections that are open already have no limit
            try:
                sync_nvdb(store, Area(), api_url=scene.server.url, source=scene.source, fresh=True)
            except StoreError as error:
                failed = error
        if failed is not None:
            assert "free some space; nothing was changed" in str(failed)
            scene.stays_old()
            n_failed, spare_pages = n_failed + 1, spare_pages + 1
    assert n_failed >= 2
    assert visible_at(scene.path) == scene.new() != scene.old


FULL = """
import resource, sys
from twin.cli import run

resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
sys.exit(run(sys.argv[2:]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there is no limit on the size of files here")
def test_disk_full_under_the_command(scene: Scene) -> None:
    """A file that may grow no more ends the command with exit code 4 and one sentence."""
    command = ["sync-nvdb", "--all", "--fresh", "--source", scene.source, "--api-url", scene.server.url]
    limit = str(scene.path.stat().st_size + 8192)
    done = subprocess.run(
        [sys.executable, "-c", FULL, limit, *command, "--store", str(scene.path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 4, done.stderr
    assert "Traceback" not in done.stderr
    assert "nothing was changed" in done.stderr
    scene.stays_old()
    scene.gets_new()


@pytest.mark.parametrize("fresh", [False, True])
def test_mass_deletion(scene: Scene, fresh: bool) -> None:
    """An API that has lost its objects is not believed until somebody confirms it; exit code 5."""
    for number in PLATES[10:20]:
        scene.world.remove(number)
    for number in GENERATED.ids(95, N_POINTS):
        scene.world.remove(number)
    for _ in range(2):
        error = scene.attempt(fresh=fresh)
        assert isinstance(error, MassDeletionError)
        assert exit_code(error) == 5
        scene.stays_old()
    scene.gets_new(fresh=fresh, confirm_deletions=True)


def test_interrupted_sync_does_not_wait_for_the_page_on_its_way(tmp_path: Path) -> None:
    """Ctrl-C ends a sync with code 130 although a page comes in drops; the next run goes on from there."""
    world = GeneratedWorld(40, 80)
    world.page_limit = 10
    slow, ended = threading.Event(), threading.Event()

    def page_in_drops(info: RequestInfo) -> Fault | None:
        if "/vegobjekter/96" not in info.path or "start" not in info.query or ended.is_set():
            return None
        slow.set()
        return Fault("drip", pause_s=1.0)  # the whole page would take hours; no wait for a byte is long

    with ReplayServer(world, faults=page_in_drops) as server:
        command = ["sync-nvdb", "--all", "--api-url", server.url, "--store", str(tmp_path / "a.db")]
        with subprocess.Popen(
            [sys.executable, "-m", "twin", *command], stderr=subprocess.PIPE, text=True
        ) as process:
            assert slow.wait(60)
            process.send_signal(signal.SIGINT)
            _, told = process.communicate(timeout=60)  # far below the client's deadline of 300 s
        assert process.returncode == 130
        assert told.count("Interrupted:") == 1
        ended.set()
        with Store.open(tmp_path / "a.db") as store:
            result = sync_nvdb(store, Area(), api_url=server.url)
        assert (result.mode, result.skiltplate) == ("resumed", 80)
