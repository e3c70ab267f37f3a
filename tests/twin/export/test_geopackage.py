"""The GeoPackages as other programs read them."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pyogrio
import pytest
from defusedxml.ElementTree import fromstring
from pyproj import Transformer
from qgis_edits import opened_as_qgis_does

from twin.errors import ExportRefusedError
from twin.export import COLUMNS, ExportLayers, edited_decisions, empty_layers, export_all
from twin.export.derived_layers import file_layers
from twin.export.folder import UTM33, WGS84
from twin.export.geopackage import check_rows, write_geopackage
from twin.export.layers import GEOMETRY, KEY, normalised

SYSTEM_PYTHON = Path("/usr/bin/python3")
FILES = {UTM33: 25833, WGS84: 4326}
OGR = {
    "str": ("OFTString", "OFSTNone"),
    "int64": ("OFTInteger64", "OFSTNone"),
    "Int64": ("OFTInteger64", "OFSTNone"),
    "float64": ("OFTReal", "OFSTNone"),
    "bool": ("OFTInteger", "OFSTBoolean"),
    "datetime64[ms, UTC]": ("OFTDateTime", "OFSTNone"),
}


@pytest.fixture(scope="module", params=["filled", "empty"])
def folder(
    request: pytest.FixtureRequest, layers: ExportLayers, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Return an exported folder, once with rows and once without, which no test changes."""
    path: Path = tmp_path_factory.mktemp(request.param)
    export_all(layers if request.param == "filled" else empty_layers(), path)
    return path


@pytest.fixture(scope="module")
def filled(layers: ExportLayers, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an exported folder with rows, which no test changes."""
    path: Path = tmp_path_factory.mktemp("filled")
    export_all(layers, path)
    return path


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("layer", COLUMNS)
def test_geopackage_schema_reads_back(folder: Path, file: str, layer: str) -> None:
    """Every layer has its columns in order, its types, its geometry and its CRS, with rows or without."""
    info = pyogrio.read_info(folder / file, layer=layer)
    assert list(info["fields"]) == [column.name for column in COLUMNS[layer]]
    read = list(zip(info["ogr_types"], info["ogr_subtypes"], strict=True))
    assert read == [OGR[column.dtype] for column in COLUMNS[layer]]
    assert info["geometry_type"] == GEOMETRY[layer]
    assert info["crs"] == f"EPSG:{FILES[file]}"
    assert (info["fid_column"], info["geometry_name"]) == ("fid", "geom")


@pytest.mark.parametrize("layer", COLUMNS)
def test_geopackage_values_read_back(layers: ExportLayers, filled: Path, layer: str) -> None:
    """What was given is what is read: text, nulls, milliseconds and coordinates to the last bit."""
    given = file_layers(normalised(layers))[layer]
    read = pyogrio.read_dataframe(filled / UTM33, layer=layer).sort_values(KEY[layer], ignore_index=True)
    for column in COLUMNS[layer]:
        known = given[column.name].notna()
        assert (read[column.name].notna() == known).all(), column.name
        assert (read[column.name][known] == given[column.name][known]).all(), column.name
    assert (read.geometry.notna() == given.geometry.notna()).all()
    assert read.geometry.dropna().geom_equals(given.geometry.dropna()).all()


def test_geopackage_is_version_1_3_in_delete_mode(folder: Path) -> None:
    """OGC 12-128r17, requirement 2: user_version 10300; no write-ahead log, nothing but the three files."""
    for file in FILES:
        with opened_as_qgis_does(folder / file) as database:
            assert database.execute("PRAGMA user_version").fetchone() == (10300,)
            assert database.execute("PRAGMA application_id").fetchone() == (0x47504B47,)  # "GPKG"
            assert database.execute("PRAGMA journal_mode").fetchone() == ("delete",)
            assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    assert sorted(path.name for path in folder.iterdir()) == [
        *("changes.geojson", "positions.csv", "positions.geojson", UTM33, WGS84)
    ]


@pytest.mark.parametrize("file", FILES)
def test_geopackage_holds_a_default_style_a_layer(folder: Path, file: str) -> None:
    """layer_styles has one default a layer, for its real geometry column, and is a registered table."""
    with opened_as_qgis_does(folder / file) as database:
        rows = database.execute(
            "SELECT f_table_catalog, f_table_schema, f_table_name, s.useAsDefault, g.column_name, styleQML "
            "FROM layer_styles s JOIN gpkg_geometry_columns g "
            "ON g.table_name = f_table_name AND g.column_name = f_geometry_column ORDER BY id"
        ).fetchall()
        registered = database.execute(
            "SELECT data_type FROM gpkg_contents WHERE table_name = 'layer_styles'"
        ).fetchone()
    assert [row[:5] for row in rows] == [("", "", layer, 1, "geom") for layer in COLUMNS]
    assert [fromstring(row[5]).tag for row in rows] == ["qgis"] * len(COLUMNS)
    assert registered == ("attributes",)


@pytest.mark.parametrize("layer", COLUMNS)
def test_geopackage_wgs84_agrees_with_proj(filled: Path, layer: str) -> None:
    """PROJ's own way from EPSG:25833 to EPSG:4326 gives the same degrees to 1e-9 (0.1 mm)."""
    metres, degrees = (pyogrio.read_dataframe(filled / file, layer=layer).geometry for file in (UTM33, WGS84))
    to_wgs84 = Transformer.from_crs(25833, 4326, always_xy=True)
    wanted = np.column_stack(to_wgs84.transform(*metres.get_coordinates().to_numpy().T))
    np.testing.assert_allclose(degrees.get_coordinates().to_numpy(), wanted, rtol=0, atol=1e-9)
    assert (metres.isna() == degrees.isna()).all()


def test_geopackage_passes_gdals_validator(folder: Path) -> None:
    """GDAL's own validate_gpkg finds nothing in either file."""
    command = [str(SYSTEM_PYTHON), "-m", "osgeo_utils.samples.validate_gpkg"]
    probe = [str(SYSTEM_PYTHON), "-c", "import osgeo_utils.samples.validate_gpkg"]
    if not SYSTEM_PYTHON.exists() or subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("the system's Python has no GDAL")
    for file in FILES:
        done = subprocess.run([*command, str(folder / file)], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def test_geopackage_opens_in_ogrinfo_without_warnings(folder: Path) -> None:
    """The ogrinfo of the system, older than the GDAL that wrote the file, lists every layer silently."""
    if shutil.which("ogrinfo") is None:
        pytest.skip("ogrinfo is not installed")
    for file in FILES:
        done = subprocess.run(
            ["ogrinfo", "-ro", "-so", str(folder / file)], capture_output=True, text=True, check=True
        )
        assert done.stderr == ""
        lines = [line.split(" ", 1)[1] for line in done.stdout.splitlines() if line[:1].isdigit()]
        assert lines[:8] == [
            "changes (Point)",
            "moves (Line String)",
            "belief (Point)",
            "roads_to_drive (Line String)",
            "nvdb_signs (Point)",
            "estimates (Point)",
            "ellipses (Polygon)",
            "drives (Line String)",
        ]


def test_edited_decisions_are_those_changed_since_the_export(layers: ExportLayers, tmp_path: Path) -> None:
    """A decision that came from the store is no edit; one that a person sets, changes or clears is."""
    path = export_all(layers, tmp_path)[0]
    assert edited_decisions(path) == {}
    with opened_as_qgis_does(path) as database:
        database.execute("UPDATE changes SET decision = 'accept' WHERE change_id = 'c-01'")
        database.execute("UPDATE changes SET decision = NULL WHERE change_id = 'c-06'")
    assert edited_decisions(path) == {"c-01": "accept", "c-06": "open"}


def test_geopackage_row_numbers_of_changes_last(layers: ExportLayers, filled: Path, tmp_path: Path) -> None:
    """A change keeps its fid when others come and go: QGIS edits by fid, also what it read before."""
    export_all(dataclasses.replace(layers, changes=layers.changes.iloc[2:]), tmp_path)
    fids = []
    for folder in (filled, tmp_path):
        with opened_as_qgis_does(folder / UTM33) as database:
            fids.append(dict(database.execute("SELECT change_id, fid FROM changes")))
    assert fids[1].items() < fids[0].items()


@pytest.mark.parametrize("content", [b"", b"not a database", b"SQLite format 3\x00" + bytes(100)])
def test_edited_decisions_refuses_a_foreign_file(tmp_path: Path, content: bytes) -> None:
    """A file that twin did not write is named, with the cure."""
    path = tmp_path / UTM33
    path.write_bytes(content)
    with pytest.raises(ExportRefusedError, match="is not an export of twin, or is damaged: move it away"):
        edited_decisions(path)


def test_geopackage_that_lacks_a_row_is_refused(layers: ExportLayers, tmp_path: Path) -> None:
    """What GDAL did not write, without saying so, is found when the file is read back."""
    path = tmp_path / "x.gpkg"
    write_geopackage(file_layers(normalised(layers)), path, time="2026-06-10T08:00:00.000Z")
    with (
        opened_as_qgis_does(path) as database,
        pytest.raises(
            ExportRefusedError, match=r"x\.gpkg could not be written in full: layer changes has 7 of 8"
        ),
    ):
        check_rows(database, path, {"changes": 8, "drives": 1})
