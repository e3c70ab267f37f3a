"""Workers: each drive in once and whole, whoever is killed, as `ingest_drive` in a row would have it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import fsspec
import pyarrow.parquet as pq
import pytest
import sqlalchemy as sa
from checkout import ROOT
from command_line import Twin
from fleet_drives import drives, held
from fleet_workers import kill_at_random
from postgres_server import Server

from twin.fleet import DaskCluster, Queue, work
from twin.ingest import ingest_drive
from twin.store import schema
from twin.store.kinds import Fault, JobKind, JobState
from twin.store.store import Store

KILLS = int(os.environ.get("TWIN_KILLS", "2"))
QUICK = ("--method", "single-frame", "--no-match")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Three short drives."""
    return drives(tmp_path_factory.mktemp("drives"), 3)


@pytest.fixture(scope="module")
def in_a_row(made: list[str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A store with the drives, ingested one after the other."""
    with Store.open(tmp_path_factory.mktemp("row") / "twin.db") as store:
        for folder in made:
            ingest_drive(store, folder, method="single-frame")
        yield store


def status(twin: Twin, store: Path) -> dict[str, int]:
    """How many drives are in which state."""
    counts: dict[str, int] = twin("fleet", "status", "--store", store, "--json").json["drives"]
    return {state: n for state, n in counts.items() if n}


def test_fleet_gives_what_ingests_in_a_row_give(
    twin: Twin, made: list[str], in_a_row: Store, address: str, tmp_path: Path
) -> None:
    """Two processes, one of the drives twice under another name; nothing is done anew the second time."""
    copied = shutil.copytree(made[0], tmp_path / "copy")
    command = ("fleet", "ingest", *made, copied, *QUICK, "--workers", "2", "--store", address)
    answer = twin(*command, "--parquet", tmp_path / "pq", "--json")
    assert answer.code == 0, answer.err
    assert answer.json["n_ingested"] == 4
    with Store.open(address) as store:
        rows = held(store)
        names = [row[1] for row in rows["drive"]]
        assert sorted(row[1:] for row in rows["estimate"]) == sorted(
            row[1:] for row in held(in_a_row)["estimate"]
        )
        assert len(names) == 3
        sightings = store.rows(sa.select(schema.sighting).order_by("drive_id", "number"))
    (first, *_) = sorted((tmp_path / "pq").glob("*.sightings.parquet"))
    table = pq.read_table(first).to_pylist()
    assert table == [row for row in sightings if row["drive_id"] == table[0]["drive_id"]]
    again = twin(*command, "--parquet", tmp_path / "pq", "--json").json
    assert (again["n_ingested"], again["n_unchanged"]) == (0, 4)


def test_bad_drive_is_parked_with_its_kind_and_the_others_are_in(
    twin: Twin, made: list[str], tmp_path: Path
) -> None:
    """Exit code 4; mended and retried, it is done."""
    bad = Path(shutil.copytree(made[1], tmp_path / "bad"))
    rig = (bad / "rig.json").rename(tmp_path / "rig.json")
    store = ("--workers", "1", "--store", tmp_path / "f.db")
    answer = twin("fleet", "ingest", made[0], bad, *QUICK, *store)
    assert answer.code == 4
    assert f"{bad} is parked" in answer.err
    shown = twin("fleet", "status", "--store", tmp_path / "f.db", "--json").json
    (parked,) = shown["parked"]
    assert (parked["address"], parked["fault"], parked["n_failed"]) == (str(bad), "drive", 3)
    assert shown["drives"]["done"] == 1
    rig.rename(bad / "rig.json")
    assert twin("fleet", "retry", "--kind", "drive", "--store", tmp_path / "f.db").code == 0
    assert twin("fleet", "work", *store).code == 0
    assert status(twin, tmp_path / "f.db") == {"done": 2}


@pytest.mark.slow
def test_whoever_is_killed_every_drive_is_in_once_and_whole(
    made: list[str], in_a_row: Store, postgres: Server
) -> None:
    """SIGKILL of processes, whole workers and the database at random; the next ones go on where these were.

    ``TWIN_KILLS=30`` makes a longer run of it; benchmarks/fleet_workers.py also kills Dask's scheduler.
    """
    address = postgres.new()
    with Store.open(address) as store:
        Queue(store).add(JobKind.INGEST, made, {"method": "single-frame"})
    killed = kill_at_random(address, held(in_a_row), kills=KILLS, seed=3, database=postgres.kill)
    assert killed.total() > 0
    with Store.open(address) as store:
        assert {job.state for job in Queue(store).jobs()} == {JobState.DONE}


@pytest.mark.slow
def test_worker_that_is_told_to_end_gives_back_what_it_has(
    made: list[str], twin: Twin, tmp_path: Path
) -> None:
    """SIGTERM: exit code 143, and the drives wait again with no loss counted."""
    path = tmp_path / "f.db"
    twin("fleet", "ingest", *made, "--no-match", "--queue", "--store", path)
    command = [sys.executable, "-m", "twin", "fleet", "work", "--workers", "2", "--store", path]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE) as worker, Store.open(path) as store:
        while not any(job.state is JobState.RUNNING for job in Queue(store).jobs()):
            time.sleep(0.05)
        worker.terminate()
        worker.communicate(timeout=60)
        assert worker.returncode == 143
        jobs = Queue(store).jobs()
    assert {job.state for job in jobs} <= {JobState.WAITING, JobState.DONE}
    assert {job.n_lost for job in jobs} == {0}


def test_drive_in_object_storage_is_located_on_a_cluster(
    made: list[str], in_a_row: Store, tmp_path: Path
) -> None:
    """Dask fetches and locates, this process saves; the drive remembers its address."""
    distributed = pytest.importorskip("distributed")
    dask = pytest.importorskip("dask")
    system = fsspec.filesystem("memory")
    system.put(made[0], "/drives/a", recursive=True)
    with (
        # A busy machine may take longer than the 30 s after which a cluster gives up starting.
        dask.config.set({"distributed.comm.timeouts.connect": "120s"}),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
        ) as cluster,
        Store.open(tmp_path / "f.db") as store,
    ):
        queue = Queue(store)
        queue.add(JobKind.INGEST, ["memory://drives/a", "memory://drives/b"], {"method": "single-frame"})
        tally = work(store, DaskCluster(cluster.scheduler_address))
        assert (tally.n_ingested, tally.parked) == (1, ["memory://drives/b"])
        assert [job.fault for job in queue.jobs()] == [None, Fault.LACKING]
        assert queue.jobs()[0].state is JobState.DONE
        rows = held(store)["estimate"]
        assert rows
        assert all(row in held(in_a_row)["estimate"] for row in rows)
        folders = store.rows(sa.select(schema.annotation_set.c.folder))
        assert folders == [{"folder": "memory://drives/a"}]
