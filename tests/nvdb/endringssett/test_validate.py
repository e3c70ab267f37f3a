"""The validator: each fault of a set that was good is found, by its code, and by nothing else."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, date, datetime
from typing import Any

import pytest

from nvdb import datakatalog
from nvdb.endringssett import (
    ADVARSEL,
    FEIL,
    Assosiasjon,
    Datter,
    Egenskap,
    Endring,
    Endringssett,
    Geometri,
    Kvalitet,
    Measured,
    NewPlate,
    Punkt,
    Stedfesting,
    Target,
    changed_type,
    errors,
    gone,
    new_sign,
    position_correction,
    validate,
)

DAY = date(2026, 10, 31)
READ = datetime(2026, 11, 1, tzinfo=UTC)
PLACE = Punkt(veglenkesekvens_id=2510771, posisjon=0.25, retning="MED", sideposisjon="H")
MEASURED = Measured(east_m=270000, north_m=7040000, std_m=0.1, captured=DAY, height_m=10.0, std_height_m=0.2)
KVALITET = Kvalitet(datafangstmetode="fot", noyaktighet_cm=10, synbarhet=0)
TOO_LARGE = "STØRRE_ENN_ABSOLUTT_MAKSIMUM"
HOYDE = replace(KVALITET, datafangstmetode_hoyde="fot", noyaktighet_hoyde_cm=20)


def _sett(*endringer: Endring, **changes: Any) -> Endringssett:
    return replace(Endringssett(datakatalogversjon="2.38", endringer=endringer), **changes)


def _new() -> tuple[Endring, Endring]:
    parent, child = new_sign(
        "s", MEASURED, on_date=DAY, stedfesting=PLACE, plates=[NewPlate(skiltnummer="202")]
    )
    return replace(parent, egenskaper=(*parent.egenskaper, Egenskap(type_id=1876, enum=(2866,)))), child


def _codes(sett: Endringssett) -> list[str]:
    return [finding.code for finding in validate(sett)]


def test_a_good_set_has_no_findings() -> None:
    """A new sign with a plate passes without a word."""
    assert validate(_sett(*_new())) == ()


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"endringer": ()}, "TOMT_ENDRINGSSETT"),
        ({"datakatalogversjon": "2"}, "UGYLDIG_DATAKATALOGVERSJON"),
        ({"datakatalogversjon": "2.41"}, "IKKE_GJELDENDE_DATAKATALOGVERSJON"),
    ],
)
def test_faults_of_the_set_are_found(changes: dict[str, Any], code: str) -> None:
    """An empty set, and one by another datakatalog."""
    assert _codes(_sett(*_new(), **changes)) == [code]


def test_more_than_a_thousand_objects_are_refused() -> None:
    """1,000 pass and 1,001 do not."""
    closings = tuple(gone(Target(96, number, 1), on_date=DAY)[0] for number in range(1, 1002))
    assert _codes(_sett(*closings[:1000])) == []
    assert _codes(_sett(*closings)) == ["FOR_MANGE_VEGOBJEKTER"]


def test_one_version_takes_one_operation() -> None:
    """A correction and a closing of the same version belong in two sets."""
    target = Target(96, 7, 2, READ)
    sett = _sett(*changed_type(target, "202"), *gone(target, on_date=DAY))
    assert _codes(sett) == ["KONFLIKT_MELLOM_VEGOBJEKTER"]
    assert _codes(_sett(*changed_type(target, "202"), *gone(Target(96, 7, 3), on_date=DAY))) == []


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"type_id": 1}, "UKJENT_VEGOBJEKTTYPE"),
        ({"nvdb_id": None}, "VEGOBJEKTET_FINNES_IKKE"),
        ({"versjon": None}, "VEGOBJEKTVERSJONEN_FINNES_IKKE"),
        ({"versjon": 0}, "VEGOBJEKTVERSJONEN_FINNES_IKKE"),
        ({"lest_fra_nvdb": None}, "MANGLER_LEST_FRA_NVDB"),
        ({"lest_fra_nvdb": datetime(2026, 1, 1)}, "MANGLER_LEST_FRA_NVDB"),  # noqa: DTZ001 (the fault meant)
        ({"overskriv": True}, "UGYLDIG_OPERASJON"),
        ({"egenskaper": ()}, "UFULLSTENDIG_VEGOBJEKT"),
        ({"startdato": DAY, "sluttdato": DAY}, "UGYLDIG_STARTDATO"),
        ({"startdato": date(206, 1, 1)}, "UGYLDIG_STARTDATO"),
        ({"kaskade": True}, "UGYLDIG_OPERASJON"),
        ({"lukkedato": DAY}, "UGYLDIG_OPERASJON"),
        ({"stedfesting": Stedfesting(operasjon="slett")}, "MANGLER_STEDFESTING"),
    ],
)
def test_faults_of_a_correction_are_found(changes: dict[str, Any], code: str) -> None:
    """Identity, time of reading, dates, and a correction of nothing."""
    (good,) = position_correction(Target(95, 1, 1, READ), MEASURED)
    assert _codes(_sett(good)) == []
    assert _codes(_sett(replace(good, **changes))) == [code]


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"startdato": None}, "UGYLDIG_STARTDATO"),
        ({"nvdb_id": 5}, "UGYLDIG_TEMPID"),
        ({"temp_id": None}, "UGYLDIG_TEMPID"),
        ({"stedfesting": None}, "MANGLER_STEDFESTING"),
    ],
)
def test_faults_of_a_registration_are_found(changes: dict[str, Any], code: str) -> None:
    """A start date, no id of NVDB's, and a place."""
    parent, child = _new()
    assert _codes(_sett(replace(parent, **changes), child)) == [code]


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"lukkedato": None}, "UGYLDIG_STARTDATO"),
        ({"kaskade": None}, "DATTEROBJEKT_UTEN_MOR"),
        ({"startdato": DAY}, "UGYLDIG_OPERASJON"),
        ({"lukkedato": date(2207, 1, 1)}, "UGYLDIG_STARTDATO"),
    ],
)
def test_faults_of_a_closing_are_found(changes: dict[str, Any], code: str) -> None:
    """A closing says from when, and what becomes of the children."""
    (good,) = gone(Target(95, 1, 1), on_date=DAY)
    assert _codes(_sett(replace(good, **changes))) == [code]


def test_required_and_wanted_properties_are_told_apart() -> None:
    """A plate without a sign number is refused; one without a geometry is warned of."""
    parent, child = _new()
    bare = replace(child, egenskaper=())
    found = validate(_sett(parent, bare))
    assert [(f.code, f.severity, f.egenskap_type_id) for f in found] == [
        ("MANGLER_OBLIGATORISKE_EGENSKAPER", FEIL, 5530),
        ("MANGLER_ANBEFALTE_EGENSKAPER", "advarsel", 4795),
    ]
    assert [f.code for f in errors(found)] == ["MANGLER_OBLIGATORISKE_EGENSKAPER"]


def _with(egenskap: Egenskap, type_id: int = 95) -> Endringssett:
    endring = Endring(
        operasjon="delvisOppdater",
        type_id=type_id,
        nvdb_id=1,
        versjon=1,
        startdato=DAY,
        egenskaper=(replace(egenskap, operasjon=egenskap.operasjon or "oppdater"),),
    )
    return _sett(endring)


@pytest.mark.parametrize(
    ("type_id", "egenskap", "codes"),
    [
        (95, Egenskap(type_id=1884, verdi=("1.8",)), []),
        (95, Egenskap(type_id=1884, verdi=("0.30",)), []),
        (95, Egenskap(type_id=1884, verdi=("1,8",)), ["UGYLDIG_FLYTTALLFORMAT"]),
        (95, Egenskap(type_id=1884, verdi=("1.85",)), ["FOR_MANGE_DESIMALER"]),
        (95, Egenskap(type_id=1884, verdi=("-100",)), ["MINDRE_ENN_ABSOLUTT_MINIMUM"]),
        (95, Egenskap(type_id=2055, verdi=("100",)), [TOO_LARGE]),
        (95, Egenskap(type_id=1877, verdi=("1.5",)), ["UGYLDIG_HELTALLFORMAT"]),
        (95, Egenskap(type_id=1877, verdi=("12",)), ["OVERSKRIDER_FELTLENGDE", TOO_LARGE]),
        (95, Egenskap(type_id=10854, verdi=("x" * 150,)), []),
        (95, Egenskap(type_id=10854, verdi=("x" * 151,)), ["OVERSKRIDER_FELTLENGDE"]),
        (95, Egenskap(type_id=10854, verdi=(" ",)), ["UGYLDIG_TYPE"]),
        (95, Egenskap(type_id=10854, enum=(1,)), ["IKKE_FLERVERDIEGENSKAP"]),
        (95, Egenskap(type_id=10854), ["UGYLDIG_TYPE"]),
        (95, Egenskap(type_id=10854, verdi=("a", "b")), ["FLERE_ENN_MAKSIMUM_ANTALL"]),
        (95, Egenskap(type_id=10854, verdi=("a",), operasjon="slett"), ["UGYLDIG_TYPE"]),
        (95, Egenskap(type_id=10854, verdi=("a",), operasjon="ny"), ["UGYLDIG_OPERASJON"]),
        (95, Egenskap(type_id=10854, operasjon="slett"), []),
        (95, Egenskap(type_id=4794, verdi=("POINT (1 2)",)), ["UGYLDIG_TYPE"]),
        (95, Egenskap(type_id=5530, enum=(7642,)), ["UGYLDIG_EGENSKAPSTYPE"]),
        (95, Egenskap(type_id=77, verdi=("x",)), ["UKJENT_EGENSKAPSTYPE"]),
        (96, Egenskap(type_id=5530, operasjon="slett"), ["MANGLER_OBLIGATORISKE_EGENSKAPER"]),
        (96, Egenskap(type_id=5128, verdi=("10",)), []),
        (96, Egenskap(type_id=2108, verdi=("2026-02-29",)), ["UGYLDIG_DATOFORMAT"]),
        (96, Egenskap(type_id=2108, verdi=("20260228",)), []),
        (96, Egenskap(type_id=1894, verdi=("Tosidig",)), []),
        (96, Egenskap(type_id=1894, verdi=("Bakover",)), ["UGYLDIG_FLERVERDI"]),
    ],
)  # fmt: skip
def test_values_are_checked_by_kind_and_limits(type_id: int, egenskap: Egenskap, codes: list[str]) -> None:
    """Each value passes, or is named with the code that API Skriv has for it."""
    assert _codes(_with(egenskap, type_id)) == codes


def test_an_unknown_enum_id_is_an_error_only_where_the_list_is_complete() -> None:
    """The shipped snapshot is partial and warns; a fetched datakatalog refuses."""
    snapshot = datakatalog.snapshot()
    sett = _with(Egenskap(type_id=5530, enum=(1,)), 96)
    (warning,) = validate(sett)
    assert warning.severity == ADVARSEL
    assert "sync with NVDB first" in str(warning)
    whole = {5530: replace(snapshot.egenskapstyper[5530], complete=True)}
    katalog = replace(snapshot, egenskapstyper={**snapshot.egenskapstyper, **whole})
    assert [f.severity for f in validate(sett, katalog)] == ["feil"]


QUALITY = ["UGYLDIG_KVALITETSPARAMETER"]


@pytest.mark.parametrize(
    ("changes", "codes"),
    [
        ({}, []),
        ({"wkt": "POINT Z (270000 7040000 12)", "kvalitet": HOYDE}, []),
        ({"wkt": "POINT Z (270000 7040000 12)"}, QUALITY),
        ({"kvalitet": HOYDE}, QUALITY),
        ({"kvalitet": None}, QUALITY),
        ({"kvalitet": replace(KVALITET, synbarhet=None)}, QUALITY),
        ({"kvalitet": replace(KVALITET, synbarhet=99)}, QUALITY),
        ({"kvalitet": replace(KVALITET, noyaktighet_cm=0)}, QUALITY),
        ({"kvalitet": replace(KVALITET, noyaktighet_cm=-1)}, QUALITY),
        ({"kvalitet": replace(KVALITET, noyaktighet_cm=1001)}, QUALITY),
        ({"kvalitet": replace(KVALITET, datafangstmetode="gps")}, QUALITY),
        ({"kvalitet": replace(KVALITET, datafangstmetode=None, malemetode=96)}, []),
        ({"datafangstdato": None}, QUALITY),
        ({"referansegeometri": True}, ["UGYLDIG_TYPE"]),
        ({"wkt": "POINT Z (270000 7040000 -999999)"}, ["UGYLDIG_GEOMETRIFORMAT"]),
        ({"wkt": "POINT (7040000 270000)"}, ["GEOMETRI_UTENFOR_OMRISSET_AV_EUREF89_UTM33N"]),
        ({"wkt": "LINESTRING (0 0, 1 1)"}, ["UGYLDIG_TYPE"]),
        ({"wkt": "POINT (a b)"}, ["UGYLDIG_GEOMETRIFORMAT"]),
        ({"srid": 25833}, []),
        ({"srid": 3857}, ["UGYLDIG_GEOMETRI_SRID"]),
        ({"srid": 4326, "wkt": "POINT (10.39 63.43)"}, []),
        ({"srid": 4326, "wkt": "POINT (63.43 10.39)"}, ["UGYLDIG_GEOMETRIFORMAT"]),
    ],
)
def test_geometries_are_checked(changes: dict[str, Any], codes: list[str]) -> None:
    """Point, reference system, height and the three or five parameters of quality."""
    good = Geometri(srid=5973, wkt="POINT (270000 7040000)", datafangstdato=DAY, kvalitet=KVALITET)
    assert _codes(_with(Egenskap(type_id=4794, geometri=replace(good, **changes)))) == codes


def test_a_geometry_in_another_property_is_refused() -> None:
    """1884 is a number, not a place."""
    geometri = Geometri(srid=5973, wkt="POINT (270000 7040000)", datafangstdato=DAY, kvalitet=KVALITET)
    assert _codes(_with(Egenskap(type_id=1884, geometri=geometri))) == ["UGYLDIG_TYPE"]


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"posisjon": 1.01}, "UGYLDIG_STEDFESTING"),
        ({"posisjon": float("nan")}, "UGYLDIG_STEDFESTING"),
        ({"veglenkesekvens_id": 0}, "UKJENT_VEGLENKESEKVENS"),
        ({"retning": "med"}, "UGYLDIG_STEDFESTING"),
        ({"sideposisjon": "X"}, "UGYLDIG_SIDEPOSISJON"),
        ({"kjorefelt": ("K",)}, "UGYLDIG_FELT"),
    ],
)
def test_places_are_checked(changes: dict[str, Any], code: str) -> None:
    """Position, direction, side and lanes."""
    place = Stedfesting(operasjon="oppdater", punkter=(replace(PLACE, **changes),))
    endring = Endring(
        operasjon="delvisOppdater", type_id=95, nvdb_id=1, versjon=1, startdato=DAY, stedfesting=place
    )
    assert _codes(_sett(endring)) == [code]


def _wanting(**krav: Any) -> datakatalog.Datakatalog:
    """The snapshot, where both types want this of their places."""
    both = dict.fromkeys((95, 96), datakatalog.Stedfestingskrav(**krav))
    return replace(datakatalog.snapshot(), stedfesting=both)


@pytest.mark.parametrize(
    ("krav", "place", "code"),
    [
        ({"retning": True}, {"retning": None}, "MANGLER_RETNING"),
        ({"retning": False, "sideposisjon": "NEI"}, {}, "UGYLDIG_SIDEPOSISJON"),
        ({"retning": False, "sideposisjon": "MÅ"}, {"sideposisjon": None}, "UGYLDIG_SIDEPOSISJON"),
        ({"retning": False, "kjorefelt": "NEI"}, {"kjorefelt": ("1",)}, "UGYLDIG_FELT"),
    ],
)
def test_a_place_says_what_its_type_wants(krav: dict[str, Any], place: dict[str, Any], code: str) -> None:
    """Direction, side and lanes missing, or not wanted: refused, for pole and plate."""
    where = Stedfesting(punkter=(replace(PLACE, **place),))
    sett = _sett(*(replace(endring, stedfesting=where) for endring in _new()))
    assert [(f.code, f.severity) for f in validate(sett, _wanting(**krav))] == [(code, FEIL)] * 2


def test_a_new_sign_without_direction_is_warned_of_only_where_nothing_is_known() -> None:
    """Not knowing whether a type wants a retning is a warning; knowing that it does not, no word."""
    where = Stedfesting(punkter=(replace(PLACE, retning=None),))
    sett = _sett(*(replace(endring, stedfesting=where) for endring in _new()))
    assert [(f.code, f.severity) for f in validate(sett)] == [("MANGLER_RETNING", ADVARSEL)] * 2
    assert validate(sett, _wanting(retning=False)) == ()


@pytest.mark.parametrize(("first", "second"), [(None, "ny"), ("oppdater", "ny")])
def test_members_of_a_list_are_all_marked_or_none(first: str | None, second: str) -> None:
    """A place to add beside one without a mark, or a mark that does not exist, is refused."""
    punkter = (replace(PLACE, operasjon=first), replace(PLACE, posisjon=0.5, operasjon=second))
    place = Stedfesting(operasjon="oppdater", punkter=punkter)
    endring = Endring(
        operasjon="delvisOppdater", type_id=95, nvdb_id=1, versjon=1, startdato=DAY, stedfesting=place
    )
    assert _codes(_sett(endring)) == ["UGYLDIG_OPERASJON"]


def test_a_property_is_given_once() -> None:
    """Two values of one property in one operation contradict each other."""
    (good,) = changed_type(Target(96, 1, 1, READ), "202")
    assert _codes(_sett(replace(good, egenskaper=good.egenskaper * 2))) == ["FLERE_ENN_MAKSIMUM_ANTALL"]


@pytest.mark.parametrize(
    ("child_place", "code"),
    [
        (replace(PLACE, posisjon=0.26), "STEDFESTING_DEKKER_IKKE_DATTEROBJEKT"),
        (replace(PLACE, sideposisjon="V"), "STEDFESTING_DEKKER_DATTEROBJEKT_MEN_ANNEN_SIDEPOSISJON"),
        (replace(PLACE, kjorefelt=("1",)), "STEDFESTING_DEKKER_DATTEROBJEKT_MEN_ANNET_FELT"),
    ],
)
def test_a_plate_stands_where_its_skiltpunkt_does(child_place: Punkt, code: str) -> None:
    """Another position, side or lane than the parent's is refused."""
    parent, child = _new()
    sett = _sett(parent, replace(child, stedfesting=Stedfesting(punkter=(child_place,))))
    assert _codes(sett) == [code]


@pytest.mark.parametrize(
    ("assosiasjon", "codes"),
    [
        (Assosiasjon(type_id=200004, dotre=(Datter(temp_id="s#1"),)), []),
        (Assosiasjon(type_id=220004, dotre=(Datter(temp_id="s#1"), Datter(nvdb_id=5))), []),
        (
            Assosiasjon(type_id=4, dotre=(Datter(temp_id="s#1"),)),
            ["UKJENT_EGENSKAPSTYPE", "MANGLER_MOROBJEKT"],
        ),
        (Assosiasjon(type_id=220004), ["UFULLSTENDIG_VEGOBJEKT", "MANGLER_MOROBJEKT"]),
        (Assosiasjon(type_id=220006, dotre=(Datter(temp_id="s#1"),)), ["DATTEROBJEKT_AV_FEIL_TYPE"]),
        (
            Assosiasjon(type_id=220004, dotre=(Datter(temp_id="s#1"), Datter(temp_id="t"))),
            ["DATTEROBJEKT_FINNES_IKKE"],
        ),
        (
            Assosiasjon(type_id=220004, dotre=(Datter(temp_id="s#1"), Datter())),
            ["DATTEROBJEKT_FINNES_IKKE"],
        ),
        (
            Assosiasjon(type_id=220004, dotre=(Datter(temp_id="s#1"), Datter(nvdb_id=5, operasjon="ny"))),
            ["UGYLDIG_OPERASJON"],
        ),
    ],
)  # fmt: skip
def test_children_are_checked(assosiasjon: Assosiasjon, codes: list[str]) -> None:
    """Both id series are taken; unknown, missing and mistyped children are named."""
    parent, child = _new()
    assert _codes(_sett(replace(parent, assosiasjoner=(assosiasjon,)), child)) == codes


def test_a_plate_has_one_parent() -> None:
    """Two Skiltpunkter that name the same new plate, and two objects of one name, are refused."""
    parent, child = _new()
    assert _codes(_sett(parent, replace(parent, temp_id="t"), child)) == ["MER_ENN_ETT_MOROBJEKT"]
    assert "UGYLDIG_TEMPID" in _codes(_sett(parent, child, child))


def test_a_finding_is_one_sentence_of_what_where_and_cure() -> None:
    """What people read names the object, what is wrong with it, and what to do."""
    (good,) = position_correction(Target(95, 78735745, 3, READ), MEASURED)
    (finding,) = validate(_sett(replace(good, lest_fra_nvdb=None)))
    assert str(finding) == (
        "delvisKorriger of 95 Skiltpunkt 78735745 version 3 has no lestFraNvdb: "
        "give the time at which it was read from NVDB."
    )
    assert (finding.nvdb_id, finding.versjon, finding.temp_id) == (78735745, 3, None)
