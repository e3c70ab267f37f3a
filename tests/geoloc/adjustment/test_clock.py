"""A camera clock that is seconds off."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import recorded

from geoloc.adjustment.result import AdjustmentDoubt
from geoloc.locate.accuracy import nees
from geoloc.locate.error_budget import ErrorBudget


@pytest.mark.parametrize("late_ms", [-2000, 700, 1500])
def test_clock_that_is_seconds_off_is_found_where_the_road_bends(late_ms: int) -> None:
    """Told, found to three sigmas, and the signs stand where they do with the right clock."""
    recording = recorded("urban")
    late = recording._replace(epoch_ns=recording.epoch_ns + late_ms * 1_000_000)
    adjusted = late.adjusted()
    assert AdjustmentDoubt.CLOCK in {doubt.kind for doubt in adjusted.doubts}
    found, drawn_ms = adjusted.time_offset_ms, recording.drive.drawn.frame_offset_ms
    assert abs(found.value + late_ms + drawn_ms) < 3.0 * found.sigma < 60.0
    assert np.hypot(*late.errors_m(adjusted).T).max() < 0.3


@pytest.mark.parametrize("late_ms", [-2000, 2000])
def test_clock_that_is_two_seconds_off_is_found_in_wide_bends(late_ms: int) -> None:
    """Where the adjustment by itself goes the wrong way: it begins where rays cross best."""
    recording = recorded("highway", 60.0, 70_000)
    late = recording._replace(epoch_ns=recording.epoch_ns + late_ms * 1_000_000)
    adjusted = late.adjusted()
    assert AdjustmentDoubt.CLOCK in {doubt.kind for doubt in adjusted.doubts}
    assert (nees(late.errors_m(adjusted), adjusted.covariance_m2) < 5.99).mean() > 0.9


def test_clock_that_is_stated_to_a_second_is_in_the_ellipses_or_found() -> None:
    """A start that is stated a second late is no doubt: it is found to centimetres where bends show it."""
    recording = recorded("urban")
    late = recording._replace(epoch_ns=recording.epoch_ns + 1_000_000_000)
    adjusted = late.adjusted(budget=ErrorBudget(time_ms=1000.0))
    assert adjusted.doubts == ()
    assert (nees(late.errors_m(adjusted), adjusted.covariance_m2) < 13.8).all()
    assert adjusted.time_offset_ms.value == pytest.approx(-1000.0, abs=50.0)


def test_straight_road_leaves_a_stated_clock_to_the_ellipses() -> None:
    """Only hills and the driver's wander tell the time there: no sign is lost, and the truth is in reach."""
    recording = recorded("highway", straight=True)
    late = recording._replace(epoch_ns=recording.epoch_ns + 500_000_000)
    adjusted = late.adjusted(budget=ErrorBudget(time_ms=1000.0))
    assert (adjusted.reason == "").all()
    assert (nees(late.errors_m(adjusted), adjusted.covariance_m2) < 5.99).mean() > 0.9


@pytest.mark.parametrize("stated_ms", [100.0, 1000.0])
def test_clock_that_is_looked_for_further_off_counts_for_what_it_was_stated_to(stated_ms: float) -> None:
    """Three tenths of a second can be by either statement; what a doubt says was added is what was added."""
    recording = recorded("urban")
    late = recording._replace(epoch_ns=recording.epoch_ns + 300_000_000)
    adjusted = late.adjusted(budget=ErrorBudget(time_ms=stated_ms))
    assert adjusted.time_prior_ms == stated_ms
    told = {doubt.kind: str(doubt) for doubt in adjusted.doubts}
    assert (AdjustmentDoubt.CLOCK_DOUBTED in told) == (stated_ms == 100.0)
    assert all(f"{adjusted.time_offset_ms.value:+.0f} ms were added" in text for text in told.values())


@pytest.mark.parametrize("stated_ms", [5.0, pytest.param(1000.0, marks=pytest.mark.slow)])
def test_clock_that_nothing_can_check_stays_and_is_told(stated_ms: float) -> None:
    """Fixes of 2 m in wide bends: the stated clock and its whole sigma are kept, and people hear of it."""
    poor = {"gnss_white_horizontal_m": 0.8, "gnss_multipath_m": 1.8, "gnss_multipath_tau_s": 10.0}
    recording = recorded("highway", 60.0, 70_000, antennas=1, single_m=2.0, **poor)
    late = recording._replace(epoch_ns=recording.epoch_ns + 1_000_000_000)
    adjusted = late.adjusted(budget=ErrorBudget(time_ms=stated_ms))
    assert AdjustmentDoubt.CLOCK_UNCHECKED in {doubt.kind for doubt in adjusted.doubts}
    assert adjusted.time_offset_ms.value == pytest.approx(0.0, abs=5.0)
    assert adjusted.time_offset_ms.sigma == pytest.approx(np.hypot(stated_ms, 90.0), rel=0.01)
    if stated_ms == 1000.0:
        assert (nees(late.errors_m(adjusted), adjusted.covariance_m2) < 5.99).mean() > 0.9
