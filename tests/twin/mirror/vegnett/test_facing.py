"""Which way plates face, by the road network in the store."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyproj
import pytest
import sqlalchemy as sa
from vegnett_links import segment

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.replay import ReplayServer, ReplayWorld
from twin.errors import StoreError
from twin.matching.config import MatchConfig
from twin.matching.sites import Site, along_the_road, sites_from_mirror
from twin.mirror.sync import sync_nvdb
from twin.mirror.vegnett import facing, load_vegnett, sync_vegnett
from twin.mirror.vegnett.network import FACT as VEGNETT
from twin.store import schema
from twin.store.store import Store
from twin.store.touched import FACT as TOUCHED
from twin.store.touched import touched_since

Raw = dict[str, Any]
EVERYTHING = Area()
MERIDIAN_E = 500_000.0
"""Easting of UTM33's central meridian, where grid north is true north."""


def _plate(
    number: int,
    enum: tuple[int, str] | None,
    at: tuple[float, float],
    *,
    place: tuple[int, float, str | None] | None = None,
    own: bool = True,
) -> Raw:
    """A Skiltplate in V4's form; `place` is its stedfesting: sekvens, position and side."""
    wkt = f"POINT Z ({at[0]} {at[1]} 10)"
    egenskaper: list[Raw] = [
        {"id": 5530, "navn": "Skiltnummer", "egenskapstype": "Tekstenum", "verdi": "202", "enum_id": 7642}
    ]
    if own:
        egenskaper.append({"id": 4795, "navn": "Geometri, punkt", "egenskapstype": "Geometri", "verdi": wkt})
    if enum is not None:
        side = {"id": 1894, "navn": "Ansiktsside, rettet mot", "egenskapstype": "Tekstenum"}
        egenskaper.append({**side, "verdi": enum[1], "enum_id": enum[0]})
    lokasjon: Raw = {"kommuner": [5001]}
    if place is not None:
        punkt = {"type": "Punkt", "veglenkesekvensid": place[0], "relativPosisjon": place[1]}
        lokasjon["stedfestinger"] = [punkt if place[2] is None else {**punkt, "sideposisjon": place[2]}]
    return {
        "id": number,
        "metadata": {"type": {"id": 96, "navn": "Skiltplate"}, "versjon": 1, "startdato": "2020-05-01"},
        "egenskaper": egenskaper,
        "lokasjon": lokasjon,
        "geometri": {"wkt": wkt, "srid": 5973, "egengeometri": own},
    }


MED = (2714, "Trafikk i metreringsretning")
MOT = (2717, "Trafikk mot metreringsretning")
TOWARDS = (2837, "Parallelt mot veg")
AWAY = (2838, "Parallelt fra veg")
BOTH = (3698, "Tosidig")


@pytest.fixture
def faces(empty: Store) -> Callable[..., dict[int, tuple[float, float]]]:
    """Sync plates and links into a store, as one of the APIs shows them, and ask which way they face."""

    def work(plates: list[Raw], links: list[Raw], source: str = "les-v4") -> dict[int, tuple[float, float]]:
        with (
            ReplayServer(ReplayWorld({96: plates}, vegnett=links)) as server,
            NvdbClient(server.url, sleep=lambda _s: None) as client,
        ):
            sync_nvdb(empty, EVERYTHING, api_url=server.url, source=source)
            sync_vegnett(empty, EVERYTHING, client=client)
        return facing(empty)

    return work


NORTHWARD = f"{MERIDIAN_E} 7000000 1, {MERIDIAN_E} 7001000 1"


@pytest.mark.parametrize("source", ["les-v4", "uberiket"])
@pytest.mark.parametrize(("retning", "turned"), [("MED", 0.0), ("MOT", 180.0)])
def test_facing_follows_ansiktsside_and_metering(
    faces: Callable[..., Any], source: str, retning: str, turned: float
) -> None:
    """On a road due north, worked out by hand: against the metering, along it, towards and away from it."""
    at = (MERIDIAN_E + 5.0, 7_000_500.0)
    sides = {MED: (180, None), MOT: (0, None), BOTH: (180, 0), TOWARDS: (270, None), AWAY: (90, None)}
    # The plate stands east of the road: right of a metering to the north, left of one to the south.
    side = "H" if retning == "MED" else "V"
    plates = [_plate(k, enum, at, place=(77, 0.5, side)) for k, enum in enumerate([*sides, None], start=1)]
    found = faces(plates, [segment(77, NORTHWARD, retning)], source)
    assert set(found) == {1, 2, 3, 4, 5, 6}
    for k, (enum, (first, second)) in enumerate(sides.items(), start=1):
        # Turning the metering turns what refers to it; the road stays on the same side of the plate.
        turn = 0.0 if enum in (TOWARDS, AWAY) else turned
        assert found[k][0] == pytest.approx((first + turn) % 360, abs=1e-6)
        assert math.isnan(found[k][1]) == (second is None)
        if second is not None:
            assert found[k][1] == pytest.approx((second + turn) % 360, abs=1e-6)
    assert all(math.isnan(azimuth) for azimuth in found[6])


def test_facing_is_from_true_north(faces: Callable[..., Any]) -> None:
    """Near Trondheim a grid-northward road runs some 4° west of north, as the geodesic along it says."""
    east, north = 270_000.0, 7_040_000.0
    link = segment(77, f"{east} {north} 1, {east} {north + 1000} 1")
    found = faces([_plate(1, MOT, (east + 4, north + 500), place=(77, 0.5, "H"))], [link])
    to_degrees = pyproj.Transformer.from_crs(25833, 4258, always_xy=True)
    ends = [to_degrees.transform(east, north + along) for along in (499.0, 501.0)]
    azimuth, _, _ = pyproj.Geod(ellps="GRS80").inv(*ends[0], *ends[1])
    # Convergence changes by less than a millionth of a degree over the metre between chord and point.
    assert found[1][0] == pytest.approx(azimuth % 360, abs=1e-5)
    assert 355.5 < found[1][0] < 356.5


def test_facing_believes_the_stedfesting_before_the_nearest_road(faces: Callable[..., Any]) -> None:
    """A plate that NVDB hangs on a road 20 m away does not follow the crossing road beside it."""
    east, north = MERIDIAN_E, 7_000_500.0
    crossing = segment(78, f"{east - 500} {north} 1, {east + 500} {north} 1")
    plates = [
        _plate(1, MED, (east + 20, north + 1), place=(77, 0.5, "H")),
        _plate(2, MED, (east + 20, north + 1), place=(999, 0.5, "H")),
        _plate(3, MED, (east + 20, north + 1)),
    ]
    found = faces(plates, [segment(77, NORTHWARD), crossing])
    assert found[1][0] == pytest.approx(180.0, abs=1e-3)
    # Unknown to the network, or without stedfesting: the road beside it runs east and is read from there.
    assert found[2][0] == pytest.approx(270.0, abs=1e-2)
    assert found[3][0] == pytest.approx(270.0, abs=1e-2)


def test_facing_finds_the_piece_of_a_sekvens_that_a_position_lies_on(faces: Callable[..., Any]) -> None:
    """Of two pieces at a right angle the one counts that holds the position; outside both none does."""
    corner = f"{MERIDIAN_E} 7000500 1"
    pieces = [
        segment(77, f"{MERIDIAN_E} 7000000 1, {corner}", sluttposisjon=0.4),
        segment(
            77,
            f"{corner}, {MERIDIAN_E + 300} 7000500 1",
            startposisjon=0.4,
            sluttposisjon=0.9,
            segmentnummer=2,
            referanse="77-1-2",
        ),
    ]
    far = (MERIDIAN_E + 5000, 7_000_000.0)  # no road near: only the stedfesting can tell
    plates = [
        _plate(k, MOT, far, place=(77, position, None))
        for k, position in enumerate((0.1, 0.6, 0.95), start=1)
    ]
    found = faces(plates, pieces)
    assert found[1][0] == pytest.approx(0.0, abs=1e-3)
    assert found[2][0] == pytest.approx(90.0, abs=1e-2)
    assert math.isnan(found[3][0])


@pytest.mark.parametrize("retning", ["MED", "MOT"])
def test_facing_takes_the_side_from_own_geometry_where_nvdb_does_not_say(
    faces: Callable[..., Any], retning: str
) -> None:
    """A plate along the road and west of it looks east to the road; one on the centre line on no side."""
    west, derived = (MERIDIAN_E - 6.0, 7_000_500.0), (MERIDIAN_E - 0.004, 7_000_500.0)
    plates = [
        _plate(1, TOWARDS, west, place=(77, 0.5, None)),
        _plate(2, TOWARDS, west),
        _plate(3, TOWARDS, west, place=(77, 0.5, "M")),
        _plate(4, TOWARDS, derived, place=(77, 0.5, None), own=False),
        _plate(5, TOWARDS, derived, own=False),
        _plate(6, MED, derived, own=False),
    ]
    found = faces(plates, [segment(77, NORTHWARD, retning)])
    assert found[1][0] == pytest.approx(90.0, abs=1e-3)
    assert found[2][0] == pytest.approx(90.0, abs=1e-3)
    assert all(math.isnan(found[number][0]) for number in (3, 4, 5))
    # The direction of the road is known also where the side is not.
    assert found[6][0] == pytest.approx(180.0 if retning == "MED" else 0.0, abs=1e-3)


def test_facing_does_not_depend_on_which_way_links_are_drawn(empty: Store) -> None:
    """Turning links round (geometry, positions, MED and MOT) changes no face by more than a microdegree."""
    rng = np.random.default_rng(11)
    links, turned, plates = [], [], []
    for k in range(30):
        x = 480_000 + 1000.0 * k + np.cumsum(rng.uniform(-80, 80, 4))
        y = 7_000_000.0 + np.cumsum(rng.uniform(-80, 80, 4))
        points = [f"{a:.3f} {b:.3f} 5" for a, b in zip(x, y, strict=True)]
        links.append(segment(100 + k, ", ".join(points)))
        turned.append(segment(100 + k, ", ".join(points[::-1]), "MOT"))
        at = (round(float(x.mean()), 2), round(float(y.mean()), 2))
        enum = [MED, MOT, TOWARDS, AWAY, BOTH][k % 5]
        # Positions that are multiples of 1/8 turn round without rounding.
        plates.append((k, enum, at, int(rng.integers(1, 8)) / 8))
    results = []
    for drawn, flip in ((links, False), (turned, True)):
        there = [
            _plate(k + 1, enum, at, place=(100 + k, 1 - p if flip else p, "H")) for k, enum, at, p in plates
        ]
        with (
            ReplayServer(ReplayWorld({96: there}, vegnett=drawn)) as server,
            NvdbClient(server.url, sleep=lambda _s: None) as client,
        ):
            sync_nvdb(empty, EVERYTHING, api_url=server.url, fresh=True)
            sync_vegnett(empty, EVERYTHING, client=client)
        results.append(np.array([faces for _, faces in sorted(facing(empty).items())]))
    assert np.isfinite(results[0][:, 0]).all()
    difference = (results[0] - results[1] + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(difference[np.isfinite(difference)], 0.0, atol=1e-6)
    np.testing.assert_array_equal(np.isnan(results[0]), np.isnan(results[1]))


def test_facing_needs_a_road_network(empty: Store) -> None:
    """Without one the cure is named."""
    with pytest.raises(StoreError, match="no road network: run `twin sync-nvdb` with --vegnett"):
        facing(empty)


def test_a_new_network_names_every_place_that_faces_otherwise(empty: Store) -> None:
    """Roads that turn, go, come, end or move: signs beside them, or set on them, are named; few others."""

    def road(number: int, retning: str = "MED", aside_m: float = 0.0, **changes: Any) -> Raw:
        east = MERIDIAN_E + 300.0 * number + aside_m
        return segment(number, f"{east} 7000000 1, {east} 7001000 1", retning, **changes)

    def signs() -> dict[str, Site]:
        day = dt.date.fromisoformat((empty.fact(VEGNETT) or {})["fetched_at"][:10])
        points, plates = (empty.rows(sa.select(t)) for t in (schema.skiltpunkt, schema.skiltplate))
        found = sites_from_mirror(points, plates, MatchConfig(), facing(empty, on_date=day))
        # NaN is no other than itself by its text.
        return {repr(site): site for site in along_the_road(found, load_vegnett(empty), day)}

    plates, ended = [], {"metadata": {"startdato": "2015-03-01", "sluttdato": "2020-01-01"}}
    for number in range(8):
        east = MERIDIAN_E + 300.0 * number
        plates.append(_plate(10 * number + 1, MED, (east + 8.0, 7_000_500.0)))
        plates.append(_plate(10 * number + 2, MED, (east, 7_000_700.0), own=False))
        plates.append(_plate(10 * number + 3, MED, (east + 120.0, 7_000_900.0), place=(number, 0.5, "H")))
    first = [road(number) for number in range(7)]
    later = [road(0, "MOT"), road(1, aside_m=20.0), road(2, **ended), *first[4:], road(7)]
    world = ReplayWorld({96: plates}, vegnett=first)
    with ReplayServer(world) as server, NvdbClient(server.url, sleep=lambda _s: None) as client:
        sync_nvdb(empty, EVERYTHING, api_url=server.url)
        sync_vegnett(empty, EVERYTHING, client=client)
        before, revision = signs(), empty.revision()
        world.vegnett = later
        sync_vegnett(empty, EVERYTHING, client=client, confirm_deletions=True)
    told = touched_since(empty.fact(TOUCHED), revision, empty.revision())
    assert told is not None
    after = signs()
    odd = [(before | after)[name] for name in before.keys() ^ after.keys()]
    other = {(math.floor(site.east_m), math.floor(site.north_m)) for site in odd}
    assert len(other) >= 10
    assert other <= told.places
    assert not any(MERIDIAN_E + 1190.0 < east < MERIDIAN_E + 2050.0 for east, _ in told.places)
