"""The generated country: consistent with itself in both forms, lazy, and changeable."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from typing import Any
from urllib.request import Request, urlopen

import pytest
from checkout import ROOT
from nvdb_country import GeneratedWorld

from nvdb.area import Area
from nvdb.datakatalog import snapshot
from nvdb.errors import ReplaySourceError
from nvdb.mirror import LesV4Source, UberiketSource
from nvdb.objects import skilt_from_les_v4
from nvdb.replay.uberiket import uberiket_from_les_v4


def objects(world: GeneratedWorld, type_id: int, **query: str) -> list[dict[str, Any]]:
    """Objects of one V4 page."""
    found: list[dict[str, Any]] = json.loads(world.page_body(type_id, query, "http://x"))["objekter"]
    return found


def bare(world: GeneratedWorld, type_id: int, **query: str) -> list[dict[str, Any]]:
    """Objects of one Uberiket page."""
    body = world.uberiket_body(type_id, query, "http://x")
    assert body is not None
    found: list[dict[str, Any]] = json.loads(body)["vegobjekter"]
    return found


def test_generated_signs_are_signs_without_problems() -> None:
    """Every generated object parses as V4's form with nothing to complain of, and uses known ids only."""
    world = GeneratedWorld(60, 130, seed=5)
    katalog = snapshot()
    for type_id in (95, 96):
        for raw in objects(world, type_id):
            assert skilt_from_les_v4(raw, type_id).problems == ()
            assert not any(katalog.is_unknown(e["id"], e.get("enum_id")) for e in raw["egenskaper"])


@pytest.mark.parametrize("type_id", [95, 96])
def test_generated_forms_agree(type_id: int) -> None:
    """Uberiket's template says what the conversion of V4's template says."""
    world = GeneratedWorld(60, 130, seed=6)
    assert bare(world, type_id) == [uberiket_from_les_v4(raw, type_id) for raw in objects(world, type_id)]


@pytest.mark.parametrize(("n_points", "n_plates"), [(1, 1), (7, 3), (10, 10), (13, 29), (5, 0)])
def test_generated_points_and_plates_point_at_each_other(n_points: int, n_plates: int) -> None:
    """The points' children and the plates' parents are the same relation, and no plate is without a point."""
    world = GeneratedWorld(n_points, n_plates)
    points = [skilt_from_les_v4(raw, 95) for raw in objects(world, 95)]
    plates = [skilt_from_les_v4(raw, 96) for raw in objects(world, 96)]
    children = [(child, point.nvdb_id) for point in points for child in point.plate_ids]  # type: ignore[union-attr]
    assert sorted(children) == sorted((plate.nvdb_id, plate.point_id) for plate in plates)  # type: ignore[union-attr]
    assert len(plates) == n_plates
    where = {point.nvdb_id: point.position for point in points}
    assert all(plate.position == where[plate.point_id] for plate in plates)  # type: ignore[index, union-attr]


def test_generated_segments_say_where_they_are() -> None:
    """Each vegsegment has the object's place, geometry and road reference, as NVDB's own have."""
    world = GeneratedWorld(20, 50)
    for raw in (*objects(world, 95), *objects(world, 96)):
        (segment,), (place,) = raw["vegsegmenter"], raw["lokasjon"]["stedfestinger"]
        assert segment["vegsystemreferanse"] == raw["lokasjon"]["vegsystemreferanser"][0]
        assert segment["geometri"] == raw["lokasjon"]["geometri"]
        for name in ("veglenkesekvensid", "relativPosisjon", "retning"):
            assert segment[name] == place[name]


def test_generated_world_depends_on_its_seed_and_not_on_its_pages() -> None:
    """An object is the same alone, on a small page and on a large one; another seed gives other signs."""
    world = GeneratedWorld(20, 50, seed=1)
    whole = objects(world, 96)
    assert objects(world, 96, antall="5", start=f"{whole[9]['id']}:1") == whole[10:15]
    assert world.one(96, whole[33]["id"]).raw == whole[33]  # type: ignore[union-attr]
    assert objects(GeneratedWorld(20, 50, seed=2), 96)[0]["egenskaper"] != whole[0]["egenskaper"]


def test_generated_world_changes_like_any_other(api: Any, plate: Callable[..., Any]) -> None:
    """Changed, removed and added objects take their place among the generated ones, in both forms."""
    world = GeneratedWorld(20, 50)
    ids = world.ids(96, 50)
    world.remove(ids[3])
    world.update(ids[4], egenskaper=[])
    world.create(96, plate(ids[10] + 1))
    world.new_version(ids[20], "2026-01-01")
    expected = sorted([*ids, ids[10] + 1])
    expected.remove(ids[3])
    client, _ = api.serve(world)
    for kind in (LesV4Source, UberiketSource):
        for size in (7, 1000):
            source = kind(client, page_size=size)
            found = [s for page in source.pages(96, Area()) for s in page.objects]
            assert [s.nvdb_id for s in found] == expected
            assert found[3].raw["egenskaper"] in ([], {})
            assert source.count(96, Area()) == len(expected)
            assert source.fetch(96, [ids[3], ids[5]], Area()).missing == {ids[3]}
    world.recreate(ids[3])
    assert world.count(96, {}) == 51


def test_generated_world_of_a_country_begins_at_once() -> None:
    """A country needs no building: the last of its 1,153,655 plates is made without those before it."""
    world = GeneratedWorld(573_299, 1_153_655)
    (last,) = world.ids(96, 1_153_655, 1_153_654)
    assert [raw["id"] for raw in objects(world, 96, start=f"{last - 1}:1")] == [last]
    (point,) = world.ids(95, 573_299, 573_298)
    assert last in skilt_from_les_v4(world.one(95, point).raw, 95).plate_ids  # type: ignore[union-attr]


def test_generated_world_refuses_filters_and_plates_without_points(api: Any) -> None:
    """What it cannot answer is refused, not answered wrongly."""
    client, _ = api.serve(GeneratedWorld(2, 4))
    with pytest.raises(Exception, match="kommune"):
        client.get_json("/vegobjekter/96", {"kommune": "5001"})
    with pytest.raises(ReplaySourceError, match="plates need points"):
        GeneratedWorld(0, 4)


def test_country_command_serves_and_changes_objects_when_told() -> None:
    """The country is served from a process of its own, and a line on stdin makes changes for its feeds."""
    command = [sys.executable, str(ROOT / "benchmarks/nvdb_country"), "20,40", "--port", "0", "--touch"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            url = process.stdout.readline().split()[0]
            process.stdin.write("96 3\n")
            process.stdin.flush()
            assert process.stdout.readline() == "touched\n"
            feed = f"{url}/uberiket/api/v1/hendelser/vegobjekter/96"
            with urlopen(Request(feed, headers={"X-Client": "test"})) as answer:
                assert [event["hendelseId"] for event in json.load(answer)["hendelser"]] == [1, 2, 3]
            process.send_signal(signal.SIGINT)
            assert process.wait(300) == 0
        finally:
            process.kill()
