"""The change set and its two written forms."""

from __future__ import annotations

import json
from datetime import UTC, date, datetime, timedelta, timezone
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvdb.endringssett import (
    Assosiasjon,
    Datter,
    Egenskap,
    Endring,
    Endringssett,
    Geometri,
    Kvalitet,
    Punkt,
    Stedfesting,
    endringssett,
    from_json,
    from_xml,
    to_json,
    to_xml,
)
from nvdb.errors import RequestError, SchemaError

NS = "{http://nvdb.vegvesen.no/apiskriv/domain/changeset/v3}"


def _maybe(strategy: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | strategy


def _text(alphabet: str = "aZ9æøÅ <>&\"'.,#-\n\tœ€𝄞") -> st.SearchStrategy[str]:
    return st.text(alphabet=alphabet, min_size=1, max_size=12)


_IDS = st.integers(1, 2**53)
_WORDS = st.text(alphabet="aZ9æøÅ<>&\"'.#-", min_size=1, max_size=8)
_DATES = st.dates(date(1950, 1, 1), date(2099, 12, 31))
_MOMENTS = st.datetimes(datetime(1990, 1, 1), datetime(2099, 1, 1)).map(  # noqa: DTZ001 (hypothesis wants naive bounds)
    lambda moment: moment.replace(microsecond=moment.microsecond // 1000 * 1000, tzinfo=UTC)
)
_SMALL = _maybe(st.integers(-1, 1000))
_KVALITET = st.builds(
    Kvalitet,
    datafangstmetode=_maybe(_WORDS),
    noyaktighet_cm=st.integers(0, 500),
    synbarhet=_SMALL,
    datafangstmetode_hoyde=_maybe(_WORDS),
    noyaktighet_hoyde_cm=_SMALL,
    toleranse_cm=_SMALL,
    malemetode=_SMALL,
    malemetode_hoyde=_SMALL,
)
_GEOMETRI = st.builds(
    Geometri,
    srid=st.sampled_from([5973, 25833]),
    wkt=_WORDS,
    lengde_m=_maybe(st.floats(0, 1e6)),
    datafangstdato=_maybe(_DATES),
    temakode=_SMALL,
    medium=_maybe(_WORDS),
    kommune=_maybe(st.sampled_from(["0301", "5001"])),
    hoydereferanse=_SMALL,
    sosinavn=_maybe(_WORDS),
    referansegeometri=_maybe(st.booleans()),
    verifiseringsdato=_maybe(_DATES),
    oppdateringsdato=_maybe(_DATES),
    prosesshistorikk=_maybe(_WORDS),
    kvalitet=_maybe(_KVALITET),
)
_EGENSKAP = st.builds(
    Egenskap,
    type_id=_IDS,
    verdi=st.lists(_text(), max_size=2).map(tuple),
    enum=st.lists(_IDS, max_size=2).map(tuple),
    geometri=_maybe(_GEOMETRI),
    operasjon=st.sampled_from([None, "oppdater", "slett"]),
)
_DATTER = st.builds(Datter, nvdb_id=_IDS, operasjon=st.sampled_from([None, "ny", "slett"]))
_NY_DATTER = st.builds(Datter, temp_id=_WORDS, operasjon=st.sampled_from([None, "ny"]))
_ASSOSIASJON = st.builds(
    Assosiasjon,
    type_id=_IDS,
    dotre=st.tuples(st.lists(_DATTER, max_size=2), st.lists(_NY_DATTER, max_size=2)).map(
        lambda two: (*two[0], *two[1])
    ),
    operasjon=st.sampled_from([None, "oppdater"]),
)
_PUNKT = st.builds(
    Punkt,
    veglenkesekvens_id=_IDS,
    posisjon=st.floats(0, 1),
    retning=_maybe(st.sampled_from(["MED", "MOT"])),
    sideposisjon=_maybe(st.sampled_from(["H", "V"])),
    kjorefelt=st.lists(st.sampled_from(["1", "2K"]), max_size=2).map(tuple),
    operasjon=st.sampled_from([None, "ny"]),
)
_STEDFESTING = st.builds(
    Stedfesting,
    punkter=st.lists(_PUNKT, min_size=1, max_size=2).map(tuple),
    operasjon=st.sampled_from([None, "oppdater"]),
)
_ENDRING = st.builds(
    Endring,
    operasjon=st.sampled_from(["registrer", "delvisOppdater", "lukk", "delvisKorriger", "fjern"]),
    type_id=_IDS,
    nvdb_id=_maybe(_IDS),
    versjon=_maybe(st.integers(1, 99)),
    temp_id=_maybe(_WORDS),
    lest_fra_nvdb=_maybe(_MOMENTS),
    overskriv=st.booleans(),
    startdato=_maybe(_DATES),
    sluttdato=_maybe(_DATES),
    egenskaper=st.lists(_EGENSKAP, max_size=2).map(tuple),
    assosiasjoner=st.lists(_ASSOSIASJON, max_size=2).map(tuple),
    stedfesting=_maybe(_STEDFESTING),
    lukkedato=_maybe(_DATES),
    kaskade=_maybe(st.booleans()),
)
_ORDER = ["registrer", "delvisOppdater", "lukk", "delvisKorriger", "fjern"]
_SETT = st.builds(
    Endringssett,
    datakatalogversjon=st.just("2.38"),
    endringer=st.lists(_ENDRING, max_size=4).map(
        lambda made: tuple(sorted(made, key=lambda endring: _ORDER.index(endring.operasjon)))
    ),
    ansvarlig=_maybe(_WORDS),
    ekstern_ref=_maybe(_WORDS),
    kontekst=_maybe(_text()),
)


@given(_SETT)
def test_endringssett_survives_xml_and_json(sett: Endringssett) -> None:
    """Whatever a set holds comes back from XML and from JSON, and both forms say the same."""
    assert from_xml(to_xml(sett)) == sett
    assert from_json(to_json(sett)) == sett
    assert to_json(from_xml(to_xml(sett))) == to_json(sett)


def _example() -> Endringssett:
    egenskap = Egenskap(
        type_id=4794,
        operasjon="oppdater",
        geometri=Geometri(
            srid=5973,
            wkt="POINT Z (270196.99 7041858.13 12.3)",
            datafangstdato=date(2025, 10, 31),
            kvalitet=Kvalitet(datafangstmetode="sat", noyaktighet_cm=10, synbarhet=0),
        ),
    )
    return Endringssett(
        datakatalogversjon="2.41",
        endringer=(
            Endring(
                operasjon="delvisKorriger",
                type_id=95,
                nvdb_id=78735745,
                versjon=3,
                lest_fra_nvdb=datetime(2025, 11, 1, 13, 0, 15, tzinfo=timezone(timedelta(hours=1))),
                egenskaper=(egenskap,),
                assosiasjoner=(
                    Assosiasjon(
                        type_id=220004,
                        operasjon="oppdater",
                        dotre=(Datter(temp_id="b", operasjon="ny"), Datter(nvdb_id=7, operasjon="slett")),
                    ),
                ),
                stedfesting=Stedfesting(
                    operasjon="oppdater",
                    punkter=(
                        Punkt(veglenkesekvens_id=2510771, posisjon=1e-7, retning="MED", kjorefelt=("1", "2")),
                    ),
                ),
            ),
        ),
    )


def test_xml_has_the_documented_words_and_places() -> None:
    """Attributes, wrappers, the time in UTC, positions without exponents and nvdbId before tempId."""
    root = ET.fromstring(to_xml(_example()))
    assert [child.tag for child in root] == [NS + "datakatalogversjon", NS + "delvisKorriger"]
    vegobjekt = root.find(f"{NS}delvisKorriger/{NS}vegobjekter/{NS}vegobjekt")
    assert vegobjekt is not None
    assert vegobjekt.attrib == {"typeId": "95", "nvdbId": "78735745", "versjon": "3"}
    assert vegobjekt.findtext(f"{NS}validering/{NS}lestFraNvdb") == "2025-11-01T12:00:15"
    egenskap = vegobjekt.find(f"{NS}egenskaper/{NS}egenskap")
    assert egenskap is not None
    assert egenskap.attrib == {"typeId": "4794", "operasjon": "oppdater"}
    assert egenskap.findtext(f"{NS}geometri/{NS}kvalitet/{NS}nøyaktighet") == "10"
    stedfesting = vegobjekt.find(f"{NS}stedfesting")
    assert stedfesting is not None
    assert stedfesting.attrib == {"operasjon": "oppdater"}
    punkt = stedfesting[0]
    assert punkt.attrib == {"veglenkesekvensNvdbId": "2510771", "posisjon": "0.0000001"}
    assert [felt.text for felt in punkt.iter(f"{NS}felt")] == ["1", "2"]
    barn = vegobjekt.find(f"{NS}assosiasjoner/{NS}assosiasjon")
    assert barn is not None
    assert [(b.tag, b.text, b.attrib) for b in barn] == [
        (NS + "nvdbId", "7", {"operasjon": "slett"}),
        (NS + "tempId", "b", {"operasjon": "ny"}),
    ]


def test_json_has_lists_of_values_and_geometries() -> None:
    """JSON writes geometri and verdi as lists, and srid as text, as published scripts do."""
    document = json.loads(to_json(_example()))
    vegobjekt = document["delvisKorriger"]["vegobjekter"][0]
    assert vegobjekt["egenskaper"][0]["geometri"][0]["srid"] == "5973"
    assert vegobjekt["stedfesting"]["punkt"][0]["kjørefelt"] == ["1", "2"]
    assert vegobjekt["validering"] == {"lestFraNvdb": "2025-11-01T12:00:15"}


@pytest.mark.parametrize("char", ["\x00", "\x0b", "\r", "\ud800", "\uffff"])
def test_xml_refuses_characters_that_it_cannot_hold(char: str) -> None:
    """A control character is named before anything is written."""
    sett = Endringssett(datakatalogversjon="2.38", endringer=(), kontekst=f"a{char}b")
    with pytest.raises(RequestError, match="cannot hold"):
        to_xml(sett)


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (b"<endringssett/>", "where an object belongs"),
        (b"<endringssett><ansvarlig>x</ansvarlig></endringssett>", "no datakatalogversjon"),
        (b"<status/>", "not a change set"),
        (
            b"<endringssett><ansvarlig>a</ansvarlig><ansvarlig>b</ansvarlig></endringssett>",
            "ansvarlig twice in one endringssett",
        ),
        (b"<endringssett", "not readable XML"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "not readable XML"),
        (
            b"<endringssett><datakatalogversjon>1</datakatalogversjon><slett>x</slett></endringssett>",
            "'slett' at endringssett",
        ),
    ],
)
def test_xml_that_is_no_change_set_is_refused(document: bytes, message: str) -> None:
    """Anything but a change set of V3 is refused in one sentence that says where."""
    with pytest.raises(SchemaError, match=message):
        from_xml(document)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"typeId": "x"}, "'x' for typeId"),
        ({"versjon": True}, "'True' for versjon"),
        ({"stedfesting": {"linje": []}}, "'linje' at endringssett.lukk.vegobjekter"),
        ({"kaskadelukking": "KANSKJE"}, "'KANSKJE' for kaskadelukking"),
        ({"lukkedato": "2020-02-30"}, "'2020-02-30' for lukkedato"),
        ({"egenskaper": ["x"]}, "where an object belongs"),
    ],
)
def test_json_with_a_bad_value_is_refused_with_its_place(change: dict[str, Any], message: str) -> None:
    """A value that cannot be read is named with its word and its path."""
    vegobjekt = {"typeId": 95, "nvdbId": 1, "versjon": 1, **change}
    document = {"datakatalogversjon": "2.38", "lukk": {"vegobjekter": [vegobjekt]}}
    with pytest.raises(SchemaError, match=message):
        from_json(json.dumps(document))


def test_json_that_is_not_json_is_refused() -> None:
    """Text that is not JSON is named as such."""
    with pytest.raises(SchemaError, match="not readable JSON"):
        from_json("{")


def _close(number: int) -> Endring:
    return Endring(operasjon="lukk", type_id=96, nvdb_id=number, versjon=1)


@given(st.lists(st.integers(1, 5), max_size=12))
def test_sets_keep_groups_whole_and_in_order(sizes: list[int]) -> None:
    """No set is too large, no group is torn apart, and everything comes once, in order."""
    numbers = iter(range(1, 1000))
    groups = [[_close(next(numbers)) for _ in range(size)] for size in sizes]
    sets = endringssett(groups, datakatalogversjon="2.38", max_objects=5)
    assert all(1 <= len(sett.endringer) <= 5 for sett in sets)
    assert [e for sett in sets for e in sett.endringer] == [e for group in groups for e in group]
    for group in groups:
        assert sum(group[0] in sett.endringer and group[-1] in sett.endringer for sett in sets) == 1


def test_a_group_larger_than_a_set_is_refused() -> None:
    """A Skiltpunkt with more plates than a set holds is refused, not torn apart."""
    with pytest.raises(RequestError, match="belong together, but a set holds 2"):
        endringssett([[_close(1), _close(2), _close(3)]], datakatalogversjon="2.38", max_objects=2)
