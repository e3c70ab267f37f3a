"""SIGKILL at any instant of a sync: readers see the old mirror or the new one, and the next runs finish.

``TWIN_KILLS=100`` makes a longer run of it. What is killed is a process that runs ``twin sync-nvdb``; its
instant is drawn from all requests, all SQL statements and all steps inside of statements that an undisturbed
run of the same kind makes. A process that has imported everything is forked for each run, since starting one
takes longer than what is tested.
"""

from __future__ import annotations

import json
import os
import queue
import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path

import pytest
from mirror_bench import Visible, visible_at
from nvdb_country import GeneratedWorld

from nvdb.area import Area
from nvdb.replay import ReplayServer, RequestInfo
from twin.mirror.sync import sync_nvdb
from twin.store.store import Store

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")

KILLS = int(os.environ.get("TWIN_KILLS", "4"))
N_POINTS, N_PLATES, PAGE = 60, 140, 25
STEP = 100
"""Steps of SQLite's virtual machine between two instants inside of a statement."""
KINDS = ("request", "statement", "publish", "step")
"""Kinds of instants; ``publish`` is a statement, or the commit, of the step that makes a mirror visible."""


RUNNER = f"""
import json, os, signal, sys
import sqlalchemy as sa
from twin.cli import run
import nvdb.mirror.follow, nvdb.mirror.les_v4, nvdb.mirror.uberiket, twin.mirror.sync
import twin.cli.app, twin.cli.mirror, twin.cli.output


def work(arguments, kill):
    counts = {{"statement": 0, "step": 0, "publish": 0}}
    publishing = False

    def count(kind):
        counts[kind] += 1
        if kill == [kind, counts[kind]]:
            os.kill(os.getpid(), signal.SIGKILL)
        return 0

    @sa.event.listens_for(sa.Engine, "before_cursor_execute")
    def statement(connection, cursor, text, *_):
        nonlocal publishing
        # What is not to be seen half done begins with old states going into the history, or with the swap.
        publishing = publishing or "_history" in text or text.startswith("DROP TABLE")
        count("publish" if publishing else "statement")

    @sa.event.listens_for(sa.Engine, "commit")
    def commit(*_):
        nonlocal publishing
        count("publish" if publishing else "statement")
        publishing = False

    @sa.event.listens_for(sa.pool.Pool, "connect")
    def connect(connection, _):
        connection.set_progress_handler(lambda: count("step"), {STEP})

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    code = run(arguments)
    os.write(answers, (json.dumps(counts) + "\\n").encode())
    os._exit(code)


answers = os.dup(1)
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        os.write(answers, f"{{os.getpid()}}\\n".encode())
        work(*json.loads(line))
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    os.write(answers, f"{{code}}\\n".encode())
"""


@dataclass
class Runner:
    """Runs ``twin sync-nvdb`` in processes that can be killed."""

    process: subprocess.Popen[str]
    url: str
    source: str
    counts: dict[str, int] = field(default_factory=dict)
    child: queue.SimpleQueue[int] = field(default_factory=queue.SimpleQueue)
    """The process at work, for whoever wants to kill it."""

    def _answer(self) -> str:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the runner has ended"
        return line.strip()

    def run(self, store: Path, *options: str, kill: tuple[str, int] | None = None) -> bool:
        """Sync; return whether the process was killed. A run that ends leaves its `counts`."""
        command = ["sync-nvdb", "--all", "--source", self.source, "--api-url", self.url, "--json"]
        assert self.process.stdin is not None
        arguments = [*command, "--store", str(store), *options]
        self.process.stdin.write(json.dumps([arguments, kill]) + "\n")
        self.process.stdin.flush()
        # First comes the process's number; its counts come before its exit code, if it lives so long.
        self.child = queue.SimpleQueue()
        self.child.put(int(self._answer()))
        code = self._answer()
        if code.startswith("{"):
            self.counts, code = json.loads(code), self._answer()
        assert int(code) in {0, -signal.SIGKILL}
        return int(code) != 0


@dataclass
class Stage:
    """A world on a server, and the processes that sync it; a request can be the last thing a process sees."""

    world: GeneratedWorld
    runner: Runner
    folder: Path
    last_request: int = 0
    n_requests: int = 0

    def note(self, info: RequestInfo) -> None:
        """Count a request; kill who asked, if it is the one."""
        self.n_requests += 1
        if self.n_requests == self.last_request:
            os.kill(self.runner.child.get(timeout=60), signal.SIGKILL)

    def run(self, store: Path, *options: str, kill: tuple[str, int] | None = None) -> bool:
        """Sync, up to an instant."""
        self.n_requests = 0
        self.last_request = kill[1] if kill is not None and kill[0] == "request" else 0
        return self.runner.run(store, *options, kill=kill)

    def instants(self, store: Path, *options: str) -> dict[str, int]:
        """How many instants of each kind an undisturbed run has."""
        assert not self.run(store, *options)
        return {**self.runner.counts, "request": self.n_requests}

    def clean(self) -> Visible:
        """What a first sync into an empty store gives now."""
        path = self.folder / f"clean-{len(self.world.events)}.db"
        if not path.exists():
            with Store.open(path) as store:
                sync_nvdb(store, Area(), api_url=self.runner.url, source=self.runner.source)
        return visible_at(path)

    def change(self, rng: random.Random) -> None:
        """Change, remove, and create again some signs, few enough not to be suspicious."""
        plates = [n for n in self.world.ids(96, N_PLATES) if self.world.one(96, n) is not None]
        chosen = rng.sample(plates, 6)
        self.world.touch([*chosen[:3], *rng.sample(self.world.ids(95, N_POINTS), 2)])
        for number in chosen[3:]:
            self.world.remove(number)
        gone = sorted(set(self.world.ids(96, N_PLATES)) - set(plates))
        for number in gone[:2]:
            self.world.recreate(number)


@pytest.fixture(params=["les-v4", "uberiket"])
def stage(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Stage]:
    """Both sources in turn; several hundred signs in small pages."""
    world = GeneratedWorld(N_POINTS, N_PLATES, seed=2)
    world.page_limit = PAGE
    with (
        ReplayServer(world) as server,
        subprocess.Popen(
            [sys.executable, "-c", RUNNER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        ) as process,
    ):
        made = Stage(world, Runner(process, server.url, request.param), tmp_path)
        world.on_request = made.note
        yield made
        assert process.stdin is not None
        process.stdin.close()


@pytest.mark.slow
def test_killed_syncs_leave_the_old_mirror_or_the_new_one(stage: Stage) -> None:
    """First backfills, fresh ones beside a mirror, and rounds of changes are killed; the last run ends."""
    rng = random.Random(f"{stage.runner.source} {KILLS}")
    source_is_first = stage.runner.source == "les-v4"
    wanted = KILLS - KILLS // 2 if source_is_first else KILLS // 2
    store = stage.folder / "twin-0.db"
    instants = {"first": stage.instants(store)}
    stage.change(rng)
    instants["changes"] = stage.instants(store)
    instants["fresh"] = stage.instants(store, "--fresh")
    killed: list[tuple[str, str, int]] = []
    n_rounds, kinds = 0, cycle(rng.sample(KINDS, len(KINDS)))
    while len(killed) < wanted:
        what = ("first", "changes", "fresh")[n_rounds % 3]
        n_rounds += 1
        if what == "first":
            store = stage.folder / f"twin-{n_rounds}.db"
        else:
            stage.change(rng)
        old, new = visible_at(store), stage.clean()
        options = ["--fresh"] if what == "fresh" else []
        for _ in range(rng.choice((1, 1, 2))):  # a resumed run may be killed too
            kind = next(kinds)
            instant = rng.randint(1, instants[what][kind])
            if stage.run(store, *options, kill=(kind, instant)):
                killed.append((what, kind, instant))
            assert visible_at(store) in (old, new), f"neither old nor new after {what}, {kind} {instant}"
        if n_rounds % 3 == 0 or len(killed) >= wanted:  # else the next sync meets what the kill has left
            assert not stage.run(store, *options)
            assert visible_at(store) == new
    assert len({kind for _, kind, _ in killed}) >= min(3, wanted)


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["les-v4"], indirect=True)
def test_a_publish_is_killed_between_any_two_statements(stage: Stage) -> None:
    """Dropping, renaming and making tables, the commit: readers see the old mirror, or the new one whole."""
    store = stage.folder / "twin.db"
    n_requests = stage.instants(store)["request"]
    stage.change(random.Random(1))
    old, new = visible_at(store), stage.clean()
    assert stage.run(store, "--fresh", kill=("request", n_requests))  # after the last page
    files = [path for name in ("", "-wal") if (path := Path(f"{store}{name}")).exists()]

    def again(number: int) -> Path:
        for path in files:
            shutil.copy(path, stage.folder / path.name.replace("twin", f"copy-{number}"))
        return stage.folder / f"copy-{number}.db"

    last = stage.instants(again(0))["publish"]
    assert last >= 12
    for number in sorted({*range(1, last, 6), last - 1, last}):
        copy = again(number)
        assert stage.run(copy, kill=("publish", number))
        assert visible_at(copy) == old
        if number == last:  # before the commit
            assert not stage.run(copy)
            assert visible_at(copy) == new
