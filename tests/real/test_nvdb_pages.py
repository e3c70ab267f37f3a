"""Real pages of API Les V4 (Utsira and Oslo, September 2026) and a V3-era Skiltpunkt, read without loss."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from checkout import REAL

from nvdb import datakatalog
from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.mirror import LesV4Source
from nvdb.objects import (
    Position,
    Skiltplate,
    Skiltpunkt,
    point_from_wkt,
    position_from_wkt,
    skilt_from_les_v4,
    vegobjekt_from_les_v4,
)
from nvdb.replay import ReplayServer

NVDB = REAL / "nvdb"
PAGES = NVDB / "les_v4_live_2026-09"

pytestmark = pytest.mark.skipif(not PAGES.is_dir(), reason="the real NVDB pages are not on this machine")

UTSIRA, OSLO = "signs-1151-page1.json", "signs-0301-page1.json"


def _raw(name: str) -> list[dict[str, Any]]:
    objects = json.loads((PAGES / name).read_text(encoding="utf-8"))["objekter"]
    assert isinstance(objects, list)
    return objects


def _plates(name: str) -> list[Skiltplate]:
    plates = [skilt_from_les_v4(raw, 96) for raw in _raw(name)]
    assert all(isinstance(plate, Skiltplate) for plate in plates)
    return [plate for plate in plates if isinstance(plate, Skiltplate)]


@pytest.mark.parametrize(("name", "n", "n_own", "n_points"), [(UTSIRA, 32, 28, 15), (OSLO, 30, 30, 20)])
def test_real_plates_are_all_read(name: str, n: int, n_own: int, n_points: int) -> None:
    """Every plate has a code, an enum id, a facing and a position; plates on one pole share theirs."""
    plates = _plates(name)
    assert len(plates) == n
    assert sum(plate.own_geometry for plate in plates) == n_own
    assert all(plate.problems == () for plate in plates)
    assert all(plate.skiltnummer and plate.enum_id and plate.ansiktsside_enum_id for plate in plates)
    assert len({plate.position for plate in plates}) == n_points
    # These pages were asked for without metadata, lokasjon and relasjoner.
    assert {(plate.version, plate.point_id, plate.road_reference) for plate in plates} == {(None, None, None)}


def test_real_utsira_plates_without_own_geometry_are_marked() -> None:
    """The four plates with ``egengeometri: false`` are the four without a geometry property."""
    without = [plate for plate in _plates(UTSIRA) if not plate.own_geometry]
    assert [plate.nvdb_id for plate in without] == [79821600, 79821641, 142101746, 465823000]
    assert all(plate.accuracy_cm is None and plate.capture_method is None for plate in without)
    # Heights of the road network are known: 2.286 m at the quay.
    assert [plate.position and plate.position.height_m for plate in without] == [
        2.28613548, 5.16790233, 2.28613548, 2.321,
    ]  # fmt: skip
    own = {plate.position for plate in _plates(UTSIRA) if plate.own_geometry}
    assert len(own) == 12


@pytest.mark.parametrize("name", [UTSIRA, OSLO])
def test_real_positions_equal_the_property_to_the_last_digit(name: str) -> None:
    """With own geometry the stored UTM33 is the number in 4795, and -999999 is no height."""
    for raw, plate in zip(_raw(name), _plates(name), strict=True):
        if not plate.own_geometry:
            continue
        verdi = next(item["verdi"] for item in raw["egenskaper"] if item["id"] == 4795)
        numbers = [float(text) for text in verdi[verdi.index("(") + 1 : -1].split()]
        assert plate.position is not None
        assert [plate.position.east_m, plate.position.north_m] == numbers[:2]
        unknown = len(numbers) == 2 or numbers[2] == -999999
        assert plate.position.height_m == (None if unknown else numbers[2])


def test_real_heights_are_unknown_on_utsira_and_partly_known_in_oslo() -> None:
    """No own geometry on Utsira has a height; in Oslo some have, the 2-D and -999999 ones not."""
    utsira = [plate.position.height_m for plate in _plates(UTSIRA) if plate.position and plate.own_geometry]
    assert utsira == [None] * 28
    oslo = [plate.position.height_m for plate in _plates(OSLO) if plate.position]
    known = [height for height in oslo if height is not None]
    assert len(oslo) == 30
    assert 0 < len(known) < 30
    assert all(0 < height < 700 for height in known)


@pytest.mark.parametrize(("name", "limit_m"), [(UTSIRA, 0.05), (OSLO, 0.006)])
def test_real_degrees_convert_to_where_the_property_is(name: str, limit_m: float) -> None:
    """``geometri`` in 4326 lands within 5 cm of 4795 on Utsira and 6 mm in Oslo: NVDB's own difference."""
    distances = []
    for raw, plate in zip(_raw(name), _plates(name), strict=True):
        if plate.own_geometry and plate.position is not None:
            shown, _ = position_from_wkt(raw["geometri"]["wkt"], raw["geometri"]["srid"])
            distances.append(
                math.hypot(shown.east_m - plate.position.east_m, shown.north_m - plate.position.north_m)
            )
    assert len(distances) >= 28
    assert max(distances) < limit_m


def test_real_network_positions_lie_among_the_signs_of_the_island() -> None:
    """Plates known only in degrees land on Utsira, within 3 km of the measured ones."""
    plates = _plates(UTSIRA)
    own = next(plate.position for plate in plates if plate.own_geometry)
    assert own is not None
    for plate in plates:
        assert plate.position is not None
        assert math.hypot(plate.position.east_m - own.east_m, plate.position.north_m - own.north_m) < 3000


def test_real_quality_is_read_as_stated() -> None:
    """Utsira: 100 cm by ukj throughout; Oslo: 29 ukj and 1 dig, 100 to 277 cm."""
    utsira = {(plate.accuracy_cm, plate.capture_method) for plate in _plates(UTSIRA) if plate.own_geometry}
    assert utsira == {(100.0, "ukj")}
    oslo = _plates(OSLO)
    assert [plate.capture_method for plate in oslo].count("dig") == 1
    assert sorted({plate.accuracy_cm for plate in oslo if plate.accuracy_cm}) == [100.0, 119.0, 162.0, 277.0]


def test_real_codes_agree_with_the_datakatalog() -> None:
    """Every code with a known enum id has that id; retired codes are marked, five of 62 plates."""
    plates = _plates(UTSIRA) + _plates(OSLO)
    known = [plate for plate in plates if plate.skiltnummer in datakatalog.SKILTNUMMER_ENUM]
    assert len(known) == len(plates)
    for plate in known:
        assert plate.skiltnummer is not None
        assert plate.enum_id == datakatalog.SKILTNUMMER_ENUM[plate.skiltnummer]
    retired = [plate.skiltnummer for plate in plates if plate.retired]
    assert retired == ["U722.2", "U722.3", "U721.2", "U721.2", "U721.2"]


def test_real_properties_and_facings_have_names_in_the_datakatalog() -> None:
    """No property or facing on the pages is unknown to the shipped tables."""
    for name in (UTSIRA, OSLO):
        for raw in _raw(name):
            found = vegobjekt_from_les_v4(raw)
            assert set(found.egenskaper) <= set(datakatalog.EGENSKAPER_96)
            assert len(found.egenskaper) == len(raw["egenskaper"])
            assert found.raw == raw
    assert {plate.ansiktsside_enum_id for plate in _plates(UTSIRA)} <= set(datakatalog.Ansiktsside)


def test_shipped_ids_equal_the_datakatalog() -> None:
    """Property, enum and sign-code ids are those of the datakatalog's own files."""
    folder = NVDB / "datakatalog"
    names = json.loads((folder / "egenskapstyper_95_96.json").read_text(encoding="utf-8"))
    known_95 = {int(key): value for key, value in names["95 Skiltpunkt"].items() if key != "100095"}
    assert known_95 == datakatalog.EGENSKAPER_95
    assert {int(key): value for key, value in names["96 Skiltplate"].items()} == datakatalog.EGENSKAPER_96
    assert sorted(names["enum 1894"].values()) == sorted(datakatalog.Ansiktsside)
    codes = json.loads((folder / "skiltnummer_5530_partial.json").read_text(encoding="utf-8"))
    assert codes["values"] == datakatalog.SKILTNUMMER_ENUM
    type_95 = json.loads((folder / "vegobjekttype_95_les_v3.json").read_text(encoding="utf-8"))
    ids = {item["id"] for item in type_95["egenskapstyper"]}
    assert {datakatalog.SKILTPLATER_I_SKILTPUNKT, *datakatalog.GEOMETRI_PUNKT.values()} - ids == {4795}
    # 12318 came after this definition was recorded.
    assert set(datakatalog.EGENSKAPER_95) - ids <= {12318}


def test_real_skiltpunkt_of_v3_is_read() -> None:
    """A Skiltpunkt of API Les V3: on the network only, with stedfesting, road and relations."""
    document = json.loads((NVDB / "lesv3" / "vegobjekter" / "95.json").read_text(encoding="utf-8"))
    (raw,) = document["objekter"]
    point = skilt_from_les_v4(raw, 95)
    assert isinstance(point, Skiltpunkt)
    assert (point.nvdb_id, point.version, point.start_date) == (78735745, 1, "1950-01-01")
    assert not point.own_geometry
    assert point.position == Position(88206.76856, 6783844.94758, 259.86262)
    assert point.kommuner == (1421,)
    assert point.road_reference == "EV16 S19D1 M759-13965"
    (stedfesting,) = point.stedfesting
    assert (stedfesting.veglenkesekvensid, stedfesting.relativ_posisjon) == (384011, 0.07178555)
    assert point.plate_ids == ()  # its child is a Variabelt skilt (97)
    found = vegobjekt_from_les_v4(raw)
    assert found.barn[0].type_id == datakatalog.VARIABELT_SKILT
    assert found.foreldre[0].vegobjekter == (78731475,)


@pytest.mark.parametrize(("number", "is_point"), [(14, True), (105, False), (581, True)])
def test_real_objects_of_other_types_are_read(number: int, is_point: bool) -> None:
    """Rekkverksende, fartsgrense and tunnel pass the same parser; a line has no position and says why."""
    document = json.loads((NVDB / "lesv3" / "vegobjekter" / f"{number}.json").read_text(encoding="utf-8"))
    (raw,) = document.get("objekter", [document])
    found = vegobjekt_from_les_v4(raw)
    assert found.type_id == number
    assert len(found.egenskaper) == len(raw["egenskaper"])
    assert (found.position is not None) == is_point
    assert found.problems == (() if is_point else ("geometri is a MULTILINESTRING, not a point",))


@pytest.mark.parametrize("page_size", [7, 1000])
@pytest.mark.parametrize(("kommune", "name"), [(1151, UTSIRA), (301, OSLO)])
def test_real_pages_replayed_and_synced_are_the_same_objects(kommune: int, name: str, page_size: int) -> None:
    """The folder of pages, served and pulled through the source, gives each kommune's plates unchanged."""
    area = Area(kommuner=(kommune,))
    with ReplayServer(PAGES) as server, NvdbClient(server.url) as client:
        assert server.counts == {95: 0, 96: 62}
        source = LesV4Source(client, page_size=page_size)
        pages = list(source.pages(96, area))
        expected = source.count(96, area)
        assert list(source.pages(95, area)) == []
    objects = [skilt for page in pages for skilt in page.objects]
    assert objects == _plates(name)
    assert [item.raw for item in objects] == _raw(name)
    assert expected == len(objects) == sum(page.received for page in pages)
    assert [page.problems for page in pages if page.problems] == []


def test_real_pages_are_found_by_a_box_around_the_island() -> None:
    """A box in UTM33 around Utsira gives its 32 plates, and none of Oslo's."""
    area = Area(bbox=(-76_000.0, 6_616_000.0, -73_000.0, 6_619_000.0))
    with ReplayServer(PAGES) as server, NvdbClient(server.url) as client:
        pages = list(LesV4Source(client).pages(96, area))
    assert [skilt for page in pages for skilt in page.objects] == _plates(UTSIRA)


def test_real_wkt_spellings_are_the_ones_that_were_looked_for() -> None:
    """Both spellings on the pages, with and without Z, are among what was read."""
    spellings = {raw["geometri"]["wkt"].split("(")[0] for name in (UTSIRA, OSLO) for raw in _raw(name)}
    assert spellings == {"POINT", "POINT Z "}
    assert point_from_wkt("POINT(272823.61970873317 6656187.927670195)")[2] is None
