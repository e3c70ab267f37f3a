"""Areas of a mirror, end to end: what is fetched, remembered, followed, refused and shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from nvdb.replay import Fault, ReplayServer, RequestInfo
from nvdb.replay_generate import GeneratedWorld
from nvdb.replay_world import ReplayWorld
from twin import schema
from twin.store import Store

Twin = Callable[..., Any]
CONTRACT = {"id": 17, "nummer": 9503, "navn": "9503 Midtre Hålogaland 2021-2026"}
ELSEWHERE = {"kommuner": [301], "fylker": [3]}


def _segment(number: int, **changes: Any) -> dict[str, Any]:
    """A link of the road network in V4's form."""
    return {
        "veglenkesekvensid": number,
        "veglenkenummer": 1,
        "segmentnummer": 1,
        "referanse": f"{number}-1-1",
        "metadata": {"startdato": "2015-03-01"},
        "startposisjon": 0,
        "sluttposisjon": 1,
        "type": "HOVED",
        "detaljnivå": "Vegtrase",
        "typeVeg_sosi": "enkelBilveg",
        "geometri": {"wkt": "LINESTRING Z(270000 7040000 1, 270050 7040070 1)", "srid": 5973},
        "vegsystemreferanse": {},
        **changes,
    }


@pytest.fixture
def world() -> ReplayWorld:
    """30 points and 60 plates in ten kommuner; those of fylke 50 also belong to a contract."""
    made = GeneratedWorld(30, 60)
    raws = {kind: [made.one(kind, number) for number in made.ids(kind, 60)] for kind in (95, 96)}
    objects = {kind: [dict(record.raw) for record in found if record] for kind, found in raws.items()}
    for raw in (*objects[95], *objects[96]):
        if raw["lokasjon"]["fylker"] == [50]:
            raw["lokasjon"]["kontraktsområder"] = [CONTRACT]
    links = [
        _segment(1, kommune=5001, fylke=50, kontraktsområder=[CONTRACT]),
        _segment(2, kommune=5006, fylke=50, kontraktsområder=[CONTRACT]),
        _segment(3, kommune=301, fylke=3),
    ]
    return ReplayWorld(objects, vegnett=links)


@pytest.fixture
def url(world: ReplayWorld) -> Iterator[str]:
    """The world on loopback."""
    with ReplayServer(world) as server:
        yield server.url


def _ids(world: ReplayWorld, fylker: set[int]) -> dict[int, set[int]]:
    """What the world has in some fylker, told by the objects alone."""
    return {
        kind: {
            raw["id"]
            for raw in world.page(kind, {"inkluder": "alle"}, "")["objekter"]
            if fylker & set(raw["lokasjon"]["fylker"])
        }
        for kind in (95, 96)
    }


def _mirrored(path: Path) -> dict[int, set[int]]:
    with Store.open(path, create=False) as store:
        return {
            kind: {row["nvdb_id"] for row in store.rows(sa.select(tables.visible.c.nvdb_id))}
            for kind, tables in schema.MIRROR.items()
        }


@pytest.mark.parametrize(
    ("option", "text", "words"),
    [
        ("--fylke", "50", "fylke 50"),
        ("--kommune", "5001,5006", "kommune 5001, 5006"),
        ("--kontraktsomrade", "9503 Midtre Hålogaland 2021-2026", f"kontraktsområde {CONTRACT['navn']}"),
        ("--kontraktsomrade", "17", "kontraktsområde 17"),
    ],
)
def test_area_is_fetched_remembered_and_followed(
    twin: Twin, world: ReplayWorld, url: str, tmp_path: Path, option: str, text: str, words: str
) -> None:
    """Signs and roads of the area come; later runs need no area, and take out and in what moved over."""
    path = tmp_path / "a.db"
    command = ["sync-nvdb", "--api-url", url, "--store", path, "--vegnett", "--json"]
    first = twin(*command, option, text).json
    inside = _ids(world, {50})
    assert (first["area"], first["mode"]) == (words, "backfill")
    assert _mirrored(path) == inside
    assert first["expected"] == {str(kind): len(ids) for kind, ids in inside.items()}
    status = twin("status", "--store", path, "--json").json
    assert (status["mirror"]["area"], status["vegnett"]["area"]) == (words, words)
    assert status["vegnett"]["count"] == 2

    leaves, comes = min(inside[96]), min(_ids(world, {3})[96])
    world.update(leaves, lokasjon=ELSEWHERE)
    world.update(comes, lokasjon={"kommuner": [5001], "fylker": [50], "kontraktsområder": [CONTRACT]})
    world.touch(sorted(inside[96] - {leaves})[:3])
    second = twin(*command).json
    counts = tuple(second[name] for name in ("mode", "n_events", "created", "changed", "deleted"))
    assert counts == ("changes", 5, 1, 3, 1)
    assert _mirrored(path) == {95: inside[95], 96: inside[96] - {leaves} | {comes}}


def test_area_of_a_mirror_is_not_changed_by_the_way(twin: Twin, url: str, tmp_path: Path) -> None:
    """Another area is refused with exit code 5 and the cure; with --replace it is fetched."""
    path = tmp_path / "a.db"
    command = ["sync-nvdb", "--api-url", url, "--store", path]
    assert twin(*command, "--fylke", "50").code == 0
    before = _mirrored(path)
    for options in (["--fylke", "3"], ["--kommune", "5001,5006"], ["--kontraktsomrade", "17"], ["--all"]):
        refused = twin(*command, *options)
        assert refused.code == 5
        assert "mirrors fylke 50, not" in refused.err
        assert "--replace" in refused.err
    assert _mirrored(path) == before
    assert twin(*command, "--fylke", "3", "--replace").code == 0
    assert before[96].isdisjoint(_mirrored(path)[96])
    assert twin(*command, "--json").json["area"] == "fylke 03"


def test_uberiket_refuses_areas_that_it_cannot_select(twin: Twin, url: str, tmp_path: Path) -> None:
    """Exit code 2 and the cure, before anything is asked or stored."""
    for options in (["--fylke", "50"], ["--kontraktsomrade", "17"], ["--kommune", "5001"]):
        command = ["sync-nvdb", "--api-url", url, "--store", tmp_path / "a.db", "--source", "uberiket"]
        for answer in (twin(*command, *options), twin(*command, *options, "--dry-run")):
            assert answer.code == 2
            assert "take the source les-v4" in answer.err


def _no_plates(info: RequestInfo) -> Fault | None:
    """Pages of Skiltplate cannot be had."""
    return Fault("status", 403) if info.path.endswith("/96") else None


def test_unfinished_backfill_is_shown_and_remembers_its_area(
    twin: Twin, world: ReplayWorld, url: str, tmp_path: Path
) -> None:
    """After an interruption `status` says how far it came, and a sync without an area goes on with it."""
    path = tmp_path / "a.db"
    command = ["sync-nvdb", "--api-url", url, "--store", path]

    n_points = len(_ids(world, {50})[95])
    with ReplayServer(world, faults=_no_plates) as server:
        assert twin("sync-nvdb", "--api-url", server.url, "--store", path, "--fylke", "50").code == 3
    status = twin("status", "--store", path)
    assert f"fylke 50: {n_points} Skiltpunkt and 0 Skiltplate so far" in status.out
    assert twin(*command).code == 0
    assert _mirrored(path) == _ids(world, {50})


def test_area_without_signs_is_pointed_out(twin: Twin, url: str, tmp_path: Path) -> None:
    """A fylke that does not exist looks like an empty one to the API: the command says so."""
    answer = twin("sync-nvdb", "--api-url", url, "--store", tmp_path / "a.db", "--fylke", "99")
    assert answer.code == 0
    assert "NVDB has no sign in fylke 99: check the area." in answer.err


def test_progress_on_a_terminal_counts_objects(
    twin: Twin, world: ReplayWorld, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bar shows how many of how many, by ``statistikk``, and rates."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    answer = twin("sync-nvdb", "--api-url", url, "--store", tmp_path / "a.db", "--fylke", "50")
    n_points, n_plates = (len(ids) for ids in _ids(world, {50}).values())
    assert f"{n_points} of {n_points}" in answer.err
    assert f"{n_plates} of {n_plates}" in answer.err
    assert "/s" in answer.err
    assert f"{n_plates} (NVDB counts {n_plates})" in answer.out
