"""The queue: each job is one worker's at a time, and comes back where that worker is gone."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from twin.fleet.queue import MOST_FAILED, MOST_LOST, Added, Job, LostLeaseError, Queue
from twin.store.kinds import Fault, JobKind, JobState
from twin.store.store import Store

INGEST, MATCH = JobKind.INGEST, JobKind.MATCH


def finish(queue: Queue, store: Store, job: Job) -> None:
    """End a run as a worker does."""
    with store.transaction() as connection:
        queue.finish(connection, job, "d", "f", 1.0)


def states(queue: Queue) -> dict[str, JobState]:
    """Return how far each job is."""
    return {job.address or "match": job.state for job in queue.jobs()}


@pytest.mark.parametrize("seed", range(2))
def test_any_history_of_workers_does_each_job_once(either: Store, address: str, seed: int) -> None:
    """Workers that claim, finish, die and come back too late: every job is done by exactly one run."""
    draw = random.Random(seed)
    done: Counter[int] = Counter()
    with Store.open(address) as other:
        # A lease that is over at once: whoever asks next takes what another one has.
        workers = [(Queue(one, name, lease_s=-1.0), one) for one, name in ((either, "a"), (other, "b"))]
        workers[0][0].add(INGEST, [str(k) for k in range(12)], {})
        held: list[Job] = []
        for _ in range(200):
            queue, store = draw.choice(workers)
            if held and draw.random() < 0.4:
                job = held.pop(draw.randrange(len(held)))
                try:
                    finish(queue, store, job)
                    done[job.job_id] += 1
                except LostLeaseError:
                    pass
            elif (job_claimed := queue.claim()) is not None:
                held.append(job_claimed)
        left = Queue(either, lease_s=60.0)
        while (job_left := left.claim()) is not None:
            finish(left, either, job_left)
            done[job_left.job_id] += 1
    parked = [job for job in left.jobs() if job.state is JobState.PARKED]
    assert {job.n_lost for job in parked} <= {MOST_LOST}
    assert set(done.values()) == {1}
    assert len(done) + len(parked) == 12


def test_job_is_parked_at_its_third_failure_with_its_kind(either: Store) -> None:
    """Others go first; a person lets it wait again, by kind."""
    queue = Queue(either, "a")
    assert queue.add(INGEST, ["bad", "good"], {}) == Added(n_new=2)
    runs = []
    while (job := queue.claim()) is not None:
        runs.append(job.address)
        if job.address == "good":
            finish(queue, either, job)
        else:
            queue.fail(job, Fault.LACKING, "a file is lacking", 1.0)
    assert runs == ["bad", "good", *["bad"] * (MOST_FAILED - 1)]
    (bad, _) = queue.jobs()
    assert (bad.state, bad.fault, bad.reason) == (JobState.PARKED, Fault.LACKING, "a file is lacking")
    assert queue.retry([Fault.STORAGE]) == 0
    assert queue.retry([Fault.LACKING]) == 1
    assert states(queue)["bad"] is JobState.WAITING


def test_lost_runs_are_no_failures_of_a_drive(either: Store) -> None:
    """A killed process does not park a drive until it has been killed many times."""
    queue = Queue(either, "a")
    queue.add(INGEST, ["drive"], {})
    for _ in range(MOST_LOST):
        job = queue.claim()
        assert job is not None
        queue.fail(job, Fault.LOST, "killed", 1.0)
    assert queue.claim() is None
    assert states(queue) == {"drive": JobState.PARKED}


def test_lease_that_is_renewed_stays(either: Store) -> None:
    """A renewed job is nobody else's; one that was given back is no lost one."""
    queue = Queue(either, "a", lease_s=-1.0)
    queue.add(INGEST, ["drive"], {})
    job = queue.claim()
    assert job is not None
    Queue(either, "a", lease_s=60.0).renew([job])
    assert queue.claim() is None
    queue.give_back()
    again = queue.claim()
    assert again is not None
    assert (again.n_lost, again.claim) == (0, 2)


def test_match_waits_for_all_drives_and_again_for_new_ones(either: Store) -> None:
    """It is claimed when no drive waits or runs, and every drive that is saved later lets it wait again."""
    queue = Queue(either, "a")
    queue.add(INGEST, ["1"], {})
    queue.add(MATCH, [""], {})
    first = queue.claim()
    assert first is not None
    assert queue.claim() is None
    finish(queue, either, first)
    match = queue.claim()
    assert match is not None
    assert match.kind is MATCH
    finish(queue, either, match)
    assert queue.claim() is None
    queue.add(INGEST, ["2"], {})
    second = queue.claim()
    assert second is not None
    finish(queue, either, second)
    assert states(queue) == {"1": JobState.DONE, "match": JobState.WAITING, "2": JobState.DONE}


def test_done_drive_is_looked_at_again_when_it_is_added_again(either: Store) -> None:
    """It knows by what its files were known; a drive that waits is in the queue once."""
    queue = Queue(either, "a")
    assert [queue.add(INGEST, ["1"], {}) for _ in range(2)] == [Added(n_new=1), Added(n_there=1)]
    job = queue.claim()
    assert job is not None
    finish(queue, either, job)
    assert queue.add(INGEST, ["1"], {}) == Added(n_again=1)
    assert queue.add(INGEST, ["1"], {"method": "paper"}) == Added(n_new=1)
    again = queue.claim()
    assert again is not None
    assert (again.fingerprint, again.drive_id) == ("f", "d")
