"""Combination of sightings: what averages out, what does not, and what is thrown out."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu
from geoloc.locate.combine import cep95_m, combine, ellipse, ring95_m
from geoloc.locate.records import Located

LAT0, LON0 = 63.4149, 10.3991


def located(
    plane: FloatArray,
    random: FloatArray,
    systematic: FloatArray | None = None,
    rejected: FloatArray | None = None,
) -> Located:
    """Positions at these metres east and north of a place."""
    n = len(plane)
    shared = np.zeros((n, 2, 1)) if systematic is None else systematic
    lat, lon = geographic_from_enu(LAT0, LON0, plane[:, 0], plane[:, 1])
    reason = np.full(n, "", dtype="U20")
    if rejected is not None:
        reason[rejected.astype(bool)] = "above the horizon"
        lat, lon = np.where(reason == "", lat, np.nan), np.where(reason == "", lon, np.nan)
    return Located(
        latitude_deg=lat,
        longitude_deg=lon,
        height_m=np.full(n, 60.0),
        covariance_m2=random + shared @ np.swapaxes(shared, 1, 2),
        random_m2=random,
        systematic_m=shared,
        source=tuple(f"source {i}" for i in range(shared.shape[2])),
        range_m=np.linspace(5.0, 4.0 + n, n),
        rejected=reason,
    )


def metres(result_lat: FloatArray, result_lon: FloatArray) -> FloatArray:
    """Back to metres east and north."""
    return np.stack(enu_offset(LAT0, LON0, result_lat, result_lon), axis=-1)


def spd(rng: np.random.Generator, n: int) -> FloatArray:
    """Random covariances of about 0.3 m."""
    root = rng.normal(0.0, 0.3, (n, 2, 2))
    return np.asarray(root @ np.swapaxes(root, 1, 2) + 0.01 * np.eye(2))


def test_independent_sightings_combine_by_the_information_sum() -> None:
    """Without shared errors the result is that of the information filter: C⁻¹ = Σ C_i⁻¹."""
    rng = np.random.default_rng(1)
    covariance = spd(rng, 6)
    plane = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), 0.5 * rng.normal(size=(6, 2)))
    result = combine(located(plane, covariance), np.zeros(6, dtype=int))
    information = np.linalg.inv(covariance)
    expected = np.linalg.inv(information.sum(axis=0))
    mean = expected @ np.einsum("nij,nj->i", information, plane)
    assert result.n_used.tolist() == [6]
    np.testing.assert_allclose(result.covariance_m2[0], expected, rtol=1e-4)
    np.testing.assert_allclose(metres(result.latitude_deg, result.longitude_deg)[0], mean, atol=1e-5)


@pytest.mark.parametrize("n", [1, 4, 100])
def test_shared_error_does_not_shrink_with_more_sightings(n: int) -> None:
    """A heading error of one sigma 0.5 m stays 0.5 m, while random 0.2 m falls as the root of n."""
    random = np.tile(0.04 * np.eye(2), (n, 1, 1))
    shared = np.tile(np.array([[0.5], [0.0]]), (n, 1, 1))
    result = combine(located(np.zeros((n, 2)), random, shared), np.zeros(n, dtype=int))
    np.testing.assert_allclose(result.covariance_m2[0], np.diag([0.25 + 0.04 / n, 0.04 / n]), rtol=1e-6)


def test_shared_error_that_changes_sign_cancels() -> None:
    """A time offset seen from both directions moves the sightings apart and leaves the mean in place."""
    shared = np.array([[[0.4], [0.0]], [[-0.4], [0.0]]])
    random = np.tile(0.01 * np.eye(2), (2, 1, 1))
    result = combine(located(np.array([[0.4, 0.0], [-0.4, 0.0]]), random, shared), [0, 0])
    np.testing.assert_allclose(result.covariance_m2[0], 0.005 * np.eye(2), rtol=1e-6)
    np.testing.assert_allclose(metres(result.latitude_deg, result.longitude_deg), 0.0, atol=1e-6)


def test_predicted_covariance_matches_the_spread_of_combined_positions() -> None:
    """Monte Carlo: 3 000 objects of 8 sightings with random and shared errors have a NEES of 2.

    The mean of 3 000 values of χ² with two degrees has a standard error of 0.036; the tolerance is 0.2
    because the gate at 99.9 % clips a little.
    """
    rng = np.random.default_rng(4)
    g, k = 3000, 8
    group = np.repeat(np.arange(g), k)
    random = spd(rng, g * k)
    shared = rng.normal(0.0, 0.3, (g * k, 2, 2))
    common = rng.normal(size=(g, 2))[group]
    plane = np.einsum("nij,nj->ni", np.linalg.cholesky(random), rng.normal(size=(g * k, 2)))
    plane += np.einsum("nij,nj->ni", shared, common)
    result = combine(located(plane, random, shared), group)
    error = metres(result.latitude_deg, result.longitude_deg)
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(result.covariance_m2, error[..., None])[..., 0])
    assert nees.mean() == pytest.approx(2.0, abs=0.2)
    assert result.n_rejected.sum() < 0.01 * g * k


@pytest.mark.parametrize("wild", [1, 3])
def test_gross_outliers_are_rejected_and_counted(wild: int) -> None:
    """Sightings metres away from the rest, even several agreeing ones, leave the result as without them."""
    rng = np.random.default_rng(6)
    random = np.tile(0.04 * np.eye(2), (9, 1, 1))
    plane = rng.normal(0.0, 0.2, (9, 2))
    moved = plane.copy()
    moved[:wild] += [8.0, -5.0]
    result = combine(located(moved, random), np.zeros(9, dtype=int))
    clean = combine(located(plane[wild:], random[wild:]), np.zeros(9 - wild, dtype=int))
    assert (result.n_used[0], result.n_rejected[0]) == (9 - wild, wild)
    np.testing.assert_array_equal(result.used, np.arange(9) >= wild)
    assert result.range_min_m[0] == 5.0 + wild
    np.testing.assert_allclose(
        metres(result.latitude_deg, result.longitude_deg),
        metres(clean.latitude_deg, clean.longitude_deg),
        atol=1e-6,
    )


def test_half_of_a_group_always_stays() -> None:
    """Two sightings that contradict each other leave one, not none."""
    result = combine(
        located(np.array([[0.0, 0.0], [50.0, 0.0]]), np.tile(0.01 * np.eye(2), (2, 1, 1))), [7, 7]
    )
    assert (result.n_used[0], result.n_rejected[0]) == (1, 1)
    assert np.isfinite(result.latitude_deg).all()


def test_groups_do_not_touch_each_other_and_order_plays_no_part() -> None:
    """Shuffled rows of many groups give each group what it gets alone; negative labels are left out."""
    rng = np.random.default_rng(9)
    group = np.repeat([-1, 3, 8, 20], [4, 5, 1, 7])
    plane, random, shared = rng.normal(0, 0.3, (17, 2)), spd(rng, 17), rng.normal(0, 0.2, (17, 2, 3))
    order = rng.permutation(17)
    result = combine(located(plane[order], random[order], shared[order]), group[order])
    assert result.group.tolist() == [3, 8, 20]
    for i, name in enumerate(result.group):
        rows = group == name
        alone = combine(located(plane[rows], random[rows], shared[rows]), np.zeros(rows.sum(), dtype=int))
        np.testing.assert_allclose(result.covariance_m2[i], alone.covariance_m2[0], rtol=1e-6)
        np.testing.assert_allclose(
            metres(result.latitude_deg[i], result.longitude_deg[i]),
            metres(alone.latitude_deg[0], alone.longitude_deg[0]),
            atol=1e-6,
        )


def test_group_without_a_located_sighting_is_nan() -> None:
    """Where every sighting was rejected there is no position, no covariance and no range."""
    one = located(np.zeros((3, 2)), np.tile(np.eye(2), (3, 1, 1)), rejected=np.array([1, 1, 0]))
    result = combine(one, [1, 1, 2])
    assert result.n_used.tolist() == [0, 1]
    assert np.isnan(result.latitude_deg[0])
    assert np.isnan(result.covariance_m2[0]).all()
    assert np.isnan([result.range_min_m[0], result.height_m[0]]).all()
    assert np.isfinite(result.height_m[1])


def test_nothing_combines_to_nothing() -> None:
    """No sightings at all make no groups."""
    result = combine(located(np.zeros((0, 2)), np.zeros((0, 2, 2))), np.zeros(0, dtype=int))
    assert result.group.size == 0
    assert result.covariance_m2.shape == (0, 2, 2)


@pytest.mark.parametrize("azimuth", [0.0, 30.0, 90.0, 135.0, 179.0])
def test_ellipse_recovers_axes_and_azimuth(azimuth: float) -> None:
    """A covariance built from axes 2 and 0.5 m along an azimuth gives them back."""
    along = np.array([np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth))])
    across = np.array([along[1], -along[0]])
    major, minor, found = ellipse(4.0 * np.outer(along, along) + 0.25 * np.outer(across, across))
    assert float(major) == pytest.approx(2.0)
    assert float(minor) == pytest.approx(0.5)
    assert abs((found - azimuth + 90.0) % 180.0 - 90.0) < 1e-6


def test_cep95_of_a_circle_and_of_a_line_are_the_known_ones() -> None:
    """2.4477 σ for a circular normal (√χ²), 1.9600 σ for one on a line."""
    covariance = np.array([9.0 * np.eye(2), [[4.0, 0.0], [0.0, 0.0]], [[2.0, 2.0], [2.0, 2.0]]])
    np.testing.assert_allclose(
        cep95_m(covariance), [3.0 * 2.447747, 2.0 * 1.959964, 2.0 * 1.959964], rtol=1e-5
    )
    assert np.isnan(cep95_m(np.full((2, 2), np.nan)))
    assert cep95_m(np.zeros((2, 2))) == 0.0


def test_corners_of_the_ellipse_lie_where_the_density_ends_95_percent() -> None:
    """Each has the squared Mahalanobis distance -2 ln 0.05, and they go round anticlockwise."""
    covariance = np.array([[[1.0, 0.55], [0.55, 0.4]], [[0.04, -0.01], [-0.01, 0.3]]])
    ring = ring95_m(covariance, 16)
    square = np.einsum("eki,eij,ekj->ek", ring, np.linalg.inv(covariance), ring)
    np.testing.assert_allclose(square, -2.0 * np.log(0.05), rtol=1e-9)
    following = np.roll(ring, -1, axis=1)
    assert (ring[..., 0] * following[..., 1] > ring[..., 1] * following[..., 0]).all()


def test_cep95_holds_95_percent_of_draws() -> None:
    """Of 200 000 draws from an elongated normal 95 % fall inside the circle: standard error 0.05 %."""
    covariance = np.array([[1.0, 0.55], [0.55, 0.4]])
    draws = np.random.default_rng(2).multivariate_normal([0.0, 0.0], covariance, 200_000)
    inside = np.mean(np.linalg.norm(draws, axis=1) < cep95_m(covariance))
    assert inside == pytest.approx(0.95, abs=0.002)
