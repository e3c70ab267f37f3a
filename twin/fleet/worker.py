"""A worker: takes jobs from the store's queue, has drives located elsewhere, and saves what comes of them."""

from __future__ import annotations

import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import sqlalchemy as sa
from tenacity import Retrying, retry_if_exception_type, stop_after_delay, wait_exponential

from twin.errors import RefusedError, StoreError
from twin.fleet.executors import Executor
from twin.fleet.locating import Failed, Located, Unchanged, failure, locate_at
from twin.fleet.matching import part_at
from twin.fleet.queue import LEASE_S, Job, LostLeaseError, Queue
from twin.ingest import save_drive
from twin.matching.match_store import match
from twin.matching.tiles import Worked, parts_to_do, stage
from twin.store.kinds import Fault, JobKind, JobState
from twin.store.store import Store

T = TypeVar("T")
Outcome = Located | Unchanged | Failed | Worked
_POLL_S = 1.0
TAKEN_APART = 100
"""A match of everything is taken apart if it has at least so many drives."""
PATIENCE_S = 300.0
"""For so long a database may be away, restarting or full of writers, before a worker gives up."""


@dataclass(slots=True)
class Tally:
    """What a worker did.

    Attributes
    ----------
    n_ingested, n_unchanged : int
        Drives that were saved, and those of which no file had changed.
    n_again : int
        Runs that failed or were lost, of jobs that are to run again.
    parked : list of str
        Addresses of drives that failed for the last time.
    is_matched : bool
    """

    n_ingested: int = 0
    n_unchanged: int = 0
    n_again: int = 0
    parked: list[str] = field(default_factory=list)
    is_matched: bool = False


def work(
    store: Store,
    executor: Executor,
    *,
    stay: bool = False,
    progress: Callable[[str], None] | None = None,
    lease_s: float = LEASE_S,
    patience_s: float = PATIENCE_S,
) -> Tally:
    """Work until the queue is empty, or for ever.

    Any number of workers on any machines may do so at once. Drives are located by the executor; this process
    alone writes to the store for them, each drive and its "done" in one transaction.

    Parameters
    ----------
    store : Store
    executor : Executor
    stay : bool
        Whether to wait for more when the queue is empty. Without it, also what other workers run is waited
        for: it may come back.
    progress : callable, optional
        Called with a sentence when a job ends.
    lease_s, patience_s : float
        How long a job is this worker's without word of it; how long the store may be away.

    Raises
    ------
    StoreError
        The store cannot be used for that long; what was done is kept, and the rest waits.
    StorageError
        The executor's engine is gone; likewise.
    """
    if store.read_only is not None:
        raise store.read_only
    return _Worker(store, executor, progress or (lambda _text: None), lease_s, patience_s).run(stay=stay)


class _Worker:
    def __init__(
        self,
        store: Store,
        executor: Executor,
        say: Callable[[str], None],
        lease_s: float,
        patience_s: float,
    ) -> None:
        name = f"{socket.gethostname()}:{os.getpid()}:{uuid.uuid4().hex[:6]}"
        self._store, self._executor, self._say = store, executor, say
        self._queue = Queue(store, name, lease_s=lease_s)
        self._lease_s, self._patience_s = lease_s, patience_s
        self._running: dict[Future[Outcome], tuple[Job, float]] = {}
        self._mine: dict[int, Job] = {}
        self.tally = Tally()

    def run(self, *, stay: bool) -> Tally:
        try:
            with self._renewing():
                while self._fill() or stay or self._patiently(self._queue.n_open):
                    if not self._running:
                        time.sleep(_POLL_S)
                        continue
                    done, _ = wait(self._running, timeout=_POLL_S, return_when=FIRST_COMPLETED)
                    for future in done:
                        self._settle(future)
        finally:
            self._executor.close()
            with suppress(StoreError):
                self._queue.give_back()
        return self.tally

    def _fill(self) -> bool:
        """Hand out what there is room for; whether anything is under way."""
        while len(self._running) < self._executor.slots:
            job = self._patiently(self._queue.claim)
            if job is None:
                break
            self._mine[job.job_id] = job
            if job.kind is JobKind.MATCH:
                self._match(job)
                continue
            self._running[self._begun(job)] = (job, time.monotonic())
        return bool(self._running)

    def _begun(self, job: Job) -> Future[Outcome]:
        """Have a job done elsewhere; what needs the store and cannot be done there is done here."""
        if job.kind is JobKind.INGEST:
            return self._executor.submit(locate_at, job.address, job.options, job.fingerprint)
        asked = self._store.address, job.options["method"], job.options["plan"], job.address
        if self._executor.reaches_store:
            return self._executor.submit(part_at, *asked)
        done: Future[Outcome] = Future()
        done.set_result(part_at(*asked))
        return done

    def _settle(self, future: Future[Outcome]) -> None:
        """Keep what came of a job."""
        job, began = self._running.pop(future)
        try:
            outcome = future.result()
        except (Exception, CancelledError) as error:  # the function itself tells of failures
            _ = self._executor.slots  # where the engine is gone, no drive is to blame
            outcome = Failed(Fault.LOST, str(error) or type(error).__name__)
        seconds = time.monotonic() - began
        try:
            if isinstance(outcome, Located):
                self._save(job, outcome, seconds)
            elif isinstance(outcome, Unchanged):
                self._done(job, job.drive_id, job.fingerprint, seconds)
                self.tally.n_unchanged += 1
            elif isinstance(outcome, Failed):
                self._failed(job, outcome, seconds)
            else:
                self._stage(job, outcome, seconds)
        except LostLeaseError as error:
            self._say(str(error))
        except (RefusedError, StoreError) as error:
            self._failed(job, failure(error), seconds)
        del self._mine[job.job_id]

    def _save(self, job: Job, located: Located, seconds: float) -> None:
        """Save a drive and mark its job as done, in one transaction."""
        drive, is_replacing = located.drive.drive, bool(job.options.get("replace"))

        def also(connection: sa.Connection) -> None:
            self._queue.finish(connection, job, drive.drive_id, located.fingerprint, seconds)

        self._patiently(partial(save_drive, self._store, located.drive, replace=is_replacing, also=also))
        self.tally.n_ingested += 1
        n = len(located.drive.estimates)
        self._say(f"{job.address}: drive {drive.name} ({drive.drive_id}), {n:,} objects, {seconds:.1f} s.")

    def _stage(self, job: Job, worked: Worked, seconds: float) -> None:
        """Keep a part of a match for it and mark its job as done, in one transaction."""

        def keep() -> None:
            with self._store.transaction() as connection:
                stage(connection, job.options["plan"], worked)
                self._queue.finish(connection, job, None, "", seconds)

        self._patiently(keep)
        self._say(f"match, {job.address}: {seconds:.1f} s.")

    def _done(self, job: Job, drive_id: str | None, fingerprint: str, seconds: float) -> None:
        """Mark a job as done that has nothing to save."""

        def finish() -> None:
            with self._store.transaction() as connection:
                self._queue.finish(connection, job, drive_id, fingerprint, seconds)

        self._patiently(finish)

    def _failed(self, job: Job, failed: Failed, seconds: float) -> None:
        state = self._patiently(partial(self._queue.fail, job, failed.fault, failed.reason, seconds))
        then = "it is parked (twin fleet status)" if state is JobState.PARKED else "it runs again"
        self._say(f"{job.address or 'match'}: {failed.reason} ({failed.fault}); {then}.")
        if state is JobState.PARKED and job.kind is not JobKind.PART:  # the match does without
            self.tally.parked.append(job.address)
        else:
            self.tally.n_again += 1

    def _match(self, job: Job) -> None:
        """Match what drives have changed."""
        began = time.monotonic()
        try:
            # A drive that was saved while the match ran is in the next one.
            while not self._is_matched():
                if self._takes_apart(job):
                    del self._mine[job.job_id]
                    return
                self._say("matching")
                match(self._store)
                self.tally.is_matched = True
            self._done(job, None, "", time.monotonic() - began)
        except LostLeaseError as error:
            self._say(str(error))
        except Exception as error:
            self._failed(job, failure(error), time.monotonic() - began)
        del self._mine[job.job_id]

    def _takes_apart(self, job: Job) -> bool:
        """Put the parts of a large match into the queue, and it behind them; whether there are any."""
        parts = parts_to_do(self._store, least=TAKEN_APART)
        if parts is None:
            return False
        options = {"method": parts.method, "plan": parts.plan}
        added = self._queue.add(JobKind.PART, parts.names, options)
        if not added.n_new + added.n_again:  # they are parked
            return False
        self._say(f"matching in parts: {added.n_new + added.n_again:,} for any worker")
        self._queue.put_back(job)
        return True

    def _is_matched(self) -> bool:
        """Whether the last match is of what the store holds."""
        last = self._store.fact("last_match")
        return last is not None and bool(last["revision"] == self._store.revision())

    def _patiently(self, step: Callable[[], T]) -> T:
        """Do something with the store; while it is away, or others write to it, try again."""
        for attempt in Retrying(
            retry=retry_if_exception_type(StoreError),
            stop=stop_after_delay(self._patience_s),
            wait=wait_exponential(multiplier=0.2, max=10.0),
            before_sleep=lambda state: self._say(f"{state.outcome.exception() if state.outcome else ''}"),
            reraise=True,
        ):
            with attempt:
                return step()
        raise AssertionError  # Retrying raises what the last attempt did

    @contextmanager
    def _renewing(self) -> Iterator[None]:
        """Renew the leases of what is under way, also while this thread saves or matches."""
        ended = threading.Event()

        def renew() -> None:
            while not ended.wait(self._lease_s / 4):
                # What is away may be back in time for the next one; else the job is another's.
                with suppress(StoreError):
                    self._queue.renew(list(self._mine.values()))

        thread = threading.Thread(target=renew, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
