"""Rays of many pixels by component: those of the pixels one by one, and their slopes."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.cameras.base import CameraModel, sin_cos
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.cameras.pinhole import PinholeCamera

MODELS: dict[str, CameraModel] = {
    "f-theta": FThetaCamera(1920, 1208, 951.0, 612.0, theta_from_r=(0.0, 9.9e-4, 2e-9, -1.1e-11)),
    "f-theta, sheared": FThetaCamera(
        1920, 1208, 951.0, 612.0, theta_from_r=(0.0, 9.9e-4, 2e-9), c=1.002, d=3e-3, e=-2e-3
    ),
    "f-theta from angles": FThetaCamera(1920, 1208, 951.0, 612.0, r_from_theta=(0.0, 1000.0, 2.0, 30.0)),
    "pinhole": PinholeCamera(1920, 1208, 1870.0, 1868.0, 948.0, 617.0),
    "pinhole, distorted": PinholeCamera(1920, 1208, 1870.0, 1868.0, 948.0, 617.0, (-0.31, 0.12, 1e-4, -2e-4)),
}


@pytest.mark.parametrize("name", list(MODELS))
def test_rays_by_component_are_those_of_the_pixels(name: str) -> None:
    """Rays agree with `camera_ray_from_pixel`, masks too, and slopes with central differences of it."""
    model, step = MODELS[name], 1e-2
    pixel = np.random.default_rng(2).uniform([-20.0, -20.0], [1940.0, 1230.0], (2000, 2))
    pixel[:3] = [[951.0, 612.0], [951.0, 612.0 + 1e-9], [np.nan, 5.0]]
    expected, mask = model.camera_ray_from_pixel(pixel)
    with np.errstate(all="ignore"):
        rays = model.rays(pixel[:, 0], pixel[:, 1], slopes=True)
    np.testing.assert_array_equal(rays.inside, mask)
    np.testing.assert_allclose(np.stack(rays.ray, axis=1)[mask], expected[mask], rtol=0, atol=1e-14)
    for axis, by in enumerate((rays.by_u, rays.by_v)):
        assert by is not None
        offset = step * np.eye(2)[axis]
        ahead, behind = (model.camera_ray_from_pixel(pixel + sign * offset)[0] for sign in (1.0, -1.0))
        # On the axis the quadratic term, 2e-9 px⁻², has a kink: 2e-11 over the step. Elsewhere: rounding.
        np.testing.assert_allclose(
            np.stack(by, axis=1)[mask], ((ahead - behind) / (2.0 * step))[mask], rtol=0, atol=3e-11
        )


def test_sin_cos_are_numpys() -> None:
    """Over three turns, at quarter turns, and NaN for NaN."""
    angle = np.concatenate([np.linspace(-10.0, 10.0, 10_001), np.arange(-4, 5) * np.pi / 2.0, [np.nan]])
    sin, cos = sin_cos(angle)
    np.testing.assert_allclose(sin, np.sin(angle), rtol=0, atol=1e-15)
    np.testing.assert_allclose(cos, np.cos(angle), rtol=0, atol=1e-15)
