"""Objects, versions and areas of Uberiket V1."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, date, datetime
from typing import Any

import pytest

from nvdb.area import Area
from nvdb.datakatalog import snapshot
from nvdb.errors import AreaError, SchemaError
from nvdb.mirror import FeedTooOldError, UberiketSource
from nvdb.mirror.uberiket import current_versions
from nvdb.objects import Skiltplate, Skiltpunkt, skilt_from_uberiket, vegobjekt_from_uberiket
from nvdb.replay import Fault, ReplayWorld

NOW = datetime(2026, 6, 1, 12, tzinfo=UTC)
COUNTRY = Area()

PLATE: dict[str, Any] = {
    "id": 7,
    "versjon": 2,
    "typeId": 96,
    "gyldighetsperiode": {"startdato": "2020-01-01"},
    "egenskaper": {
        "5530": {"type": "EnumEgenskap", "verdi": 7633},
        "1894": {"type": "EnumEgenskap", "verdi": 2717},
        "5128": {"type": "HeltallEgenskap", "verdi": 20},
        "4795": {
            "type": "GeometriEgenskap",
            "verdi": {
                "wkt": "POINT Z (270196.99 7041858.13 12.3)",
                "srid": 5973,
                "datafangstdato": "2025-10-31",
                "kvalitet": {"datafangstmetode": "sat", "noyaktighet": 10, "maksimaltAvvik": -1},
            },
        },
    },
    "barn": {},
    "stedfesting": {
        "type": "StedfestingPunkter",
        "punkter": [{"id": 123, "posisjon": 0.5, "retning": "MED", "sideposisjon": "H", "kjorefelt": []}],
    },
    "sistEndret": "2025-11-01T12:00:00.5Z",
}


def changed(**egenskaper: Any) -> dict[str, Any]:
    """The plate with other properties."""
    return PLATE | {"egenskaper": PLATE["egenskaper"] | {key[1:]: item for key, item in egenskaper.items()}}


def test_uberiket_plate_is_read_with_the_datakatalogs_words() -> None:
    """Enum ids become text, the geometry property becomes position and quality, -1 becomes unknown."""
    plate = skilt_from_uberiket(PLATE, 96, snapshot())
    assert isinstance(plate, Skiltplate)
    assert (plate.skiltnummer, plate.skiltnummer_text, plate.enum_id) == ("142", "142 - Barn", 7633)
    assert (plate.ansiktsside, plate.ansiktsside_enum_id) == ("Trafikk mot metreringsretning", 2717)
    assert plate.plasseringskode == 20
    assert plate.position is not None
    assert (plate.position.east_m, plate.position.north_m, plate.position.height_m) == (
        270196.99,
        7041858.13,
        12.3,
    )
    assert (plate.own_geometry, plate.accuracy_cm, plate.capture_method) == (True, 10.0, "sat")
    assert plate.stedfesting[0].veglenkesekvensid == 123
    assert (plate.version, plate.start_date, plate.end_date, plate.problems) == (2, "2020-01-01", None, ())


@pytest.mark.parametrize("barn", [{"220004": [8, 9]}, {"200004": [8, 9]}, {"220004": [8], "200004": [8, 9]}])
def test_uberiket_point_finds_its_plates_under_either_id(barn: dict[str, list[int]]) -> None:
    """The list's id and its members' id both lead to the plates, each of them once."""
    point = skilt_from_uberiket(PLATE | {"typeId": 95, "egenskaper": {}, "barn": barn}, 95, snapshot())
    assert isinstance(point, Skiltpunkt)
    assert point.plate_ids == (8, 9)
    assert point.problems == ()


def test_uberiket_unknown_ids_are_kept_and_named() -> None:
    """A new sign number, property kind and relation are kept by id, and the object lives."""
    raw = changed(
        _5530={"type": "EnumEgenskap", "verdi": 99999},
        _4711={"type": "HelligEgenskap", "verdi": {"x": 1}},
    ) | {"barn": {"999001": [4]}}
    plate = skilt_from_uberiket(raw, 96, snapshot())
    assert isinstance(plate, Skiltplate)
    assert (plate.enum_id, plate.skiltnummer) == (99999, None)
    assert plate.problems == (
        "enum 99999 of egenskap 5530 is not in datakatalog 2.38",
        "relation 999001 is not in datakatalog 2.38, its children are left out",
    )
    kept = vegobjekt_from_uberiket(raw, snapshot()).egenskaper[4711]
    assert (kept.egenskapstype, kept.verdi) == ("HelligEgenskap", {"x": 1})


@pytest.mark.parametrize(
    ("part", "field"),
    [
        ({"versjon": None}, "versjon"),
        ({"egenskaper": {"tull": {}}}, "egenskaper.tull"),
        ({"egenskaper": {"5530": {"type": "EnumEgenskap", "verdi": "8874"}}}, "egenskaper.5530.verdi"),
        ({"egenskaper": {"4795": {"type": "GeometriEgenskap", "verdi": "POINT"}}}, "egenskaper.4795.verdi"),
        ({"stedfesting": {"type": "StedfestingPunkter", "punkter": [{"posisjon": "x"}]}}, "posisjon"),
        ({"barn": {"220004": ["8"]}}, "barn.220004"),
    ],
)
def test_uberiket_object_that_breaks_the_form_names_the_field(part: dict[str, Any], field: str) -> None:
    """A field of the wrong type names the object and the path of the field."""
    with pytest.raises(SchemaError, match=rf"vegobjekt 7 .*{field}"):
        skilt_from_uberiket(PLATE | part, 96, snapshot())


@pytest.mark.parametrize(
    ("wkt", "srid", "clause"),
    [
        ("POINT Z (7041858.13 270196.99 1)", 5973, "axes look swapped"),
        ("POINT (270196.99 7041858.13)", 3857, "unknown srid 3857"),
        ("POINT EMPTY", 5973, "is empty"),
    ],
)
def test_uberiket_geometry_that_cannot_be_used_leaves_no_position(wkt: str, srid: int, clause: str) -> None:
    """Swapped axes, a wrong srid and an empty geometry are named, and never become a position."""
    geometry = {"type": "GeometriEgenskap", "verdi": {"wkt": wkt, "srid": srid}}
    plate = skilt_from_uberiket(changed(_4795=geometry), 96, snapshot())
    assert plate.position is None
    assert any(clause in problem for problem in plate.problems)


@pytest.mark.parametrize(
    ("day", "versjon"),
    [("2019-12-31", 1), ("2020-01-01", 1), ("2023-12-31", 1), ("2024-01-01", 2), ("2025-06-01", None)],
)
def test_current_version_is_the_one_valid_on_the_day(day: str, versjon: int | None) -> None:
    """The end date is the first day that no longer counts; before all versions the first to come is taken."""
    versions = [
        {"id": 1, "versjon": 1, "gyldighetsperiode": {"startdato": "2020-01-01", "sluttdato": "2024-01-01"}},
        {"id": 1, "versjon": 2, "gyldighetsperiode": {"startdato": "2024-01-01", "sluttdato": "2025-06-01"}},
    ]
    chosen = [raw["versjon"] for raw in current_versions(versions, date.fromisoformat(day))]
    assert chosen == ([] if versjon is None else [versjon])


@pytest.fixture
def world(plate: Callable[..., Any]) -> ReplayWorld:
    """Plates 501 to 504."""
    return ReplayWorld({96: [plate(number) for number in range(501, 505)]}, clock=lambda: NOW)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6, 1000])
@pytest.mark.parametrize("start", ["2026-05-01", "2026-07-01"])
def test_versions_on_both_sides_of_a_page_break_are_weighed_together(
    api: Any, world: ReplayWorld, size: int, start: str
) -> None:
    """Wherever the pages break, the version kept last is the one valid today, past or future ones aside."""
    world.new_version(502, start)
    world.close(504, "2026-05-31")
    client, _ = api.serve(world)
    source = UberiketSource(client, page_size=size, clock=lambda: NOW)
    kept = {s.nvdb_id: s.version for page in source.pages(96, COUNTRY) for s in page.objects}
    assert kept == {501: 2, 502: 3 if start < "2026-06-01" else 2, 503: 2}
    assert source.fetch(96, [502, 504], COUNTRY).missing == {504}


@pytest.mark.parametrize(
    "area",
    [
        Area(kommuner=(5001,)),
        Area(fylker=(50,)),
        Area(kontraktsomrader=("9503 Midtre Hålogaland 2021-2026",)),
    ],
    ids=Area.text,
)
def test_uberiket_refuses_what_it_cannot_select_with_the_cure(
    api: Any, world: ReplayWorld, area: Area
) -> None:
    """There are no such filters, and guessing would mirror the wrong signs."""
    client, server = api.serve(world)
    source = UberiketSource(client)
    for ask in (lambda: next(source.pages(96, area)), lambda: source.fetch(96, [501], area)):
        with pytest.raises(AreaError, match=f"cannot select {area.text()}: take the source les-v4"):
            ask()
    assert server.requests == []


def test_uberiket_box_is_decided_by_own_geometry(api: Any, world: ReplayWorld, plate: Any) -> None:
    """Backfill and fetch agree on what is in a box; a sign without own geometry is left out and named."""
    bare = plate(505)
    bare["egenskaper"] = [item for item in bare["egenskaper"] if item["id"] != 4795]
    world.create(96, bare)
    client, _ = api.serve(world)
    source = UberiketSource(client)
    box = Area(bbox=(269_999.0, 7_040_501.5, 270_001.0, 7_040_503.5))
    (page,) = source.pages(96, box)
    result = source.fetch(96, [501, 502, 503, 505], box)
    assert [s.nvdb_id for s in page.objects] == [s.nvdb_id for s in result.objects] == [502, 503]
    assert result.missing == {501, 505}
    assert any("505 has no usable geometry" in problem for problem in (*page.problems, *result.problems))
    assert source.count(96, box) is None


def test_uberiket_event_that_is_gone_asks_for_a_backfill(api: Any, world: ReplayWorld) -> None:
    """410 from the feed means that the mirror's position is lost."""
    client, _ = api.serve(world, lambda info: Fault("status", 410))
    with pytest.raises(FeedTooOldError, match=r"event 17 .*make a fresh backfill"):
        list(UberiketSource(client).changes((96,), "17"))
