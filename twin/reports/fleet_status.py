"""What who runs a fleet asks every morning: which drives came in, what waits, what nobody has looked at."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import sqlalchemy as sa

from twin.decisions.findings import Brief
from twin.store import schema
from twin.store.kinds import QUIET, Decision, Fault, JobKind, JobState
from twin.store.store import Snapshot

_MOST_DAYS = 7


@dataclass(frozen=True, slots=True)
class DayOfDrives:
    """The drives that were read on one day.

    Attributes
    ----------
    day : str
        UTC; a drive that was read again counts on the last one.
    n : int
    length_m : float
        Driven, metres.
    """

    day: str
    n: int
    length_m: float


@dataclass(frozen=True, slots=True)
class QueueStatus:
    """How far a fleet's queue is; drives alone, not the match after them.

    Attributes
    ----------
    jobs : mapping of str to int
        State → drives, each state named.
    failing : int
        Of those that wait or run: they failed, or their process was killed, and they are tried again.
    parked : mapping of str to int
        Kind of the failure → drives that wait for a person; kinds that there are.
    oldest : str or None
        When the one was put in that waits or runs the longest, UTC.
    """

    jobs: Mapping[str, int]
    failing: int
    parked: Mapping[str, int]
    oldest: str | None


@dataclass(frozen=True, slots=True)
class OldestOpen:
    """The finding that nobody has decided though what speaks for it is the oldest.

    Attributes
    ----------
    change_id, verdict : str
    since : str
        When the first of the drives began that it rests on, UTC.
    """

    change_id: str
    verdict: str
    since: str


def days_of_drives(view: Snapshot) -> tuple[DayOfDrives, ...]:
    """Return the last seven days on which drives were read, the latest first."""
    of, drive = schema.annotation_set.c, schema.drive.c
    day = sa.func.substr(of.read_at, 1, 10).label("day")
    asked = (
        sa.select(day, sa.func.count().label("n"), sa.func.sum(drive.length_m).label("length_m"))
        .join_from(schema.annotation_set, schema.drive, of.drive_id == drive.drive_id)
        .where(of.is_current, of.read_at.is_not(None))
        .group_by(day)
        .order_by(day.desc())
        .limit(_MOST_DAYS)
    )
    return tuple(DayOfDrives(**row) for row in view.rows(asked))


def queue_status(view: Snapshot) -> QueueStatus:
    """Count a fleet's queue."""
    job = schema.fleet_job.c
    asked = (
        sa.select(
            job.state,
            job.fault,
            sa.func.count().label("n"),
            sa.func.count().filter(job.n_failed + job.n_lost > 0).label("n_failing"),
            sa.func.min(job.added_at).label("oldest"),
        )
        .where(job.kind == JobKind.INGEST)
        .group_by(job.state, job.fault)
    )
    rows = view.rows(asked)
    going = [row for row in rows if row["state"] in {JobState.WAITING, JobState.RUNNING}]
    parked = [row for row in rows if row["state"] == JobState.PARKED]
    return QueueStatus(
        jobs={state.value: sum(row["n"] for row in rows if row["state"] == state) for state in JobState},
        failing=sum(row["n_failing"] for row in going),
        parked={Fault(row["fault"]).value: row["n"] for row in parked},
        oldest=min((row["oldest"] for row in going), default=None),
    )


def oldest_open(view: Snapshot, findings: Iterable[Brief]) -> OldestOpen | None:
    """Return the oldest finding that nobody has decided; None where there is none."""
    drive = schema.drive.c
    began = {
        row["drive_id"]: row["started_ns"] for row in view.rows(sa.select(drive.drive_id, drive.started_ns))
    }
    found = [
        (min(ages), one.change_id, one)
        for one in findings
        if one.decision == Decision.OPEN and one.verdict not in QUIET
        if (ages := [began[drive_id] for drive_id in one.drive_ids if drive_id in began])
    ]
    if not found:
        return None
    started_ns, _, one = min(found, key=lambda each: each[:2])
    return OldestOpen(one.change_id, one.verdict.value, moment(started_ns))


def moment(epoch_ns: int) -> str:
    """Return an epoch as ISO 8601 UTC to the second."""
    return dt.datetime.fromtimestamp(epoch_ns // 10**9, tz=dt.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
