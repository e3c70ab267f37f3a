"""A camera behind a windscreen, against NVIDIA's own implementation of the model."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.cameras import CameraModel, FisheyeCamera, FThetaCamera, PinholeCamera
from geoloc.cameras.windshield import Windshield, WindshieldCamera
from geoloc.errors import CalibrationError

HORIZONTAL = (
    *(-0.000475919834570959, 0.99944007396698, 0.000166745347087272, 0.000205887947231531),
    *(0.0055195577442646, 0.000861024134792387),
)
VERTICAL = (
    *(0.00152770057320595, -0.000532537756953388, -5.65027039556298e-05, -4.02410341848736e-06),
    *(0.000608163303695619, 1.0094313621521, -0.00125278066843748, 0.00823396816849709),
    *(-0.000293767458060756, 0.0185473654419184, -0.003074218519032, 0.00599765172228217),
    *(0.0172030478715897, -0.00364979170262814, 0.0069147446192801),
)
"""A calibrated screen, from the tests of NVIDIA ncore (Apache 2.0)."""
RAYS = np.array(
    [[0, 0, 1], [0.3, -0.1, 1], [-0.3, 0.2, 1], [1.2, 0.4, 1], [-1.5, -0.5, 1], [0.05, 0.6, 1]], dtype=float
)
INTO_CAMERA = np.array(
    [
        [-4.7591981660501012e-04, 1.5276999789638407e-03, 9.9999871981573174e-01],
        [2.8528263079714239e-01, -9.4755553454418551e-02, 9.5374797806077061e-01],
        [-2.8272578170944052e-01, 1.9256929566527914e-01, 9.3967185693930633e-01],
        [7.4450136096952868e-01, 2.5423604761996599e-01, 6.1731819639882468e-01],
        [-8.0083503222686458e-01, -2.6808012179930829e-01, 5.3553365856336688e-01],
        [4.2825483566466510e-02, 5.2701537375482566e-01, 8.4877604453905264e-01],
    ]
)
"""`RAYS` by ``BivariateWindshieldModel.distort_camera_rays`` of nvidia-ncore 19.8.3, in float64."""
PIXELS = np.array(
    [
        [958.274095232473, 613.5276516715069],
        [1246.7657530241934, 516.3366502715527],
        [672.1851177887792, 807.1841717305113],
        [1800.6531562342857, 899.4972997242646],
        [23.55245210478347, 298.94192629282713],
        [1003.3819880708297, 1161.2464279606497],
    ]
)
"""`RAYS` by its ``FThetaCameraModel`` behind that screen (float32, counted from a pixel's corner)."""

SCREEN = Windshield(HORIZONTAL, VERTICAL)
FTHETA = FThetaCamera(1920, 1208, 958.25, 611.5, (0.0, 1e-3, 2e-8))
CAMERAS: dict[str, CameraModel] = {
    "ftheta": WindshieldCamera(FTHETA, SCREEN),
    "backward": WindshieldCamera(FTHETA, Windshield(HORIZONTAL, VERTICAL, forward=False)),
    "pinhole": WindshieldCamera(PinholeCamera(1920, 1080, 1400.0, 1400.0, 959.5, 539.5), SCREEN),
    "fisheye": WindshieldCamera(FisheyeCamera(1280, 800, 600.0, 600.0, 639.5, 399.5), SCREEN),
}
EVERY_CAMERA = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())


def test_screen_bends_rays_as_nvidia_does() -> None:
    """Into the camera by the polynomials, to 1e-15; and from within back to where the rays came from."""
    bent, inside = SCREEN.into_camera(7.0 * RAYS)
    assert inside.all()
    np.testing.assert_allclose(bent, INTO_CAMERA, rtol=0, atol=1e-15)
    backward = Windshield(HORIZONTAL, VERTICAL, forward=False)
    again, inside = backward.into_camera(INTO_CAMERA)
    assert inside.all()
    np.testing.assert_allclose(again, RAYS / np.linalg.norm(RAYS, axis=1)[:, np.newaxis], rtol=0, atol=1e-14)


def test_pixels_of_a_camera_behind_a_screen_are_nvidias() -> None:
    """The screen first, then the lens, to a thousandth of a pixel; without the screen they are 15 px off."""
    pixel, seen = CAMERAS["ftheta"].pixel_from_camera_point(RAYS)
    assert seen.all()
    np.testing.assert_allclose(pixel, PIXELS - 0.5, rtol=0, atol=1e-3)
    bare, _ = FTHETA.pixel_from_camera_point(RAYS)
    assert 14.0 < np.abs(bare - (PIXELS - 0.5)).max() < 15.0


@EVERY_CAMERA
def test_camera_behind_a_screen_keeps_the_protocol(camera: CameraModel) -> None:
    """Pixel → ray → pixel closes to 1e-9 px over the image; rays by component and slopes are the same."""
    assert isinstance(camera, CameraModel)
    size, step = np.array([camera.width_px, camera.height_px]), 1e-2
    pixel = np.random.default_rng(1).uniform(-0.5, size - 0.5, (500, 2))
    ray, seen = camera.camera_ray_from_pixel(pixel)
    again, on_image = camera.pixel_from_camera_point(30.0 * ray)
    assert seen.all()
    assert on_image.all()
    np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1.0, atol=1e-14)
    np.testing.assert_allclose(again, pixel, rtol=0, atol=1e-9)
    rays = camera.rays(pixel[:, 0], pixel[:, 1], slopes=True)
    np.testing.assert_allclose(np.stack(rays.ray, axis=1), ray, rtol=0, atol=1e-14)
    for axis in (0, 1):
        offset = step * np.eye(2)[axis]
        ahead, behind = (camera.camera_ray_from_pixel(pixel + sign * offset)[0] for sign in (1.0, -1.0))
        off = rays.by_pixel()[..., axis] - (ahead - behind) / (2.0 * step)
        assert np.abs(off).max() < 1e-10
    assert camera.rays(pixel[:, 0], pixel[:, 1]).by_u is None
    row = np.column_stack([np.linspace(-0.5, size[0] - 0.5, 2001), np.full(2001, size[1] / 2)])
    along = camera.camera_ray_from_pixel(row)[0]
    turned = np.arcsin(np.linalg.norm(np.cross(along[1:], along[:-1]), axis=1)).sum()
    assert camera.horizontal_fov_rad == pytest.approx(turned, abs=5e-3)


@EVERY_CAMERA
def test_camera_behind_a_screen_answers_nan_where_it_sees_nothing(camera: CameraModel) -> None:
    """Its own centre, behind it, straight to the side, no number; the neighbour is not touched."""
    points = np.array([[0, 0, 0], [0, 0, -5], [1, 0, 0], [np.nan, 0, 1], [0, np.inf, 1], [0.1, 0.1, 1]])
    pixel, seen = camera.pixel_from_camera_point(points)
    assert seen.tolist() == [False] * 5 + [True]
    assert np.isnan(pixel[:5]).all()
    ray, seen = camera.camera_ray_from_pixel(np.array([[np.nan, 3.0], [400.0, 300.0]]))
    assert seen.tolist() == [False, True]
    assert np.isnan(ray[0]).all()
    assert camera.camera_ray_from_pixel(np.zeros((0, 2)))[0].shape == (0, 3)


def test_screen_that_bends_nothing_is_known() -> None:
    """The identity of any degree."""
    assert Windshield((0, 1, 0), (0, 0, 1)).is_identity
    assert Windshield((0, 1, 0, 0, 0, 0), (0.0,) * 5 + (1.0,) + (0.0,) * 9).is_identity
    assert not Windshield((0, 1, 0), (1e-9, 0, 1)).is_identity


@pytest.mark.parametrize(
    ("horizontal", "vertical", "message"),
    [
        ((0, 1), (0, 0, 1), "horizontal windshield polynomial has 2 numbers"),
        ((0, 1, 0), (0, 0, 1, 0), "vertical windshield polynomial has 4 numbers"),
        ((0, 0, 1), (0, 1, 0), "no windshield's"),
        ((0.5, 1, 0), (0, 0, 1), "ray along the axis by 28.6°"),
        ((0, 0, 0), (0, 0, 1), "no windshield's"),
        ((0, np.nan, 0), (0, 0, 1), "not a finite number"),
    ],
)
def test_polynomials_that_are_no_screen_are_refused(
    horizontal: tuple[float, ...], vertical: tuple[float, ...], message: str
) -> None:
    """Another count, exchanged terms, degrees for radians, nothing, or no numbers."""
    with pytest.raises(CalibrationError, match=message):
        Windshield(horizontal, vertical)
