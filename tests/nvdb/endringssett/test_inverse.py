"""Undo: carried out and undone, an object says what it said before."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, date, datetime
from typing import Any

import pytest

from nvdb.endringssett import (
    Assosiasjon,
    Datter,
    Earlier,
    Egenskap,
    Endring,
    Measured,
    NewPlate,
    Punkt,
    Target,
    changed_type,
    earlier_from_vegobjekt,
    endringssett,
    errors,
    gone,
    inverse,
    moved,
    new_plates,
    new_sign,
    position_correction,
    validate,
)
from nvdb.errors import RequestError
from nvdb.objects import vegobjekt_from_les_v4

READ = datetime(2026, 11, 1, tzinfo=UTC)
DONE = datetime(2026, 11, 2, tzinfo=UTC)
DAY = date(2026, 10, 31)
PLACE = Punkt(veglenkesekvens_id=2510771, posisjon=0.5)
MEASURED = Measured(east_m=270001, north_m=7040001, std_m=0.1, captured=DAY)


def _undo(group: tuple[Endring, ...], earlier: list[Earlier], **ids: int) -> tuple[Endring, ...]:
    (sett,) = endringssett([group], datakatalogversjon="2.38")
    undone = inverse(sett, earlier, nvdb_ids=ids, lest_fra_nvdb=DONE)
    assert errors(validate(undone)) == ()
    return undone.endringer


@pytest.fixture
def before(plate: Any) -> Earlier:
    """State of a plate as API Les V4 gives it, with a full set of quality parameters."""
    raw = plate(801)
    geometry = raw["egenskaper"][-1]
    geometry["kvalitet"] = {
        "datafangstmetode": "sat", "nøyaktighet": 12, "synbarhet": 0,
        "datafangstmetodeHøyde": "sat", "nøyaktighetHøyde": 30,
    }  # fmt: skip
    geometry["datafangstdato"] = "2019-05-04"
    return earlier_from_vegobjekt(vegobjekt_from_les_v4(raw))


def test_state_of_an_object_is_taken_from_api_les(before: Earlier) -> None:
    """Values, enum ids, geometry with its quality, place and version come over in Skriv's words."""
    assert (before.type_id, before.nvdb_id, before.versjon, before.startdato) == (
        96,
        801,
        2,
        date(2020, 5, 1),
    )
    values = {e.type_id: (*e.verdi, *e.enum) for e in before.egenskaper if e.geometri is None}
    assert values == {5530: (8874,), 1894: (2714,), 5128: ("10",), 1910: ("50",)}
    (geometri,) = (e.geometri for e in before.egenskaper if e.geometri is not None)
    assert (geometri.srid, geometri.wkt) == (5973, "POINT Z (270000.0 7040801.0 42.5)")
    assert geometri.datafangstdato == date(2019, 5, 4)
    assert before.stedfesting is not None
    assert before.stedfesting.punkter == (
        Punkt(veglenkesekvens_id=2510771, posisjon=0.25, retning="MED", sideposisjon="H", kjorefelt=("1",)),
    )


def test_unknown_heights_and_foreign_geometries_are_not_sent_back(plate: Any) -> None:
    """-999999 becomes a position in plan, and a point on the centre line is no property of the object."""
    raw = plate(801)
    raw["egenskaper"][-1]["verdi"] = "POINT Z (270000 7040801 -999999)"
    state = earlier_from_vegobjekt(vegobjekt_from_les_v4(raw))
    (wkt,) = (e.geometri.wkt for e in state.egenskaper if e.geometri is not None)
    assert wkt == "POINT (270000.0 7040801.0)"
    raw["geometri"]["egengeometri"] = False
    foreign = earlier_from_vegobjekt(vegobjekt_from_les_v4(raw))
    assert all(e.geometri is None for e in foreign.egenskaper)


def test_a_correction_is_undone_in_its_version(before: Earlier) -> None:
    """The same version gets its old geometry and place, read at the time of the set's own transaction."""
    group = position_correction(Target(96, 801, 2, READ), MEASURED, stedfesting=PLACE)
    (undone,) = _undo(group, [before])
    assert (undone.operasjon, undone.versjon, undone.lest_fra_nvdb) == ("delvisKorriger", 2, DONE)
    (old,) = (e for e in before.egenskaper if e.geometri is not None)
    assert undone.egenskaper == (replace(old, operasjon="oppdater"),)
    assert undone.stedfesting is not None
    assert before.stedfesting is not None
    assert undone.stedfesting.punkter == before.stedfesting.punkter


def test_an_update_is_undone_in_the_version_that_it_made(before: Earlier) -> None:
    """Version 3, which the update made, gets what version 2 says."""
    target = Target(96, 801, 2)
    (of_type,) = _undo(changed_type(target, "362.60", on_date=DAY), [before])
    assert (of_type.operasjon, of_type.versjon) == ("delvisKorriger", 3)
    assert of_type.egenskaper == (Egenskap(type_id=5530, enum=(8874,), operasjon="oppdater"),)
    (of_place,) = _undo(moved(target, MEASURED, on_date=DAY, stedfesting=PLACE), [before])
    assert of_place.versjon == 3


def test_a_property_that_was_not_there_is_deleted_again(before: Earlier) -> None:
    """A geometry that NVDB lacked before the correction goes."""
    bare = replace(before, egenskaper=())
    (undone,) = _undo(position_correction(Target(96, 801, 2, READ), MEASURED), [bare])
    assert undone.egenskaper == (Egenskap(type_id=4795, operasjon="slett"),)


def test_a_new_sign_is_removed_with_its_plates() -> None:
    """One removal of the Skiltpunkt takes the plates along."""
    group = new_sign("s", MEASURED, on_date=DAY, stedfesting=PLACE, plates=[NewPlate(skiltnummer="202")] * 2)
    (undone,) = _undo(group, [], **{"s": 50, "s#1": 51, "s#2": 52})
    assert (undone.operasjon, undone.type_id, undone.nvdb_id, undone.versjon, undone.kaskade) == (
        "fjern", 95, 50, None, True,
    )  # fmt: skip


def test_a_new_plate_on_a_known_skiltpunkt_is_taken_off_it() -> None:
    """The Skiltpunkt loses the child, and the child is removed."""
    point = Earlier(type_id=95, nvdb_id=1, versjon=4, startdato=DAY, dotre={220004: (7,)})
    group = new_plates(
        Target(95, 1, 4), "p", MEASURED, on_date=DAY, stedfesting=PLACE, plates=[NewPlate(skiltnummer="202")]
    )
    parent, child = _undo(group, [point], **{"p#1": 9})
    assert (parent.operasjon, parent.versjon) == ("delvisKorriger", 5)
    assert [(d.nvdb_id, d.operasjon) for d in parent.assosiasjoner[0].dotre] == [(9, "slett")]
    assert (child.operasjon, child.nvdb_id) == ("fjern", 9)


@pytest.mark.parametrize(
    ("before", "expected"), [((7, 8), ("oppdater", (7, 8))), ((), ("slett", ()))], ids=["two", "none"]
)
def test_a_replaced_list_of_children_is_replaced_again(
    before: tuple[int, ...], expected: tuple[str, tuple[int, ...]]
) -> None:
    """The earlier children come back under either id of the association; where there were none, it goes."""
    assosiasjon = Assosiasjon(type_id=220004, dotre=(Datter(nvdb_id=9),), operasjon="oppdater")
    group = (
        Endring(
            operasjon="delvisOppdater", type_id=95, nvdb_id=1, versjon=4, startdato=DAY,
            assosiasjoner=(assosiasjon,),
        ),
    )  # fmt: skip
    state = Earlier(type_id=95, nvdb_id=1, versjon=4, startdato=DAY, dotre={200004: before})
    (undone,) = _undo(group, [state])
    (restored,) = undone.assosiasjoner
    assert (restored.operasjon, tuple(datter.nvdb_id for datter in restored.dotre)) == expected


def test_truth_values_come_back_as_ja_and_nei(plate: Any) -> None:
    """API Les writes JSON's true and false, API Skriv JA and NEI."""
    raw = plate(801)
    raw["egenskaper"] = [
        {"id": 1, "navn": "a", "egenskapstype": "Boolsk", "verdi": True},
        {"id": 2, "navn": "b", "egenskapstype": "Boolsk", "verdi": False},
        {"id": 3, "navn": "c", "egenskapstype": "Flyttall", "verdi": 1.5},
    ]
    state = earlier_from_vegobjekt(vegobjekt_from_les_v4(raw))
    assert [e.verdi for e in state.egenskaper] == [("JA",), ("NEI",), ("1.5",)]


def test_a_closing_is_opened_with_the_children_that_it_took_along(before: Earlier) -> None:
    """Each gets its validity back, without an end date."""
    point = Earlier(type_id=95, nvdb_id=1, versjon=4, startdato=DAY, dotre={220004: (801,)})
    undone = _undo(gone(Target(95, 1, 4), on_date=DAY), [point, before])
    assert [(e.operasjon, e.nvdb_id, e.versjon, e.startdato, e.sluttdato) for e in undone] == [
        ("delvisKorriger", 1, 4, DAY, None),
        ("delvisKorriger", 801, 2, date(2020, 5, 1), None),
    ]
    with pytest.raises(RequestError, match="closed 801 too"):
        _undo(gone(Target(95, 1, 4), on_date=DAY), [point])


def test_what_cannot_be_undone_is_said(before: Earlier) -> None:
    """No state, no id, no place before, or a removal: each is refused by name."""
    with pytest.raises(RequestError, match="without the state before it"):
        _undo(changed_type(Target(96, 1, 1, READ), "202"), [before])
    with pytest.raises(RequestError, match="'s' has no nvdbId"):
        _undo(
            new_sign("s", MEASURED, on_date=DAY, stedfesting=PLACE, plates=[NewPlate(skiltnummer="202")]), []
        )
    group = position_correction(Target(96, 801, 2, READ), MEASURED, stedfesting=PLACE)
    with pytest.raises(RequestError, match="stedfesting that it had before"):
        _undo(group, [replace(before, stedfesting=None)])
    with pytest.raises(RequestError, match="cannot be undone: register"):
        _undo((Endring(operasjon="fjern", type_id=96, nvdb_id=1, kaskade=True),), [])
    with pytest.raises(RequestError, match="inkluder=alle"):
        earlier_from_vegobjekt(vegobjekt_from_les_v4({"id": 1}, type_id=96))
