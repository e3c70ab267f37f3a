"""Places of poles that several drives saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.trajectory.trajectory import Poses
from twin.matching.config import MatchConfig
from twin.matching.poles.many_drives import Driven, with_fused_places
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.store.records import Correction, Corrections, Estimate

CONFIG = MatchConfig()
# On the central meridian, where the grid's north is the true one.
EAST_M, NORTH_M = 500_000.0, 7_030_000.0
BUDGET = {"pixels": (0.01, 0.0, 0.01), "ground": (0.01, 0.0, 0.01), "gnss": (0.04, 0.0, 0.04)}


def driven(drive_id: str, *, adjusted: bool = True) -> Driven:
    """A drive due north past all poles, 10 m in a second."""
    epoch_ns = np.arange(10, dtype=np.int64) * 1_000_000_000
    lat, lon = geographic_from_utm33(np.full(10, EAST_M - 5.0), NORTH_M + 10.0 * np.arange(10))
    zero = np.zeros(10)
    names = (*("roll", "pitch", "heading", "speed"), *("sh", "sv", "sr", "sp", "sy"))
    poses = Poses(epoch_ns, lat, lon, *(zero for _ in names), zero, np.ones(10, bool), np.full(10, ""))
    clock = Correction(0.0, 5.0)
    found = Corrections(1.0, clock, clock, {}, 5.0) if adjusted else None
    return Driven(drive_id, poses, found, "car")


def estimate(drive_id: str, name: str, north: float, east: float = 0.0) -> Estimate:
    """What a drive says of a pole."""
    return Estimate(
        drive_id=drive_id,
        object=name,
        codes=("202",),
        east_m=EAST_M + east,
        north_m=NORTH_M + north,
        covariance_m2=(0.06, 0.0, 0.06),
        cameras=("C1",),
        n_sightings=5,
        last_ns=int(1e8 * north),
        budget=BUDGET,
    )


def placed(estimates: list[Estimate], drives: list[Driven]) -> tuple[list[ObservedPole], list[ObservedPole]]:
    """Poles as they were gathered, and as all drives place them."""
    poles = observed_poles(estimates, [drive.drive_id for drive in drives], CONFIG)
    return poles, with_fused_places(poles, estimates, drives)


def test_what_each_drive_has_of_its_own_is_averaged() -> None:
    """Two drives alike meet half-way; pixels and satellites count half, the ground below the pole fully."""
    rows = [estimate("a", "1", 10.0), estimate("b", "1", 10.0, 0.2)]
    _, (pole,) = placed(rows, [driven("a"), driven("b")])
    assert (pole.east_m - EAST_M, pole.north_m - NORTH_M) == pytest.approx((0.1, 10.0), abs=1e-4)
    assert pole.covariance_m2 == pytest.approx((0.5 * 0.05 + 0.01) * np.eye(2), abs=1e-4)
    assert pole.averaged == 1.0


def test_a_drive_by_itself_keeps_its_places() -> None:
    """Also where two other drives share a pole: nothing ties it to them."""
    rows = [estimate("a", "1", 10.0), estimate("b", "1", 10.0, 0.2), estimate("c", "1", 900.0)]
    before, after = placed(rows, [driven("a"), driven("b"), driven("c")])
    assert after[1] is before[1]
    assert after[0].sigma_m < before[0].sigma_m


def test_a_pole_that_one_drive_saw_moves_with_its_track() -> None:
    """The other drive shows at a shared pole that the track is off; seconds later it still is."""
    rows = [estimate("a", "1", 10.0, 0.4), estimate("b", "1", 10.0), estimate("a", "2", 30.0, 0.4)]
    before, after = placed(rows, [driven("a"), driven("b")])
    assert [pole.members for pole in before] == [("a:1", "b:1"), ("a:2",)]
    assert after[1].east_m - EAST_M == pytest.approx(0.4 - 0.2 * 0.04 / 0.06, abs=0.02)
    assert after[1].covariance_m2[0, 0] < before[1].covariance_m2[0, 0]


@pytest.mark.parametrize("untold", ["budget", "corrections"])
def test_without_sources_covariance_intersection_holds(untold: str) -> None:
    """A method that does not tell where its errors come from is never made more certain by averaging."""
    rows = [estimate("a", "1", 10.0), estimate("b", "1", 10.0, 0.2)]
    if untold == "budget":
        rows = [replace(row, budget={}) for row in rows]
    before, after = placed(rows, [driven(name, adjusted=untold != "corrections") for name in "ab"])
    assert after == before
