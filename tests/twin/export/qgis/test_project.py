"""The QGIS project in the GeoPackage: the document, and what QGIS itself makes of it."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import sqlite3
import subprocess
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import pytest
from checkout import ROOT
from defusedxml.ElementTree import fromstring
from PIL import Image

from twin.export import COLUMNS, ExportLayers, empty_layers, export_all
from twin.export.derived_layers import file_layers, in_wgs84
from twin.export.folder import UTM33, WGS84
from twin.export.geopackage import Answer, edited_answers
from twin.export.layers import normalised
from twin.export.open_in_qgis import project_uri
from twin.export.qgis.project import BASE_MAP, CREDIT, FILTERED, GROUPS, THEMES, document, project_row
from twin.export.qgis.qml import style
from twin.words import Lang, say

SYSTEM_PYTHON = Path("/usr/bin/python3")
SCRIPT = ROOT / "tests" / "qgis_open_project.py"
STYLES = {name: style(name, verdicts=()) for name in COLUMNS}
TIME = "2026-06-10T08:00:00.000Z"


def _waiting(changes: Any) -> Any:
    """The rows that a person has to decide about, told another way than by the code under test."""
    return changes[
        (changes["decision"] == "open") & ~changes["verdict"].isin(["unchanged", "not_observable"])
    ]


def _projects(path: Path) -> list[tuple[str, str, str]]:
    with closing(sqlite3.connect(path)) as database:
        tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master")}
        if "qgis_projects" not in tables:
            return []
        rows: list[tuple[str, str, str]] = database.execute("SELECT * FROM qgis_projects").fetchall()
        return rows


NAMES = [name for names in GROUPS.values() for name in names]


def test_project_groups_hold_every_layer_once_in_the_order_of_the_file() -> None:
    """What lies on top in the file lies on top in the project, below what is to decide."""
    assert [*FILTERED, *COLUMNS, "base_map"] == NAMES


def test_project_names_no_folder_and_no_clock(layers: ExportLayers) -> None:
    """Sources are relative, ids are our own and longer than ten letters, the zip is of 1980."""
    made = file_layers(normalised(layers))
    name, metadata, content = project_row(made, STYLES, UTM33, TIME)
    with zipfile.ZipFile(io.BytesIO(bytes.fromhex(content))) as archive:
        (entry,) = archive.infolist()
        root = fromstring(archive.read(entry))
    assert (name, json.loads(metadata)["last_modified_time"]) == ("twin", TIME[:19])
    assert (entry.filename, entry.date_time) == ("twin.qgs", (1980, 1, 1, 0, 0, 0))
    sources = [element.text for element in root.iter("datasource")]
    assert [source.partition("|subset=")[0] for source in sources] == [
        *(f"./{UTM33}|layername={FILTERED.get(layer, (layer,))[0]}" for layer in NAMES[:-1]),
        BASE_MAP,
    ]
    ids = [element.text or "" for element in root.iterfind("projectlayers/maplayer/id")]
    assert len(set(ids)) == len(NAMES)
    assert all(len(layer_id) > 10 for layer_id in ids)
    assert ids == [element.get("id") for element in root.iter("layer-tree-layer")]


@pytest.mark.parametrize("degrees", [False, True])
def test_project_view_holds_the_findings_and_no_more_than_it_must(
    layers: ExportLayers, degrees: bool
) -> None:
    """The map is zoomed to what waits for a decision with a margin of a tenth, in metres and in degrees."""
    made = file_layers(normalised(layers))
    made = in_wgs84(made) if degrees else made
    west, south, east, north = _waiting(made["changes"]).total_bounds
    view = fromstring(document(made, STYLES, UTM33)).find("ProjectViewSettings/DefaultViewExtent")
    sides = [float(view.get(side)) for side in ("xmin", "ymin", "xmax", "ymax")]
    assert sides[0] < west < east < sides[2]
    assert sides[1] < south < north < sides[3]
    assert sides[2] - sides[0] == pytest.approx(1.2 * (east - west), rel=1e-4)


def test_project_of_no_rows_leaves_the_view_to_qgis() -> None:
    """There is nothing to zoom to."""
    root = fromstring(document(file_layers(empty_layers()), STYLES, UTM33))
    assert root.find("ProjectViewSettings") is None
    assert root.find("mapcanvas") is None


def test_project_of_one_finding_shows_fifty_metres(layers: ExportLayers) -> None:
    """A single point has no extent; the map still shows what is around it."""
    one = dataclasses.replace(layers, changes=_waiting(layers.changes).iloc[:1])
    view = fromstring(document(file_layers(normalised(one)), STYLES, UTM33)).find(
        "ProjectViewSettings/DefaultViewExtent"
    )
    assert float(view.get("xmax")) - float(view.get("xmin")) == pytest.approx(50.0, abs=0.01)


def test_export_with_a_project_gives_the_same_bytes_again(layers: ExportLayers, tmp_path: Path) -> None:
    """The project is in the UTM33 file alone, and costs it nothing of its sameness."""
    for name in ("a", "b"):
        export_all(layers, tmp_path / name, project=True)
    for file in (UTM33, WGS84):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert [name for name, _, _ in _projects(tmp_path / "a" / UTM33)] == ["twin"]
    assert _projects(tmp_path / "a" / WGS84) == []


def test_export_without_a_project_has_none(layers: ExportLayers, tmp_path: Path) -> None:
    """It is put in where it is asked for, and only there."""
    export_all(layers, tmp_path)
    assert _projects(tmp_path / UTM33) == []


def test_geopackage_with_a_project_passes_gdals_validator(layers: ExportLayers, tmp_path: Path) -> None:
    """GDAL's own validate_gpkg finds nothing."""
    probe = [str(SYSTEM_PYTHON), "-c", "import osgeo_utils.samples.validate_gpkg"]
    if not SYSTEM_PYTHON.exists() or subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("the system's Python has no GDAL")
    export_all(layers, tmp_path, project=True)
    command = [str(SYSTEM_PYTHON), "-m", "osgeo_utils.samples.validate_gpkg", str(tmp_path / UTM33)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def _opened(uri: str) -> dict[str, Any]:
    """What QGIS says of a project."""
    probe = [str(SYSTEM_PYTHON), "-c", "import qgis.gui"]
    environment = {**os.environ, "LC_ALL": "C.UTF-8", "QT_QPA_PLATFORM": "offscreen"}
    if not SYSTEM_PYTHON.exists() or subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("QGIS's Python bindings are not installed")
    command = [str(SYSTEM_PYTHON), str(SCRIPT), uri]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    said: dict[str, Any] = json.loads(done.stdout)
    return said


@pytest.fixture(scope="module")
def opened(layers: ExportLayers, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return a file with a project, in a folder with a difficult name, and what QGIS says of it."""
    folder = tmp_path_factory.mktemp("project") / "ferdig & 100 % på 'veg' #1"
    (folder / "crops").mkdir(parents=True)
    for crop, rgb in (("face", (255, 0, 0)), ("wide", (0, 0, 255))):
        Image.new("RGB", (30, 20), rgb).save(folder / "crops" / f"{crop}.webp", lossless=True)
    pictured = layers.changes.assign(crop_face="crops/face.webp", crop_wide="crops/wide.webp")
    export_all(dataclasses.replace(layers, changes=pictured), folder, project=True)
    return folder / UTM33, _opened(project_uri(folder / UTM33))


@pytest.mark.qgis
def test_qgis_opens_the_project_with_every_layer(
    opened: tuple[Path, dict[str, Any]], layers: ExportLayers
) -> None:
    """Groups, order, CRS and rows are as they were written, and the ids are ours."""
    said = opened[1]
    assert (said["read"], said["error"], said["names"]) == (True, "", ["twin"])
    assert said["crs"] == "EPSG:25833"
    assert said["order"] == [f"twin_layer_{name}" for name in NAMES]
    made = file_layers(normalised(layers))
    waiting = _waiting(made["changes"])
    rows = {name: len(frame) for name, frame in made.items()}
    rows["to_decide"] = len(waiting)
    rows["moves_to_decide"] = int(made["moves"]["change_id"].isin(waiting["change_id"]).sum())
    assert 0 < rows["moves_to_decide"] < rows["moves"]
    assert said["groups"] == {
        say(Lang.EN, f"qgis.group.{group}"): [f"twin_layer_{name}" for name in names]
        for group, names in GROUPS.items()
    }
    assert {layer["id"]: layer["features"] for layer in said["layers"]} == {
        f"twin_layer_{name}": n for name, n in rows.items()
    }
    assert all((layer["valid"], layer["crs"]) == (True, "EPSG:25833") for layer in said["layers"])


@pytest.mark.qgis
def test_qgis_opens_on_what_is_to_decide(opened: tuple[Path, dict[str, Any]]) -> None:
    """The two themes turn their layers on; the first is on from the start, and the base map in neither."""
    said = opened[1]
    shown = {
        say(Lang.EN, f"qgis.theme.{theme}"): sorted(map("twin_layer_{}".format, of))
        for theme, of in THEMES.items()
    }
    assert said["themes"] == shown
    assert said["visible"] == shown["To decide"]
    assert said["base_map"] == ["twin_layer_base_map", "wms", CREDIT]


@pytest.mark.qgis
def test_qgis_finds_the_styles_in_the_project(opened: tuple[Path, dict[str, Any]]) -> None:
    """Colours, aliases and map tips are there; only the decision can be edited."""
    for layer in opened[1]["layers"]:
        name = layer["id"].removeprefix("twin_layer_")
        table = FILTERED.get(name, (name,))[0]
        assert layer["name"] == say(Lang.EN, f"qgis.layer.{name}")
        assert layer["renderer"] == "categorizedSymbol"
        assert layer["map_tip"]
        assert layer["aliases"] == {"fid": ""} | {c.name: c.label for c in COLUMNS[table]}
        assert layer["editable"] == (["decision", "comment", "author"] if table == "changes" else [])
        assert layer["labels"] == (table == "changes")
        if table == "changes":
            assert layer["table"][:5] == ["verdict", "sign", "road", "reason", "decision"]
            assert "config_sha256" not in layer["table"]


@pytest.mark.qgis
def test_qgis_is_zoomed_to_the_findings(opened: tuple[Path, dict[str, Any]], layers: ExportLayers) -> None:
    """The project opens where something was found."""
    west, south, east, north = opened[1]["view"]
    bounds = _waiting(layers.changes).total_bounds
    assert west < bounds[0] < bounds[2] < east
    assert south < bounds[1] < bounds[3] < north


@pytest.mark.qgis
def test_qgis_form_saves_what_was_said_and_nothing_else(opened: tuple[Path, dict[str, Any]]) -> None:
    """The form shows every column and both pictures; rounded numbers are not written back rounded."""
    path, said = opened
    decided = said["decided"]
    assert decided["form"][0] == "decision"
    assert sorted(decided["form"]) == sorted(column.name for column in COLUMNS["changes"])
    answer = {"decision": "accept", "comment": "Står ikke lenger", "author": "kari"}
    assert (decided["saved"], decided["changed"]) == (True, answer)
    assert edited_answers(path) == {decided["change_id"]: Answer(*answer.values())}
    assert decided["left"] == decided["before"] - 1, "what is decided leaves the queue"
    ours = ["#ff0000", "#0000ff"]
    assert [colour for colour in decided["pictures"] if colour in ours] == ours, "others are icons"
    assert [Path(unquote(urlparse(source).path)).is_file() for source in decided["tip"]] == [True, True]


@pytest.mark.qgis
def test_qgis_speaks_norwegian(layers: ExportLayers, tmp_path: Path) -> None:
    """Layers, themes, columns and boxes of the form."""
    export_all(layers, tmp_path, project=True, lang=Lang.NB)
    said = _opened(project_uri(tmp_path / UTM33))
    assert list(said["groups"])[:2] == ["Å avgjøre", "Alle funn"]
    assert sorted(said["themes"]) == ["Alt", "Hvor sikre vi er", "Å avgjøre"]
    assert said["layers"][0]["aliases"]["author"] == "Avgjort av"
    assert {layer["id"]: layer["legend"] for layer in said["layers"]}["twin_layer_ellipses"] == [
        "CEP95 inntil 1 m",
        "CEP95 over 1 m",
    ]
    assert said["boxes"] == ["Avgjør", "Bilder", "Funn", "NVDB", "Opphav"]
