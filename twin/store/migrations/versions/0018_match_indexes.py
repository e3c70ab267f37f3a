"""Indexes by which a match finds what it needs about a few places, however large the store is."""

from alembic import op

revision = "18"
down_revision = "17"

_INDEXES = (
    ("known_mark", "pole"),
    ("known_mark", "east_m"),
    ("pole_key", "pole"),
    ("skiltplate", "skiltnummer"),
)


def upgrade() -> None:
    """Make them."""
    for table, column in _INDEXES:
        op.create_index(f"ix_{table}_{column}", table, [column])
