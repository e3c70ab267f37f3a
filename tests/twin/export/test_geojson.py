"""changes.geojson against RFC 7946."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from twin.export import COLUMNS, ExportLayers, empty_layers, export_all
from twin.export.geojson import write_geojson


@pytest.fixture(scope="module")
def document(layers: ExportLayers, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """Return what another program reads."""
    path = export_all(layers, tmp_path_factory.mktemp("geojson"))[2]
    text = path.read_bytes().decode("utf-8")

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON (RFC 8259, section 6)")

    return json.loads(text, parse_constant=refuse)


def test_geojson_is_a_feature_collection_without_crs(document: dict) -> None:
    """RFC 7946, sections 3.3 and 4: a collection of features in WGS84; the crs member is gone."""
    assert document["type"] == "FeatureCollection"
    assert "crs" not in document
    assert all(set(feature) == {"type", "id", "geometry", "properties"} for feature in document["features"])


def test_geojson_positions_are_longitude_latitude_with_seven_decimals(document: dict) -> None:
    """Section 3.1.1: longitude first; Trondheim lies at 10° E, 63° N. Seven decimals are 1 cm."""
    for feature in document["features"]:
        longitude, latitude = feature["geometry"]["coordinates"]
        assert 10.3 < longitude < 10.5
        assert 63.3 < latitude < 63.5
        assert round(longitude, 7) == longitude
        assert round(latitude, 7) == latitude


def test_geojson_feature_ids_are_the_change_ids(document: dict, layers: ExportLayers) -> None:
    """Section 3.2: the identifier of a feature is its id; here the same for the same finding in every run."""
    assert [feature["id"] for feature in document["features"]] == sorted(layers.changes["change_id"])


def test_geojson_properties_are_the_columns(document: dict) -> None:
    """Every column is there in order; what is not known is null, and text keeps its letters."""
    by_verdict = {feature["properties"]["verdict"]: feature["properties"] for feature in document["features"]}
    assert list(by_verdict["new"]) == [column.name for column in COLUMNS["changes"]]
    assert by_verdict["new"]["nvdb_id"] is None
    assert by_verdict["new"]["distance_m"] is None
    assert by_verdict["moved"]["nvdb_id"] == 900_000_001
    assert by_verdict["moved"]["reason"] == 'Skjærgårdsveien <moved> & "so" on'


def test_geojson_of_nothing_is_an_empty_collection(tmp_path: Path) -> None:
    """No changes give a valid document without features."""
    path = export_all(empty_layers(), tmp_path)[2]
    assert json.loads(path.read_text(encoding="utf-8"))["features"] == []


def test_geojson_writes_moments_and_missing_positions(layers: ExportLayers, tmp_path: Path) -> None:
    """Other layers go the same way: times in ISO 8601 with Z, no position as a null geometry."""
    estimates = layers.estimates.to_crs(4326)
    estimates.geometry = [None, *estimates.geometry[1:]]
    write_geojson(estimates, "estimates", tmp_path / "e.geojson")
    feature = json.loads((tmp_path / "e.geojson").read_text(encoding="utf-8"))["features"][0]
    assert feature["geometry"] is None
    assert feature["properties"]["first_seen"] == "2026-06-10T08:00:00.125Z"


def test_geojson_refuses_metres(layers: ExportLayers, tmp_path: Path) -> None:
    """UTM33 is never written as if it were degrees."""
    with pytest.raises(ValueError, match="EPSG:4326"):
        write_geojson(layers.changes, "changes", tmp_path / "c.geojson")
