"""Two fits of one camera compared: what chance does, what it does not, and whose axes are turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from geoloc.calibration.intrinsics.coverage import map_pixels
from geoloc.calibration.intrinsics.known_lens import KnownLens, known_lens
from geoloc.calibration.intrinsics.radial_lenses import FThetaLens
from geoloc.calibration.lens_difference import lens_difference
from geoloc.calibration.mounting_difference import mounting_difference
from geoloc.calibration.sign_shift import foot_sigma_m, mounting_slopes
from geoloc.rig.rig import FLU_R_RDF, RigCamera

SIZE = (960, 604)
PIXELS = map_pixels(*SIZE).reshape(-1, 2)


@pytest.fixture(scope="module")
def lens() -> KnownLens:
    """A 120° f-theta lens whose rays are known to some 0.002°, the centre worse, as boards leave it."""
    model = FThetaLens(*SIZE, 4, False)
    k = np.array([477.6, 305.4, 1.18, 0.0, -0.03, 0.01])
    blank = KnownLens(model, k, np.zeros((6, 6)))
    ray, _ = blank.camera.camera_ray_from_pixel(PIXELS[::7])
    slopes = blank.ray_slopes(ray).reshape(-1, 6)
    weight = slopes.T @ slopes / np.radians(0.01) ** 2
    return replace(blank, covariance=np.linalg.inv(weight) + np.diag([0.2**2, 0.2**2, 0, 0, 0, 0]))


def drawn(lens: KnownLens, rng: np.random.Generator) -> KnownLens:
    """The lens as another calibration would find it."""
    return replace(lens, k=rng.multivariate_normal(lens.k, lens.covariance))


def test_fits_that_only_chance_parts_are_judged_as_chance_has_it(lens: KnownLens) -> None:
    """Over pairs of drawn fits the mean square is 1, the probabilities are even, the covariance is theirs."""
    rng = np.random.default_rng(4)
    found = []
    for _ in range(200):
        a, b = drawn(lens, rng), drawn(lens, rng)
        found.append(lens_difference(a.camera, b.camera, PIXELS, (a, b)))
    assert np.mean([d.mean_square for d in found]) == pytest.approx(1.0, abs=0.15)
    assert kstest([d.by_chance for d in found], "uniform").pvalue > 0.01
    apart = np.array([d.apart_rad[100] for d in found])
    covariance = found[0].covariance
    assert covariance is not None
    assert np.trace(np.cov(apart.T)) == pytest.approx(np.trace(covariance[100]), rel=0.3)


def test_another_zoom_is_no_chance_and_another_axis_is_no_difference(lens: KnownLens) -> None:
    """A focal length that is 0.1 % off is found and where it shows most; a turn of all rays is taken out."""
    zoomed = replace(lens, k=lens.k * (1, 1, 1.001, 1, 1.001, 1.001))
    found = lens_difference(lens.camera, zoomed.camera, PIXELS, (lens, zoomed))
    assert found.by_chance is not None
    assert found.by_chance < 1e-6
    corner = PIXELS[int(np.nanargmax(found.angle_rad))]
    assert np.abs(corner - 0.5 * np.array(SIZE)).min() > 150.0
    # A narrow lens whose centre is moved looks elsewhere, and does little else.
    narrow = replace(lens, k=lens.k * (1, 1, 0.25, 1, 0, 0))
    moved = replace(narrow, k=narrow.k + np.array([4.0, 0, 0, 0, 0, 0]))
    found = lens_difference(narrow.camera, moved.camera, PIXELS)
    turn = np.degrees(Rotation.from_matrix(found.rotation).magnitude())
    assert turn == pytest.approx(np.degrees(4.0 * 0.25 * 1.18 / lens.lens.units[2] ** -1), rel=0.02)
    assert np.degrees(np.nanmax(found.angle_rad)) < 0.05 * turn


def test_result_files_numbers_are_the_lens_again(lens: KnownLens) -> None:
    """Values and covariance in the units of files give back the lens, by its parameters' names."""
    units = lens.lens.units
    again = known_lens(lens.lens.parameters, lens.k * units, lens.covariance * np.outer(units, units), *SIZE)
    assert again.lens == lens.lens
    np.testing.assert_allclose(again.k, lens.k, rtol=1e-14)
    np.testing.assert_allclose(again.covariance, lens.covariance, rtol=1e-12)


def test_mounting_makes_up_for_the_axes_of_its_lens(lens: KnownLens) -> None:
    """A lens with turned axes on a mounting that is turned back is the same mounting; a real turn is told."""
    axes = Rotation.from_rotvec([0.002, -0.003, 0.001]).as_matrix()
    first = RigCamera("C", lens.camera, FLU_R_RDF, np.array([1.8, 0.0, 1.5]))
    second = replace(first, rig_R_camera=FLU_R_RDF @ axes.T)
    covariance = np.diag([1e-4**2] * 3 + [1e-3**2] * 3)
    same = mounting_difference(first, second, axes, (covariance, covariance))
    assert same.angle_rad < 1e-12
    assert same.by_chance == pytest.approx(1.0)
    nose_down = Rotation.from_rotvec([0.0, 1e-3, 0.0]).as_matrix()
    turned = replace(second, rig_R_camera=nose_down @ second.rig_R_camera)
    off = mounting_difference(first, turned, axes, (covariance, covariance))
    np.testing.assert_allclose(off.turn_rad, [0.0, 1e-3, 0.0], atol=1e-12)
    assert off.by_chance is not None
    assert off.by_chance < 1e-6


def test_metres_of_a_sign_are_those_of_rays_that_meet_the_road() -> None:
    """One sigma of a foot 20 m away is the spread of where drawn cameras' rays meet level ground."""
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(6, 6)) * 1e-3
    covariance = factor @ factor.T
    camera, foot = np.array([1.8, 0.2, 1.5]), np.array([1.8 + 16.0, 0.2 + 12.0, 0.0])
    ray = (foot - camera) / np.linalg.norm(foot - camera)
    draws = rng.multivariate_normal(np.zeros(6), covariance, size=20_000)
    rays = Rotation.from_rotvec(draws[:, :3]).apply(ray)
    places = camera + draws[:, 3:]
    found = places - rays * (places[:, 2:] / rays[:, 2:])
    along = np.array([0.8, 0.6])
    spread = [np.std((found[:, :2] - foot[:2]) @ axis) for axis in (along[::-1] * (-1, 1), along)]
    slopes = mounting_slopes(ray[np.newaxis])
    whole = slopes @ covariance @ np.swapaxes(slopes, -1, -2)
    np.testing.assert_allclose(foot_sigma_m(ray[np.newaxis], whole, 20.0, 1.5)[0], spread, rtol=0.03)
