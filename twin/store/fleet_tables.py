"""The queue of a fleet: what is to be done, by whom it is being done, and what became of it."""

from __future__ import annotations

import sqlalchemy as sa

from twin.store.mirror_tables import metadata
from twin.store.types import JSON, REAL, ROWID, TEXT

fleet_job = sa.Table(
    "fleet_job",
    metadata,
    sa.Column("job_id", ROWID, primary_key=True, comment="counts the jobs"),
    sa.Column("kind", TEXT, nullable=False, comment="ingest, match or part (of a match)"),
    sa.Column(
        "address",
        TEXT,
        nullable=False,
        comment="where the drive is (folder or URL); which part; empty for a match",
    ),
    sa.Column("options", JSON, nullable=False, comment="how it is located"),
    sa.Column("digest", TEXT, nullable=False, unique=True, comment="SHA-256 of kind, address and options"),
    sa.Column("state", TEXT, nullable=False, index=True, comment="waiting, running, done or parked"),
    sa.Column("n_failed", sa.Integer, nullable=False, comment="runs that ended with a reason"),
    sa.Column("n_lost", sa.Integer, nullable=False, comment="runs whose process was killed"),
    sa.Column("claim", sa.Integer, nullable=False, comment="counts the runs: an earlier one saves nothing"),
    sa.Column("worker", TEXT, nullable=False, comment="who runs it, or did so last"),
    sa.Column("leased_until", REAL, comment="seconds since 1970; when it runs no more unless renewed"),
    sa.Column("fault", TEXT, comment="kind of the last failure; null where there is none"),
    sa.Column("reason", TEXT, nullable=False, comment="its sentence, for people"),
    sa.Column("drive_id", TEXT, comment="what the drive turned out to be"),
    sa.Column("fingerprint", TEXT, nullable=False, comment="of its files, when it was done"),
    sa.Column("added_at", TEXT, nullable=False, comment="UTC"),
    sa.Column("ended_at", TEXT, comment="of the last run, UTC"),
    sa.Column("seconds", REAL, comment="that the last run took"),
    comment="A fleet's queue: drives to ingest, and the match after them.",
)
