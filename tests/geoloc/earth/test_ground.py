"""Rays against the plane of the road."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from geoloc.earth.ground import intersect_plane, miss_reason
from geoloc.reasons import Reason


@given(
    x=st.floats(-40.0, 40.0),
    y=st.floats(-40.0, 40.0),
    height=st.floats(0.5, 4.0),
    plane=st.floats(-0.4, 0.4),
    length=st.floats(1e-3, 1e3),
)
def test_ray_towards_a_point_of_the_plane_hits_that_point(
    x: float, y: float, height: float, plane: float, length: float
) -> None:
    """The ray from a camera to any point of the plane, whatever its length, meets the plane there."""
    origin, target = np.array([1.5, 0.2, height]), np.array([x, y, plane])
    ray = (target - origin) * length
    point, valid = intersect_plane(origin, ray, plane)
    assert valid
    np.testing.assert_allclose(point, target, atol=1e-9)
    assert point[2] == plane


def test_range_is_read_off_the_dip_of_the_ray() -> None:
    """From 1.5 m a ray 0.1 rad below the horizon travels 1.5 / tan 0.1 = 14.950 m."""
    ray = np.array([np.cos(0.1), 0.0, -np.sin(0.1)])
    point, valid = intersect_plane(np.array([0.0, 0.0, 1.5]), ray)
    assert valid
    np.testing.assert_allclose(point, [14.94996, 0.0, 0.0], atol=1e-5)


def test_rays_that_miss_are_nan_with_a_reason() -> None:
    """Rays that rise, run level, are NaN, start below the plane or hit too far away give no point."""
    origin = np.array([[0.0, 0.0, 1.5]] * 5 + [[0.0, 0.0, -0.1]])
    ray = np.array(
        [[1, 0, 0.1], [1, 0, 0.0], [np.nan, 0, -1], [1, 0, -0.0249], [1, 0, -0.0251], [1, 0, -0.1]],
    )
    point, valid = intersect_plane(origin, ray)
    np.testing.assert_array_equal(valid, [False, False, False, False, True, False])
    assert np.isnan(point[~valid]).all()
    assert miss_reason(origin, ray).tolist() == [
        Reason.ABOVE_HORIZON,
        Reason.ABOVE_HORIZON,
        Reason.NO_RAY,
        Reason.TOO_FAR,
        "",
        Reason.CAMERA_UNDERGROUND,
    ]


def test_batches_of_any_shape_broadcast() -> None:
    """One camera position serves a whole grid of rays, and arguments stay as they were."""
    rng = np.random.default_rng(5)
    origin = np.array([1.0, 0.0, 1.4])
    ray = rng.normal(size=(3, 4, 3))
    before = ray.copy()
    point, valid = intersect_plane(origin, ray)
    assert point.shape == (3, 4, 3)
    for index in np.ndindex(3, 4):
        one, ok = intersect_plane(origin, ray[index])
        assert ok == valid[index]
        np.testing.assert_array_equal(one, point[index])
    np.testing.assert_array_equal(ray, before)
