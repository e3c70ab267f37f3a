"""An older store's tables to this version's, inside one transaction.

Up to schema 15 a store was SQLite's alone: :mod:`.upgrades` has the SQL of that time. From there on each
version is a revision of Alembic in ``migrations/versions``, whose name is its number, for both databases. The
version stands in the table ``meta``, which older versions of twin read too, and nowhere else.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import sqlalchemy as sa

from twin.errors import StoreError
from twin.store import schema
from twin.store.upgrades import UPGRADES

if TYPE_CHECKING:
    from alembic.script import ScriptDirectory

MIGRATIONS = Path(__file__).with_name("migrations")


def revisions() -> ScriptDirectory:
    """Return Alembic's revisions."""
    from alembic.script import ScriptDirectory

    return ScriptDirectory(str(MIGRATIONS))


def upgrade(connection: sa.Connection, version_found: int, name: str) -> None:
    """Bring the tables to :data:`.schema.VERSION`; what they hold stays.

    Raises
    ------
    StoreError
        The store `name` is older than any that can be upgraded.
    """
    if version_found < min(UPGRADES):
        raise StoreError(
            f"The store {name} was written by an older twin (schema {version_found}; this twin needs "
            f"{schema.VERSION}): sync and ingest into a new --store."
        )
    for version in range(version_found, schema.VERSION):
        for statement in UPGRADES.get(version, ()):
            connection.exec_driver_sql(statement)
    if max(UPGRADES) + 1 < schema.VERSION:
        _revise(connection, max(version_found, max(UPGRADES) + 1))
    is_version = schema.meta.c.key == "schema_version"
    connection.execute(sa.update(schema.meta).where(is_version).values(value=str(schema.VERSION)))


def _revise(connection: sa.Connection, version: int) -> None:
    """Run the revisions after a version."""
    from alembic.operations import Operations
    from alembic.runtime.migration import MigrationContext

    later = list(revisions().iterate_revisions("head", str(version)))
    with Operations.context(MigrationContext.configure(connection)):
        for revision in reversed(later):
            revision.module.upgrade()
