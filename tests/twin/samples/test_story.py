"""The sample tells the whole story: two drives, a person who decides, and a set that API Skriv takes."""

from __future__ import annotations

import csv
import re
from collections import Counter
from pathlib import Path

import pytest
from checkout import ROOT
from command_line import Twin

from nvdb.replay import ReplayServer
from nvdb.replay.skriv import SkrivReplayServer
from nvdb.replay.skriv.__main__ import world_from_pages

DATA = ROOT / "data"
README = ROOT / "README.md"


def test_readmes_job_can_be_pasted(twin: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """README's commands run as they stand: the sample's verdicts, one set carried out, one left to ask."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demo-out").symlink_to(DATA)  # the trips without their painted pictures
    job = re.search(
        r"^## The job\n.*?```\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    assert job
    world = world_from_pages(DATA / "nvdb")
    before = len(world.objects)
    with (
        ReplayServer(DATA / "nvdb") as les,
        SkrivReplayServer(world, users={"demo": "demo"}, on_the_way=()) as skriv,
    ):
        monkeypatch.setenv("TWIN_API_URL", les.url)
        monkeypatch.setenv("TWIN_SKRIV_URL", skriv.url)
        monkeypatch.setenv("TWIN_SKRIV_USER", "demo")
        monkeypatch.setenv("TWIN_SKRIV_PASSWORD", "demo")
        answers = [twin(*line.split()[1:]) for line in job[1].splitlines() if line.startswith("twin ")]
    assert [answer.code for answer in answers] == [0] * 8, [answer.err for answer in answers]
    assert "UTFØRT, 7 objects" in answers[-1].out + answers[-1].err
    assert len(world.objects) == before + 3  # the pole P04 with 142 and 802
    assert world.objects[1042500115].sluttdato is not None
    assert (world.objects[1042600114].versjon, world.objects[1042500106].versjon) == (2, 2)

    verdicts = Counter(one["verdict"] for one in twin("match", "--json").json["changes"])
    with (DATA / "expected_changes.csv").open(encoding="utf-8", newline="") as file:
        expected = Counter(row["verdict"] for row in csv.DictReader(file))
    assert verdicts == expected
    assert expected["review"] == 1
