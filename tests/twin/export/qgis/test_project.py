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

import pytest
from checkout import ROOT
from defusedxml.ElementTree import fromstring

from twin.export import COLUMNS, ExportLayers, edited_decisions, empty_layers, export_all
from twin.export.derived_layers import file_layers, in_wgs84
from twin.export.folder import UTM33, WGS84
from twin.export.layers import normalised
from twin.export.open_in_qgis import project_uri
from twin.export.qgis.project import GROUPS, document, project_row
from twin.export.qgis.qml import style

SYSTEM_PYTHON = Path("/usr/bin/python3")
SCRIPT = ROOT / "tests" / "qgis_open_project.py"
STYLES = {name: style(name, verdicts=()) for name in COLUMNS}
TIME = "2026-06-10T08:00:00.000Z"


def _projects(path: Path) -> list[tuple[str, str, str]]:
    with closing(sqlite3.connect(path)) as database:
        tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master")}
        if "qgis_projects" not in tables:
            return []
        rows: list[tuple[str, str, str]] = database.execute("SELECT * FROM qgis_projects").fetchall()
        return rows


def test_project_groups_hold_every_layer_once_in_the_order_of_the_file() -> None:
    """What lies on top in the file lies on top in the project, and nothing is forgotten."""
    assert [name for names in GROUPS.values() for name in names] == list(COLUMNS)


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
    assert sources == [f"./{UTM33}|layername={layer}" for layer in COLUMNS]
    ids = [element.text or "" for element in root.iterfind("projectlayers/maplayer/id")]
    assert len(set(ids)) == len(COLUMNS)
    assert all(len(layer_id) > 10 for layer_id in ids)
    assert ids == [element.get("id") for element in root.iter("layer-tree-layer")]


@pytest.mark.parametrize("degrees", [False, True])
def test_project_view_holds_the_findings_and_no_more_than_it_must(
    layers: ExportLayers, degrees: bool
) -> None:
    """The map is zoomed to the findings with a margin of a tenth, in metres and in degrees."""
    made = file_layers(normalised(layers))
    made = in_wgs84(made) if degrees else made
    west, south, east, north = made["changes"].total_bounds
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
    one = dataclasses.replace(layers, changes=layers.changes.iloc[:1])
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


@pytest.fixture(scope="module")
def opened(layers: ExportLayers, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return a file with a project, in a folder with a difficult name, and what QGIS says of it."""
    probe = [str(SYSTEM_PYTHON), "-c", "import qgis.gui"]
    environment = {**os.environ, "LC_ALL": "C.UTF-8", "QT_QPA_PLATFORM": "offscreen"}
    if not SYSTEM_PYTHON.exists() or subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("QGIS's Python bindings are not installed")
    folder = tmp_path_factory.mktemp("project") / "ferdig & 100 % på veg"
    export_all(layers, folder, project=True)
    uri = project_uri(folder / UTM33)
    command = [str(SYSTEM_PYTHON), str(SCRIPT), uri]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return folder / UTM33, json.loads(done.stdout)


@pytest.mark.qgis
def test_qgis_opens_the_project_with_every_layer(
    opened: tuple[Path, dict[str, Any]], layers: ExportLayers
) -> None:
    """Groups, order, CRS and rows are as they were written, and the ids are ours."""
    said = opened[1]
    assert (said["read"], said["error"], said["names"]) == (True, "", ["twin"])
    assert said["crs"] == "EPSG:25833"
    assert said["order"] == list(COLUMNS)
    rows = {name: len(frame) for name, frame in file_layers(normalised(layers)).items()}
    assert {group: [layer["name"] for layer in of] for group, of in said["groups"].items()} == {
        group: list(names) for group, names in GROUPS.items()
    }
    for layer in (layer for of in said["groups"].values() for layer in of):
        assert (layer["valid"], layer["crs"]) == (True, "EPSG:25833")
        assert layer["features"] == rows[layer["name"]]
        assert layer["id"] == f"twin_layer_{layer['name']}"


@pytest.mark.qgis
def test_qgis_finds_the_styles_in_the_project(opened: tuple[Path, dict[str, Any]]) -> None:
    """Colours, aliases and map tips are there; only the decision can be edited."""
    for layer in (layer for of in opened[1]["groups"].values() for layer in of):
        assert layer["renderer"] == "categorizedSymbol"
        assert layer["map_tip"]
        assert layer["aliases"] == {"fid": ""} | {c.name: c.label for c in COLUMNS[layer["name"]]}
        assert layer["editable"] == (["decision"] if layer["name"] == "changes" else [])
        assert layer["labels"] == (layer["name"] == "changes")


@pytest.mark.qgis
def test_qgis_is_zoomed_to_the_findings(opened: tuple[Path, dict[str, Any]], layers: ExportLayers) -> None:
    """The project opens where something was found."""
    west, south, east, north = opened[1]["view"]
    bounds = layers.changes.total_bounds
    assert west < bounds[0] < bounds[2] < east
    assert south < bounds[1] < bounds[3] < north


@pytest.mark.qgis
def test_qgis_form_saves_the_decision_and_nothing_else(opened: tuple[Path, dict[str, Any]]) -> None:
    """The form shows every column, the decision first; rounded numbers are not written back rounded."""
    path, said = opened
    decided = said["decided"]
    assert decided["form"][0] == "decision"
    assert sorted(decided["form"]) == sorted(column.name for column in COLUMNS["changes"])
    assert (decided["saved"], decided["changed"]) == (True, {"decision": "accept"})
    assert edited_decisions(path) == {decided["change_id"]: "accept"}
