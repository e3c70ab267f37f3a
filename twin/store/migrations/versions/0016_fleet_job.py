"""The queue of a fleet."""

import sqlalchemy as sa
from alembic import op

from twin.store.types import JSON, REAL, ROWID, TEXT

revision = "16"
down_revision = "15"


def upgrade() -> None:
    """Make its table, and the index by state."""
    op.create_table(
        "fleet_job",
        sa.Column("job_id", ROWID, primary_key=True),
        sa.Column("kind", TEXT, nullable=False),
        sa.Column("address", TEXT, nullable=False),
        sa.Column("options", JSON, nullable=False),
        sa.Column("digest", TEXT, nullable=False, unique=True),
        sa.Column("state", TEXT, nullable=False),
        sa.Column("n_failed", sa.Integer, nullable=False),
        sa.Column("n_lost", sa.Integer, nullable=False),
        sa.Column("claim", sa.Integer, nullable=False),
        sa.Column("worker", TEXT, nullable=False),
        sa.Column("leased_until", REAL),
        sa.Column("fault", TEXT),
        sa.Column("reason", TEXT, nullable=False),
        sa.Column("drive_id", TEXT),
        sa.Column("fingerprint", TEXT, nullable=False),
        sa.Column("added_at", TEXT, nullable=False),
        sa.Column("ended_at", TEXT),
        sa.Column("seconds", REAL),
    )
    op.create_index("ix_fleet_job_state", "fleet_job", ["state"])
