"""Links as API Les V4 and Uberiket write them, and what happens to those that break the form."""

from __future__ import annotations

from datetime import date
from typing import Any

import numpy as np
import pytest
from vegnett_links import segment

from nvdb.errors import SchemaError
from nvdb.vegnett import Vegnett, veglenke_from_les_v4, veglenker_from_uberiket


def _segment(**changes: Any) -> dict[str, Any]:
    """A piece of a link in V4's form, with a field that no client knows yet."""
    piece = {
        "veglenkenummer": 3,
        "segmentnummer": 2,
        "referanse": "1001-3-2",
        "kortform": "0.25-0.75@1001",
        "metadata": {"startdato": "2020-11-18"},
        "startposisjon": 0.25,
        "sluttposisjon": 0.75,
        "typeVeg": "Enkel bilveg",
        "feltoversikt": ["1", "2"],
        "lengde": 498.5,
        "nyttFelt2027": {"dypt": [1]},
    }
    link = segment(1001, "270000 7040000 10, 270300 7040400 10", "MOT", **piece)
    link["geometri"]["lengde"] = 500
    return link | changes


def _sekvens() -> dict[str, Any]:
    """A veglenkesekvens of two links in Uberiket's form."""
    link = {
        "gyldighetsperiode": {"startdato": "1950-01-01", "sluttdato": "2001-05-01"},
        "konnektering": False,
        "topologiniva": "VEGTRASE",
        "detaljniva": "VEGTRASE_OG_KJOREBANE",
        "typeVeg": "GANG_OG_SYKKELVEG",
        "feltoversikt": ["1"],
        "kommune": 301,
        "lengde": 10.0,
    }
    lines = ("LINESTRING Z(260000 6650000 1, 260010 6650000 1)", "LINESTRING(260010 6650000, 260010 6650030)")
    return {
        "id": 77,
        "porter": [
            {"nummer": 1, "nodeId": 5, "posisjon": 0.0},
            {"nummer": 2, "nodeId": 6, "posisjon": 1.0},
            {"nummer": 7, "nodeId": 8, "posisjon": 0.25},
        ],
        "veglenker": [
            link | {"nummer": 4, "startport": 1, "sluttport": 7, "geometri": {"wkt": lines[0], "srid": 5973}},
            link
            | {
                "nummer": 5,
                "startport": 7,
                "sluttport": 2,
                "konnektering": True,
                "topologiniva": "KJOREBANE",
                "gyldighetsperiode": {"startdato": "2001-05-01"},
                "geometri": {"wkt": lines[1], "srid": 5973},
            },
        ],
    }


def test_veglenke_of_les_keeps_all_that_is_documented() -> None:
    """A segment's numbers, positions, lanes, levels and road reference arrive; unknown fields are ignored."""
    link = veglenke_from_les_v4(_segment())
    assert (link.veglenkesekvensid, link.veglenkenummer, link.segmentnummer) == (1001, 3, 2)
    assert (link.startposisjon, link.sluttposisjon, link.lengde_m, link.geometri_lengde_m) == (
        0.25,
        0.75,
        498.5,
        500.0,
    )
    assert (link.detaljniva, link.type_veg, link.feltoversikt) == ("VTKB", "enkelBilveg", ("1", "2"))
    assert (link.startdato, link.sluttdato, link.konnektering, link.detaljert) == (
        date(2020, 11, 18),
        None,
        False,
        False,
    )
    assert link.referanse is not None
    assert (link.referanse.vegkategori, link.referanse.nummer, link.referanse.trafikantgruppe) == (
        "F",
        6690,
        "K",
    )
    assert (link.referanse.retning, link.referanse.fra_meter, link.referanse.til_meter) == (
        "MOT",
        100.0,
        598.5,
    )


def test_veglenke_in_an_intersection_is_metered_by_the_kryssdel() -> None:
    """Where a kryssystem is named, its direction and meters count, not those of the strekning above it."""
    system = {
        "strekning": {"retning": "MOT", "meter": 3211.697, "trafikantgruppe": "K"},
        "kryssystem": {"retning": "MED", "fra_meter": 24, "til_meter": 560, "trafikantgruppe": "K"},
        "kortform": "EV18 S53D1 m3212 KD3 m24-560",
    }
    reference = veglenke_from_les_v4(_segment(vegsystemreferanse=system)).referanse
    assert reference is not None
    assert (reference.retning, reference.fra_meter, reference.til_meter) == ("MED", 24.0, 560.0)


@pytest.mark.parametrize(
    ("kind", "niva", "konnektering", "detaljert"),
    [
        ("HOVED", "Vegtrase", False, False),
        ("KONNEKTERING", "Vegtrase", True, False),
        ("DETALJERT", "Kjørebane", False, True),
        ("DETALJERT_KONNEKTERING", None, True, True),
        ("Ukjent", "Vegtrase", False, False),
        ("NY_TYPE_2027", None, False, False),
    ],
)
def test_veglenke_type_says_konnektering_and_detaljert(
    kind: str, niva: str | None, konnektering: bool, detaljert: bool
) -> None:
    """Both flags follow from type and topologinivå, and a type that is new is no error."""
    link = veglenke_from_les_v4(_segment(type=kind, topologinivå=niva))
    assert (link.konnektering, link.detaljert) == (konnektering, detaljert)


def test_veglenke_without_road_reference_has_none() -> None:
    """An empty vegsystemreferanse is no reference, not an empty one."""
    assert veglenke_from_les_v4(_segment(vegsystemreferanse={})).referanse is None


@pytest.mark.parametrize(
    ("changes", "clause"),
    [
        ({"veglenkesekvensid": None}, "veglenkesekvensid is missing"),
        ({"startposisjon": None}, "startposisjon is missing"),
        ({"startposisjon": 1.5}, "startposisjon is 1.5, not between 0 and 1"),
        ({"startposisjon": 0.8}, "startposisjon (0.8) lies after the end (0.75)"),
        ({"sluttposisjon": "0.75"}, "sluttposisjon is '0.75' instead of a number"),
        ({"metadata": {}}, "metadata.startdato is missing"),
        ({"metadata": {"startdato": "18.11.2020"}}, "metadata.startdato is '18.11.2020' instead of a date"),
        ({"geometri": {"srid": 5973}}, "geometri.wkt is missing"),
        ({"geometri": {"wkt": "LINESTRING (1", "srid": 5973}}, "geometri.wkt is not readable WKT"),
        ({"geometri": {"wkt": "POINT (270000 7040000)", "srid": 5973}}, "geometri.wkt is not a line"),
        ({"geometri": {"wkt": "LINESTRING EMPTY", "srid": 5973}}, "geometri.wkt is not a line"),
        ({"geometri": {"wkt": "LINESTRING (63 10, 63 11)", "srid": 4326}}, "ask for srid=5973"),
        (
            {"geometri": {"wkt": "LINESTRING (7040000 270000, 7040001 270000)", "srid": 5973}},
            "outside Norway",
        ),
        (
            {"vegsystemreferanse": {"kortform": "EV6", "strekning": {"retning": "NED"}}},
            "instead of MED or MOT",
        ),
        ({"feltoversikt": "1"}, "feltoversikt is '1' instead of a list"),
    ],
)
def test_veglenke_that_breaks_the_form_is_named_with_its_field(changes: dict[str, Any], clause: str) -> None:
    """The error says which link, which field and what is wrong, in one sentence."""
    with pytest.raises(SchemaError) as caught:
        veglenke_from_les_v4(_segment(**changes))
    assert "veglenke 1001-3-2" in str(caught.value)
    assert clause in str(caught.value)


def test_veglenker_of_uberiket_take_their_positions_from_the_ports() -> None:
    """A link reaches from its start port's position to its end port's; names become those of Les."""
    first, second = veglenker_from_uberiket(_sekvens())
    assert (first.veglenkesekvensid, first.veglenkenummer, second.veglenkenummer) == (77, 4, 5)
    assert (first.startposisjon, first.sluttposisjon) == (0.0, 0.25)
    assert (second.startposisjon, second.sluttposisjon) == (0.25, 1.0)
    assert (first.type_veg, first.detaljniva, first.referanse) == ("gangOgSykkelveg", "VTKB", None)
    assert (first.konnektering, second.konnektering, second.detaljert) == (False, True, True)


def test_veglenker_of_uberiket_refuse_a_port_that_is_not_there() -> None:
    """A link that names an unknown port cannot be placed, and the error says which."""
    raw = _sekvens()
    raw["veglenker"][1]["sluttport"] = 9
    with pytest.raises(SchemaError, match=r"veglenkesekvens 77 .*sluttport names port 9"):
        list(veglenker_from_uberiket(raw))


def test_vegnett_keeps_what_is_readable_and_reports_the_rest() -> None:
    """One unreadable link costs itself alone, and is reported by name."""
    nett = Vegnett.from_les_v4([_segment(), _segment(referanse="1001-9-1", geometri={}), _segment()])
    assert len(nett) == 2
    assert len(nett.rejected) == 1
    assert "1001-9-1" in nett.rejected[0]


def test_vegnett_of_uberiket_leaves_out_a_broken_sekvens_whole() -> None:
    """A veglenkesekvens with a link that cannot be read gives none of its links."""
    broken = _sekvens() | {"id": 78}
    broken["veglenker"][1]["geometri"] = {}
    nett = Vegnett.from_uberiket([broken, _sekvens()])
    assert set(nett.veglenkesekvensid.tolist()) == {77}
    assert len(nett.rejected) == 1


def test_vegnett_validity_is_half_open() -> None:
    """On the day that one link ends and the next begins, exactly the next is valid."""
    nett = Vegnett.from_uberiket([_sekvens()])
    assert nett.veglenkenummer.tolist() == [4, 5]
    assert nett.valid(date(1949, 12, 31)).tolist() == [False, False]
    assert nett.valid(date(2001, 4, 30)).tolist() == [True, False]
    assert nett.valid(date(2001, 5, 1)).tolist() == [False, True]
    assert nett.valid().tolist() == [False, True]


def test_vegnett_rows_do_not_depend_on_the_order_of_arrival() -> None:
    """Links come out sorted by veglenkesekvens and position, however they came in."""
    links = [
        _segment(veglenkesekvensid=sekvens, startposisjon=start, sluttposisjon=start + 0.1)
        for sekvens in (5, 3, 9)
        for start in (0.6, 0.0, 0.3)
    ]
    nett, turned = Vegnett.from_les_v4(links), Vegnett.from_les_v4(links[::-1])
    assert nett.veglenkesekvensid.tolist() == [3, 3, 3, 5, 5, 5, 9, 9, 9]
    assert nett.startposisjon.tolist() == [0.0, 0.3, 0.6] * 3
    assert np.array_equal(nett.startposisjon, turned.startposisjon)


def test_vegnett_refuses_columns_of_unequal_length() -> None:
    """A column that is too short is an error at once, not a wrong answer later."""
    nett = Vegnett.from_les_v4([_segment(), _segment()])
    columns = {name: getattr(nett, name) for name in nett.__slots__}
    with pytest.raises(ValueError, match="same number"):
        Vegnett(**columns | {"fra_meter": columns["fra_meter"][:1]})
