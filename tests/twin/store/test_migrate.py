"""Revisions of the tables, on both databases."""

from __future__ import annotations

from pathlib import Path

import pytest
import sqlalchemy as sa
from later_versions import with_revisions

from twin.errors import StoreError
from twin.store import migrate, schema
from twin.store.store import Store

REVISIONS = {
    schema.VERSION + 1: """op.add_column("change", sa.Column("colour", sa.String(), nullable=True))
    op.execute("UPDATE change SET colour = 'red'")""",
    schema.VERSION + 2: """with op.batch_alter_table("change") as table:
        table.alter_column("colour", new_column_name="paint")
        table.alter_column("distance_m", type_=sa.Numeric())""",  # which the views for QGIS show
}


def test_newest_revision_is_the_schemas_version() -> None:
    """Who raises VERSION adds a revision, and the other way round."""
    assert migrate.revisions().get_current_head() == str(schema.VERSION)


def one_finding(address: str) -> None:
    """Make a store of today with a finding."""
    from findings import finding

    from twin.matching.save import save_changes

    with Store.open(address) as store:
        save_changes(store, [finding("a")], {}, {"method": "m"})


def test_store_is_brought_through_every_revision(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In their order, as it is opened; opened again, nothing is left to do; an older twin refuses it then."""
    one_finding(address)
    today = schema.VERSION
    with monkeypatch.context() as later:
        with_revisions(tmp_path / "migrations", later, REVISIONS)
        for _ in range(2):
            with Store.open(address, create=False) as store:
                assert store.rows(sa.select(sa.literal_column("paint")).select_from(schema.change)) == [
                    {"paint": "red"}
                ]
    assert today == schema.VERSION
    with pytest.raises(StoreError, match="newer twin"):
        Store.open(address, create=False)


def test_revision_that_fails_leaves_the_store_as_it_was(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also what the revisions before it have done: an upgrade is one transaction."""
    one_finding(address)
    with monkeypatch.context() as later:
        broken = {**REVISIONS, schema.VERSION + 3: 'op.execute("UPDATE nothing SET a = 1")'}
        with_revisions(tmp_path / "migrations", later, broken)
        with pytest.raises(StoreError, match="nothing"):
            Store.open(address, create=False)
    with Store.open(address, create=False) as store:
        assert store.count(schema.change) == 1
        with pytest.raises(StoreError, match=r"paint|colour"):
            store.rows(sa.select(sa.literal_column("colour")).select_from(schema.change))
