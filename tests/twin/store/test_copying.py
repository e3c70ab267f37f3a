"""A whole store into another database, and back."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import sqlalchemy as sa
from command_line import Twin
from findings import finding
from store_rows import row

from twin.decisions import decide
from twin.errors import ConfigError, RefusedError
from twin.matching.save import save_changes
from twin.store import schema
from twin.store.copying import copy_store
from twin.store.sql import as_values, bulk_insert
from twin.store.store import Store

POINT = schema.MIRROR[95].visible


def rows_of(address: str | Path) -> dict[str, list[str]]:
    """Every row of every table, as text."""
    with Store.open(address, create=False) as store, store.snapshot() as view:
        return {
            table.name: sorted(repr(one) for one in view.rows(sa.select(table)))
            for table in schema.metadata.sorted_tables
        }


def filled(address: str | Path) -> None:
    """Make a store with findings, a decision and rows that databases keep differently."""
    with Store.open(address) as store:
        save_changes(store, [finding("a"), finding("b")], {}, {"method": "adjusted", "revision": 0})
        with store.transaction() as connection:
            values = {"east_m": 0.1 + 0.2, "raw": b"\x00\xff", "kommuner": [5001, "æ\t\\N"]}
            rows = as_values(POINT, [row(POINT, nvdb_id=one, **values) for one in range(7)])
            bulk_insert(connection, POINT, rows)
        decide(store, ["a"], "accept", by="kari", reason="seen")


def test_there_and_back_nothing_has_changed(address: str, tmp_path: Path) -> None:
    """To the last bit and NULL; new rows are numbered after those that came, and a log stays unchangeable."""
    first, last = tmp_path / "first.db", tmp_path / "last.db"
    filled(first)
    copy_store(first, address)
    with Store.open(address, create=False) as store:
        decide(store, ["b"], "dismiss", by="ola", reason="none there")
        with pytest.raises(Exception, match="never"), store.transaction() as connection:
            connection.execute(sa.update(schema.decision_log).values(by="x"))
    copied = copy_store(address, last)
    assert copied.rows["skiltpunkt"] == 7
    assert rows_of(last) == rows_of(address)
    before, after = rows_of(first), rows_of(last)
    assert len(after.pop("decision_log")) == len(before.pop("decision_log")) + 1
    assert {name: rows for name, rows in after.items() if name != "meta"} == {
        name: rows for name, rows in before.items() if name != "meta"
    }


def test_a_store_that_holds_something_is_left_alone(tmp_path: Path, twin: Twin) -> None:
    """One sentence, and not a row more; the same store twice is refused too."""
    filled(tmp_path / "a.db")
    filled(tmp_path / "b.db")
    before = rows_of(tmp_path / "b.db")
    with pytest.raises(RefusedError, match="holds something already"):
        copy_store(tmp_path / "a.db", tmp_path / "b.db")
    assert rows_of(tmp_path / "b.db") == before
    with pytest.raises(ConfigError, match="name two"):
        copy_store(tmp_path / "a.db", tmp_path / "a.db")
    answer = twin("store", "copy", tmp_path / "a.db", tmp_path / "c.db", "--json")
    assert json.loads(answer.out)["rows"]["change"] == 2
