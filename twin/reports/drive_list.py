"""The store's drives as people ask for them: when, how long, what of them was located, what is to decide."""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from twin.decisions.findings import Selection, select_briefly
from twin.store import schema
from twin.store.kinds import Decision
from twin.store.store import Snapshot, Store
from twin.words import sentence
from twin.words.reasons import DriveDoesNotFit, misfit_from_json


@dataclass(frozen=True, slots=True)
class DriveItem:
    """One drive of a store.

    Attributes
    ----------
    started, ended : datetime
        UTC.
    length_m : float
        Driven, metres.
    n_objects : mapping of method → int
        Objects that were located.
    n_findings, n_open : int
        Of the last match, that ask for a decision; of these, still to decide.
    is_matched : bool
        Whether the last match knew the drive.
    doubt : str
        Why its findings are for review alone, or why it cannot show that a sign is missing; "" for a drive
        that can be trusted.
    """

    drive_id: str
    name: str
    started: dt.datetime
    ended: dt.datetime
    length_m: float
    n_annotations: int
    is_complete: bool
    n_objects: Mapping[str, int]
    n_findings: int
    n_open: int
    is_matched: bool
    doubt: str


def list_drives(store: Store) -> list[DriveItem]:
    """Return the store's drives in order of time."""
    with store.snapshot() as view:
        drive = schema.drive.c
        columns = (drive.drive_id, drive.name, drive.started_ns, drive.ended_ns, drive.length_m)
        rows = view.rows(
            sa.select(*columns, drive.n_annotations, drive.annotations_complete).order_by(
                drive.started_ns, drive.drive_id
            )
        )
        objects = _objects(view)
        doubts = _doubts(view)
        matched = (view.fact("last_match") or {}).get("settings", {}).get("drives", {})
        findings, still_open = Counter[str](), Counter[str]()
        for one in select_briefly(view.rows, Selection(decisions=())):
            findings.update(one.drive_ids)
            if one.decision is Decision.OPEN:
                still_open.update(one.drive_ids)
    return [
        DriveItem(
            drive_id=row["drive_id"],
            name=row["name"],
            started=_moment(row["started_ns"]),
            ended=_moment(row["ended_ns"]),
            length_m=row["length_m"],
            n_annotations=row["n_annotations"],
            is_complete=row["annotations_complete"],
            n_objects=objects.get(row["drive_id"], {}),
            n_findings=findings[row["drive_id"]],
            n_open=still_open[row["drive_id"]],
            is_matched=row["drive_id"] in matched,
            doubt=doubts.get(row["drive_id"], ""),
        )
        for row in rows
    ]


def drive_names(view: Snapshot) -> dict[str, str]:
    """Return the name of each drive by its id."""
    drive = schema.drive.c
    return {row["drive_id"]: row["name"] for row in view.rows(sa.select(drive.drive_id, drive.name))}


def _objects(view: Snapshot) -> dict[str, dict[str, int]]:
    estimate = schema.estimate.c
    by = estimate.drive_id, estimate.method
    counted = sa.select(*by, sa.func.count().label("n")).group_by(*by).order_by(*by)
    found: dict[str, dict[str, int]] = {}
    for row in view.rows(counted):
        found.setdefault(row["drive_id"], {})[row["method"]] = row["n"]
    return found


def _doubts(view: Snapshot) -> dict[str, str]:
    names, method = drive_names(view), schema.drive_method.c
    found: dict[str, str] = {}
    asked = sa.select(method.drive_id, method.method, method.misfits, method.absence_gap)
    # By the alphabet the best method is the first: it is the one that is matched.
    for row in view.rows(asked.order_by(method.method)):
        found.setdefault(row["drive_id"], _doubt(names[row["drive_id"]], row))
    return found


def _doubt(name: str, row: Mapping[str, Any]) -> str:
    if misfits := tuple(misfit_from_json(one) for one in row["misfits"]):
        return sentence(DriveDoesNotFit(name, misfits))
    return f"It cannot show that a sign is missing: {row['absence_gap']}." if row["absence_gap"] else ""


def _moment(epoch_ns: int) -> dt.datetime:
    return dt.datetime.fromtimestamp(epoch_ns // 1_000_000_000, tz=dt.UTC)
