"""Roads of any length: bends, hills and crossfall that do not repeat, about one place."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.errors import GeolocError
from geoloc.simulation.long_roads import LONG_ROADS, long_road
from geoloc.simulation.road import Road, RoadSpec
from geoloc.simulation.simulate import scenario


@pytest.mark.parametrize("kind", LONG_ROADS)
def test_road_stays_about_its_beginning_and_does_not_repeat(kind: str) -> None:
    """30 km of road never leave a circle of 8 km; bends and climbs of its halves have nothing in common."""
    road = Road(long_road(RoadSpec(), LONG_ROADS[kind], 30_000.0, 4), 4)
    station = np.arange(0.0, 30_000.0, 5.0)
    plan = road.plan_m(station, np.zeros_like(station))
    assert np.hypot(*plan.T).max() < 8_000.0
    curvature = road.curvature_per_m(station)
    assert 1.0 / np.abs(curvature).max() >= LONG_ROADS[kind].radius_m[0]
    climb = np.gradient(road.surface_m(station, np.zeros_like(station)), station)
    for signal in (curvature, climb):
        first, second = np.split(signal, 2)
        best = max(np.corrcoef(first[: second.size - k], second[k:])[0, 1] for k in range(0, 2000, 4))
        assert best < 0.65


def test_crossfall_changes_along_the_road() -> None:
    """Sections of 200 m depart from the road's own crossfall by the stated spread."""
    road = Road(long_road(RoadSpec(crossfall_spread=0.0), LONG_ROADS["urban"], 40_000.0, 1), 1)
    station = np.arange(100.0, 40_000.0, 200.0)
    fall = road.across_slope(station, np.full(station.size, -1.65))
    assert fall.mean() == pytest.approx(0.03, abs=0.001)
    assert 0.002 < fall.std() < 0.006


def test_only_roads_without_a_length_of_their_own_are_made_longer() -> None:
    """The yard and the sample are what they are."""
    with pytest.raises(GeolocError, match="minutes go with urban, highway"):
        scenario("still", minutes=5.0)
