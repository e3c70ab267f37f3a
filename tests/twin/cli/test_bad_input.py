"""Bad input: one clear sentence with the file and the cure, the right exit code, the store unchanged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from command_line import Twin

from nvdb.replay import Fault, ReplayServer
from twin.store import schema
from twin.store.store import Store


def contents(store: Path) -> dict[str, Any]:
    """Everything of a store that anybody sees: not what an interrupted backfill keeps aside to go on with."""
    with Store.open(store) as opened:
        seen = {
            table.name: opened.rows(sa.select(table).order_by(*table.primary_key.columns))
            for table in schema.metadata.sorted_tables
            if not table.name.endswith("_aside")
        }
    seen["meta"] = [row for row in seen["meta"] if row["key"] != "mirror_backfill"]
    return seen


@pytest.mark.parametrize("command", ["status", "match", "export out", "show P01", "explain x", "decide undo"])
def test_an_empty_file_is_no_store_to_read(twin: Twin, tmp_path: Path, command: str) -> None:
    """Commands that only read say so and leave the file empty."""
    path = tmp_path / "twin.db"
    path.touch()
    answer = twin(*command.split(), "--store", path)
    assert (answer.code, "is empty and not a twin store: name another --store." in answer.err) == (4, True)
    assert path.stat().st_size == 0


def test_missing_drive_folder_is_said(twin: Twin, store: Path, tmp_path: Path) -> None:
    """A folder that is not there is named."""
    answer = twin("ingest-drive", tmp_path / "nowhere", "--store", store)
    assert answer.code == 4
    assert "nowhere" in answer.err


NETWORK_FAULTS = [
    Fault("html_200"),
    Fault("status", status=503),
    Fault("status", status=404, body=b"nothing here"),
    Fault("truncate"),
    Fault("disconnect"),
    Fault("garbage"),
]


@pytest.mark.usefixtures("no_waiting")
@pytest.mark.parametrize("fault", NETWORK_FAULTS, ids=lambda f: f"{f.kind}{f.status}")
def test_bad_api_exits_with_3_and_leaves_the_store(
    twin: Twin, store: Path, sample: Path, fault: Fault
) -> None:
    """An API that fails on its second page leaves the old mirror, whole."""
    before = contents(store)
    with ReplayServer(sample / "nvdb", faults=lambda r: fault if "start" in r.query else None) as server:
        arguments = ["sync-nvdb", "--kommune", "5001", "--api-url", server.url, "--store", store]
        answer = twin(*arguments, "--json")
    assert answer.code == 3, answer.err
    assert len(answer.err.strip().splitlines()) == 1, answer.err
    assert contents(store) == before


@pytest.mark.usefixtures("no_waiting")
def test_retries_are_told(twin: Twin, store: Path, sample: Path) -> None:
    """A wait without a word looks like a hang: each failed attempt is said, and the sync goes on."""
    with ReplayServer(
        sample / "nvdb", faults=[Fault("status", status=503), None, Fault("html_200")]
    ) as server:
        answer = twin("sync-nvdb", "--kommune", "5001", "--api-url", server.url, "--store", store)
    assert answer.code == 0
    assert answer.err.count("Trying again in") == 2


@pytest.mark.usefixtures("no_waiting")
def test_unreachable_api_names_the_address(twin: Twin, store: Path) -> None:
    """Nobody listens: the message says where and what to check."""
    with ReplayServer({95: [], 96: []}) as server:
        url = server.url
    answer = twin("sync-nvdb", "--kommune", "5001", "--api-url", url, "--store", store)
    assert answer.code == 3
    assert url.removeprefix("http://") in answer.err


def test_another_area_is_refused_unless_replaced(twin: Twin, store: Path, nvdb_url: str) -> None:
    """A mirror of another area is not thrown away by accident."""
    before = contents(store)
    arguments = ["sync-nvdb", "--kommune", "301", "--api-url", nvdb_url, "--store", store]
    answer = twin(*arguments)
    assert answer.code == 5
    assert "kommune 5001" in answer.err
    assert contents(store) == before
    assert twin(*arguments, "--replace", "--json").json["skiltpunkt"] == 0


def test_newer_store_is_refused(twin: Twin, store: Path, trip: Path) -> None:
    """Every command refuses a store that a newer twin wrote."""
    with Store.open(store) as opened, opened.transaction() as connection:
        connection.execute(
            sa.update(schema.meta).where(schema.meta.c.key == "schema_version").values(value="999")
        )
    for command in (["status"], ["match"], ["ingest-drive", trip]):
        answer = twin(*command, "--store", store)
        assert answer.code == 4
        assert "newer twin" in answer.err


TRUTH_FAULTS = {
    "no such file": None,
    "lacks the column": "object,x,y\nP01,1,2\n",
    "must be numbers": "object,label,easting,northing\nP01,s,abc,7039178\n",
    "not in Norway": "object,label,easting,northing\nP01,s,273036,9039178\n",
    "no rows": "object,label,easting,northing\n",
    "No estimate": "object,label,easting,northing\nnobody,s,271036,7039178\n",
}


@pytest.mark.parametrize("problem", TRUTH_FAULTS)
def test_bad_truth_is_said(twin: Twin, store: Path, tmp_path: Path, problem: str) -> None:
    """A truth file that cannot be used exits with 4 and says why."""
    path = tmp_path / "truth.csv"
    text = TRUTH_FAULTS[problem]
    if text is not None:
        path.write_text(text)
    answer = twin("evaluate", path, "--store", store)
    assert answer.code == 4
    assert ("cannot be read" if text is None else problem) in answer.err


def test_export_onto_a_file_is_refused(twin: Twin, store: Path, tmp_path: Path) -> None:
    """A file where the folder should be is refused with exit code 5, and stays."""
    target = tmp_path / "out"
    target.write_text("mine")
    answer = twin("export", target, "--store", store)
    assert answer.code == 5
    assert target.read_text() == "mine"
