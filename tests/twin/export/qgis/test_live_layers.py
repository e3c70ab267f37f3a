"""The live layers, as QGIS itself opens and edits them (tests/qgis_live_layers.py, without a screen)."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
import sqlalchemy as sa
from checkout import ROOT
from command_line import Twin
from postgres_server import Server
from qgis_python import ENVIRONMENT, SYSTEM_PYTHON, need_qgis

from twin.decisions.log import history
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.copying import copy_store
from twin.store.store import Store

pytestmark = pytest.mark.qgis


def test_qgis_opens_the_live_layers_and_decides_in_them(
    postgres: Server, matched_store: Path, twin: Twin
) -> None:
    """Types, CRS and styles are there by themselves; a reviewer's edit is her decision in the store."""
    need_qgis()
    address = postgres.new()
    copy_store(matched_store, address)
    for command in ("init-roles", "qgis", "qgis"):
        assert twin("store", command, "--store", address).code == 0
    url = StoreAddress(address).url()
    postgres.run("CREATE ROLE signe LOGIN IN ROLE twin_reviewer")
    with Store.open(address, create=False) as store:
        change = store.rows(sa.select(schema.change).where(schema.change.c.verdict == "moved"))[0]
    words = (str(url.query["host"]), str(url.database), "signe", str(change["change_id"]))
    done = subprocess.run(
        [SYSTEM_PYTHON, str(ROOT / "tests" / "qgis_live_layers.py"), *words],
        capture_output=True,
        text=True,
        check=False,
        env=ENVIRONMENT,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)

    assert told.pop("errors") == []
    assert {name: (one["type"], one["crs"]) for name, one in told.items()} == {
        "changes": ("Point", "EPSG:25833"),
        "changes_wgs84": ("Point", "EPSG:4326"),
        "drives": ("LineString", "EPSG:25833"),
        "estimates": ("Point", "EPSG:25833"),
        "nvdb_signs": ("Point", "EPSG:25833"),
    }
    assert all(one["valid"] and one["features"] for one in told.values())
    assert {name: one["renderer"] for name, one in told.items()} == dict.fromkeys(told, "categorizedSymbol")
    answers = ["decision", "comment"]
    assert {name: one["editable"] for name, one in told.items() if one["editable"]} == {
        "changes": answers,
        "changes_wgs84": answers,
    }
    assert told["changes"]["aliases"]["distance_m"] == "Distance from NVDB's position (m)"
    assert any("<b>Moved</b>" in tip and "<img" not in tip for tip in told["changes"]["map_tips"])
    assert "CEP95 –" in told["estimates"]["map_tips"][0]
    assert not any("[%" in tip for one in told.values() for tip in one["map_tips"])

    with Store.open(address, create=False) as store:
        (entry,) = history(store.rows, str(change["change_id"]))
    assert (entry.decision, entry.reason, entry.by) == ("accept", "seen in QGIS", "signe")
