"""Stedfesting: laws of the projection, hand-worked places, and an independent search as the oracle."""

from __future__ import annotations

from datetime import date
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from nvdb.errors import RequestError
from nvdb.vegnett import BILVEG, Stedfestinger, Veglenke, Vegnett, Vegreferanse, stedfester
from nvdb.vegnett.stedfest import meter_kortform, position_text

E0, N0 = 270_000.0, 7_040_000.0
DAY = date(2026, 5, 4)


def _placed(
    nett: Vegnett, east: Any, north: Any, *, max_distance_m: float = 50.0, **options: Any
) -> Stedfestinger:
    return stedfester(nett, **options).stedfest(east, north, max_distance_m=max_distance_m)


def _link(
    points: list[tuple[float, ...]], sekvens: int = 1, start: float = 0.0, slutt: float = 1.0, **changes: Any
) -> Veglenke:
    """A link along points relative to (E0, N0)."""
    line = shapely.LineString([(E0 + point[0], N0 + point[1], *point[2:]) for point in points])
    given = {"veglenkenummer": 1, "segmentnummer": 1, "startdato": date(2000, 1, 1)} | changes
    return Veglenke(
        veglenkesekvensid=sekvens, startposisjon=start, sluttposisjon=slutt, geometri=line, **given
    )


def _metered(retning: str, fra: float = 1000.0, til: float = 1100.0) -> Vegreferanse:
    return Vegreferanse(f"FV1 S2D3 m{fra:.0f}-{til:.0f}", "F", "V", 1, "K", retning, fra, til)


def _nett(*links: Veglenke) -> Vegnett:
    return Vegnett.from_veglenker(links)


def _place(nett: Vegnett, x: float, y: float, **options: Any) -> Any:
    return _placed(nett, [E0 + x], [N0 + y], on_date=DAY, **options)


def test_stedfest_of_a_hand_worked_point_gives_every_field() -> None:
    """Due north, 100 m, positions 0.2 to 0.4: a point 5 m east of its 25th metre."""
    link = _link([(0, 0, 10), (0, 100, 10)], 42, 0.2, 0.4, referanse=_metered("MED"))
    place = _place(_nett(link), 5.0, 25.0)
    assert place.found.tolist() == [True]
    assert place.reason.tolist() == [""]
    assert place.veglenkesekvensid.tolist() == [42]
    assert place.relativ_posisjon.tolist() == [0.25]
    assert place.veglenkeposisjoner() == ["0.25@42"]
    assert place.distance_m == pytest.approx([5.0], abs=1e-9)
    assert place.right_m == pytest.approx([5.0], abs=1e-9)
    assert place.sideposisjon.tolist() == ["H"]
    assert (place.east[0], place.north[0], place.height[0]) == (E0, N0 + 25.0, 10.0)
    assert place.link_azimuth_grid_deg.tolist() == [0.0]
    assert place.metering_azimuth_grid_deg.tolist() == [0.0]
    assert place.retning.tolist() == ["MED"]
    assert place.meter.tolist() == [1025.0]
    assert place.kortform.tolist() == ["FV1 S2D3 m1025"]


def test_stedfest_against_the_metering_turns_side_azimuth_and_meters() -> None:
    """With MOT the link begins at the highest meter value, and its right is the metering's left."""
    link = _link([(0, 0), (0, 100)], referanse=_metered("MOT"))
    place = _place(_nett(link), 5.0, 25.0)
    assert place.relativ_posisjon.tolist() == [0.25]
    assert place.right_m == pytest.approx([5.0], abs=1e-9)
    assert place.sideposisjon.tolist() == ["V"]
    assert place.link_azimuth_grid_deg.tolist() == [0.0]
    assert place.metering_azimuth_grid_deg.tolist() == [180.0]
    assert place.meter.tolist() == [1075.0]
    assert place.kortform.tolist() == ["FV1 S2D3 m1075"]


def test_stedfest_without_road_reference_leaves_the_metering_unknown() -> None:
    """No reference: no side, no metering direction, no meter; across the link is still known."""
    place = _place(_nett(_link([(0, 0), (0, 100)])), -5.0, 25.0)
    assert place.found.tolist() == [True]
    assert place.right_m == pytest.approx([-5.0], abs=1e-9)
    assert (place.sideposisjon[0], place.retning[0], place.kortform[0]) == ("", "", "")
    assert np.isnan(
        [place.metering_azimuth_grid_deg[0], place.meter[0], place.metering_azimuth_deg()[0]]
    ).all()


def test_stedfest_needs_the_metering_direction_to_say_the_meter() -> None:
    """Meter values without a direction could be counted from either end: none is given."""
    place = _place(_nett(_link([(0, 0), (0, 100)], referanse=_metered(""))), 5.0, 25.0)
    assert np.isnan(place.meter[0])
    assert place.kortform.tolist() == ["FV1 S2D3 m1000-1100"]


def test_stedfest_is_linear_in_the_length_with_heights() -> None:
    """A flat 3 m and then a slope of 3 m plan and 4 m rise: the bend is at 3/8, not at a half."""
    link = _link([(0, 0, 0), (3, 0, 0), (6, 0, 4)])
    assert _place(_nett(link), 3.0, 0.0).relativ_posisjon.tolist() == [0.375]
    assert _place(_nett(link), 4.5, 1.0).relativ_posisjon.tolist() == [0.6875]


@pytest.mark.parametrize("unknown", [-999999.0, np.nan])
def test_stedfest_measures_in_plan_where_a_height_is_unknown(unknown: float) -> None:
    """One unknown height among the vertices makes the whole link count in plan."""
    link = _link([(0, 0, 0), (3, 0, unknown), (6, 0, 0), (12, 0, 8)])
    place = _placed(_nett(link), E0 + np.array([3.0, 6.0]), [N0, N0], on_date=DAY)
    assert place.relativ_posisjon.tolist() == [0.25, 0.5]
    assert np.isnan(place.height).all()


def test_stedfest_rounds_positions_to_eight_decimals() -> None:
    """A third of the link is 0.33333333, as NVDB writes it."""
    place = _place(_nett(_link([(0, 0), (0, 90)])), 2.0, 30.0)
    assert place.relativ_posisjon.tolist() == [0.33333333]
    assert place.veglenkeposisjoner() == ["0.33333333@1"]


def test_stedfest_beyond_the_end_of_a_road_stays_at_its_end() -> None:
    """Past a dead end the foot is the end; straight ahead is on no side, obliquely ahead is."""
    nett = _nett(_link([(0, 0), (0, 100)], referanse=_metered("MED")))
    ahead, oblique = _place(nett, 0.0, 110.0), _place(nett, 3.0, 104.0)
    assert ahead.relativ_posisjon.tolist() == oblique.relativ_posisjon.tolist() == [1.0]
    assert (ahead.sideposisjon[0], oblique.sideposisjon[0]) == ("", "H")
    assert oblique.distance_m == pytest.approx([5.0], abs=1e-9)
    assert oblique.right_m == pytest.approx([3.0], abs=1e-9)


def test_stedfest_outside_a_sharp_bend_is_on_the_outer_side() -> None:
    """The foot is the bend itself, where each leg alone calls some outer points inner."""
    nett = _nett(_link([(0, 0), (0, 100), (1, 0)], referanse=_metered("MED")))
    x = np.array([-0.4, 0.2, 0.9])
    place = _placed(nett, E0 + x, N0 + np.full(3, 103.0), on_date=DAY)
    assert place.relativ_posisjon == pytest.approx([0.5] * 3, abs=1e-4)
    assert place.sideposisjon.tolist() == ["V"] * 3


def test_stedfest_on_a_road_that_turns_back_on_itself_keeps_a_direction() -> None:
    """Where the two directions at a vertex cancel, the first one is given."""
    place = _place(_nett(_link([(0, 0), (0, 100), (0, 40)])), 0.0, 105.0)
    assert place.link_azimuth_grid_deg.tolist() == [0.0]


def test_stedfest_on_a_link_without_length_has_no_direction() -> None:
    """Repeated vertices are stepped over; a link of nothing else has a place but no azimuth."""
    doubled = _place(_nett(_link([(0, 0), (0, 0), (10, 0), (10, 0)])), 5.0, 1.0)
    assert doubled.relativ_posisjon.tolist() == [0.5]
    assert doubled.link_azimuth_grid_deg.tolist() == [90.0]
    nothing = _place(_nett(_link([(0, 0), (0, 0)], start=0.3, slutt=0.3)), 5.0, 1.0)
    assert nothing.relativ_posisjon.tolist() == [0.3]
    assert np.isnan(nothing.link_azimuth_grid_deg).all()


def test_stedfest_takes_only_links_of_the_day() -> None:
    """A road that was moved is found where it lay on the day of the drive."""
    old = _link([(0, 0), (0, 100)], 1, sluttdato=date(2020, 6, 1))
    new = _link([(20, 0), (20, 100)], 2, startdato=date(2020, 6, 1))
    for day, sekvens in ((date(2020, 5, 31), 1), (date(2020, 6, 1), 2), (None, 2)):
        place = _placed(_nett(old, new), [E0 + 1], [N0 + 50], on_date=day)
        assert place.veglenkesekvensid.tolist() == [sekvens]


def test_stedfest_passes_over_links_that_only_connect_or_are_detailed() -> None:
    """Konnektering and kjørebane are nearer here, and are taken only if allowed."""
    nett = _nett(
        _link([(0, 0), (0, 100)], 1),
        _link([(4, 0), (4, 100)], 2, konnektering=True),
        _link([(5, 0), (5, 100)], 3, detaljert=True),
    )
    assert _place(nett, 6.0, 50.0).veglenkesekvensid.tolist() == [1]
    assert _place(nett, 6.0, 50.0, allow_konnektering=True).veglenkesekvensid.tolist() == [2]
    assert _place(nett, 6.0, 50.0, allow_detaljert=True).veglenkesekvensid.tolist() == [3]


def test_stedfest_keeps_to_the_roads_that_are_asked_for() -> None:
    """A cycleway beside the road, or a private road, can be passed over by name."""
    cycleway = Vegreferanse("FV1 S2D3 m0-9", "F", "V", 1, "G", "MED", 0.0, 9.0)
    private = Vegreferanse("PV9 S1D1 m0-9", "P", "V", 9, "K", "MED", 0.0, 9.0)
    nett = _nett(
        _link([(0, 0), (0, 100)], 1, referanse=_metered("MED")),
        _link([(4, 0), (4, 100)], 2, referanse=cycleway),
        _link([(8, 0), (8, 100)], 3, referanse=private),
        _link([(9, 0), (9, 100)], 4, type_veg="rampe"),
    )
    assert _place(nett, 5.0, 50.0).veglenkesekvensid.tolist() == [2]
    assert _place(nett, 5.0, 50.0, trafikantgruppe="K").veglenkesekvensid.tolist() == [3]
    kept = _place(nett, 5.0, 50.0, trafikantgruppe="K", vegkategorier={"E", "R", "F", "K"})
    assert kept.veglenkesekvensid.tolist() == [1]
    assert _place(nett, 5.0, 50.0, type_veg=BILVEG).veglenkesekvensid.tolist() == [4]


def test_stedfest_says_why_a_point_has_no_place() -> None:
    """Too far and not finite are told apart; nothing is invented, and the other points keep their rows."""
    nett = _nett(_link([(0, 0), (0, 100)], 7))
    x = E0 + np.array([60.0, np.nan, 3.0, np.inf, 50.0])
    place = _placed(nett, x, np.full(5, N0 + 50.0), on_date=DAY)
    assert place.found.tolist() == [False, False, True, False, True]
    assert place.reason.tolist() == [
        "no usable link within 50 m",
        "the position is not finite",
        "",
        "the position is not finite",
        "",
    ]
    assert place.veglenkesekvensid.tolist() == [-1, -1, 7, -1, 7]
    assert np.isnan(place.relativ_posisjon).tolist() == [True, True, False, True, False]
    assert place.veglenkeposisjoner() == ["", "", "0.5@7", "", "0.5@7"]
    assert len(place) == 5


def test_stedfest_of_nothing_is_nothing() -> None:
    """No points, no links, or no usable link: empty answers, not errors."""
    link = _link([(0, 0), (0, 100)])
    assert len(_placed(_nett(link), [], [], on_date=DAY)) == 0
    assert _place(_nett(), 0.0, 0.0).found.tolist() == [False]
    assert _placed(_nett(link), [E0], [N0], on_date=date(1999, 1, 1)).found.tolist() == [False]


@pytest.mark.parametrize(
    ("east", "north", "distance"), [([1.0], [1.0, 2.0], 50), ([1.0], [1.0], 0), ([1.0], [1.0], np.nan)]
)
def test_stedfest_refuses_what_cannot_be_asked(east: Any, north: Any, distance: float) -> None:
    """Coordinates that do not pair up and a distance that is none are errors."""
    with pytest.raises(RequestError):
        _placed(_nett(_link([(0, 0), (0, 100)])), east, north, on_date=DAY, max_distance_m=distance)


def test_stedfest_at_a_node_does_not_depend_on_the_order_of_links() -> None:
    """Of links that meet in the nearest point, the one with the lowest veglenkesekvensid is taken."""
    star = [_link([(0, 0), (x, y)], sekvens) for sekvens, x, y in ((9, 31, 47), (4, -50, 13), (6, 0, 50))]
    for links in (star, star[::-1], [star[1], star[2], star[0]]):
        for south in (0.0, 7.3):
            assert _place(_nett(*links), 0.1, -south - 0.1).veglenkesekvensid.tolist() == [4]


def _random_nett(rng: np.random.Generator, n: int) -> Vegnett:
    """Crooked links of 2 to 9 vertices in a square of 300 m, with heights, metered both ways."""
    links = []
    for number in range(n):
        steps = np.cumsum(rng.normal(0, 25, (rng.integers(2, 10), 3)) * [1, 1, 0.1], axis=0)
        points = [tuple(point) for point in steps + np.array([*rng.uniform(0, 300, 2), 50])]
        reference = _metered("MED" if number % 2 else "MOT")
        links.append(_link(points, 100 + number, 0.25, 0.75, referanse=reference))
    return _nett(*links)


@given(seed=st.integers(0, 2**32 - 1))
def test_stedfest_agrees_with_a_search_through_every_link(seed: int) -> None:
    """GEOS, link by link and point by point, finds the same distance, the same link and the same foot."""
    rng = np.random.default_rng(seed)
    nett = _random_nett(rng, 12)
    x, y = E0 + rng.uniform(-100, 400, 25), N0 + rng.uniform(-100, 400, 25)
    place = _placed(nett, x, y, on_date=DAY, max_distance_m=60)
    distances = shapely.distance(nett.geometri, shapely.points(x, y)[:, np.newaxis])
    nearest = distances.min(axis=1)
    assert place.found.tolist() == (nearest <= 60).tolist()
    for i in np.flatnonzero(place.found):
        line = nett.geometri[place.veglenke[i]]
        assert place.veglenke[i] == np.argmin(distances[i])
        # 1e-8: float64 keeps 1 nm in a northing of 7e6 m.
        assert place.distance_m[i] == pytest.approx(nearest[i], abs=1e-8)
        foot = line.interpolate(line.project(shapely.Point(x[i], y[i])))
        assert np.hypot(foot.x - place.east[i], foot.y - place.north[i]) < 1e-6
        assert foot.z == pytest.approx(place.height[i], abs=1e-6)


@given(seed=st.integers(0, 2**32 - 1))
def test_stedfest_of_its_own_feet_changes_nothing(seed: int) -> None:
    """Projecting is idempotent: a foot lies on its link, where it was said to lie."""
    rng = np.random.default_rng(seed)
    nett = _random_nett(rng, 1)
    first = _placed(nett, E0 + rng.uniform(0, 300, 20), N0 + rng.uniform(0, 300, 20), max_distance_m=1e4)
    again = _placed(nett, first.east, first.north, max_distance_m=1e4)
    assert again.distance_m.max() < 1e-7
    # A line that crosses itself has two positions at the crossing; 20 random feet do not hit one.
    assert np.abs(again.relativ_posisjon - first.relativ_posisjon).max() <= 1e-8


@given(seed=st.integers(0, 2**32 - 1))
def test_stedfest_of_the_reversed_link_is_the_mirror_image(seed: int) -> None:
    """Turning a link round turns position, offset and azimuth, and nothing that is seen on the road."""
    rng = np.random.default_rng(seed)
    points = [tuple(p) for p in np.cumsum(rng.normal(0, 30, (6, 2)), axis=0)]
    there = _nett(_link(points, referanse=_metered("MED")))
    back = _nett(_link(points[::-1], referanse=_metered("MOT")))
    x, y = E0 + rng.uniform(-60, 60, 20), N0 + rng.uniform(-60, 60, 20)
    a, b = (_placed(nett, x, y, on_date=DAY, max_distance_m=1e4) for nett in (there, back))
    assert np.abs(a.relativ_posisjon + b.relativ_posisjon - 1.0).max() <= 2e-8
    assert np.abs(a.right_m + b.right_m).max() < 1e-6
    turned = (a.link_azimuth_grid_deg - b.link_azimuth_grid_deg) % 360
    assert turned == pytest.approx(np.full(20, 180.0), abs=1e-6)
    assert np.abs(a.meter - b.meter).max() < 1e-6
    assert a.sideposisjon.tolist() == b.sideposisjon.tolist()
    assert a.metering_azimuth_grid_deg == pytest.approx(b.metering_azimuth_grid_deg, abs=1e-6)


def test_stedfest_in_many_blocks_equals_stedfest_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where memory makes the work be cut up, the cuts cannot be seen in the result."""
    rng = np.random.default_rng(3)
    nett = _random_nett(rng, 20)
    x, y = E0 + rng.uniform(0, 300, 200), N0 + rng.uniform(0, 300, 200)
    whole = _placed(nett, x, y, on_date=DAY)
    monkeypatch.setattr("nvdb.vegnett.polylinjer._PAIRS_AT_ONCE", 7)
    cut = _placed(nett, x, y, on_date=DAY)
    assert np.array_equal(whole.relativ_posisjon, cut.relativ_posisjon, equal_nan=True)
    assert np.array_equal(whole.right_m, cut.right_m, equal_nan=True)


@pytest.mark.parametrize(
    ("stretch", "meter", "place"),
    [
        ("FV4854 S2D20 m0-900", 670.915, "FV4854 S2D20 m671"),
        ("EV18 S53D1 m3212 KD3 m24-560", 24.4, "EV18 S53D1 m3212 KD3 m24"),
        ("EV6 S1D1 m10-20 SD1 m0-5", 4.5, "EV6 S1D1 m10-20 SD1 m5"),
        ("SV113 S2D1 M0-46", 3.0, "SV113 S2D1 M3"),
        ("EV16", 3.0, "EV16"),
        ("EV18 S53D1 m3212 KD3 m24-560", float("nan"), "EV18 S53D1 m3212 KD3 m24-560"),
    ],
)
def test_meter_kortform_replaces_the_last_stretch_by_one_meter(
    stretch: str, meter: float, place: str
) -> None:
    """Only the innermost meter value is the place; a reference without one stays as it is."""
    assert meter_kortform(stretch, meter) == place


@given(st.integers(0, 10**8))
def test_position_text_reads_back_and_is_never_an_exponent(hundred_millionths: int) -> None:
    """Every position of 8 decimals survives being written, without an e and with at least one decimal."""
    text = position_text(hundred_millionths / 1e8)
    assert float(text) == hundred_millionths / 1e8
    assert 1 <= len(text.split(".")[1]) <= 8
