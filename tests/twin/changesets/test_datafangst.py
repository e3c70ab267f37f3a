"""Accepted findings in Datafangst's form, as its documentation describes it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import pytest
from command_line import Twin
from findings import finding
from pyproj import Transformer

from nvdb.endringssett import Measured, Target, endringssett, position_correction
from twin.changesets import ChangeSets, files_of, groups_from_store
from twin.changesets.build import Sett
from twin.changesets.datafangst import datafangst
from twin.changesets.operations import Group
from twin.store.store import Store

MOVED, WRONG_PLATE, MISSING = 1042500106, 1042600114, 1042500115
# https://apiskriv.vegdata.no/datafangst/datafangst-api, sections Properties and geometryAttributes.
PROPERTIES = {
    "tag", "dataCatalogVersion", "typeId", "nvdbId", "nvdbVersion", "operation", "verticalDatum", "comment",
    "attributes", "geometryAttributes",
}  # fmt: skip
QUALITY = {
    "captureDate", "length", "measurementMethod", "measurementMethodHeight", "accuracy", "accuracyHeight",
    "visibility", "tolerance", "themeCode", "medium", "municipality", "heightRef", "referenceGeometry",
}  # fmt: skip


@pytest.fixture
def made(twin: Twin, matched_road: Path, tmp_path: Path) -> ChangeSets:
    """The sample's findings, all accepted, with a road network."""
    path = Path(shutil.copy(matched_road, tmp_path / "road.db"))
    verdicts = [part for name in ("new", "missing", "moved", "wrong_type") for part in ("--verdict", name)]
    assert twin("decide", "accept", *verdicts, "--by", "kari", "--store", path).code == 0
    with Store.open(path) as opened:
        return groups_from_store(opened)


def features(made: ChangeSets) -> list[dict[str, Any]]:
    """What is written for the only set."""
    document = json.loads(files_of(made)["datafangst-1.geojson"])
    assert document["type"] == "FeatureCollection"
    found: list[dict[str, Any]] = document["features"]
    return found


def test_datafangst_says_what_is_documented_and_nothing_else(made: ChangeSets) -> None:
    """Names of properties, what an existing and a new object must have, and numbers as text."""
    for feature in features(made):
        properties = feature["properties"]
        assert feature["type"] == "Feature"
        assert set(properties) <= PROPERTIES
        assert {"tag", "typeId", "dataCatalogVersion", "comment"} <= set(properties)
        if "nvdbId" in properties:
            assert properties["operation"] in {"CORRECT", "UPDATE", "CLOSE"}
            assert isinstance(properties["nvdbVersion"], int)
        else:
            assert "operation" not in properties
            assert "attributes" in properties
            assert feature["geometry"]["type"] == "Point"
        quality = properties.get("geometryAttributes", {})
        assert set(quality) <= QUALITY
        assert all(isinstance(value, str) for value in [*quality.values(), *properties.get("attributes", {})])
    ids = [f["properties"].get("nvdbId") for f in features(made) if "nvdbId" in f["properties"]]
    assert len(set(ids)) == len(ids)


def test_every_accepted_verdict_reaches_datafangst(made: ChangeSets) -> None:
    """Moved and wrong type are updates, what is gone is closed with its plate, a new pole brings plates."""
    found = [(f["properties"].get("operation"), f["properties"]["typeId"]) for f in features(made)]
    assert sorted(found, key=str) == [
        ("CLOSE", 95), ("CLOSE", 96), ("UPDATE", 95), ("UPDATE", 96), ("UPDATE", 96),
        (None, 95), (None, 96), (None, 96),
    ]  # fmt: skip
    by_id = {f["properties"].get("nvdbId"): f for f in features(made)}
    assert by_id[WRONG_PLATE]["properties"]["attributes"] == {"5530": "8874"}
    assert "geometry" not in by_id[WRONG_PLATE]
    assert "geometry" not in by_id[MISSING]
    assert by_id[MISSING]["properties"]["comment"].startswith("From 2026-06-10. twin ")


def test_datafangst_gives_the_measured_place_in_degrees(made: ChangeSets) -> None:
    """Longitude before latitude, to a millimetre of PROJ's; the accuracy is that of the change set."""
    (moved,) = (f for f in features(made) if f["properties"].get("nvdbId") == MOVED)
    stands = next(one for one in made.findings.values() if one.nvdb_id == MOVED)
    to_degrees = Transformer.from_crs(25833, 4326, always_xy=True)
    wanted = to_degrees.transform(round(stands.east_m, 3), round(stands.north_m, 3))
    assert moved["geometry"]["coordinates"][:2] == pytest.approx(wanted, abs=1e-8)
    quality = moved["properties"]["geometryAttributes"]
    assert quality["captureDate"] == "2026-06-10"
    assert 1 <= int(quality["accuracy"]) <= 20
    assert "measurementMethod" not in quality
    assert "Measured from pictures" in moved["properties"]["comment"]


def test_plates_in_datafangst_say_where_they_hang(made: ChangeSets) -> None:
    """The form knows no relations: the comment names the Skiltpunkt by its tag."""
    new = [f["properties"] for f in features(made) if "nvdbId" not in f["properties"]]
    (point,) = (properties for properties in new if properties["typeId"] == 95)
    plates = [properties for properties in new if properties["typeId"] == 96]
    assert len(plates) == 2
    assert all(f"Hangs on {point['tag']}." in plate["comment"] for plate in plates)
    assert {plate["attributes"]["5530"] for plate in plates} == {"7633", "7781"}


def test_datafangst_keeps_heights_and_corrections() -> None:
    """A position measured better corrects the version, with its height and that height's accuracy."""
    measured = Measured(
        east_m=270196.991,
        north_m=7041858.135,
        std_m=0.08,
        captured=date(2026, 10, 31),
        height_m=12.3,
        std_height_m=0.2,
    )
    group = position_correction(Target(95, 78735745, 3, datetime(2026, 11, 1, tzinfo=UTC)), measured)
    (sett,) = endringssett([group], datakatalogversjon="2.38")
    part = Sett(sett=sett, groups=(Group(("abc",), group),), errors=(), warnings=(), before=(), not_undone=())
    made = ChangeSets("accept", setts=(part,), findings={"abc": finding("abc")})
    (feature,) = json.loads(datafangst(made, part))["features"]
    assert feature["properties"]["operation"] == "CORRECT"
    assert feature["geometry"]["coordinates"][2] == 12.3
    assert feature["properties"]["geometryAttributes"] == {
        "captureDate": "2026-10-31", "accuracy": "8", "accuracyHeight": "20", "visibility": "0",
    }  # fmt: skip


def test_set_with_errors_goes_to_datafangst_no_more_than_to_nvdb(made: ChangeSets) -> None:
    """What our own checks refuse is not written in any form."""
    bad = replace(made, setts=tuple(replace(sett, errors=("wrong",)) for sett in made.setts))
    assert list(files_of(bad)) == ["proveniens.json"]


def test_datafangst_is_in_the_provenance_and_the_same_again(made: ChangeSets) -> None:
    """Its sum stands beside the set's, and the same findings give the same bytes."""
    first, second = files_of(made), files_of(made)
    assert first == second
    (sett,) = json.loads(first["proveniens.json"])["sets"]
    assert "datafangst-1.geojson" in sett["sha256"]
