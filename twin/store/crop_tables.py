"""The tables of findings' pictures, as :mod:`.schema` hands them on."""

from __future__ import annotations

import sqlalchemy as sa

from twin.store.mirror_tables import metadata
from twin.store.types import JSON, JSON_OR_NULL, REAL, ROWID, TEXT

crop = sa.Table(
    "crop",
    metadata,
    sa.Column("change_id", TEXT, primary_key=True, comment="the finding"),
    sa.Column(
        "number", sa.Integer, primary_key=True, autoincrement=False, comment="counts its views; 0 is the best"
    ),
    sa.Column("role", TEXT, primary_key=True, comment="face: the sign alone; wide: its surroundings"),
    sa.Column("drive_id", TEXT, nullable=False, comment="the drive"),
    sa.Column("camera", TEXT, nullable=False, comment="the camera"),
    sa.Column("frame", sa.Integer, nullable=False, comment="number of the frame, from 0"),
    sa.Column("epoch_ns", sa.BigInteger, nullable=False, comment="when it was taken, nanoseconds UTC"),
    sa.Column("range_m", REAL, nullable=False, comment="from camera to sign, metres"),
    sa.Column("sha256", TEXT, nullable=False, index=True, comment="of the WebP file, which is named by it"),
    sa.Column("width_px", sa.Integer, nullable=False, comment="of the crop"),
    sa.Column("height_px", sa.Integer, nullable=False, comment="likewise"),
    sa.Column("is_masked", sa.Boolean, nullable=False, comment="whether people and vehicles were masked"),
    sa.Column("proof", JSON, nullable=False, comment="what was masked, by what: twin help evidence"),
    comment="Crops of pictures that show a finding; the files lie beside the store.",
)
"""Crops of pictures that show a finding; the files lie beside the store (:mod:`twin.evidence.files`)."""

crop_gap = sa.Table(
    "crop_gap",
    metadata,
    sa.Column("id", ROWID, primary_key=True, comment="counts the rows"),
    sa.Column("change_id", TEXT, nullable=False, index=True, comment="the finding"),
    sa.Column("drive_id", TEXT, nullable=False, comment="the drive"),
    sa.Column("kind", TEXT, nullable=False, comment="what kind of reason"),
    sa.Column("sentence", TEXT, nullable=False, comment="the reason, in English"),
    sa.Column(
        "why",
        JSON_OR_NULL,
        comment="the reason as a kind with facts; null in rows from before schema 14",
    ),
    comment="Why a finding has no crops, or fewer than it could have.",
)

crop_log = sa.Table(
    "crop_log",
    metadata,
    sa.Column("id", ROWID, primary_key=True, comment="counts the rows"),
    sa.Column("at", TEXT, nullable=False, comment="when, UTC"),
    sa.Column("kind", TEXT, nullable=False, comment="unmasked or forgotten"),
    sa.Column("by", TEXT, nullable=False, comment="who"),
    sa.Column("reason", TEXT, nullable=False, comment="why, as the person wrote"),
    sa.Column("n_crops", sa.Integer, nullable=False, comment="how many"),
    sa.Column("change_ids", JSON, nullable=False, comment="of which findings"),
    comment="When crops were made without masks, and when crops were deleted: rows are added, never changed.",
)

CROP_LOG_RULES = tuple(
    f"CREATE TRIGGER crop_log_{name} BEFORE {act} ON crop_log "
    "BEGIN SELECT RAISE(ABORT, 'the log of crops is never changed'); END"
    for name, act in (("keeps", "UPDATE"), ("stays", "DELETE"))
)
for _rule in CROP_LOG_RULES:
    sa.event.listen(metadata, "after_create", sa.DDL(_rule).execute_if(dialect="sqlite"))  # type: ignore[no-untyped-call]
