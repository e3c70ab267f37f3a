"""Skiltpunkt and Skiltplate as the twin sees them."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from nvdb.datakatalog import Ansiktsside
from nvdb.errors import SchemaError
from nvdb.objects import (
    Position,
    Skiltplate,
    Skiltpunkt,
    skilt_from_les_v4,
    skilt_from_vegobjekt,
    vegobjekt_from_les_v4,
)


def _plate(raw: dict[str, Any]) -> Skiltplate:
    found = skilt_from_les_v4(raw, 96)
    assert isinstance(found, Skiltplate)
    return found


def test_skiltplate_has_every_typed_field(plate: Any) -> None:
    """Code, enum, facing, text, order, parent, place and quality come out typed."""
    raw = plate(700)
    found = _plate(raw)
    assert (found.nvdb_id, found.version, found.point_id) == (700, 2, 200)
    assert (found.skiltnummer, found.enum_id) == ("362.50", 8874)
    assert found.skiltnummer_text == "362.50 - Fartsgrense, 50 km/t"
    assert found.ansiktsside == "Trafikk i metreringsretning"
    assert found.ansiktsside_enum_id == Ansiktsside.MED_METRERINGSRETNING
    assert (found.text, found.plasseringskode) == ("50", 10)
    assert found.position == Position(270000.0, 7040700.0, 42.5)
    assert found.own_geometry
    assert (found.accuracy_cm, found.capture_method) == (12.0, "sat")
    assert found.road_reference == "EV6 S46D1 m1200"
    assert found.kommuner == (5001,)
    assert found.stedfesting[0].relativ_posisjon == 0.25
    assert (found.start_date, found.last_modified) == ("2020-05-01", "2024-03-02T10:11:12Z")
    assert not found.retired
    assert found.problems == ()
    assert found.raw is raw


def test_skiltpunkt_has_its_plates(point: Any) -> None:
    """A Skiltpunkt's children of type 96 are its plates; its point is the property 4794."""
    raw = point(200)
    raw["relasjoner"]["barn"].append({"type": {"id": 97}, "vegobjekter": [1]})
    found = skilt_from_les_v4(raw, 95)
    assert isinstance(found, Skiltpunkt)
    assert found.plate_ids == (700, 701)
    assert found.position == Position(270000.0, 7040200.0, 42.5)
    assert (found.version, found.accuracy_cm, found.capture_method) == (1, None, None)


def test_skiltplate_of_a_retired_code_says_so(plate: Any) -> None:
    """``U…`` codes are kept as they are and marked."""
    raw = plate(700)
    raw["egenskaper"][0] |= {"verdi": "U722.2 - Vegviser for vegkryss", "enum_id": 7765}
    found = _plate(raw)
    assert (found.skiltnummer, found.retired) == ("U722.2", True)


@pytest.mark.parametrize(
    ("verdi", "problem"),
    [("Annet", "no sign code"), ("", "missing"), (7, "instead of text"), (None, "missing")],
)
def test_skiltplate_without_a_readable_code_is_kept(plate: Any, verdi: object, problem: str) -> None:
    """A plate whose code cannot be read has none, and says why."""
    raw = plate(700)
    raw["egenskaper"][0]["verdi"] = verdi
    found = _plate(raw)
    assert found.skiltnummer is None
    assert not found.retired
    assert any(problem in text for text in found.problems)


def test_skiltplate_with_an_odd_property_is_kept(plate: Any) -> None:
    """A plasseringskode that is no whole number is None and told."""
    raw = plate(700)
    raw["egenskaper"][2]["verdi"] = "øverst"
    found = _plate(raw)
    assert found.plasseringskode is None
    assert found.problems == ("egenskap 5128 is 'øverst' instead of a whole number",)


def test_skiltplate_with_two_points_above_it_has_none(plate: Any) -> None:
    """Two parents contradict each other: neither is taken."""
    raw = plate(700)
    raw["relasjoner"]["foreldre"][0]["vegobjekter"] = [1, 2]
    found = _plate(raw)
    assert found.point_id is None
    assert "2 Skiltpunkt above it" in found.problems[0]


def test_skilt_points_and_plates_name_each_other(plate: Any, point: Any) -> None:
    """Down from the points' children and up from the plates' parents is the same relation."""
    points = [skilt_from_les_v4(point(number), 95) for number in (200, 202)]
    owner = {
        child: item.nvdb_id for item in points if isinstance(item, Skiltpunkt) for child in item.plate_ids
    }
    plates = [_plate(plate(number)) for number in (700, 702)]
    assert [item.point_id for item in plates] == [owner[item.nvdb_id] for item in plates] == [200, 202]


def test_skilt_of_another_type_is_refused(plate: Any, point: Any) -> None:
    """A Skiltpunkt is not read as a Skiltplate."""
    with pytest.raises(SchemaError):
        skilt_from_les_v4(point(200), 96)
    with pytest.raises(SchemaError, match="is of type 95"):
        skilt_from_vegobjekt(vegobjekt_from_les_v4(point(200)), 96)


def test_skilt_is_frozen(plate: Any) -> None:
    """What has been read is not changed afterwards."""
    with pytest.raises(dataclasses.FrozenInstanceError):
        _plate(plate(700)).skiltnummer = "202"  # type: ignore[misc]  # the point of the test
