"""The sample in ``data/``: remade byte for byte, and as different from its NVDB as it says."""

from __future__ import annotations

import csv
import json
import re
import tomllib
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import ROOT

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.simulation.simulate import NoiseSpec, scenario, simulate_drive
from nvdb.area import Area
from nvdb.client import NvdbClient, iter_pages
from nvdb.objects import Skiltplate, Skiltpunkt, skilt_from_les_v4
from nvdb.replay import ReplayServer
from nvdb.vegnett import BILVEG, Vegnett, hent_vegnett, stedfester
from twin.drives.read import read_drive
from twin.errors import TwinError
from twin.samples.sample import MISREAD, MOVED, NEW, SECOND_TRIP, SEED, TRIP, WRONG_TYPE, main, make_sample
from twin.samples.sample_nvdb import MAIN_LINK

DATA = ROOT / "data"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a freshly made sample."""
    folder = tmp_path_factory.mktemp("sample")
    make_sample(folder)
    return folder


def _content(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def _rows(name: str) -> list[dict[str, str]]:
    with (DATA / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _objects(type_id: int) -> list[dict[str, Any]]:
    pages = sorted((DATA / "nvdb").glob(f"*_{type_id}_page*.json"))
    return [o for page in pages for o in json.loads(page.read_text(encoding="utf-8"))["objekter"]]


def _points() -> dict[int, Skiltpunkt]:
    found = [skilt_from_les_v4(raw, 95) for raw in _objects(95)]
    return {point.nvdb_id: point for point in found if isinstance(point, Skiltpunkt)}


def _plates() -> dict[int, Skiltplate]:
    found = [skilt_from_les_v4(raw, 96) for raw in _objects(96)]
    return {plate.nvdb_id: plate for plate in found if isinstance(plate, Skiltplate)}


def _truth() -> dict[str, FloatArray]:
    return {
        row["object"]: np.array([float(row["easting"]), float(row["northing"])]) for row in _rows("truth.csv")
    }


def _plan(point: Skiltpunkt) -> FloatArray:
    assert point.position is not None
    return np.array([point.position.east_m, point.position.north_m])


def test_shipped_sample_is_what_the_command_makes(made: Path) -> None:
    """Every shipped file but the README equals the freshly made one, byte for byte, and none is left over."""
    shipped = _content(DATA)
    shipped.pop("README.md")
    fresh = _content(made)
    assert sorted(shipped) == sorted(fresh)
    assert [name for name in fresh if shipped[name] != fresh[name]] == []


def test_making_twice_changes_nothing(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command over an existing sample leaves the same bytes, and says how much it wrote."""
    main([str(tmp_path)])
    main([str(tmp_path)])
    assert _content(tmp_path) == _content(made)
    assert re.search(r"^\d+ files, \d+ kB in ", capsys.readouterr().out)


def test_another_seed_makes_another_sample(made: Path, tmp_path: Path) -> None:
    """The seed decides: another one gives the same files with other fixes and other NVDB positions."""
    make_sample(tmp_path, SEED + 1)
    one, other = _content(made), _content(tmp_path)
    assert sorted(one) == sorted(other)
    for name in (f"{TRIP}/gnss50_vehicle.bin", f"{TRIP}/C3_tricam120.xml", "nvdb/skiltpunkt_95_page1.json"):
        assert one[name] != other[name]


def test_sample_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    """A folder that is a file is refused in one sentence; the command ends with 1."""
    blocked = tmp_path / "data"
    blocked.write_text("", encoding="utf-8")
    with pytest.raises(TwinError, match="cannot be written"):
        make_sample(blocked)
    with pytest.raises(SystemExit) as ended:
        main([str(blocked)])
    assert ended.value.code == 1


def test_sample_is_small() -> None:
    """The shipped sample stays below 700 kB, a third of what the project allows."""
    assert sum(len(content) for content in _content(DATA).values()) < 700_000


def test_drive_reads_without_a_skip_or_a_warning() -> None:
    """The reader takes everything: 15 objects in two cameras, two antennas, nothing skipped, no warning."""
    drive = read_drive(DATA / TRIP)
    assert (drive.skipped, drive.warnings) == ((), ())
    assert drive.annotations_complete
    assert drive.datum == "EUREF89"
    assert set(drive.annotations.object) == set(_truth())
    assert set(drive.annotations.camera) == {"C2_tricam60", "C3_tricam120"}
    assert [fixes.antenna for fixes in drive.gnss] == ["gnss50:vehicle", "gnss52:vehicle"]
    assert (
        tomllib.loads((DATA / TRIP / "drive.toml").read_text(encoding="utf-8"))["annotations_complete"]
        is True
    )


def test_truth_is_where_the_simulator_put_the_poles() -> None:
    """truth.csv has the simulated feet in EPSG:25833 to the millimetre, under the annotator's object ids."""
    objects = simulate_drive(scenario("sample"), SEED).objects
    truth = _truth()
    assert list(truth) == list(objects.object)
    for i, name in enumerate(objects.object):
        assert truth[str(name)] == pytest.approx(
            [objects.east_utm33_m[i], objects.north_utm33_m[i]], abs=5.1e-4
        )


def test_nvdb_differs_as_expected_changes_says() -> None:
    """Unchanged poles are 0.1 to 0.3 m off, the moved one 3 m, and only the wrong type differs in code."""
    points, plates, truth = _points(), _plates(), _truth()
    rows = _rows("expected_changes.csv")
    verdicts = [row["verdict"] for row in rows]
    assert {v: verdicts.count(v) for v in verdicts} == {
        "unchanged": 11, "moved": 1, "new": 1, "wrong_type": 1, "missing": 1, "review": 1
    }  # fmt: skip
    for row in rows:
        if row["verdict"] in ("unchanged", "moved"):
            point = points[int(row["nvdb_id"])]
            distance = float(np.linalg.norm(_plan(point) - truth[row["object"]]))
            low, high = (2.9, 3.1) if row["verdict"] == "moved" else (0.099, 0.301)
            assert low <= distance <= high, row
            codes = [plates[i].skiltnummer for i in point.plate_ids]
            assert codes == row["skiltnummer_nvdb"].split(";") == row["skiltnummer_seen"].split(";")
    by_verdict = {row["verdict"]: row for row in rows}
    assert by_verdict["moved"]["object"] == MOVED
    assert by_verdict["new"]["object"] == NEW
    wrong = by_verdict["wrong_type"]
    assert (wrong["object"], wrong["nvdb_type"]) == (WRONG_TYPE, "96")
    assert (plates[int(wrong["nvdb_id"])].skiltnummer, wrong["skiltnummer_seen"]) == ("362.60", "362.50")


def test_second_drive_reads_like_the_first_but_for_one_arrow() -> None:
    """It passes P10 to P13 three months later; only on P13 its annotator set another code."""
    first, second = (read_drive(DATA / name) for name in (TRIP, SECOND_TRIP))
    assert (second.skipped, second.warnings) == ((), ())
    days = [int(drive.gnss[0].epoch_ns[0]) / 86_400e9 for drive in (first, second)]
    assert 90 < days[1] - days[0] < 100
    codes = [
        dict(zip(d.annotations.object.tolist(), d.annotations.skiltnummer, strict=True))
        for d in (first, second)
    ]
    assert set(codes[1]) <= set(codes[0])
    assert {name for name in codes[1] if codes[1][name] != codes[0][name]} == {MISREAD}
    row = next(row for row in _rows("expected_changes.csv") if row["verdict"] == "review")
    assert (row["object"], row["skiltnummer_nvdb"], row["skiltnummer_seen"]) == (
        MISREAD, "404.1", "404.1 or 404.2"
    )  # fmt: skip


def test_road_network_runs_past_every_sign_of_its_road() -> None:
    """Each sign's own stedfesting is where our reckoning puts its place on the road, to half a metre."""
    with ReplayServer(DATA / "nvdb") as server, NvdbClient(server.url) as client:
        pages = list(hent_vegnett(client, Area(kommuner=(5001,))))
    nett = Vegnett.from_les_v4(link for page in pages for link in page.objects)
    assert list(nett.rejected) == []
    raws = [
        raw for raw in _objects(95) if raw["lokasjon"]["stedfestinger"][0]["veglenkesekvensid"] == MAIN_LINK
    ]
    assert len(raws) == 15
    stated = np.array([raw["lokasjon"]["stedfestinger"][0]["relativPosisjon"] for raw in raws])
    sides = [raw["lokasjon"]["stedfestinger"][0]["sideposisjon"] for raw in raws]
    plan = np.array([_plan(_points()[raw["id"]]) for raw in raws])
    places = stedfester(nett, on_date=date(2026, 6, 10), type_veg=BILVEG).stedfest(plan[:, 0], plan[:, 1])
    assert places.found.all()
    assert np.abs(places.relativ_posisjon - stated).max() * 1000.0 < 0.5
    assert places.sideposisjon.tolist() == sides


def test_new_and_missing_poles_have_nothing_near_them() -> None:
    """NVDB has nothing within 15 m of the new pole, and no pole stands within 10 m of the missing one."""
    points, truth = _points(), _truth()
    assert min(np.linalg.norm(_plan(p) - truth[NEW]) for p in points.values()) > 15.0
    missing = next(row for row in _rows("expected_changes.csv") if row["verdict"] == "missing")
    gone = _plan(points[int(missing["nvdb_id"])])
    assert min(np.linalg.norm(gone - place) for place in truth.values()) > 10.0
    drive = simulate_drive(scenario("sample"), SEED).poses
    path = np.stack(utm33_from_geographic(drive.latitude_deg, drive.longitude_deg), axis=-1)
    assert np.linalg.norm(path - gone, axis=-1).min() < 6.0


def test_signs_on_side_roads_are_out_of_view() -> None:
    """What is not named in expected_changes.csv stands over 200 m from the drive; one has no own geometry."""
    points = _points()
    rows = _rows("expected_changes.csv")
    named = {int(row["nvdb_id"]) for row in rows if row["nvdb_type"] == "95" and row["nvdb_id"]}
    named |= {
        plate.point_id or 0
        for plate in _plates().values()
        if str(plate.nvdb_id) in {r["nvdb_id"] for r in rows}
    }
    rest = [point for number, point in points.items() if number not in named]
    assert len(rest) == 5
    poses = simulate_drive(scenario("sample"), SEED).poses
    path = np.stack(utm33_from_geographic(poses.latitude_deg, poses.longitude_deg), axis=-1)
    for point in rest:
        assert np.linalg.norm(path - _plan(point), axis=-1).min() > 200.0
    assert [point.own_geometry for point in rest].count(False) == 1


def test_pages_parse_without_a_problem() -> None:
    """Every object reads as a Skiltpunkt or Skiltplate, plates know their point, and no value is in doubt."""
    points, plates = _points(), _plates()
    assert (len(points), len(plates)) == (20, 24)
    for skilt in [*points.values(), *plates.values()]:
        assert skilt.problems == ()
        assert skilt.kommuner == (5001,)
        assert skilt.road_reference is not None
        assert skilt.accuracy_cm is not None or not skilt.own_geometry
    for number, plate in plates.items():
        assert plate.point_id is not None
        assert number in points[plate.point_id].plate_ids
        assert plate.position == points[plate.point_id].position
    heights = [p.position.height_m for p in points.values() if p.position]
    assert heights.count(None) == 5
    # The road climbs from 96 m above the ellipsoid, which is 56.6 m above sea level there.
    assert all(55.0 < h < 75.0 for h in heights if h is not None)


def test_replayed_pages_are_complete() -> None:
    """The replay server pages the folder to its end: the same ids as in the files, for kommune 5001 only."""
    with ReplayServer(DATA / "nvdb") as server, NvdbClient(server.url) as client:
        for type_id, known in ((95, _points()), (96, _plates())):
            params = {"kommune": "5001", "inkluder": "alle", "srid": "5973", "antall": "7"}
            got = [
                o["id"]
                for page in iter_pages(client, f"/vegobjekter/{type_id}", params)
                for o in page.objects
            ]
            assert got == sorted(known)
            elsewhere = iter_pages(client, f"/vegobjekter/{type_id}", params | {"kommune": "301"})
            assert [o for page in elsewhere for o in page.objects] == []


def test_readme_states_every_source_of_noise() -> None:
    """The README has every field of the sample's `NoiseSpec` with its value, the seed, and the command."""
    text, noise = (DATA / "README.md").read_text(encoding="utf-8"), scenario("sample").noise
    for field in fields(NoiseSpec):
        assert f"| `{field.name}` | {getattr(noise, field.name):g} |" in text, field.name
    assert "python -m twin.samples.sample data" in text
    assert str(SEED) in text
