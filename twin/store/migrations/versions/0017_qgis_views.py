"""Views for QGIS: `twin.store.postgres` takes them away before revisions and makes them after."""

revision = "17"
down_revision = "16"


def upgrade() -> None:
    """Nothing: the tables are as they were."""
