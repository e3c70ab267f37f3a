"""Areas of a mirror, end to end: what is fetched, remembered, followed, refused and shown."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import pytest
import sqlalchemy as sa
from command_line import Twin
from nvdb_country import GeneratedWorld
from vegnett_links import segment

from nvdb.area import Area
from nvdb.errors import HttpStatusError
from nvdb.replay import Fault, ReplayServer, ReplayWorld, RequestInfo
from twin.errors import RefusedError
from twin.mirror.sync import dry_run, sync_nvdb
from twin.store import schema
from twin.store.store import Store

CONTRACT = {"id": 17, "nummer": 9503, "navn": "9503 Midtre Hålogaland 2021-2026"}
ELSEWHERE = {"kommuner": [301], "fylker": [3]}
BOX = "box 0, 6500000, 1000, 6501000 (UTM33)"
LINE = "270000 7040000 1, 270050 7040070 1"


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
        segment(1, LINE, kommune=5001, fylke=50, kontraktsområder=[CONTRACT]),
        segment(2, LINE, kommune=5006, fylke=50, kontraktsområder=[CONTRACT]),
        segment(3, LINE, kommune=301, fylke=3),
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


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--kommune", "5006"], "kommune 5001, 5006"),
        (["--kommune=5006", "--kommune", "301"], "kommune 0301, 5001, 5006"),
        (["--kommune", "5006,301"], "kommune 0301, 5001, 5006"),
    ],
)
def test_areas_add_up(twin: Twin, url: str, tmp_path: Path, options: list[str], words: str) -> None:
    """An option given again adds to the area, and a mirror grows to an area that holds its own."""
    command = ["sync-nvdb", "--api-url", url, "--store", tmp_path / "a.db", "--kommune", "5001"]
    assert twin(*command).code == 0
    before = _mirrored(tmp_path / "a.db")
    assert twin(*command, *options, "--json").json["area"] == words
    after = _mirrored(tmp_path / "a.db")
    assert all(before[kind] <= after[kind] for kind in before)
    unknown = twin(*command[:-2], "--kommune", "5051")
    assert (unknown.code, "--replace" in unknown.err) == (2, False), unknown.err


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
    """A box without signs is said to be one, and can be left for the right area without --replace."""
    sync = ("sync-nvdb", "--api-url", url, "--store", tmp_path / "a.db")
    box = ("--bbox", "0,6500000,1000,6501000")
    dry = twin(*sync, *box, "--dry-run")
    assert (dry.code, f"NVDB has no sign in {BOX}: check the area." in dry.err) == (0, True)
    assert not (tmp_path / "a.db").exists()
    answer = twin(*sync, *box)
    assert (answer.code, f"NVDB has no sign in {BOX}: check the area." in answer.err) == (0, True)
    assert twin(*sync, "--fylke", "50").code == 0


@pytest.mark.parametrize("dry", [(), ("--dry-run",)])
@pytest.mark.parametrize(
    ("area", "told"),
    [
        (("--kommune", "5001,5051"), "NVDB has no kommune 5051 (perhaps 5501, 5001, 5006)"),
        (("--fylke", "99"), "NVDB has no fylke 99: give a number that is in use today."),
    ],
)
def test_area_that_nvdb_does_not_have_is_refused(
    twin: Twin, url: str, tmp_path: Path, area: tuple[str, str], told: str, dry: tuple[str, ...]
) -> None:
    """A wrong number is looked up in NVDB's own list before a store is made that would be bound to it."""
    answer = twin("sync-nvdb", "--api-url", url, "--store", tmp_path / "a.db", *area, *dry)
    assert (answer.code, told in answer.err, answer.err.count("\n")) == (2, True, 1), answer.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("source", ["les-v4", "uberiket"])
def test_dry_run_tells_first_what_the_sync_then_does(
    world: ReplayWorld, url: str, tmp_path: Path, source: str
) -> None:
    """A new mirror, one that follows its changes, one made anew: mode, position and first question."""
    asked: list[RequestInfo] = []
    world.on_request = asked.append
    options: dict[str, Any] = {"api_url": url, "source": source}
    with Store.open(tmp_path / "a.db") as store:
        for fresh, mode, word in (
            (False, "backfill", "/vegobjekter/95?"),
            (False, "changes", "start="),
            (True, "backfill", "/vegobjekter/95?"),
        ):
            plan = dry_run(Area(), store=store, fresh=fresh, **options)
            assert (plan.mode, word in plan.first_url) == (mode, True)
            assert plan.expected == {95: 30, 96: 60}
            position = (store.fact("mirror") or {}).get("position")
            assert plan.position == (position if mode == "changes" else None)
            asked.clear()
            assert sync_nvdb(store, Area(), fresh=fresh, **options).mode == mode
            path = urlsplit(plan.first_url)
            question = path.path, dict(parse_qsl(path.query))
            assert question in [(info.path, dict(info.query)) for info in asked]


def test_dry_run_goes_on_with_an_interrupted_backfill(world: ReplayWorld, url: str, tmp_path: Path) -> None:
    """It asks from where the pages stopped, and leaves what is aside as it is."""
    with Store.open(tmp_path / "a.db") as store, ReplayServer(world, faults=_no_plates) as server:
        with pytest.raises(HttpStatusError):
            sync_nvdb(store, Area(), api_url=server.url)
        before = store.fact("mirror_backfill")
        assert before is not None
        plan = dry_run(Area(), api_url=server.url, store=store)
        assert (plan.mode, plan.position) == ("resumed", before["position"])
        assert dict(parse_qsl(urlsplit(plan.first_url).query))["start"] == before["cursors"]["95"]
        assert store.fact("mirror_backfill") == before
        assert dry_run(Area(), api_url=url, store=store).mode == "backfill"  # another address


def test_dry_run_refuses_what_the_sync_would_refuse(url: str, tmp_path: Path) -> None:
    """Another area than the store's, unless it may be replaced."""
    with Store.open(tmp_path / "a.db") as store:
        sync_nvdb(store, Area.from_fylker_text("50"), api_url=url)
        other = Area.from_fylker_text("3")
        with pytest.raises(RefusedError, match="--replace"):
            dry_run(other, api_url=url, store=store)
        assert dry_run(other, api_url=url, store=store, replace=True).mode == "backfill"


def test_dry_run_of_the_command_knows_the_store(twin: Twin, url: str, tmp_path: Path) -> None:
    """It follows the changes of the mirror that is there, refuses another area, and makes no store."""
    path = tmp_path / "a.db"
    command = ["sync-nvdb", "--api-url", url, "--store", path]
    assert "Would mirror fylke 50" in twin(*command, "--fylke", "50", "--dry-run").out
    assert not path.exists()
    twin(*command, "--fylke", "50")
    shown = twin(*command, "--dry-run")
    position = twin("status", "--store", path, "--json").json["mirror"]["position"]
    assert f"Would follow the changes of fylke 50 since {position}" in " ".join(shown.out.split())
    assert "/vegobjekter/endringer?" in shown.out
    refused = twin(*command, "--fylke", "3", "--dry-run")
    assert (refused.code, "--replace" in refused.err) == (5, True)
    assert "Would mirror fylke 03" in twin(*command, "--fylke", "3", "--replace", "--dry-run").out


def _no_roads(info: RequestInfo) -> Fault | None:
    """The road network cannot be had."""
    return Fault("status", 403) if "segmentert" in info.path else None


def test_signs_are_shown_where_the_network_fails(twin: Twin, world: ReplayWorld, tmp_path: Path) -> None:
    """Exit code 3, but the signs are in the mirror and their table, or JSON document, was printed."""
    path = tmp_path / "a.db"
    with ReplayServer(world, faults=_no_roads) as server:
        command = ["sync-nvdb", "--all", "--vegnett", "--api-url", server.url, "--store", path]
        shown = twin(*command)
        assert (shown.code, "NVDB: the whole country" in shown.out) == (3, True)
        assert "The signs are synced and kept; the road network is not yet." in shown.err
        plain = twin(*command, "--json")
        assert (plain.code, plain.json["mode"]) == (3, "changes")
    status = twin("status", "--store", path, "--json").json
    assert (status["skiltpunkt"], status["vegnett"]) == (30, None)


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
