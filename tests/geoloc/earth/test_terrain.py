"""A raster of heights: exact on planes and bilinear surfaces, and rays that meet it first."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoloc.arrays import FloatArray
from geoloc.earth.terrain import Terrain
from geoloc.errors import GeolocError
from geoloc.reasons import Reason

EAST, NORTH, STEP = 270_000.0, 7_040_000.0, 0.5


def terrain_of(surface: FloatArray, step_m: float = STEP) -> Terrain:
    """A terrain with these heights at its nodes."""
    return Terrain(EAST, NORTH, step_m, surface)


def plane(rise_east: float, rise_north: float, size: int = 161) -> Terrain:
    """A tilted plane, 80 m by 80 m, 100 m high in its south-western corner."""
    x, y = np.meshgrid(np.arange(size) * STEP, np.arange(size) * STEP)
    return terrain_of(100.0 + rise_east * x + rise_north * y)


SLOPE = st.floats(-0.15, 0.15)


@given(SLOPE, SLOPE, st.floats(3.0, 77.0), st.floats(3.0, 77.0))
def test_height_and_slope_of_a_plane_are_exact(
    rise_east: float, rise_north: float, x: float, y: float
) -> None:
    """Bilinear interpolation leaves a plane as it is, anywhere between the nodes."""
    terrain = plane(rise_east, rise_north)
    height = terrain.height_m(EAST + x, NORTH + y)
    assert height == pytest.approx(100.0 + rise_east * x + rise_north * y, abs=1e-8)
    assert terrain.slope(EAST + x, NORTH + y) == pytest.approx([rise_east, rise_north], abs=1e-8)


def test_height_is_that_of_the_nodes_and_bilinear_between_them() -> None:
    """Rows go north, columns east; the middle of a cell is the mean of its four nodes."""
    terrain = terrain_of(np.array([[1.0, 2.0, 4.0], [10.0, 20.0, 40.0]]), 2.0)
    east, north = np.meshgrid(EAST + np.array([0.0, 2.0, 4.0]), NORTH + np.array([0.0, 2.0]))
    np.testing.assert_array_equal(terrain.height_m(east, north), terrain.grid_m)
    assert terrain.height_m(EAST + 1.0, NORTH + 1.0) == pytest.approx((1.0 + 2.0 + 10.0 + 20.0) / 4.0)


def test_height_outside_or_beside_unknown_nodes_is_nan() -> None:
    """What the raster does not know stays unknown: outside, and in the cells around a missing node."""
    grid = np.zeros((5, 5))
    grid[2, 2] = np.nan
    terrain = terrain_of(grid, 1.0)
    east = EAST + np.array([-0.01, 4.01, 2.0, 1.5, 0.5, 4.0, np.nan])
    assert np.isnan(terrain.height_m(east, NORTH + 1.5)).tolist() == [
        True,
        True,
        True,
        True,
        False,
        False,
        True,
    ]
    assert np.isnan(terrain.slope(EAST + 0.5, NORTH + 2.0)).any()


@given(SLOPE, SLOPE, st.floats(0.0, 360.0), st.floats(3.0, 60.0))
def test_rays_meet_a_plane_where_they_must(
    rise_east: float, rise_north: float, azimuth: float, fall_deg: float
) -> None:
    """From 1.5 m above a tilted plane, rays of any direction end where the equation of the plane says."""
    terrain = plane(rise_east, rise_north)
    x = y = 40.0
    origin = np.array([EAST + x, NORTH + y, 101.5 + rise_east * x + rise_north * y])
    a, f = np.radians(azimuth), np.radians(fall_deg)
    ray = np.array([np.sin(a) * np.cos(f), np.cos(a) * np.cos(f), -np.sin(f)])
    closing = -ray[2] + rise_east * ray[0] + rise_north * ray[1]
    expected = origin + 1.5 / closing * ray if closing > 0.0 else np.full(3, np.inf)
    reach = np.hypot(*(expected - origin)[:2])
    hits = terrain.intersect(origin, ray, max_range_m=30.0)
    assert hits.valid == (reach <= 30.0)
    if hits.valid:
        np.testing.assert_allclose(hits.point_m, expected, atol=1e-5)


def test_rays_end_at_the_first_ground_they_meet() -> None:
    """A ray stops on the near slope of a ridge; one that passes over it meets the ground behind."""
    x = np.arange(201) * STEP
    terrain = terrain_of(np.tile(2.0 * np.exp(-(((x - 20.0) / 4.0) ** 2)), (20, 1)))
    origin, ray = np.array([EAST, NORTH + 4.0, 1.5]), np.array([1.0, 0.0, -0.01])
    hits = terrain.intersect(origin, ray)
    assert 10.0 < hits.point_m[0] - EAST < 20.0
    np.testing.assert_allclose(terrain.height_m(*hits.point_m[:2]), hits.point_m[2], atol=1e-7)
    # A steeper one that just passes over the crest comes down well behind it.
    over = terrain.intersect(
        origin + np.array([0.0, 0.0, 1.6]), ray * np.array([1.0, 0.0, 5.0]), max_range_m=70.0
    )
    assert over.point_m[0] - EAST == pytest.approx(3.1 / 0.05, abs=0.1)


def test_rays_that_meet_nothing_say_why() -> None:
    """Each kind of miss is NaN with its reason."""
    level = plane(0.0, 0.0)
    above = np.array([EAST + 40.0, NORTH + 40.0, 101.5])
    nan = np.full(3, np.nan)
    origin = np.array([above, above, above, nan, above - [0.0, 0.0, 3.0], above - [39.0, 0.0, 0.0], above])
    ray = np.array(
        [
            [1.0, 0.0, -0.1],
            [1.0, 0.0, 0.1],
            [1.0, 0.0, -0.03],
            [1.0, 0.0, -0.1],
            [1.0, 0.0, -0.1],
            [-1.0, 0.0, -0.1],
            [0.0, 0.0, 1.0],
        ]
    )
    hits = level.intersect(origin, ray, max_range_m=30.0)
    assert hits.reason.tolist() == [
        "",
        Reason.ABOVE_HORIZON,
        Reason.TOO_FAR_ON_TERRAIN,
        Reason.NO_RAY,
        Reason.CAMERA_UNDERGROUND,
        Reason.TERRAIN_UNKNOWN,
        Reason.ABOVE_HORIZON,
    ]
    assert hits.valid.tolist() == [True] + [False] * 6
    assert np.isnan(hits.point_m[1:]).all()


def test_rays_keep_their_batch_shape() -> None:
    """One origin with a batch of rays, more than are marched at a time, and none at all."""
    level = plane(0.0, 0.0)
    origin = np.array([EAST + 40.0, NORTH + 40.0, 102.0])
    ray = np.broadcast_to(np.array([0.5, 0.5, -0.2]), (3, 400, 3))
    hits = level.intersect(origin, ray)
    assert hits.valid.shape == (3, 400)
    np.testing.assert_allclose(
        hits.point_m, np.broadcast_to(origin + np.array([5.0, 5.0, -2.0]), (3, 400, 3)), atol=1e-6
    )
    assert level.intersect(origin, np.zeros((0, 3))).point_m.shape == (0, 3)


def test_straight_down_is_the_height_below() -> None:
    """A plumb line has no horizontal length and still meets the ground."""
    terrain = plane(0.1, -0.05)
    place = np.array([EAST + 33.3, NORTH + 41.7, 200.0])
    hits = terrain.intersect(place, np.array([0.0, 0.0, -1.0]))
    assert hits.point_m[2] == pytest.approx(terrain.height_m(*place[:2]), abs=1e-6)


@pytest.mark.parametrize(("shape", "step"), [((1, 5), 1.0), ((5, 1), 1.0), ((5,), 1.0), ((5, 5), 0.0)])
def test_terrain_that_is_no_surface_is_refused(shape: tuple[int, ...], step: float) -> None:
    """Fewer than two rows or columns, or no step, say so at once."""
    with pytest.raises(GeolocError, match="is no surface"):
        Terrain(EAST, NORTH, step, np.zeros(shape))
