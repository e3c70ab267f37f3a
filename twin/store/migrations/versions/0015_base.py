"""The tables as they were when PostgreSQL came: SQLite's older ones get here by `twin.store.upgrades`."""

revision = "15"
down_revision = None


def upgrade() -> None:
    """Nothing: a store of this version has its tables."""
