"""A large match by many processes: that of one, whoever is killed."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import sqlalchemy as sa
from checkout import ROOT
from fleet import fill

from twin.fleet import LocalProcesses, Queue, work
from twin.matching import match
from twin.store import schema
from twin.store.kinds import JobKind, JobState
from twin.store.store import Store

WORLD = (3, 150, (-2200.0, 2600.0))
"""Three drives past 150 signs, with a corner of four tiles in their middle."""
WORKER = """
import sys
from twin.fleet import LocalProcesses, work, worker
from twin.store.store import Store

worker.TAKEN_APART = 1
with Store.open(sys.argv[1]) as store:
    work(store, LocalProcesses(1), lease_s=1.0)
"""


@pytest.fixture(autouse=True)
def _small_matches_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twin.fleet.worker.TAKEN_APART", 1)


@pytest.fixture(scope="module")
def in_one_piece(tmp_path_factory: pytest.TempPathFactory) -> list[object]:
    """What one match leaves."""
    with Store.open(tmp_path_factory.mktemp("one") / "twin.db") as store:
        fill(store.name, *WORLD)
        match(store)
        return left(store)


def left(store: Store) -> list[object]:
    """What a match says, and what it leaves to the next one."""
    tables = (schema.change, schema.pole_key, schema.known_mark, schema.kept_part)
    return [store.rows(sa.select(table).order_by(*table.primary_key)) for table in tables]


def to_match(address: str) -> Store:
    """A store with drives, and a match in the queue."""
    fill(address, *WORLD)
    store = Store.open(address)
    Queue(store).add(JobKind.MATCH, [""], {})
    return store


def test_processes_match_as_one_does(address: str, in_one_piece: list[object]) -> None:
    """Drives, then tiles, by two processes; the queue holds no part of it afterwards."""
    said: list[str] = []
    with to_match(address) as store:
        tally = work(store, LocalProcesses(2), progress=said.append)
        assert tally.is_matched
        assert sum(line.startswith("match, tile") for line in said) >= 4
        assert left(store) == in_one_piece
        assert [job.kind for job in Queue(store).jobs()] == [JobKind.MATCH]


@pytest.mark.slow
def test_part_of_a_killed_worker_runs_again(tmp_path: Path, in_one_piece: list[object]) -> None:
    """SIGKILL while it works out a tile: the next worker does what is left."""
    path = tmp_path / "twin.db"
    command = [sys.executable, "-c", WORKER, str(path)]
    with to_match(str(path)) as store:
        with subprocess.Popen(command, cwd=ROOT) as worker:
            while not any(
                job.state is JobState.RUNNING and job.address.startswith("tile")
                for job in Queue(store).jobs()
            ):
                assert worker.poll() is None
                time.sleep(0.02)
            worker.send_signal(signal.SIGKILL)
        (lost,) = (job for job in Queue(store).jobs() if job.state is JobState.RUNNING)
        said: list[str] = []
        assert work(store, LocalProcesses(1), progress=said.append).is_matched
        assert any(line.startswith(f"match, {lost.address}:") for line in said)
        assert left(store) == in_one_piece
