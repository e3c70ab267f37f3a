"""The whole job on both databases: the same findings, to the last bit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from command_line import Twin
from postgres_server import Server

from twin.cli import run
from twin.store import schema
from twin.store.store import Store

CLOCKS = {"read_at", "synced_at", "at", "matched_at", "decided_at"}
"""Columns that say when something was done."""
SAID_WHEN = {"last_match", "mirror", "mirror_backfill"}


@pytest.fixture(scope="module")
def jobs(
    sample: Path,
    nvdb_url: str,
    matched_store: Path,
    postgres: Server,
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, str]:
    """The sample synced, ingested by every method, matched and decided: in a file, and in a database."""
    file = tmp_path_factory.mktemp("job") / "twin.db"
    file.write_bytes(matched_store.read_bytes())
    database = postgres.new()
    store = ["--store", database, "--json"]
    assert run(["sync-nvdb", "--kommune", "5001", "--api-url", nvdb_url, *store]) == 0
    for method in schema.METHODS:
        assert run(["ingest-drive", str(sample / "trip_trondheim"), "--method", method, *store]) == 0
    assert run(["match", *store]) == 0
    for address in (str(file), database):
        decided = ["accept", "--verdict", "moved", "--by", "kari"]
        assert run(["decide", *decided, "--store", address, "--json"]) == 0
    return file, database


@pytest.mark.parametrize("table", schema.metadata.sorted_tables, ids=lambda table: table.name)
def test_rows_are_the_same_to_the_last_bit(jobs: tuple[Path, str], table: sa.Table) -> None:
    """Each table of the store, but for the time of day at which it was written."""
    columns = [column for column in table.columns if column.name not in CLOCKS]
    asked = sa.select(*columns).order_by(*table.primary_key.columns)
    rows: list[Any] = []
    for address in jobs:
        with Store.open(address, create=False) as store:
            found = store.rows(asked)
        rows.append([row for row in found if table is not schema.meta or row["key"] not in SAID_WHEN])
    assert repr(_plain(rows[0])) == repr(_plain(rows[1]))


def _plain(value: Any) -> Any:
    """Without the order of JSON's keys, which PostgreSQL does not keep."""
    if isinstance(value, dict):
        return {key: _plain(value[key]) for key in sorted(value)}
    return [_plain(one) for one in value] if isinstance(value, list) else value


def test_commands_say_the_same(jobs: tuple[Path, str], twin: Twin) -> None:
    """Findings, drives, one finding and one estimate explained, as a program reads them."""
    (first, *_) = json.loads(twin("findings", "--json", "--store", jobs[0]).out)["rows"]
    for words in (["findings"], ["drives"], ["explain", first["change_id"]], ["show", "P01"]):
        one, other = (json.loads(twin(*words, "--json", "--store", address).out) for address in jobs)
        assert _timeless(one) == _timeless(other), words


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _timeless(one) for key, one in value.items() if key not in CLOCKS}
    return [_timeless(one) for one in value] if isinstance(value, list) else value


def test_exports_are_the_same(jobs: tuple[Path, str], twin: Twin, tmp_path: Path) -> None:
    """The GeoJSON of both, but for the times of sync and match."""
    files = []
    for address, name in zip(jobs, "ab", strict=True):
        out = tmp_path / name
        assert twin("export", out, "--no-project", "--store", address).code == 0
        files.append({file.name: _timeless(json.loads(file.read_text())) for file in out.glob("*.geojson")})
    assert files[0] == files[1]
    assert files[0]
