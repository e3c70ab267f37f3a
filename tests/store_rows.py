"""Rows of the store's tables, and what an ingest gives of a drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, cast

import numpy as np
import sqlalchemy as sa

from geoloc.trajectory.trajectory import Poses
from twin.ingest import LocatedDrive
from twin.store.drive_records import DriveRecord, MethodRecord, Sightings
from twin.store.kinds import Method
from twin.store.records import Corrections, Estimate

EMPTY = {sa.JSON: [], sa.LargeBinary: b"", sa.String: "", sa.Float: 0.0, sa.Boolean: False, sa.Integer: 0}


def row(table: sa.Table, **values: Any) -> dict[str, Any]:
    """Make a row with something in every column that must not be null."""
    made = {}
    for column in table.columns:
        kind = next(kind for kind in EMPTY if isinstance(column.type, kind))
        made[column.name] = None if column.nullable else EMPTY[kind]
    return {**made, **values}


def located(
    method: str = Method.SINGLE_FRAME,
    estimates: Sequence[Estimate] = (),
    *,
    objects: Sequence[str] = (),
    annotations_sha256: str = "",
    corrections: Corrections | None = None,
    **drive: Any,
) -> LocatedDrive:
    """Make what an ingest gives of a drive, with sightings of these objects and columns of the drive."""
    nothing: dict[str, Any] = {
        "drive_id": "d",
        "name": "",
        "started_ns": 0,
        "ended_ns": 0,
        "datum": "",
        "length_m": 0.0,
        "annotations_complete": False,
        "n_frames": 0,
        "n_annotations": 0,
        "delay_ms": None,
        "line": b"",
        "rig_document": "",
        "content_sha256": "",
        "fix_quality": {},
        "software": "",
        **dict.fromkeys(("cameras", "warnings", "skipped"), ()),
        "poses": Poses(*cast("Any", [np.empty(0, np.bool_) for _ in Poses.__slots__])),
    }
    n = len(objects)
    texts, whole = ("camera", "kind"), ("frame", "epoch_ns")
    columns: dict[str, Any] = {one.name: np.zeros(n) for one in fields(Sightings)}
    columns |= {**{name: np.full(n, "") for name in texts}, **{name: np.zeros(n, np.int64) for name in whole}}
    columns |= {"object": np.array(objects), "rejected": ("",) * n, "is_measured": np.ones(n, np.bool_)}
    return LocatedDrive(
        DriveRecord(**{**nothing, **drive}),
        MethodRecord(Method(method), corrections=corrections),
        Sightings(**columns),
        tuple(estimates),
        annotations_sha256,
    )
