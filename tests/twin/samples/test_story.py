"""The sample tells the whole story: two drives, a person who decides, and a set that API Skriv takes."""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path

import pytest
from checkout import ROOT
from command_line import Twin

from nvdb.replay import ReplayServer
from nvdb.replay.skriv import SkrivReplayServer
from nvdb.replay.skriv.__main__ import world_from_pages

DATA = ROOT / "data"
KINDS = ("new", "moved", "wrong_type", "missing")


def test_all_four_kinds_of_change_reach_api_skriv(
    twin: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both drives give what the sample names; what is accepted is carried out, one finding is left to ask."""
    store = ["--store", str(tmp_path / "twin.db")]
    with ReplayServer(DATA / "nvdb") as server:
        assert twin("sync-nvdb", "--kommune", "5001", "--vegnett", "--api-url", server.url, *store).code == 0
    for trip in ("trip_trondheim", "trip_trondheim_2"):
        assert twin("ingest-drive", DATA / trip, *store).code == 0
    found = twin("match", "--json", *store).json
    with (DATA / "expected_changes.csv").open(encoding="utf-8", newline="") as file:
        expected = Counter(row["verdict"] for row in csv.DictReader(file))
    assert {verdict: n for verdict, n in found["verdicts"].items() if n} == expected
    assert expected["review"] == 1

    accept = [word for kind in KINDS for word in ("--verdict", kind)]
    assert twin("decide", "accept", *accept, "--by", "kari", *store).code == 0
    assert twin("export", tmp_path / "out", *store).code == 0
    world = world_from_pages(DATA / "nvdb")
    before = len(world.objects)
    monkeypatch.setenv("TWIN_SKRIV_PASSWORD", "demo")
    with SkrivReplayServer(world, users={"demo": "demo"}, on_the_way=()) as skriv:
        sent = twin("submit", tmp_path / "out", "--go", "--user", "demo", "--api-url", skriv.url, *store)
    assert sent.code == 0, sent.err
    assert "UTFØRT, 7 objects" in sent.out + sent.err
    assert len(world.objects) == before + 3  # the pole P04 with 142 and 802
    assert world.objects[1042500115].sluttdato is not None
    assert (world.objects[1042600114].versjon, world.objects[1042500106].versjon) == (2, 2)
