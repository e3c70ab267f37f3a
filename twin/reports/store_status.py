"""What the store holds, in numbers."""

from __future__ import annotations

import datetime as dt
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import sqlalchemy as sa

from twin.decisions.findings import Brief, Selection, select_briefly
from twin.decisions.opinions import Agreement, agreement, opinions_of
from twin.reports.fleet_status import (
    DayOfDrives,
    OldestOpen,
    QueueStatus,
    days_of_drives,
    moment,
    oldest_open,
    queue_status,
)
from twin.store import schema
from twin.store.kinds import Decision
from twin.store.store import Row, Snapshot, Store

_FACTS = ("mirror", "mirror_backfill", "vegnett", "last_match")


@dataclass(frozen=True, slots=True, kw_only=True)
class MirrorStatus:
    """The mirror of NVDB's signs: of what, as of when, and how far it has come in the change feed.

    ``unread``: type → ids of objects that came in a form that cannot be read; ``since``: from when on this
    area's states were observed. Both None in a store from before they were kept.
    """

    source: str
    area: str
    position: str
    unread: Mapping[str, Sequence[int]] | None = None
    since: str | None = None
    synced_at: str
    age_hours: float


@dataclass(frozen=True, slots=True, kw_only=True)
class UnfinishedBackfill:
    """A backfill that was interrupted; ``kept``: objects that it has, by type."""

    source: str
    area: str
    position: str
    cursors: Mapping[str, str]
    unread: Mapping[str, Sequence[int]] | None = None
    kept: Mapping[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkStatus:
    """The road network; ``rejected``: why links could not be used, one sentence each."""

    area: str
    url: str | None = None
    fetched_at: str
    count: int
    n_rejected: int | None = None
    rejected: Sequence[str] | None = None


@dataclass(frozen=True, slots=True)
class DriveStatus:
    """One ingested drive."""

    drive_id: str
    name: str
    length_m: float
    n_annotations: int
    started: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LastMatch:
    """When the last match was, with what settings, and of which revision of the store."""

    method: str
    at: str
    settings: Mapping[str, Any] | None = None
    config_sha256: str | None = None
    revision: int


@dataclass(frozen=True, slots=True)
class Status:
    """What a store holds; None for what it does not.

    Attributes
    ----------
    store : str
        Its path.
    skiltpunkt, skiltplate : int
        Objects in the mirror.
    drives : tuple of DriveStatus
        In order of time.
    estimates, verdicts, decisions : dict
        Method → estimates; verdict → findings; decision → findings that ask for one, each decision named.
    opinions : dict
        Verdict → how often people agree who reviewed blindly; only verdicts with second opinions.
    days : tuple of DayOfDrives
        The last seven on which drives were read, the latest first.
    queue : QueueStatus
    oldest_open : OldestOpen or None
    """

    store: str
    mirror: MirrorStatus | None
    unfinished: UnfinishedBackfill | None
    vegnett: NetworkStatus | None
    skiltpunkt: int
    skiltplate: int
    drives: tuple[DriveStatus, ...]
    estimates: dict[str, int]
    verdicts: dict[str, int]
    decisions: dict[str, int]
    opinions: dict[str, Agreement]
    last_match: LastMatch | None
    days: tuple[DayOfDrives, ...]
    queue: QueueStatus
    oldest_open: OldestOpen | None

    def as_json(self) -> dict[str, Any]:
        """Return it in types that JSON has; what the store does not keep of a fact is left out."""
        document = asdict(self)
        for name in ("mirror", "unfinished", "vegnett", "last_match"):
            if document[name] is not None:
                document[name] = {key: value for key, value in document[name].items() if value is not None}
        return document


def status(store: Store) -> Status:
    """Summarise mirror, drives, estimates and findings: one state, also while a sync is at work."""
    with store.snapshot() as view:
        facts = _facts(view)
        findings = select_briefly(view.rows, Selection(decisions=()))
        return Status(
            store=store.name,
            mirror=_mirror(facts.get("mirror")),
            unfinished=_unfinished(view, facts.get("mirror_backfill")),
            vegnett=_vegnett(facts.get("vegnett")),
            skiltpunkt=_count(view, schema.skiltpunkt),
            skiltplate=_count(view, schema.skiltplate),
            drives=_drives(view),
            estimates=_counts_by(view, schema.estimate.c.method),
            verdicts=_counts_by(view, schema.change.c.verdict),
            decisions=_decisions(findings),
            opinions=agreement(opinions_of(view.rows)),
            last_match=_last_match(facts.get("last_match")),
            days=days_of_drives(view),
            queue=queue_status(view),
            oldest_open=oldest_open(view, findings),
        )


def _facts(view: Snapshot) -> dict[str, Any]:
    kept = schema.meta.c
    rows = view.rows(sa.select(kept.key, kept.value).where(kept.key.in_(_FACTS)))
    return {row["key"]: json.loads(row["value"]) for row in rows}


def _count(view: Snapshot, table: sa.Table) -> int:
    return int(view.rows(sa.select(sa.func.count().label("n")).select_from(table))[0]["n"])


def _counts_by(view: Snapshot, column: sa.Column[Any]) -> dict[str, int]:
    rows = view.rows(sa.select(column, sa.func.count().label("n")).group_by(column).order_by(column))
    return {row[column.name]: row["n"] for row in rows}


def _drives(view: Snapshot) -> tuple[DriveStatus, ...]:
    drive = schema.drive.c
    columns = (drive.drive_id, drive.name, drive.length_m, drive.n_annotations)
    rows = view.rows(sa.select(*columns, drive.started_ns).order_by(drive.started_ns))
    return tuple(
        DriveStatus(
            **{column.name: row[column.name] for column in columns}, started=moment(row["started_ns"])
        )
        for row in rows
    )


def _decisions(findings: Iterable[Brief]) -> dict[str, int]:
    counted = Counter(one.decision for one in findings)
    return {decision.value: counted[decision] for decision in Decision}


def _of(kind: type, fact: Row) -> dict[str, Any]:
    """What a fact has of a record's fields."""
    return {field.name: fact[field.name] for field in fields(kind) if field.name in fact}


def _mirror(fact: Row | None) -> MirrorStatus | None:
    if fact is None:
        return None
    age = dt.datetime.now(dt.UTC) - dt.datetime.fromisoformat(fact["synced_at"])
    return MirrorStatus(**_of(MirrorStatus, fact), age_hours=round(age.total_seconds() / 3600, 2))


def _unfinished(view: Snapshot, fact: Row | None) -> UnfinishedBackfill | None:
    if fact is None:
        return None
    kept = {t.visible.name.capitalize(): _count(view, t.aside) for t in schema.MIRROR.values()}
    return UnfinishedBackfill(**_of(UnfinishedBackfill, fact), kept=kept)


def _vegnett(fact: Row | None) -> NetworkStatus | None:
    return None if fact is None else NetworkStatus(**_of(NetworkStatus, fact))


def _last_match(fact: Row | None) -> LastMatch | None:
    return None if fact is None else LastMatch(**_of(LastMatch, fact))
