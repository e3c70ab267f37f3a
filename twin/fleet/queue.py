"""The queue in the store: which drive is whose, so that each is ingested once, by whoever is there.

A worker claims a job for a while (a lease) and renews it as long as it works. A lease that nobody renews has
run out: the worker was killed, its machine or its way to the database is gone, and the job waits again. Each
run of a job has a number; a run that was taken for dead and comes back saves nothing, since its rows and
"done" are one transaction, which the wrong number ends.

The same statements run on SQLite, where one transaction writes at a time, and on PostgreSQL, where ``FOR
UPDATE SKIP LOCKED`` lets workers pass by each other's rows. Why no library does it: docs/decisions/0018.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from twin.errors import TwinError
from twin.store.kinds import Fault, JobKind, JobState
from twin.store.schema import fleet_job as table
from twin.store.store import Row, Store, utc_now

LEASE_S = 60.0
MOST_FAILED = 3
"""A job that failed so often is parked."""
MOST_LOST = 10
"""So is one whose process was killed so often: a machine that restarts is no fault of the drive."""


class LostLeaseError(TwinError):
    """A run that was taken for dead: another one has the job, and nothing of this one is kept."""


@dataclass(frozen=True, slots=True)
class Job:
    """A job that is this worker's, or a row of the list.

    Attributes
    ----------
    job_id : int
    kind : JobKind
    address : str
        Folder or URL of the drive; name of the part; "" of a match.
    options : mapping
        How it is located.
    state : JobState
    n_failed, n_lost : int
        Runs that ended with a reason; runs whose process was killed.
    claim : int
        Number of the run.
    worker : str
        Who runs it, or did so last: host, process, and a draw of its own.
    fault : Fault or None
        Kind of the last failure.
    reason : str
        Its sentence.
    drive_id : str or None
        Known when it was done.
    fingerprint : str
        Of the drive's files when it was last done; "" if it never was.
    added_at, ended_at : str
        UTC; when it was last put in, or let wait again by a person; of the last run.
    seconds : float or None
        That the last run took.
    """

    job_id: int
    kind: JobKind
    address: str
    options: Mapping[str, Any]
    state: JobState
    n_failed: int
    n_lost: int
    claim: int
    worker: str
    fault: Fault | None
    reason: str
    drive_id: str | None
    fingerprint: str
    added_at: str
    ended_at: str | None
    seconds: float | None

    @classmethod
    def from_row(cls, row: Row) -> Job:
        """Take it from a row of the table ``fleet_job``."""
        plain = {name: row[name] for name in cls.__slots__}
        fault = None if row["fault"] is None else Fault(row["fault"])
        return cls(**plain | {"kind": JobKind(row["kind"]), "state": JobState(row["state"]), "fault": fault})


@dataclass(frozen=True, slots=True)
class Added:
    """What became of jobs that were to be added.

    Attributes
    ----------
    n_new, n_again, n_there : int
        New in the queue; done once and looked at again; waiting, running or parked already.
    """

    n_new: int = 0
    n_again: int = 0
    n_there: int = 0


class Queue:
    """A store's queue, as one worker sees it.

    Parameters
    ----------
    store : Store
    worker : str
        Its name, which no other one has.
    lease_s : float
        How long a job is a worker's without word of it.
    """

    def __init__(self, store: Store, worker: str = "", *, lease_s: float = LEASE_S) -> None:
        self._store, self._worker, self._lease_s = store, worker, lease_s

    def add(self, kind: JobKind, addresses: Iterable[str], options: Mapping[str, Any]) -> Added:
        """Add jobs; those that are done wait again (a drive that has not changed is then done at once).

        Parameters
        ----------
        kind : JobKind
        addresses : iterable of str
        options : mapping
            JSON. With other options it is another job.
        """
        rows = {_digest(kind, address, options): address for address in addresses}
        n_new = n_again = 0
        with self._store.transaction() as connection:
            for digest, address in rows.items():
                mine = table.c.digest == digest
                found = connection.execute(sa.select(table.c.state).where(mine).with_for_update()).scalar()
                if found is None:
                    first = {**_FRESH, "kind": kind, "address": address, "options": dict(options)}
                    times = {"digest": digest, "added_at": utc_now()}
                    connection.execute(sa.insert(table), [{**first, **times}])
                    n_new += 1
                elif found == JobState.DONE or (kind is JobKind.MATCH and found == JobState.PARKED):
                    waits = {"state": JobState.WAITING, "n_failed": 0, "n_lost": 0, "added_at": utc_now()}
                    connection.execute(sa.update(table).where(mine).values(**waits))
                    n_again += 1
        return Added(n_new, n_again, len(rows) - n_new - n_again)

    def claim(self) -> Job | None:
        """Take the next job that waits; None where there is none for now.

        Those that never failed come first; parts of a match when no drive waits or runs, then the match.
        """
        with self._store.transaction() as connection:
            now = _now(connection)
            self._take_back(connection, now)
            # A match and its parts are of what all drives left; the match puts its parts together.
            waits = (table.c.state == JobState.WAITING) & (
                (table.c.kind == JobKind.INGEST)
                | ((table.c.kind == JobKind.PART) & ~_is_open(JobKind.INGEST))
                | ~_is_open(JobKind.INGEST, JobKind.PART)
            )
            order = (table.c.n_failed + table.c.n_lost, table.c.job_id)
            asked = sa.select(table).where(waits).order_by(*order).limit(1).with_for_update(skip_locked=True)
            row = connection.execute(asked).mappings().first()
            if row is None:
                return None
            mine = {
                "state": JobState.RUNNING,
                "claim": row["claim"] + 1,
                "worker": self._worker,
                "leased_until": now + self._lease_s,
            }
            connection.execute(sa.update(table).where(table.c.job_id == row["job_id"]).values(**mine))
        return Job.from_row({**row, **mine})

    def _take_back(self, connection: sa.Connection, now: float) -> None:
        """Let jobs wait whose lease has run out."""
        over = (table.c.state == JobState.RUNNING) & (table.c.leased_until < now)
        asked = sa.select(table.c.job_id, table.c.n_lost).where(over).with_for_update(skip_locked=True)
        for job_id, n_lost in connection.execute(asked).all():
            lost = _after_loss(n_lost + 1)
            connection.execute(sa.update(table).where(table.c.job_id == job_id).values(**lost))

    def renew(self, jobs: Collection[Job]) -> None:
        """Say that these are still being worked on."""
        with self._store.transaction() as connection:
            until = _now(connection) + self._lease_s
            for job in jobs:
                connection.execute(sa.update(table).where(_is_run(job)).values(leased_until=until))

    def finish(
        self, connection: sa.Connection, job: Job, drive_id: str | None, fingerprint: str, seconds: float
    ) -> None:
        """Mark a job as done inside the caller's transaction, which keeps its rows.

        A drive lets the match wait again, where one was ever asked for.

        Raises
        ------
        LostLeaseError
            Another run has the job, or has done it.
        """
        done = {
            "state": JobState.DONE,
            "leased_until": None,
            "fault": None,
            "reason": "",
            "n_failed": 0,
            "n_lost": 0,
            "drive_id": drive_id,
            "fingerprint": fingerprint,
            "ended_at": utc_now(),
            "seconds": seconds,
        }
        if connection.execute(sa.update(table).where(_is_run(job)).values(**done)).rowcount == 1:
            if job.kind is JobKind.INGEST and not job.options.get("no_match"):
                rearmed = (table.c.kind == JobKind.MATCH) & (table.c.state == JobState.DONE)
                connection.execute(sa.update(table).where(rearmed).values(state=JobState.WAITING))
            if job.kind is JobKind.MATCH:  # its parts are of no use to another one
                parts = (table.c.kind == JobKind.PART) & (table.c.state != JobState.RUNNING)
                connection.execute(sa.delete(table).where(parts))
            return
        asked = sa.select(table.c.claim, table.c.state).where(table.c.job_id == job.job_id)
        # A commit of which the database's answer was lost is no other run's.
        if connection.execute(asked).first() != (job.claim, JobState.DONE):
            raise LostLeaseError(
                f"{job.address or job.kind}: another worker has taken this over; nothing of this run is kept."
            )

    def fail(self, job: Job, fault: Fault, reason: str, seconds: float) -> JobState:
        """Note why a run failed, and park the job if it was the third time; a lost one counts apart."""
        if fault is Fault.LOST:
            values = _after_loss(job.n_lost + 1, reason)
        else:
            n_failed = job.n_failed + 1
            state = JobState.PARKED if n_failed >= MOST_FAILED else JobState.WAITING
            values = {"state": state, "n_failed": n_failed, "fault": fault, "reason": reason}
        values |= {"leased_until": None, "ended_at": utc_now(), "seconds": seconds}
        with self._store.transaction() as connection:
            connection.execute(sa.update(table).where(_is_run(job)).values(**values))
        return JobState(values["state"])

    def put_back(self, job: Job) -> None:
        """Let a job wait again that has to come after others."""
        waits = {"state": JobState.WAITING, "leased_until": None}
        with self._store.transaction() as connection:
            connection.execute(sa.update(table).where(_is_run(job)).values(**waits))

    def give_back(self) -> None:
        """Let wait again what this worker has begun, known to it or not: it was interrupted."""
        mine = (table.c.worker == self._worker) & (table.c.state == JobState.RUNNING)
        waits = {"state": JobState.WAITING, "leased_until": None}
        with self._store.transaction() as connection:
            connection.execute(sa.update(table).where(mine).values(**waits))

    def retry(self, faults: Collection[Fault] = (), addresses: Collection[str] = ()) -> int:
        """Let parked jobs wait again: all, or of these kinds, or at these addresses; return how many."""
        which = table.c.state == JobState.PARKED
        if faults:
            which &= table.c.fault.in_(list(faults))
        if addresses:
            which &= table.c.address.in_(list(addresses))
        waits = {"state": JobState.WAITING, "n_failed": 0, "n_lost": 0, "added_at": utc_now()}
        with self._store.transaction() as connection:
            return connection.execute(sa.update(table).where(which).values(**waits)).rowcount

    def jobs(self) -> list[Job]:
        """Return all jobs, in the order in which they were added."""
        return [Job.from_row(row) for row in self._store.rows(sa.select(table).order_by(table.c.job_id))]

    def n_open(self) -> int:
        """Return how many wait or run, anywhere."""
        opened = table.c.state.in_([JobState.WAITING, JobState.RUNNING])
        return int(self._store.rows(sa.select(sa.func.count().label("n")).where(opened))[0]["n"])


_FRESH: Mapping[str, Any] = {
    "state": JobState.WAITING,
    "n_failed": 0,
    "n_lost": 0,
    "claim": 0,
    "worker": "",
    "reason": "",
    "fingerprint": "",
}


def _after_loss(n_lost: int, reason: str = "") -> dict[str, Any]:
    """What a job is after its process was killed so many times."""
    return {
        "state": JobState.PARKED if n_lost >= MOST_LOST else JobState.WAITING,
        "n_lost": n_lost,
        "fault": Fault.LOST,
        "reason": reason or "The worker that ran it was killed, or lost its way to the database.",
        "leased_until": None,
    }


def _is_open(*kinds: JobKind) -> sa.ColumnElement[bool]:
    """Whether a job of some kind waits or runs."""
    other = table.alias()
    opened = other.c.state.in_([JobState.WAITING, JobState.RUNNING])
    return sa.exists(sa.select(other.c.job_id).where(other.c.kind.in_(kinds), opened))


def _is_run(job: Job) -> sa.ColumnElement[bool]:
    """Whether a row is this very run of a job."""
    return (table.c.job_id == job.job_id) & (table.c.claim == job.claim) & (table.c.state == JobState.RUNNING)


def _digest(kind: JobKind, address: str, options: Mapping[str, Any]) -> str:
    text = json.dumps([kind, address, dict(options)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _now(connection: sa.Connection) -> float:
    """Seconds since 1970 by the clock that all workers share: the database's."""
    if connection.dialect.name == "sqlite":  # its workers are on one machine
        return time.time()
    return float(connection.execute(sa.select(sa.extract("epoch", sa.func.clock_timestamp()))).scalar_one())
