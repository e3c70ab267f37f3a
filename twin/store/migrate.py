"""An older store's tables to this version's, inside one transaction."""

from __future__ import annotations

import sqlalchemy as sa

from twin.errors import StoreError
from twin.store import schema
from twin.store.upgrades import UPGRADES


def upgrade(connection: sa.Connection, version_found: int, name: str) -> None:
    """Bring the tables to :data:`.schema.VERSION`; what they hold stays.

    Raises
    ------
    StoreError
        The store `name` is older than any that can be upgraded.
    """
    if any(version not in UPGRADES for version in range(version_found, schema.VERSION)):
        raise StoreError(
            f"The store {name} was written by an older twin (schema {version_found}; this twin needs "
            f"{schema.VERSION}): sync and ingest into a new --store."
        )
    for version in range(version_found, schema.VERSION):
        for statement in UPGRADES[version]:
            connection.exec_driver_sql(statement)
    is_version = schema.meta.c.key == "schema_version"
    connection.execute(sa.update(schema.meta).where(is_version).values(value=str(schema.VERSION)))
