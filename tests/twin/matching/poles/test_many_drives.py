"""Places of poles that several drives saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fused_drives import BUDGET, CONFIG, EAST_M, NORTH_M, driven, estimate

from twin.matching.poles.many_drives import Driven, with_fused_places
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.store.records import Correction, Corrections, Estimate


def placed(estimates: list[Estimate], drives: list[Driven]) -> tuple[list[ObservedPole], list[ObservedPole]]:
    """Poles as they were gathered, and as all drives place them."""
    poles = observed_poles(estimates, [drive.drive_id for drive in drives], CONFIG)
    return poles, with_fused_places(poles, estimates, drives).poles


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
    """The other drive shows that the track is off; seconds later three quarters of that still are."""
    rows = [estimate("a", "1", 10.0, 0.4), estimate("b", "1", 10.0), estimate("a", "2", 30.0, 0.4)]
    before, after = placed(rows, [driven("a"), driven("b")])
    assert [pole.members for pole in before] == [("a:1", "b:1"), ("a:2",)]
    assert after[1].east_m - EAST_M == pytest.approx(0.4 - 0.2 * 0.03 / 0.06, abs=0.02)
    assert after[1].covariance_m2[0, 0] < before[1].covariance_m2[0, 0]


@pytest.mark.parametrize("untold", ["budget", "corrections"])
def test_without_sources_covariance_intersection_holds(untold: str) -> None:
    """A method that does not tell where its errors come from is never made more certain by averaging."""
    rows = [estimate("a", "1", 10.0), estimate("b", "1", 10.0, 0.2)]
    if untold == "budget":
        rows = [replace(row, budget={}) for row in rows]
    before, after = placed(rows, [driven(name, adjusted=untold != "corrections") for name in "ab"])
    assert after == before


@pytest.mark.parametrize("stated_ms", [100.0, None])
def test_a_clock_that_was_doubted_moves_no_pole_by_itself(stated_ms: float | None) -> None:
    """Two drives that agree, each with 250 ms added to a clock that is known to 254 ms: they stay there."""
    clock, sigma_s, speed = Correction(-250.0, 254.0), 0.254, 10.0
    found = Corrections(1.0, clock, clock, {}, camera_prior_ms=stated_ms)
    budget = {**BUDGET, "time": (0.0, 0.0, (sigma_s * speed) ** 2)}
    rows = [replace(estimate(name, "1", 10.0), budget=budget) for name in "ab"]
    _, (pole,) = placed(rows, [replace(driven(name), corrections=found) for name in "ab"])
    assert pole.north_m - NORTH_M == pytest.approx(10.0, abs=0.01)


def test_what_lies_far_off_changes_no_place() -> None:
    """Drives past poles two kilometres on: bit for bit the same places; past the next pole: others."""
    near = [estimate(name, "1", 10.0, 0.1 * k) for k, name in enumerate("ab")]
    far = [estimate(name, "2", 2010.0, 0.3 * k) for k, name in enumerate("abc")]
    beside = [estimate(name, "3", 40.0, 0.3 * k) for k, name in enumerate("abc")]
    of_first = []
    for rows in (near, near + far, near + beside):
        _, (pole, *_) = placed(rows, [driven(name) for name in "abc"])
        of_first.append((pole.east_m, pole.north_m, pole.covariance_m2.tolist()))
    assert of_first[0] == of_first[1] != of_first[2]
