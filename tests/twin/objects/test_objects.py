"""``twin objects`` on a simulated drive: places against the truth, files, comparison with NVDB."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import geopandas as gpd
import numpy as np
import pyogrio
import pytest
import shapely
from command_line import Twin

from geoloc.earth.geodesy import utm33_covariance_from_enu, utm33_from_geographic
from nvdb.replay import ReplayServer, ReplayWorld
from nvdb.replay.pages import record_from_raw
from twin.drives.annotations.labels import read_label_map
from twin.drives.read import read_drive
from twin.errors import DriveError, FileError
from twin.objects import DriveObjects, GroundObject, GroundVerdict, compare, locate_objects, read_nvdb_objects
from twin.objects.shapes import plane_geometry
from twin.samples.ground_objects import CAMERA, LABELS, TRUTH, simulate_ground_objects

TYPES = (123, 9, 5, 181)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example's folder; copy it before writing."""
    folder = tmp_path_factory.mktemp("objects") / "trial"
    simulate_ground_objects(folder, seed=3)
    return folder


@pytest.fixture(scope="module")
def found(drive: Path) -> DriveObjects:
    """What is found in it."""
    return locate_objects(drive)


def truth_of(drive: Path) -> gpd.GeoDataFrame:
    """The true objects in EPSG:25833."""
    frame = gpd.read_file(drive / TRUTH).to_crs(25833)
    frame.geometry = shapely.force_2d(frame.geometry.to_numpy())
    return frame


def test_every_object_is_found_once_where_it_is(drive: Path, found: DriveObjects) -> None:
    """113 drawings are nine objects; each lies within three sigmas, lengths and areas too."""
    truth = truth_of(drive)
    assert len(found.objects) == len(truth) == 9
    assert Counter(one.kind for one in found.objects) == {"area": 3, "line": 3, "point": 3}
    left = set(truth.index)
    for one in found.objects:
        shape = plane_geometry(one)
        nearest = min(left, key=lambda k: shape.hausdorff_distance(truth.geometry[k]))
        left.remove(nearest)
        true = truth.geometry[nearest]
        measure, size = one.length or one.area, true.length if one.kind == "line" else true.area
        assert measure is None or abs(measure.value - size) < 3 * measure.sigma
        assert one.is_whole
        if one.kind == "line":
            assert shape.hausdorff_distance(true) < 1.5
            continue
        outline = one.outline
        off = np.stack(utm33_from_geographic(outline.latitude_deg, outline.longitude_deg), axis=1)
        off = off - shapely.get_coordinates(true)[: len(off)]
        covariance = utm33_covariance_from_enu(outline.corner_m2, outline.latitude_deg, outline.longitude_deg)
        assert (np.einsum("ki,kij,kj->k", off, np.linalg.inv(covariance), off) < 13.8).all()
    assert sum(one.n_drawn for one in found.objects) + sum(found.left_out.values()) == found.n_drawn


def verdicts(drive: Path, found: DriveObjects, *, all_drawn: bool) -> Counter[tuple[int, str]]:
    """Verdicts by type."""
    nvdb = [read_nvdb_objects(drive / f"nvdb_{number}.geojson", number) for number in TYPES]
    rows = compare(found, nvdb, all_drawn=all_drawn).rows
    return Counter((one.nvdb_type, str(one.verdict)) for one in rows)


def test_comparison_finds_what_the_example_was_made_to_hold(drive: Path, found: DriveObjects) -> None:
    """A kerb longer than in NVDB, a lamp that is gone, one that is new, two damages that NVDB lacks."""
    expected = {
        (9, "size differs"): 1,
        (5, "found"): 3,
        (123, "found"): 1,
        (123, "new"): 2,
        (181, "found"): 2,
        (181, "new"): 1,
    }
    assert verdicts(drive, found, all_drawn=True) == expected | {(181, "missing"): 1}
    assert verdicts(drive, found, all_drawn=False) == expected | {(181, "not drawn"): 1}


def test_missing_is_what_was_in_view_and_a_line_is_judged_by_its_stretches(
    drive: Path, found: DriveObjects, tmp_path: Path
) -> None:
    """A rail far off is not seen, one on the other side is missing; what goes beyond NVDB's kerb is told."""
    truth = truth_of(drive).set_index("id").geometry
    kerb, rail = truth["kerb"], truth["rail 2"]
    shifted = {
        "beside": shapely.offset_curve(rail, 9.0),
        "behind a field": shapely.offset_curve(rail, 28.0),
        "elsewhere": shapely.affinity.translate(rail, 200, 200),
    }
    path = tmp_path / "rails.gpkg"
    gpd.GeoDataFrame({"nvdb_id": list(shifted)}, geometry=list(shifted.values()), crs=25833).to_file(path)
    rails = compare(found, [read_nvdb_objects(path, 5)], all_drawn=True)
    assert {one.nvdb_id: one.verdict for one in rails.rows if one.nvdb_id} == {
        "beside": GroundVerdict.MISSING,
        "behind a field": GroundVerdict.NOT_SEEN,
    }
    assert rails.elsewhere == 1
    pieces = [shapely.ops.substring(kerb, 0.0, 20.0), shapely.ops.substring(kerb, 20.0, 40.0)]
    gpd.GeoDataFrame({"nvdb_id": ["a", "b"]}, geometry=pieces, crs=25833).to_file(path)
    first, last = compare(found, [read_nvdb_objects(path, 9)]).rows
    assert (first.verdict, last.verdict) == (GroundVerdict.FOUND, GroundVerdict.SIZE_DIFFERS)
    assert last.beyond_m == pytest.approx(kerb.length - 40.0, abs=1.5)
    gpd.GeoDataFrame({"nvdb_id": ["k"]}, geometry=[kerb], crs=25833).to_file(path)
    (row,) = compare(found, [read_nvdb_objects(path, 9)], all_drawn=True).rows
    assert row.verdict is GroundVerdict.FOUND


def test_api_les_is_asked_for_any_type_and_what_lies_on_the_centre_line_is_left_out(
    drive: Path, found: DriveObjects, twin: Twin, tmp_path: Path
) -> None:
    """The same lamps from NVDB's API, from its answer in a file, and from GeoJSON are judged alike."""
    lamps = gpd.read_file(drive / "nvdb_181.geojson").to_crs(25833)
    raws: list[dict[str, Any]] = [
        {
            "id": int(row["id"]),
            "href": "",
            "metadata": {"type": {"id": 181, "navn": "Lysmast"}, "versjon": 1, "startdato": "2020-01-01"},
            "geometri": {"wkt": shapely.to_wkt(row.geometry), "srid": 5973, "egengeometri": True},
        }
        for _, row in lamps.iterrows()
    ]
    raws[1]["geometri"]["egengeometri"] = False
    answer = tmp_path / "answer.json"
    answer.write_text(json.dumps({"objekter": raws}))
    of_file = read_nvdb_objects(answer, 181)
    assert (len(of_file.objects), of_file.left_out) == (2, 1)
    world = ReplayWorld({181: [record_from_raw(raw, 181).raw for raw in raws]})
    with ReplayServer(world) as server:
        told = twin("objects", drive, "--nvdb", 181, "--api-url", server.url, "--all-drawn", "--json").json
    assert told["nvdb_left_out"] == 1
    assert Counter(one["verdict"] for one in told["compared"]) == {"found": 2, "new": 1}


def test_files_are_what_gis_and_the_web_expect(drive: Path, twin: Twin, tmp_path: Path) -> None:
    """The GeoPackage is UTM33 with heights and an ellipse a corner, the GeoJSON RFC 7946."""
    out = tmp_path / "out"
    nvdb = f"9={drive / 'nvdb_9.geojson'}"
    told = twin("objects", drive, "--out", out, "--nvdb", nvdb, "--json").json
    file = out / "objects_utm33.gpkg"
    layers = dict(pyogrio.list_layers(file))
    assert layers == {
        "points": "Point Z",
        "lines": "MultiLineString Z",
        "areas": "Polygon Z",
        "corners": "Point Z",
        "ellipses": "Polygon",
        "compared_lines": "MultiLineString",
    }
    frames = {name: gpd.read_file(file, layer=name) for name in layers}
    assert all(frame.crs.to_epsg() == 25833 for frame in frames.values())
    corners, ellipses = frames["corners"], frames["ellipses"]
    assert len(corners) == sum(one["n_corners"] for one in told["objects"])
    area = np.pi * 5.991464547 * corners["sigma_major_m"] * corners["sigma_minor_m"]
    np.testing.assert_allclose(ellipses.area, area, rtol=0.01)
    assert corners["correlation_next"].dropna().between(0, 1).all()
    document = json.loads((out / "objects.geojson").read_text())
    assert "crs" not in document
    assert [one["properties"] for one in document["features"]] == told["objects"]
    web = gpd.read_file(out / "objects.geojson").to_crs(25833)
    at = gpd.read_file(out / "corners.geojson")
    assert len(at) == len(corners)
    assert "crs" not in json.loads((out / "corners.geojson").read_text())
    back = at.to_crs(25833).geometry.get_coordinates(include_z=True)
    np.testing.assert_allclose(back, corners.geometry.get_coordinates(include_z=True), rtol=0, atol=1e-3)
    lines = web[web["kind"] == "line"].geometry.length.to_numpy()
    np.testing.assert_allclose(lines, frames["lines"].geometry.length, atol=0.01)


def test_one_name_is_one_object_corner_by_corner_and_two_names_are_two(drive: Path, tmp_path: Path) -> None:
    """Two drawings of one damage lie on one another; the annotator's word counts for more."""
    folder = Path(shutil.copytree(drive, tmp_path / "named"))
    file = folder / f"{CAMERA}_ground.xml"
    document = ET.parse(file)

    def located(*names: str) -> list[GroundObject]:
        """Name the last drawings of the first damage, those nearest to it, and look for these names."""
        tracks = [track for track in document.iter("track") if track.get("label") == "krakelering"]
        frames = [int(track[0].get("frame", "")) for track in tracks]
        last = next(k for k in range(1, len(frames)) if frames[k] - frames[k - 1] > 100)
        for track, name in zip(tracks[last - len(names) : last], names, strict=True):
            for shape in track.iter("polygon"):
                shape[:] = []
                ET.SubElement(shape, "attribute", name="object").text = name
        document.write(file)
        return [one for one in locate_objects(folder).objects if one.object in names]

    (one,) = located("A", "A")
    assert (one.n_drawn, one.n_used) == (2, 2)
    alone = located("A", "B")
    assert sorted((other.object, other.n_used) for other in alone) == [("A", 1), ("B", 1)]
    sigmas = [np.trace(other.outline.own_m2, axis1=1, axis2=2).sum() for other in (one, *alone)]
    assert sigmas[0] < min(sigmas[1:])


def test_signs_of_the_drive_are_what_they_are_without_such_drawings(drive: Path, tmp_path: Path) -> None:
    """Nothing of what lies on the ground is read as a sign, nor left out."""
    alone = Path(shutil.copytree(drive, tmp_path / "alone"))
    (alone / f"{CAMERA}_ground.xml").unlink()
    with_both, signs = read_drive(drive), read_drive(alone)
    assert (len(with_both.on_ground), len(signs.on_ground)) == (113, 0)
    for name in ("camera", "frame", "object", "skiltnummer", "kind", "pixel_px"):
        np.testing.assert_array_equal(getattr(with_both.annotations, name), getattr(signs.annotations, name))
    assert with_both.skipped == signs.skipped
    assert with_both.drive_id == signs.drive_id


def test_a_drive_without_such_labels_and_wrong_meanings_are_told(trip: Path, tmp_path: Path) -> None:
    """Each with what to write."""
    with pytest.raises(DriveError, match=r"ground = true.*twin help objects"):
        locate_objects(trip)
    for wrong in ('{ ground = "yes" }', "{ ground = false }", "{}", "{ type = 5, on = true }"):
        with pytest.raises(DriveError, match="ground = true"):
            read_label_map(f'[labels]\n"kerb" = {wrong}\n'.encode())
    assert read_label_map(LABELS.encode()).is_on_ground("Kantstein")
    empty = tmp_path / "empty.geojson"
    empty.write_text('{"type": "FeatureCollection", "features": []}')
    with pytest.raises(FileError, match="holds no geometry"):
        read_nvdb_objects(empty, 5)
