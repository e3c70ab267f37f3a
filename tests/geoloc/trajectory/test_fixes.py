"""How far fixes are trusted."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.trajectory.fix_checks import (
    CHANGES_WITHIN_S,
    SIGMA_FLOOR_M,
    changing_m,
    lateness_s,
    noise_of_fixes,
    sigma_of_fixes,
)
from geoloc.trajectory.poses import GnssFixes

NAN = np.nan


def test_stated_sigma_is_taken_where_there_is_one() -> None:
    """Else that of the quality; never below a centimetre."""
    sigma = sigma_of_fixes(np.array([4, 4, 4, 1]), np.array([NAN, 0.002, 0.04, 0.6]))
    assert sigma == pytest.approx([0.015, SIGMA_FLOOR_M, 0.04, 0.6])


def test_good_fix_of_unknown_kind_shares_its_error_like_a_fixed_one() -> None:
    """A third of the slow error is an antenna's own at 2 cm, nearly all of it at 2 m."""
    noise = noise_of_fixes(np.array([1, 4, 1]), np.array([0.02, NAN, NAN]))
    assert noise.slow_m / noise.sigma_m == pytest.approx([0.33, 0.33, 0.9])
    assert noise.white_m / noise.sigma_m == pytest.approx([0.4] * 3)
    assert noise.slow_lasts_s.tolist() == [10.0, 10.0, 120.0]


def test_velocities_bound_what_places_change_by_within_seconds() -> None:
    """By fixes alone half of 5 cm and 0.3 m of 2 m are new; by velocities what they let places wander by."""
    sigma_m = np.array([0.05, 2.0])
    assert changing_m(sigma_m) == pytest.approx([0.025, 0.3])
    held = changing_m(sigma_m, 0.005)
    assert held[0] == 0.025
    assert 2.0 * held[1] ** 2 / CHANGES_WITHIN_S == pytest.approx(0.005)


def test_fixes_without_stated_sigmas_have_nan() -> None:
    """One NaN a fix, so that rows can be picked alike."""
    stamp = np.arange(3)
    fixes = GnssFixes("a", stamp, stamp, *(np.zeros(3) for _ in range(3)), np.full(3, 4))
    assert np.isnan(fixes.sigma_horizontal_m).tolist() == [True] * 3
    assert np.isnan(fixes.sigma_vertical_m).tolist() == [True] * 3


@pytest.mark.parametrize(
    ("quality", "stated_m", "late_s"), [(4, NAN, 0.0), (5, NAN, 0.0), (1, NAN, 0.15), (1, 0.02, 0.0)]
)
def test_receivers_without_a_carrier_phase_solution_are_late(
    quality: int, stated_m: float, late_s: float
) -> None:
    """By half of a normal distribution; those of surveyors are not, whatever they call their solution."""
    stamp = np.arange(3)
    place = (np.zeros(3) for _ in range(3))
    one = GnssFixes("a", stamp, stamp, *place, np.full(3, quality), np.full(3, stated_m))
    drawn_s = late_s * np.abs(np.random.default_rng(0).normal(size=100_000))
    assert lateness_s([one]) == pytest.approx((drawn_s.mean(), drawn_s.std()), abs=0.002)
