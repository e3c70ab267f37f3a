"""The mirror's rows → sites."""

from __future__ import annotations

import datetime as dt
import math
from typing import Any

import pytest
from shapely import LineString

from nvdb.vegnett import Veglenke, Vegnett, Vegreferanse
from twin.matching.config import MatchConfig
from twin.matching.sites import Plate, along_the_road, sites_from_mirror

CONFIG = MatchConfig()


def row(nvdb_id: int, **changed: Any) -> dict[str, Any]:
    """Make a row that both tables share."""
    return {
        "nvdb_id": nvdb_id,
        "version": 1,
        "start_date": "2020-01-01",
        "end_date": None,
        "east_m": 1000.0,
        "north_m": 2000.0,
        "own_geometry": True,
        "accuracy_cm": 20.0,
        "capture_method": "sat",
        "synced_at": "2026-06-10T08:00:00Z",
        **changed,
    }


def point(nvdb_id: int, *plate_ids: int, **changed: Any) -> dict[str, Any]:
    """Make a Skiltpunkt."""
    return row(nvdb_id, plate_ids=list(plate_ids), **changed)


def plate(nvdb_id: int, code: str, **changed: Any) -> dict[str, Any]:
    """Make a Skiltplate."""
    values: dict[str, Any] = {
        "point_id": None,
        "ansiktsside": None,
        "plasseringskode": None,
        "text": None,
        **changed,
    }
    return row(nvdb_id, skiltnummer=code, **values)


def test_sites_hold_their_plates_top_down() -> None:
    """Plates come in the order of plasseringskode, found by either end of the relation."""
    plates = [plate(11, "808", point_id=1, plasseringskode=20), plate(12, "362.50", plasseringskode=10)]
    (site,) = sites_from_mirror([point(1, 12)], plates, CONFIG)
    assert (site.nvdb_type, site.nvdb_id, site.codes) == (95, 1, ("362.50", "808"))


def test_sites_group_plates_without_a_point_by_position() -> None:
    """Plates whose Skiltpunkt is not mirrored and that share coordinates are one site."""
    plates = [plate(11, "202"), plate(12, "808"), plate(13, "372", east_m=1005.0)]
    first, second = sites_from_mirror([], plates, CONFIG)
    assert (first.nvdb_type, first.nvdb_id, first.codes) == (96, 11, ("202", "808"))
    assert second.codes == ("372",)


def test_sites_take_a_plates_own_position_where_the_point_has_none() -> None:
    """A Skiltpunkt on the centre line stands where its plate was measured."""
    bare = point(1, 11, own_geometry=False, east_m=990.0)
    (site,) = sites_from_mirror([bare], [plate(11, "202")], CONFIG)
    assert site.own_geometry
    assert site.east_m == 1000.0


def test_sites_without_any_position_are_left_out() -> None:
    """What has no position cannot be matched by position."""
    assert sites_from_mirror([point(1, east_m=None, own_geometry=False)], [], CONFIG) == []


def test_sites_whose_sluttdato_has_passed_are_left_out() -> None:
    """An object closed before the sync is no sign; one that closes later still is."""
    assert sites_from_mirror([point(1, end_date="2020-01-01")], [], CONFIG) == []
    assert len(sites_from_mirror([point(1, end_date="2030-01-01")], [], CONFIG)) == 1


def test_sites_distrust_default_looking_accuracy() -> None:
    """A stated 20 cm is taken; 100 cm by an unknown method, -1 and nothing are the configured default."""
    stated = {"accuracy_cm": 20.0, "capture_method": "sat"}
    default = {"accuracy_cm": 100.0, "capture_method": "ukj"}
    for given, expected in ((stated, 0.2), (default, 1.0), ({"accuracy_cm": None}, 1.0)):
        (site,) = sites_from_mirror([point(1, **given)], [], CONFIG)
        assert site.sigma_m == expected
    (line,) = sites_from_mirror([point(1, own_geometry=False)], [], CONFIG)
    assert line.sigma_m == CONFIG.centre_line_sigma_m


def test_sites_leave_disputed_plates_to_their_own_word() -> None:
    """A plate that two points claim belongs to the one that it names itself."""
    points = [point(1, 11), point(2, 11, east_m=1005.0)]
    sites = sites_from_mirror(points, [plate(11, "202", point_id=2)], CONFIG)
    assert [(s.nvdb_id, s.codes) for s in sites] == [(1, ()), (2, ("202",))]


def test_sites_on_the_centre_line_keep_the_side_that_nvdb_says() -> None:
    """The side of stedfesting is kept where there is no better position, and only a real side."""
    for side, expected in (("H", "H"), ("V", "V"), ("M", ""), (None, "")):
        bare = point(1, own_geometry=False, stedfesting=[{"sideposisjon": side}])
        (site,) = sites_from_mirror([bare], [], CONFIG)
        assert site.side == expected
    (site,) = sites_from_mirror([point(1, stedfesting=[{"sideposisjon": "H"}])], [], CONFIG)
    assert site.side == ""


def test_sites_on_the_centre_line_get_the_direction_of_their_road() -> None:
    """Along a link to the east that is metered with it, the road runs at 90° of the grid; others get none."""
    road = Veglenke(
        veglenkesekvensid=7,
        veglenkenummer=1,
        segmentnummer=1,
        startposisjon=0.0,
        sluttposisjon=1.0,
        geometri=LineString([(900.0, 2000.0, 5.0), (1100.0, 2000.0, 5.0)]),
        startdato=dt.date(2010, 1, 1),
        type_veg="enkelBilveg",
        referanse=Vegreferanse("FV1", "F", "V", 1, "K", "MED", 0.0, 200.0),
    )
    sites = sites_from_mirror([point(1, own_geometry=False), point(2)], [], CONFIG)
    loose, own = along_the_road(sites, Vegnett.from_veglenker([road]))
    assert loose.road_azimuth_deg == pytest.approx(90.0)
    assert math.isnan(own.road_azimuth_deg)


def test_plates_show_their_faces() -> None:
    """A plate that looks south shows to the south, not to the north; a two-sided one to both."""
    south, both = (Plate(1, 1, "202", None, faces) for faces in ((180.0, math.nan), (180.0, 0.0)))
    assert (south.shows_to(170.0), south.shows_to(10.0)) == (True, False)
    assert (both.shows_to(170.0), both.shows_to(10.0)) == (True, True)
    assert Plate(1, 1, "202", None).shows_to(10.0)
