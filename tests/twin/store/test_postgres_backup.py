"""The lines of docs/operations.md that copy a store in PostgreSQL, and bring it back."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from checkout import ROOT
from postgres_server import Server

from twin.decisions.findings import latest_findings
from twin.decisions.record import decide
from twin.errors import StoreError
from twin.store import schema
from twin.store.copying import copy_store
from twin.store.kinds import Decision
from twin.store.store import Store

PAGE = ROOT / "docs" / "operations.md"

if not PAGE.is_file():
    pytest.skip("the page is not beside the tests", allow_module_level=True)


def documented() -> list[list[str]]:
    """Return the lines of the two blocks: to copy, and to go back."""
    section = PAGE.read_text("utf-8").partition("### Of a store in PostgreSQL\n")[2].partition("\n## ")[0]
    return [block.splitlines() for block in re.findall(r"```\n(.*?)```", section, flags=re.DOTALL)]


@pytest.fixture
def database(postgres: Server, tmp_path: Path) -> Iterator[str]:
    """A database as the page names it, of a user without the administrator's rights."""
    postgres.run("CREATE ROLE twin LOGIN", "CREATE DATABASE twin OWNER twin TEMPLATE postgis")
    yield f"{postgres.address('twin', 'twin').partition('&pictures')[0]}&pictures={tmp_path}/srv/pictures"
    for name in ("twin", "twin_before", "twin_restored"):
        postgres.run(f"DROP DATABASE IF EXISTS {name} WITH (FORCE)")
    postgres.run("DROP ROLE twin")


def everything(address: str) -> dict[str, list[str]]:
    """Every row of a store, and every finding with its decision."""
    with Store.open(address, create=False) as store:
        rows: dict[str, list[Any]] = {
            table.name: store.rows(sa.select(table)) for table in schema.metadata.sorted_tables
        }
        rows["findings"] = latest_findings(store.rows)
    return {name: sorted(map(repr, some)) for name, some in rows.items()}


@pytest.mark.slow
def test_documented_lines_bring_every_row_back(
    matched_store: Path, database: str, postgres: Server, tmp_path: Path
) -> None:
    """Also pictures; what was decided after the copy is in the store that was set aside."""
    folders = {"/backup": tmp_path / "backup", "/srv/twin": tmp_path / "srv"}
    for folder in folders.values():
        folder.mkdir()

    def run(lines: list[str]) -> None:
        for line in lines:
            here = re.sub(
                r"postgresql://(\w+)@db/(\w+)",
                lambda named: postgres.address(named[2], named[1]).partition("&pictures")[0],
                line,
            )
            for stated, folder in folders.items():
                here = here.replace(stated, str(folder))
            subprocess.run(shlex.split(here), check=True, capture_output=True, timeout=120)

    picture = tmp_path / "srv" / "pictures" / "ab" / "abcd.jpg"
    picture.parent.mkdir(parents=True)
    picture.write_bytes(b"a picture")
    copy_store(matched_store, database)
    with Store.open(database) as store:
        first, *_, last = sorted(one.change_id for one in latest_findings(store.rows) if one.is_open)
        decide(store, [first], Decision.ACCEPT, by="kari")
    before = everything(database)
    copy, back = documented()
    run(copy)
    with Store.open(database) as store:
        decide(store, [last], Decision.DISMISS, by="kari")
    later = everything(database)
    picture.unlink()
    run(back)
    assert everything(database) == before
    assert picture.read_bytes() == b"a picture"
    assert everything(database.replace("@/twin?", "@/twin_before?")) == later != before
    with Store.open(database) as store:
        decide(store, [last], Decision.DEFER, by="kari")
        with pytest.raises(StoreError, match="never"), store.transaction() as connection:
            connection.execute(sa.delete(schema.decision_log))
