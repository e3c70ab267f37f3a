"""Parsing V4 objects: whole, bare, and broken."""

from __future__ import annotations

from typing import Any

import pytest

from nvdb.errors import SchemaError
from nvdb.objects import GeometriKvalitet, Position, Relasjon, VegobjektStedfesting, vegobjekt_from_les_v4


def test_vegobjekt_keeps_everything_of_a_whole_object(plate: Any) -> None:
    """Metadata, properties, place on the network, relations, geometry and the original are all there."""
    raw = plate(700)
    found = vegobjekt_from_les_v4(raw)
    assert (found.id, found.type_id, found.versjon) == (700, 96, 2)
    assert (found.startdato, found.sluttdato) == ("2020-05-01", None)
    assert found.sist_modifisert == "2024-03-02T10:11:12Z"
    assert list(found.egenskaper) == [5530, 1894, 5128, 1910, 4795]
    assert (found.egenskaper[5530].enum_id, found.egenskaper[5128].verdi) == (8874, 10)
    assert (found.kommuner, found.fylker) == ((5001,), (50,))
    assert found.vegsystemreferanser == ("EV6 S46D1 m1200", "FV1 S1D1 m0")
    assert found.stedfestinger == (
        VegobjektStedfesting(
            type="Punkt",
            veglenkesekvensid=2510771,
            relativ_posisjon=0.25,
            retning="MED",
            kjorefelt=("1",),
            sideposisjon="H",
            kortform="0.25@2510771",
        ),
    )
    assert found.foreldre == (Relasjon(type_id=95, vegobjekter=(200,), id=220004),)
    assert found.position == Position(270000.0, 7040700.0, 42.5)
    assert found.own_geometry
    assert found.kvalitet == GeometriKvalitet(datafangstmetode="sat", noyaktighet_cm=12.0)
    assert found.problems == ()
    assert found.raw is raw


def test_vegobjekt_of_an_id_alone_is_empty_and_not_wrong() -> None:
    """``inkluder=minimum`` brings id and href: everything else is None or empty, the type is in href."""
    found = vegobjekt_from_les_v4({"id": 7, "href": "https://x/vegobjekter/96/7"})
    assert (found.id, found.type_id, found.versjon, found.position) == (7, 96, None, None)
    assert not found.own_geometry
    assert found.egenskaper == {}
    assert found.problems == ()


def test_vegobjekt_type_comes_from_metadata_href_or_the_question() -> None:
    """Each of the three tells the type; without any, and where they contradict, it is a SchemaError."""
    assert vegobjekt_from_les_v4({"id": 7}, type_id=95).type_id == 95
    assert vegobjekt_from_les_v4({"id": 7, "metadata": {"type": {"id": 24}}}).type_id == 24
    assert vegobjekt_from_les_v4({"id": 7, "href": "/vegobjekter/api/v4/vegobjekter/95/7"}).type_id == 95
    with pytest.raises(SchemaError, match="is missing"):
        vegobjekt_from_les_v4({"id": 7})
    with pytest.raises(SchemaError, match=r"vegobjekt 7 .*is 95, but 96 was asked"):
        vegobjekt_from_les_v4({"id": 7, "href": "/vegobjekter/95/7"}, type_id=96)


def test_vegobjekt_prefers_its_geometry_property(plate: Any) -> None:
    """The property is UTM33 to the last digit even where ``geometri`` was asked for in degrees."""
    raw = plate(700, geometri={"wkt": "POINT Z (63.4 10.4 -999999)", "srid": 4326, "egengeometri": True})
    assert vegobjekt_from_les_v4(raw).position == Position(270000.0, 7040700.0, 42.5)


def test_vegobjekt_without_own_geometry_is_placed_on_the_network(plate: Any) -> None:
    """``egengeometri: false`` takes ``geometri`` and says that it is no own geometry."""
    raw = plate(700)
    raw["geometri"] = {"wkt": "POINT Z(269996 7040701 -999999)", "srid": 5973, "egengeometri": False}
    found = vegobjekt_from_les_v4(raw)
    assert found.position == Position(269996.0, 7040701.0, None)
    assert not found.own_geometry


def test_vegobjekt_falls_back_to_geometri_where_the_property_is_unusable(plate: Any) -> None:
    """A broken property is told, and the object keeps the position that V4 shows."""
    raw = plate(700)
    raw["egenskaper"][-1]["verdi"] = "POINT EMPTY"
    found = vegobjekt_from_les_v4(raw)
    assert found.position == Position(270000.0, 7040700.0, 42.5)
    assert found.own_geometry
    assert found.problems == ("egenskap 4795 is empty",)


@pytest.mark.parametrize(
    ("wkt", "problem"),
    [
        ("", "is empty"),
        ("POINT(nan nan)", "has NaN or infinite coordinates"),
        ("POINT(7040000 270000)", "its axes look swapped"),
        ("LINESTRING(0 0,1 1)", "is a LINESTRING, not a point"),
    ],
)
def test_vegobjekt_without_a_usable_point_is_kept_with_the_reason(plate: Any, wkt: str, problem: str) -> None:
    """No position is better than a wrong one: the object stays, with a clause for each source that failed."""
    raw = plate(700)
    raw["egenskaper"][-1]["verdi"] = wkt
    raw["geometri"]["wkt"] = wkt
    found = vegobjekt_from_les_v4(raw)
    assert found.position is None
    assert len(found.problems) == 2
    assert all(problem in text for text in found.problems)
    assert found.egenskaper[5530].enum_id == 8874


@pytest.mark.parametrize(("stated", "read"), [(-1, None), (0, 0.0), (277, 277.0), (None, None)])
def test_vegobjekt_accuracy_of_minus_one_is_unknown(
    plate: Any, stated: int | None, read: float | None
) -> None:
    """nøyaktighet -1 and absence are None; every other number is centimetres."""
    raw = plate(700)
    raw["egenskaper"][-1]["kvalitet"]["nøyaktighet"] = stated
    kvalitet = vegobjekt_from_les_v4(raw).kvalitet
    assert kvalitet is not None
    assert kvalitet.noyaktighet_cm == read


def test_vegobjekt_keeps_kinds_and_fields_that_nobody_knows(plate: Any) -> None:
    """A new egenskapstype, enum id or field of tomorrow is kept as it came."""
    raw = plate(700, nyttFelt={"x": 1})
    raw["egenskaper"].append({"id": 99999, "navn": "Ny", "egenskapstype": "Romskip", "verdi": {"fart": 3}})
    raw["egenskaper"][0]["enum_id"] = 123456789
    found = vegobjekt_from_les_v4(raw)
    assert found.egenskaper[99999].egenskapstype == "Romskip"
    assert found.egenskaper[99999].verdi == {"fart": 3}
    assert found.egenskaper[5530].enum_id == 123456789
    assert found.raw["nyttFelt"] == {"x": 1}


def test_vegobjekt_reads_lists_and_structures(plate: Any) -> None:
    """Members of a Liste are egenskaper too."""
    raw = plate(700)
    inner = {"id": 200004, "navn": "a", "egenskapstype": "Assosiasjon", "verdi": 5}
    raw["egenskaper"].append({"id": 220004, "navn": "b", "egenskapstype": "Liste", "innhold": [inner]})
    (member,) = vegobjekt_from_les_v4(raw).egenskaper[220004].innhold
    assert (member.id, member.verdi) == (200004, 5)


def test_vegobjekt_reads_relations_of_whole_objects(plate: Any) -> None:
    """``relasjonstype: vegobjekter`` holds whole objects: their ids are taken."""
    raw = plate(700)
    raw["relasjoner"] = {
        "barn": [
            {
                "id": 1,
                "type": {"id": 96},
                "relasjonstype": "vegobjekter",
                "vegobjekter": [{"id": 8}, {"id": 9}],
            }
        ]
    }
    assert vegobjekt_from_les_v4(raw).barn == (Relasjon(type_id=96, vegobjekter=(8, 9), id=1),)


def test_vegobjekt_tells_a_property_that_comes_twice_and_a_date_that_is_none(plate: Any) -> None:
    """The first of two is used; a date that cannot be is None; both are told."""
    raw = plate(700)
    raw["egenskaper"].append({"id": 5128, "navn": "x", "egenskapstype": "Heltall", "verdi": 99})
    raw["metadata"]["startdato"] = "2020-13-01"
    found = vegobjekt_from_les_v4(raw)
    assert found.egenskaper[5128].verdi == 10
    assert found.startdato is None
    assert len(found.problems) == 2


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        (("id",), None, "id is missing"),
        (("id",), True, "id is True"),
        (("id",), 1.5, "id is 1.5"),
        (("egenskaper",), {}, "egenskaper is {}"),
        (("egenskaper", 0), "x", r"egenskaper\[0\] is 'x'"),
        (("egenskaper", 1, "id"), None, r"egenskaper\[1\].id is missing"),
        (("egenskaper", 1, "enum_id"), "abc", r"egenskaper\[1\].enum_id"),
        (("egenskaper", 4, "kvalitet", "nøyaktighet"), "12 cm", "kvalitet.nøyaktighet"),
        (("metadata",), [], r"metadata is \[\]"),
        (("metadata", "versjon"), "to", "metadata.versjon"),
        (("lokasjon", "kommuner"), ["5001"], "lokasjon.kommuner"),
        (("lokasjon", "stedfestinger", 0, "relativPosisjon"), "0.5", r"stedfestinger\[0\].relativPosisjon"),
        (("lokasjon", "stedfestinger", 0, "kjørefelt"), [1], "kjørefelt"),
        (("relasjoner", "foreldre", 0, "type"), None, r"foreldre\[0\].type.id is missing"),
        (("relasjoner", "foreldre", 0, "vegobjekter"), ["a"], "vegobjekter"),
        (("geometri", "egengeometri"), "ja", "geometri.egengeometri"),
        (("geometri", "wkt"), 7, "geometri.wkt"),
    ],
)  # fmt: skip
def test_vegobjekt_names_the_object_and_the_field_that_breaks_the_form(
    plate: Any, path: tuple[Any, ...], value: Any, field: str
) -> None:
    """A field of the wrong type is a SchemaError with the id and the path of the field."""
    raw = plate(700)
    inner = raw
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    with pytest.raises(SchemaError, match=field) as caught:
        vegobjekt_from_les_v4(raw, type_id=96)
    assert f"In vegobjekt {raw['id']} " in str(caught.value)
