"""Builders: what is found on the road becomes operations that pass every check."""

from __future__ import annotations

import dataclasses
import math
from datetime import UTC, date, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvdb.datakatalog import Ansiktsside, snapshot
from nvdb.endringssett import (
    Endring,
    Measured,
    NewPlate,
    NewPoint,
    Punkt,
    Target,
    changed_type,
    endringssett,
    errors,
    from_xml,
    gone,
    moved,
    new_plates,
    new_sign,
    position_correction,
    punkt_from_stedfesting,
    skiltnummer_enum,
    target_from_skilt,
    to_xml,
    validate,
)
from nvdb.errors import RequestError
from nvdb.objects import VegobjektStedfesting, position_from_wkt, skilt_from_les_v4

READ = datetime(2026, 11, 1, 12, 0, 15, tzinfo=UTC)
DAY = date(2026, 10, 31)
POINT = Target(95, 78735745, 3, READ)
PLATES = (Target(96, 801, 1, READ), Target(96, 802, 2, READ))
PLACE = Punkt(veglenkesekvens_id=2510771, posisjon=0.142940712345, retning="MED", sideposisjon="H")
MEASURED = Measured(
    east_m=270196.9912, north_m=7041858.1349, std_m=0.081, captured=DAY, height_m=12.3, std_height_m=0.2
)


def _geometri(endring: Endring) -> tuple[str, tuple[object, ...]]:
    (egenskap,) = (e for e in endring.egenskaper if e.geometri is not None)
    assert egenskap.geometri is not None
    assert egenskap.geometri.kvalitet is not None
    return egenskap.geometri.wkt, dataclasses.astuple(egenskap.geometri.kvalitet)


def _all_groups() -> list[tuple[Endring, ...]]:
    sign = NewPlate(skiltnummer="362.50", ansiktsside=Ansiktsside.MED_METRERINGSRETNING, plasseringskode=10)
    text = NewPlate(skiltnummer="808.105", tekst="0-300 m")
    point = NewPoint(enum={1876: 2866}, verdi={1877: "1"})
    return [
        position_correction(POINT, MEASURED, plates=PLATES, stedfesting=PLACE),
        position_correction(Target(96, 901, 1, READ), MEASURED),
        moved(Target(95, 11, 1), MEASURED, on_date=DAY, stedfesting=PLACE, plates=[Target(96, 12, 1)]),
        changed_type(Target(96, 21, 4), "362.60", on_date=DAY),
        changed_type(Target(96, 22, 4, READ), "362.60"),
        new_sign("s1", MEASURED, on_date=DAY, stedfesting=PLACE, plates=[sign, text], point=point),
        new_plates(Target(95, 31, 1), "s2", MEASURED, on_date=DAY, stedfesting=PLACE, plates=[sign]),
        gone(Target(95, 41, 1), on_date=DAY),
        gone(Target(96, 42, 1), on_date=DAY, with_plates=False),
    ]


def test_every_builder_makes_what_the_validator_passes() -> None:
    """One set of all builders has no error, no warning, and survives XML."""
    (sett,) = endringssett(_all_groups(), datakatalogversjon="2.38")
    assert validate(sett) == ()
    order = sorted(sett.endringer, key=lambda e: (e.operasjon, e.nvdb_id or 0, e.temp_id or ""))
    back = sorted(
        from_xml(to_xml(sett)).endringer, key=lambda e: (e.operasjon, e.nvdb_id or 0, e.temp_id or "")
    )
    assert back == order


def test_position_correction_keeps_the_version_and_its_dates() -> None:
    """An unmoved sign is corrected in its version, with the time it was read, the plates alike."""
    point, *plates = position_correction(POINT, MEASURED, plates=PLATES)
    assert {(e.operasjon, e.lest_fra_nvdb, e.startdato, e.stedfesting) for e in (point, *plates)} == {
        ("delvisKorriger", READ, None, None)
    }
    assert [(e.type_id, e.nvdb_id, e.versjon) for e in (point, *plates)] == [
        (95, 78735745, 3), (96, 801, 1), (96, 802, 2),
    ]  # fmt: skip


def test_quality_has_five_parameters_with_a_height_and_three_without() -> None:
    """The foot's height goes to the Skiltpunkt alone; its plates are placed in plan."""
    point, plate, _ = position_correction(POINT, MEASURED, plates=PLATES)
    assert _geometri(point) == (
        "POINT Z (270196.991 7041858.135 12.300)",
        ("fot", 9, 0, "fot", 20, None, None, None),
    )
    assert _geometri(plate) == (
        "POINT (270196.991 7041858.135)",
        ("fot", 9, 0, None, None, None, None, None),
    )


@given(st.floats(1e-4, 50.0), st.floats(-120e3, 1150e3), st.floats(6.4e6, 7.99e6))
def test_geometry_is_sent_to_the_millimetre_and_never_better_than_it_is(
    std_m: float, east_m: float, north_m: float
) -> None:
    """What is read back lies within 1 mm, and the stated accuracy is at least the measured one."""
    measured = Measured(east_m=east_m, north_m=north_m, std_m=std_m, captured=DAY)
    (endring,) = position_correction(POINT, measured)
    wkt, kvalitet = _geometri(endring)
    position, problems = position_from_wkt(wkt, 5973)
    assert problems == ()
    assert math.hypot(position.east_m - east_m, position.north_m - north_m) < 1e-3
    assert isinstance(kvalitet[1], int)
    assert 100 * std_m - 1e-6 <= kvalitet[1] < max(100 * std_m, 1) + 1


def test_moved_makes_new_versions_in_one_place() -> None:
    """Point and plates get the day, one stedfesting of 8 decimals, and no time of reading."""
    changes = moved(POINT, MEASURED, on_date=DAY, stedfesting=PLACE, plates=PLATES)
    assert {(e.operasjon, e.startdato, e.lest_fra_nvdb) for e in changes} == {("delvisOppdater", DAY, None)}
    (place,) = {e.stedfesting for e in changes}
    assert place is not None
    assert place.operasjon == "oppdater"
    assert place.punkter[0].posisjon == 0.14294071


def test_changed_type_is_a_new_version_or_a_correction() -> None:
    """A plate that was changed gets a version from that day; one that was registered wrongly is corrected."""
    (changed,) = changed_type(PLATES[0], "362.60", on_date=DAY)
    (wrong,) = changed_type(PLATES[0], "362.60")
    assert (changed.operasjon, changed.startdato, changed.lest_fra_nvdb) == ("delvisOppdater", DAY, None)
    assert (wrong.operasjon, wrong.startdato, wrong.lest_fra_nvdb) == ("delvisKorriger", None, READ)
    assert changed.egenskaper[0].enum == wrong.egenskaper[0].enum == (8875,)


def test_new_sign_is_registered_with_its_plates_as_children() -> None:
    """The Skiltpunkt names its plates under 220004 by tempId; all stand in one place from one day."""
    parent, *children = new_sign(
        "s",
        MEASURED,
        on_date=DAY,
        stedfesting=PLACE,
        plates=[NewPlate(skiltnummer="202"), NewPlate(skiltnummer="204", plasseringskode=20)],
    )
    assert [e.type_id for e in (parent, *children)] == [95, 96, 96]
    (assosiasjon,) = parent.assosiasjoner
    assert (assosiasjon.type_id, assosiasjon.operasjon) == (220004, None)
    assert [d.temp_id for d in assosiasjon.dotre] == [e.temp_id for e in children] == ["s#1", "s#2"]
    assert len({(e.startdato, e.stedfesting) for e in (parent, *children)}) == 1
    assert [e.egenskaper[0].enum for e in children] == [(7642,), (7643,)]


def test_gone_closes_and_says_about_its_plates() -> None:
    """Closing has a day and takes the plates along unless told otherwise."""
    (endring,) = gone(POINT, on_date=DAY)
    assert (endring.operasjon, endring.lukkedato, endring.kaskade) == ("lukk", DAY, True)


def test_sign_codes_become_enum_ids() -> None:
    """Codes come from the datakatalog; one that it lacks is refused by name."""
    assert skiltnummer_enum("362.50") == 8874
    with pytest.raises(RequestError, match=r"only 130 codes .* sync with NVDB first"):
        skiltnummer_enum("999.9")
    kind = dataclasses.replace(snapshot().egenskapstyper[5530], complete=True)
    whole = dataclasses.replace(snapshot(), egenskapstyper={5530: kind})
    with pytest.raises(RequestError, match=r"no sign code '999\.9': correct the code"):
        skiltnummer_enum("999.9", whole)


@pytest.mark.parametrize(
    "bad",
    [
        {"east_m": math.nan},
        {"north_m": 569467.68},
        {"std_m": 0.0},
        {"std_m": math.inf},
        {"height_m": math.nan},
        {"std_height_m": -1.0},
        {"std_height_m": None},
    ],
)
def test_an_impossible_position_is_never_sent(bad: dict[str, float | None]) -> None:
    """NaN, a place outside Norway, no accuracy, or a height without one are refused."""
    with pytest.raises(RequestError, match=r"cannot be sent|both or neither"):
        position_correction(POINT, dataclasses.replace(MEASURED, **bad))  # type: ignore[arg-type]


def test_a_correction_needs_the_time_of_reading() -> None:
    """Without it, API Skriv could not tell whether somebody else has changed the object."""
    with pytest.raises(RequestError, match="needs the time at which it was read"):
        position_correction(Target(95, 1, 1), MEASURED)
    with pytest.raises(RequestError, match="needs the time at which it was read"):
        changed_type(Target(96, 1, 1, READ.replace(tzinfo=None)), "202")


def test_a_sign_without_a_plate_is_refused() -> None:
    """A new Skiltpunkt has at least one plate, and so has an addition to one."""
    with pytest.raises(RequestError, match="has no plate"):
        new_sign("s", MEASURED, on_date=DAY, stedfesting=PLACE, plates=[])
    with pytest.raises(RequestError, match="no plate to register on Skiltpunkt 78735745"):
        new_plates(POINT, "s", MEASURED, on_date=DAY, stedfesting=PLACE, plates=[])


_ABOVE_SEA = st.floats(-300.0, 2400.0)


@given(
    st.builds(
        Measured,
        east_m=st.floats(-120e3, 1150e3),
        north_m=st.floats(6.4e6, 7.99e6),
        std_m=st.floats(1e-4, 9.99),
        captured=st.just(DAY),
        method=st.sampled_from(["fot", "sat"]),
    ),
    st.none() | st.tuples(_ABOVE_SEA, st.floats(1e-4, 9.99)),
    st.floats(0.0, 1.0),
)
def test_whatever_is_measured_in_norway_passes(
    measured: Measured, height: tuple[float, float] | None, posisjon: float
) -> None:
    """No position, accuracy, height or place on a road makes a builder produce what would be refused."""
    if height is not None:
        measured = dataclasses.replace(measured, height_m=height[0], std_height_m=height[1])
    place = Punkt(veglenkesekvens_id=1, posisjon=posisjon)
    sign = [NewPlate(skiltnummer="202")]
    sets = endringssett(
        [
            position_correction(POINT, measured, plates=PLATES, stedfesting=place),
            new_sign("s", measured, on_date=DAY, stedfesting=place, plates=sign),
        ],
        datakatalogversjon="2.38",
    )
    assert [f for sett in sets for f in errors(validate(from_xml(to_xml(sett))))] == []


def test_targets_and_places_come_from_what_api_les_gave(plate: Any, point: Any) -> None:
    """Type, id, version, the sign's own time of change in UTC, and its place with side and lanes."""
    skilt = skilt_from_les_v4(plate(801), 96)
    assert target_from_skilt(skilt) == Target(96, 801, 2, datetime(2024, 3, 2, 10, 11, 12, tzinfo=UTC))
    assert target_from_skilt(skilt_from_les_v4(point(1), 95), lest_fra_nvdb=READ) == Target(95, 1, 1, READ)
    assert punkt_from_stedfesting(skilt.stedfesting[0]) == Punkt(
        veglenkesekvens_id=2510771, posisjon=0.25, retning="MED", sideposisjon="H", kjorefelt=("1",)
    )
    assert punkt_from_stedfesting(VegobjektStedfesting("Linje", 1)) is None
    with pytest.raises(RequestError, match="801 came without its version"):
        target_from_skilt(dataclasses.replace(skilt, version=None))
