"""Error statistics against hand-worked numbers and draws with known truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geoloc.locate.accuracy import RANGE_EDGES_M, cep, ellipse_coverage, error_stats, nees, stats_by_range


def test_error_stats_are_the_hand_worked_ones() -> None:
    """Of 1, 2, 3, 4, 10: mean 4, median 3, p95 8.8 (between 4 and 10), RMSE √26."""
    stats = error_stats([1.0, 10.0, 3.0, np.nan, 2.0, 4.0])
    assert stats.n == 5
    assert (stats.mean, stats.median, stats.max) == (4.0, 3.0, 10.0)
    assert stats.p95 == pytest.approx(4.0 + 0.8 * 6.0)
    assert stats.rmse == pytest.approx(math.sqrt(26.0))


def test_error_stats_of_nothing_are_nan() -> None:
    """Without a finite error every statistic is NaN and n is 0."""
    stats = error_stats([np.nan])
    assert stats.n == 0
    assert all(math.isnan(v) for v in (stats.mean, stats.median, stats.p95, stats.max, stats.rmse))
    assert math.isnan(cep([]))


def test_cep_of_circular_normal_errors_is_rayleigh() -> None:
    """A circular normal has CEP50 1.1774 σ and CEP95 2.4477 σ, within 2 % for 40 000 draws."""
    radial = np.linalg.norm(np.random.default_rng(8).normal(0.0, 0.3, (40_000, 2)), axis=1)
    assert cep(radial) == pytest.approx(0.3 * 1.17741, rel=0.02)
    assert cep(radial, 0.95) == pytest.approx(0.3 * 2.44775, rel=0.02)


def test_nees_agrees_with_a_linear_solve() -> None:
    """The closed form equals dᵀ C⁻¹ d by LAPACK."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(50, 2, 2))
    covariance = root @ np.swapaxes(root, 1, 2) + 0.01 * np.eye(2)
    error = rng.normal(size=(50, 2))
    expected = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    np.testing.assert_allclose(nees(error, covariance), expected, rtol=1e-9)


def test_nees_of_a_covariance_that_is_none_is_nan() -> None:
    """Singular, negative and NaN covariances have no NEES."""
    covariance = np.array([np.zeros((2, 2)), -np.eye(2), np.full((2, 2), np.nan), [[1.0, 1.0], [1.0, 1.0]]])
    assert np.isnan(nees(np.ones((4, 2)), covariance)).all()


@pytest.mark.parametrize("probability", [0.5, 0.95])
def test_ellipse_coverage_of_honest_covariances_is_the_probability(probability: float) -> None:
    """Draws from their own covariances fall inside their ellipses as often as stated.

    20 000 seeded draws: a standard error of 0.35 % at most, tolerance four of them.
    """
    rng = np.random.default_rng(2)
    root = rng.normal(size=(20_000, 2, 2)) + np.eye(2)
    error = np.einsum("nij,nj->ni", root, rng.normal(size=(20_000, 2)))
    coverage = ellipse_coverage(error, root @ np.swapaxes(root, 1, 2), probability)
    assert coverage == pytest.approx(probability, abs=0.015)


def test_ellipse_coverage_shows_covariances_that_are_too_small() -> None:
    """Errors three times their sigma are inside the 95 % ellipse far less often: 1 - exp(-2.9957/9)."""
    error = np.random.default_rng(3).normal(0.0, 3.0, (20_000, 2))
    assert ellipse_coverage(error, np.tile(np.eye(2), (20_000, 1, 1))) == pytest.approx(0.283, abs=0.015)
    assert math.isnan(ellipse_coverage(np.zeros((0, 2)), np.zeros((0, 2, 2))))


def test_stats_by_range_put_each_error_in_one_class() -> None:
    """Classes are [from, to): an object at exactly 8 m belongs to the second, one at 45 m to the open one."""
    ranges = np.array([0.0, 7.9, 8.0, 11.0, 21.0, 45.0, np.nan])
    classes = stats_by_range(np.arange(7.0), ranges)
    assert [c.stats.n for c in classes] == [2, 2, 0, 1, 0, 1]
    assert [c.from_m for c in classes] == list(RANGE_EDGES_M[:-1])
    assert classes[1].stats.mean == 2.5
    assert math.isinf(classes[-1].to_m)
