"""SQLite and PostgreSQL: what is written comes back the same from either, and neither forgets its rules."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from store_rows import row

from twin.errors import RefusedError, StoreError
from twin.store import schema
from twin.store.sql import as_values, bulk_insert, cut, each_number, each_text, rounded, swap
from twin.store.store import Store

POINT, ASIDE = schema.MIRROR[95].visible, schema.MIRROR[95].aside


def points(*ids: int, **values: Any) -> list[Any]:
    """Make rows of the mirror, as they are written in bulk."""
    return as_values(POINT, [row(POINT, nvdb_id=one, **values) for one in ids])


def test_types_that_databases_differ_in_have_one_of_ours() -> None:
    """No column compares texts by a locale, keeps JSON as text in PostgreSQL, or NaN as a number there."""
    from sqlalchemy.dialects import postgresql

    for column in (c for table in schema.metadata.sorted_tables for c in table.columns):
        made = column.type.compile(postgresql.dialect())  # type: ignore[no-untyped-call]
        kind = column.type.dialect_impl(postgresql.dialect())
        nan = kind.bind_processor(postgresql.dialect()) if isinstance(column.type, sa.Float) else None
        assert made != "JSON", column
        assert not made.startswith("VARCHAR") or made == 'VARCHAR COLLATE "C"', column
        assert nan is None or nan(math.nan) is None, column


@pytest.mark.parametrize("replace", [False, True])
def test_rows_in_bulk_come_back_as_they_were(either: Store, replace: bool) -> None:
    """Floats to the last bit, JSON, bytes and NULL; NaN is NULL, in bulk and one by one."""
    values = {"east_m": 0.1 + 0.2, "accuracy_cm": math.nan, "raw": b"\x00\xff", "kommuner": [5001, "æ\t\\N"]}
    with either.transaction() as connection:
        bulk_insert(connection, ASIDE, points(2, **values), replace=replace)
        connection.execute(sa.insert(ASIDE), [row(ASIDE, nvdb_id=1, **values)])
    one, two = either.rows(sa.select(ASIDE).order_by(ASIDE.c.nvdb_id))
    assert {**one, "nvdb_id": 2} == two
    expected = {**row(ASIDE, nvdb_id=2), **values, "accuracy_cm": None}
    assert two == expected


def test_row_that_comes_again_in_bulk_takes_the_place_of_the_first(either: Store) -> None:
    """Within one call and over two; without `replace` it is refused, and nothing of the call is kept."""
    with either.transaction() as connection:
        bulk_insert(connection, ASIDE, points(1, 2, version=1), replace=True)
        bulk_insert(connection, ASIDE, points(2, version=2) + points(2, 3, version=3), replace=True)
    versions = sa.select(ASIDE.c.nvdb_id, ASIDE.c.version).order_by(ASIDE.c.nvdb_id)
    assert [tuple(r.values()) for r in either.rows(versions)] == [(1, 1), (2, 3), (3, 3)]
    with pytest.raises(StoreError, match="nothing was changed"), either.transaction() as connection:
        bulk_insert(connection, ASIDE, points(9, 2))
    assert either.count(ASIDE) == 3


def test_swap_shows_the_rows_aside_and_an_old_snapshot_the_old_ones(either: Store) -> None:
    """Who reads while a mirror is published sees the one before, whole."""
    with either.transaction() as connection:
        bulk_insert(connection, POINT, points(1, 2))
        bulk_insert(connection, ASIDE, points(2, 3))
    with either.snapshot() as view:
        before = view.rows(sa.select(sa.func.count()).select_from(schema.meta))
        with either.transaction() as connection:
            swap(connection, POINT, ASIDE)
        ids = view.rows(sa.select(POINT.c.nvdb_id).order_by(POINT.c.nvdb_id))
        assert before
        assert [r["nvdb_id"] for r in ids] == [1, 2]
    assert [r["nvdb_id"] for r in either.rows(sa.select(POINT.c.nvdb_id).order_by(POINT.c.nvdb_id))] == [2, 3]
    assert either.count(ASIDE) == 0


def test_numbers_are_cut_and_rounded_as_numpy_does_it(either: Store) -> None:
    """Towards zero, and a half away from zero: also where PostgreSQL would round a half to even."""
    values = [-2.5, -1.5, -0.4, 0.0, 0.5, 1.4, 2.5, 100062.5]
    with either.transaction() as connection:
        for at, value in enumerate(values):
            bulk_insert(connection, ASIDE, points(at, east_m=value))
    asked = sa.select(cut(ASIDE.c.east_m).label("cut"), rounded(ASIDE.c.east_m).label("rounded"))
    found = either.rows(asked.order_by(ASIDE.c.nvdb_id))
    assert [r["cut"] for r in found] == np.trunc(values).tolist()
    assert [r["rounded"] for r in found] == [math.copysign(math.floor(abs(v) + 0.5), v) for v in values]


def test_many_values_are_one_parameter_and_texts_sort_by_their_bytes(either: Store) -> None:
    """More values than SQLite has parameters; capital letters first, then Ø by its UTF-8."""
    names = ["a", "B", "Ø", "z", "aa", "-"]
    with either.transaction() as connection:
        for at, name in enumerate(names):
            bulk_insert(connection, ASIDE, points(at, road_reference=name))
    by_number = ASIDE.c.nvdb_id.in_(each_number(range(40_000)))
    by_text = ASIDE.c.road_reference.in_(each_text([*names, *map(str, range(40_000))]))
    found = either.rows(sa.select(ASIDE.c.road_reference).where(by_number, by_text).order_by(sa.text("1")))
    assert [r["road_reference"] for r in found] == sorted(names, key=str.encode)


@pytest.mark.parametrize("table", [schema.decision_log, schema.crop_log])
def test_logs_refuse_to_be_changed(either: Store, table: sa.Table) -> None:
    """Neither a row's values nor the row itself, whoever tries."""
    entry = {name: value for name, value in row(table).items() if name != "id"}
    with either.transaction() as connection:
        connection.execute(sa.insert(table), [entry])
    for change in (sa.update(table).values(reason="other"), sa.delete(table)):
        with pytest.raises(StoreError, match=r"are never|is never"), either.transaction() as connection:
            connection.execute(change)
    assert [r["reason"] for r in either.rows(sa.select(table.c.reason))] == [""]


HOLDER = """
import sys
from twin.store.store import Store
with Store.open(sys.argv[1]) as store, store.alone("sync", "sync"):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_lock_of_a_task_is_held_by_one_process_and_ends_with_it(either: Store, address: str) -> None:
    """The second is told which process it is; other tasks go on, and a killed process holds nobody up."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, address], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.raises(RefusedError, match=f"process {process.pid} on"), either.alone("sync", "sync"):
            pytest.fail("the lock was given twice")
        with either.alone("submit", "submit"):
            process.kill()
    process.wait()
    for _ in range(2):
        with either.alone("sync", "sync"):
            pass
