"""Revisions of the tables, on both databases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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


UNDONE: Mapping[int, Sequence[str]] = {
    16: ["DROP TABLE fleet_job"],
    17: [],  # views, which every upgrade makes anew
    18: [
        "CREATE INDEX ix_estimate_method ON estimate (method)",
        *(
            f"DROP INDEX ix_{name}"
            for name in ("known_mark_pole", "known_mark_east_m", "pole_key_pole", "skiltplate_skiltnummer")
        ),
    ],
}
"""Revision → what makes a store of it one of the version before."""


@pytest.mark.filterwarnings("ignore:Did not recognize type 'geometry'")
@pytest.mark.parametrize("version", range(15, schema.VERSION))
def test_store_of_every_version_is_brought_to_the_tables_of_a_new_one(address: str, version: int) -> None:
    """Columns with their types, keys and indexes; what the store holds stays. Before 15: test_upgrade."""
    one_finding(address)
    with Store.open(address) as store:
        new = tables_of(store)
        with store.transaction() as connection:
            for revision in range(schema.VERSION, version, -1):
                for statement in UNDONE[revision]:
                    connection.exec_driver_sql(statement)
            older = sa.update(schema.meta).where(schema.meta.c.key == "schema_version")
            connection.execute(older.values(value=str(version)))
    with Store.open(address, create=False) as store:
        assert tables_of(store) == new
        assert store.count(schema.change) == 1


def tables_of(store: Store) -> dict[str, str]:
    """Table → its columns, key and indexes, as the database tells them."""
    with store.transaction() as connection:
        seen = sa.inspect(connection)
        return {
            name: repr(
                [
                    [(one["name"], repr(one["type"]), one["nullable"]) for one in seen.get_columns(name)],
                    seen.get_pk_constraint(name)["constrained_columns"],
                    sorted((one["column_names"], one["unique"]) for one in seen.get_indexes(name)),
                    sorted(one["column_names"] for one in seen.get_unique_constraints(name)),
                ]
            )
            for name in sorted(seen.get_table_names())
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
