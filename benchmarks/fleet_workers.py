"""Two workers against one, and workers, schedulers and databases killed at random, against the bars.

Usage: python benchmarks/fleet_workers.py [--drives 12] [--minutes 1.5] [--kills 30]
       [--only speed|kills] [--postgres]

Speed: drives an hour by two processes over those by one, on 2 cores; bar 1.7. Clocks mean that where the
machine is quiet. Else the processor's time counts, of all processes: 2 x (one worker's) / (two workers'),
less what two leave unused more than one: what two free cores would give. Which of the two counts is said.

Kills: short drives, and something killed by SIGKILL every second or so, until that was done 30 times: a
process that locates, a whole worker, Dask's scheduler, and where the store is PostgreSQL its server. After
each kill, and at the end, every drive in the store is compared with what `ingest_drive` gives, row by row.
Bar: each drive once, none lost, no half of one.

A PostgreSQL server is started in a temporary folder for it (``--postgres``), or not used.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

from fleet_drives import differing, drives, held

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from postgres_server import running

from twin.cli.output import print_table
from twin.errors import StoreError
from twin.fleet import DaskCluster, Job, LocalProcesses, Queue, work
from twin.ingest import ingest_drive
from twin.store.kinds import JobKind, JobState
from twin.store.store import Store

BAR_SPEED, BAR_KILLS = 1.7, 30
METHOD = "single-frame"
_QUIET = 0.3
"""Processes that others run, in the mean: below it a clock on the wall is fair."""
_LEASE_S = 2.0
_HERE = [sys.executable, __file__]
_ROOT = str(Path(__file__).resolve().parents[1])
_ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": _ROOT}


# -- what the processes run ----------------------------------------------------------------------------------


def run_worker(store: str, engine: str) -> int:
    """Work until the queue is empty."""
    with Store.open(store, create=False) as opened:
        executor = DaskCluster(engine) if engine.startswith("tcp:") else LocalProcesses(int(engine))
        work(opened, executor, lease_s=_LEASE_S)
    return 0


def children(pid: int) -> list[int]:
    """Return the processes that a process and its children have started."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if int(path.read_text().rpartition(")")[2].split()[1]) == pid:
                found += [int(path.parent.name), *children(int(path.parent.name))]
    return found


class Running:
    """A process group that is started anew when it has ended too early."""

    def __init__(self, *command: str) -> None:
        self._command = command
        self.start()

    def start(self) -> None:
        """Start it."""
        self.process = subprocess.Popen(
            self._command,
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=_ENVIRONMENT,
        )

    def kill(self) -> None:
        """Kill it with all that it started."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def kill_a_child(self, draw: random.Random) -> bool:
        """Kill one of the processes that it has started; False where there is none."""
        started = children(self.process.pid)
        if started:
            with suppress(ProcessLookupError):
                os.kill(draw.choice(started), signal.SIGKILL)
        return bool(started)


# -- kills ---------------------------------------------------------------------------------------------------


def kill_at_random(
    store: str,
    whole: Mapping[str, list[Any]],
    *,
    kills: int,
    seed: int,
    between_s: tuple[float, float] = (0.0, 1.5),
    dask: bool = False,
    database: Callable[[], None] | None = None,
) -> Counter[str]:
    """Ingest drives while processes are killed; AssertionError where a drive is not in once and whole.

    Parameters
    ----------
    store : str
        With the drives in its queue.
    whole : mapping of table to rows
        What the store must hold in the end, of no other drives than it has at any time.
    dask : bool
        Whether a Dask cluster locates.
    database : callable, optional
        Kills the database and starts it again.

    Returns
    -------
    Counter
        What was killed how often; fewer than `kills` where the drives were in before that.
    """
    draw, done = random.Random(seed), Counter[str]()
    cluster: list[Running] = []
    engines = ["1", "1"]
    if dask:
        address = f"tcp://127.0.0.1:{_free_port()}"
        port = address.rpartition(":")[2]
        quiet = ("--no-dashboard",)
        scheduler = Running(sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", port, *quiet)
        options = ("--nworkers", "2", "--nthreads", "1", *quiet)
        cluster = [scheduler, Running(sys.executable, "-m", "distributed.cli.dask_worker", address, *options)]
        engines = [address]
    workers = [Running(*_HERE, "--work", store, engine) for engine in engines]
    victims = ["process", "worker", *["scheduler"] * dask, *["database"] * (database is not None)]
    began, bag = 0, list[str]()
    try:
        while jobs := _open_jobs(store):
            # What is killed has begun something since the last time.
            n_runs = sum(job.claim for job in jobs)
            if n_runs > began and sum(done.values()) < kills:
                time.sleep(draw.uniform(*between_s))
                # Each kind in its turn, in an order drawn anew.
                bag = bag or draw.sample(victims, len(victims))
                done[_kill(bag.pop(), draw, workers, cluster, database)] += 1
                _check(store, whole, complete=False)
                began = sum(job.claim for job in _open_jobs(store))
            for one in (*cluster, *workers):
                # A worker's 0 says that all is done; a cluster's that it has lost its scheduler.
                if one.process.poll() not in ((None,) if one in cluster else (None, 0)):
                    one.start()
            time.sleep(0.1)
    finally:
        for one in (*workers, *cluster):
            one.kill()
    _check(store, whole, complete=True)
    done.pop("nothing", None)
    return done


def _kill(
    what: str,
    draw: random.Random,
    workers: Sequence[Running],
    cluster: Sequence[Running],
    database: Callable[[], None] | None,
) -> str:
    if what == "database" and database is not None:
        database()
    elif what == "scheduler":
        cluster[0].kill()
    elif what == "worker":
        draw.choice(workers).kill()
    elif not draw.choice([*cluster[1:]] or workers).kill_a_child(draw):
        return "nothing"
    return what


def _open_jobs(store: str) -> list[Job]:
    """Return all jobs; none when each is done or parked."""
    for _ in range(60):
        with suppress(StoreError), Store.open(store, create=False) as opened:
            jobs = Queue(opened).jobs()
            ended = (JobState.DONE, JobState.PARKED)
            return [] if all(job.state in ended for job in jobs) else jobs
        time.sleep(0.5)
    raise AssertionError("the store does not come back")


def _check(store: str, whole: Mapping[str, list[Any]], *, complete: bool) -> None:
    for _ in range(60):
        with suppress(StoreError), Store.open(store, create=False) as opened:
            wrong = differing(held(opened), whole, complete=complete)
            parked = [job.address for job in Queue(opened).jobs() if job.state is JobState.PARKED]
            assert not wrong, f"half a drive, or one twice: {wrong}"
            assert not parked, f"parked: {parked}"
            return
        time.sleep(0.5)
    raise AssertionError("the store does not come back")


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


# -- speed ---------------------------------------------------------------------------------------------------


class Timed(NamedTuple):
    """An ingest by so many processes: seconds on the wall, and of the processor in all processes.

    ``in_use``: share of the time in which a process had a drive.
    """

    wall_s: float
    processor_s: float
    in_use: float


def timed(store: str, folders: Sequence[str], workers: int) -> Timed:
    """Ingest by so many processes."""
    # Processes whose parent has ended become this one's, not the system's (prctl, PR_SET_CHILD_SUBREAPER).
    ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)
    with Store.open(store) as opened:
        Queue(opened).add(JobKind.INGEST, folders, {})
        before = _processor_s()
        began = time.perf_counter()
        # In a process of its own, whose children count when it has ended.
        subprocess.run([*_HERE, "--work", store, str(workers)], check=True, env=_ENVIRONMENT)
        wall_s = time.perf_counter() - began
        # Its server of forks ends after it, and counts when it is waited for.
        with suppress(ChildProcessError):
            while True:
                os.wait()
        used_s = sum(job.seconds or 0.0 for job in Queue(opened).jobs())
    return Timed(wall_s, _processor_s() - before, used_s / (workers * wall_s))


def _processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def others_busy(seconds: float = 3.0) -> float:
    """How many cores others keep busy, in the mean over some seconds."""

    def busy() -> float:
        fields = [int(n) for n in Path("/proc/stat").read_text().splitlines()[0].split()[1:]]
        return (sum(fields[:3]) + sum(fields[5:8])) / os.sysconf("SC_CLK_TCK")

    before = busy()
    time.sleep(seconds)
    return (busy() - before) / seconds


def speed(work_folder: Path, n: int, minutes: float, address: Callable[[str], str]) -> bool:
    """Print the table of one worker and two; whether the bar is held."""
    folders = drives(work_folder / "speed", n, minutes)
    load = others_busy()
    rows, found = [], {}
    for workers in (1, 2):
        found[workers] = one = timed(address(f"speed{workers}"), folders, workers)
        an_hour = 3600 * n / one.wall_s
        rows.append((workers, one.wall_s, an_hour, one.processor_s / n, f"{one.in_use:.0%}"))
    title = f"{n} drives of {minutes:g} minutes, others keep {load:.1f} cores busy"
    columns = ["workers", "seconds", "drives an hour", "processor, s a drive", "in use"]
    print_table(title, columns, rows)
    wall = found[1].wall_s / found[2].wall_s
    processor = 2 * found[1].processor_s / found[2].processor_s * min(1.0, found[2].in_use / found[1].in_use)
    is_quiet = load < _QUIET
    ratio = wall if is_quiet else processor
    what = "the clock on the wall" if is_quiet else "the processor's time, as others work on the machine"
    verdict = "held" if ratio >= BAR_SPEED else "MISSED"
    print(f"2 workers / 1: {wall:.2f} on the wall, {processor:.2f} by processor; by {what}: {verdict}")
    return ratio >= BAR_SPEED


# -- all of it -----------------------------------------------------------------------------------------------


def kills(
    work_folder: Path,
    n: int,
    address: Callable[[str], str],
    database: Callable[[], None] | None,
) -> bool:
    """Kill so often, in as many rounds as it takes; whether each drive was in once and whole."""
    folders = drives(work_folder / "kills", 12)
    with Store.open(work_folder / "whole.db") as store:
        for folder in folders:
            ingest_drive(store, folder, method=METHOD)
        whole = held(store)
    total, rounds = Counter[str](), 0
    while sum(total.values()) < n:
        name = address(f"kills{rounds}")
        with Store.open(name) as store:
            Queue(store).add(JobKind.INGEST, folders, {"method": METHOD})
        total += kill_at_random(
            name,
            whole,
            kills=n - sum(total.values()),
            seed=rounds,
            dask=bool(rounds % 2),
            database=database,
        )
        rounds += 1
    told = ", ".join(f"{what} {times}" for what, times in sorted(total.items()))
    print(
        f"{sum(total.values())} kills ({told}), {rounds} rounds of {len(folders)} drives: each in once, held"
    )
    return True


def main() -> int:
    """Print what was measured; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=12)
    parser.add_argument("--minutes", type=float, default=1.5)
    parser.add_argument("--kills", type=int, default=BAR_KILLS)
    parser.add_argument("--only", choices=("speed", "kills"))
    parser.add_argument("--postgres", action="store_true", help="stores in a server of its own, killed too")
    parser.add_argument("--work", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        return run_worker(*options.work)
    with tempfile.TemporaryDirectory(prefix="twin-fleet-bench-") as folder, ExitStack() as stack:
        place, database = Path(folder), None
        if options.postgres:
            server = stack.enter_context(running())
            database = server.kill

        def address(name: str) -> str:
            return server.new() if options.postgres else str(place / f"{name}.db")

        is_held = options.only == "kills" or speed(place, options.drives, options.minutes, address)
        is_held &= options.only == "speed" or kills(place, options.kills, address, database)
    return 0 if is_held else 1


if __name__ == "__main__":
    sys.exit(main())
