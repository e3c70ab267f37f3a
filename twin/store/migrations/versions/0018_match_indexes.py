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
    """Make them; one by method, which SQLite takes for the better one, only leads to all estimates."""
    op.execute("DROP INDEX IF EXISTS ix_estimate_method")
    for table, column in _INDEXES:
        op.create_index(f"ix_{table}_{column}", table, [column], if_not_exists=True)
