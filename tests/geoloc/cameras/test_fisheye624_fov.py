"""The fisheye624 and FOV cameras, against the definitions of the programs that write them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from calibration_samples import FISHEYE624, FOV

from geoloc.calibration_files import read_cameras
from geoloc.cameras import CameraModel, Fisheye624Camera, FisheyeCamera, FovCamera, PinholeCamera

POINTS = np.random.default_rng(11).normal((0.0, 0.0, 1.0), size=(400, 3))
EQUIDISTANT_OMEGA = 2.0 * math.atan(0.5)
"""Here 2 tan(ω / 2) is 1, and the FOV lens is θ / ω."""


def fisheye624_of_opensfm(x: float, y: float, z: float) -> tuple[float, float]:
    """Pixel of a point as OpenSfM computes it: its three steps for one point, in the file's units."""
    k1, k2, k3, k4, k5, k6, p1, p2, s0, s1, s2, s3 = FISHEYE624.distortion
    across = math.hypot(x, y)
    theta = math.atan2(across, z)
    x, y = theta / across * x, theta / across * y
    r2 = x * x + y * y
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4 + k5 * r2**5 + k6 * r2**6
    bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + s0 * r2 + s1 * r2 * r2
    bent_y = y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y) + s2 * r2 + s3 * r2 * r2
    longer, middle = 1280.0, (639.5, 479.5)
    u = 460.0 / longer * bent_x + (636.2 - middle[0]) / longer
    v = 461.5 / longer * bent_y + (483.7 - middle[1]) / longer
    return longer * u + middle[0], longer * v + middle[1]


def fov_of_kalibr(x: float, y: float, z: float) -> tuple[float, float]:
    """Pixel of a point before the camera as Kalibr computes it: a pinhole, then the distortion."""
    x, y = x / z, y / z
    radius = math.hypot(x, y)
    factor = math.atan(2.0 * math.tan(FOV.omega_rad / 2.0) * radius) / (radius * FOV.omega_rad)
    return FOV.fx_px * factor * x + FOV.cx_px, FOV.fy_px * factor * y + FOV.cy_px


def at(*angles_deg: float) -> np.ndarray:
    """Unit rays to the right, at these angles from the axis."""
    angle = np.radians(angles_deg)
    return np.column_stack([np.sin(angle), np.zeros(angle.size), np.cos(angle)])


def assert_same_pixels(a: CameraModel, b: CameraModel, px: float) -> None:
    """Both see the points at the same places of the image, to this many pixels."""
    (one, seen), (other, also) = a.pixel_from_camera_point(POINTS), b.pixel_from_camera_point(POINTS)
    np.testing.assert_array_equal(seen, also)
    assert seen.sum() > 50
    np.testing.assert_allclose(one[seen], other[seen], rtol=0, atol=px)


def test_fisheye624_agrees_with_opensfm() -> None:
    """Pixels are those of OpenSfM's own steps to 1e-9 px, behind the camera too."""
    pixel, seen = FISHEYE624.pixel_from_camera_point(POINTS)
    expected = np.array([fisheye624_of_opensfm(*point) for point in POINTS.tolist()])
    assert (POINTS[seen, 2] < 0.0).any()
    np.testing.assert_allclose(pixel[seen], expected[seen], rtol=0, atol=1e-9)


def test_fisheye624_agrees_with_a_hand_worked_pixel() -> None:
    """θ = 0.5 along (0.6, 0.8): x, y = 0.3, 0.4 and r² = 0.25, so R = 1 + 0.1 r² - 0.02 r⁴ = 1.02375."""
    distortion = (0.1, -0.02, 0.0, 0.0, 0.0, 0.0, 1e-3, -2e-3, 1e-3, 2e-3, -1e-3, 8e-3)
    camera = Fisheye624Camera(1920, 1280, 1000.0, 1000.0, 960.0, 640.0, distortion)
    point = np.array([0.6 * math.sin(0.5), 0.8 * math.sin(0.5), math.cos(0.5)])
    # x: 0.307125, tangential 0.00024 - 0.00086, prism 0.00025 + 0.000125; y: 0.4095, 0.00057 - 0.00048,
    # -0.00025 + 0.0005.
    pixel, _ = camera.pixel_from_camera_point(point)
    np.testing.assert_allclose(pixel, [960.0 + 306.88, 640.0 + 409.84], rtol=0, atol=1e-9)


def test_fisheye624_of_four_coefficients_is_the_fisheye_camera() -> None:
    """k1 to k4 alone are OpenCV's fisheye."""
    short = (0.0034, 0.0007, -0.002, 0.0002)
    ours = Fisheye624Camera(1280, 1024, 470.3, 472.1, 651.2, 498.7, short)
    assert_same_pixels(ours, FisheyeCamera(1280, 1024, 470.3, 472.1, 651.2, 498.7, short), 1e-9)


def test_fisheye624_of_an_opensfm_file_is_read_as_written() -> None:
    """Coefficients go by their names; fisheye62 has no prism, and none is looked for."""
    document = {
        "projection_type": "fisheye624",
        "width": 1280,
        "height": 960,
        "focal_x": 0.5,
        "focal_y": 0.5,
        **{name: 0.001 * (1 + i) for i, name in enumerate(("s0", "s1", "s2", "s3", "p1", "p2"))},
        **{f"k{i}": 0.01 * i for i in range(1, 7)},
    }
    distortion = (*(0.01 * i for i in range(1, 7)), *(0.001 * i for i in (5, 6, 1, 2, 3, 4)))
    for kind, count in (("fisheye624", 12), ("fisheye62", 8)):
        content = json.dumps({"a": {**document, "projection_type": kind}}).encode()
        model = read_cameras(content, "camera_models.json")["a"].model
        assert isinstance(model, Fisheye624Camera)
        assert (model.fx_px, model.fy_px, model.cx_px, model.cy_px) == (640.0, 640.0, 639.5, 479.5)
        assert model.distortion == pytest.approx(distortion[:count])


def test_fisheye624_sees_behind_itself() -> None:
    """An equidistant lens of 2 rad to either side: rays at 100° have pixels, and pixels there such rays."""
    camera = Fisheye624Camera(1000, 800, 250.0, 250.0, 499.5, 399.5)
    pixel, seen = camera.pixel_from_camera_point(at(-100.0, 100.0))
    assert seen.all()
    np.testing.assert_allclose(camera.camera_ray_from_pixel(pixel)[0], at(-100.0, 100.0), rtol=0, atol=1e-13)
    assert camera.horizontal_fov_rad == pytest.approx(4.0, abs=1e-12)


def test_fov_agrees_with_kalibr() -> None:
    """Pixels are those of Kalibr's own two steps to 1e-9 px."""
    ahead = POINTS[POINTS[:, 2] > 0.1]
    pixel, _ = FOV.pixel_from_camera_point(ahead)
    expected = np.array([fov_of_kalibr(*point) for point in ahead.tolist()])
    np.testing.assert_allclose(pixel, expected, rtol=0, atol=1e-9)


def test_fov_of_one_omega_is_the_equidistant_fisheye() -> None:
    """Where 2 tan(ω / 2) is 1 the distortion undoes the tangent: θ_d is θ / ω."""
    ours = FovCamera(1280, 960, 685.7, 689.2, 631.3, 485.1, EQUIDISTANT_OMEGA)
    focal = (685.7 / EQUIDISTANT_OMEGA, 689.2 / EQUIDISTANT_OMEGA)
    assert_same_pixels(ours, FisheyeCamera(1280, 960, *focal, 631.3, 485.1), 1e-9)


def test_fov_without_omega_is_a_pinhole_camera() -> None:
    """As ω goes to 0 the radius goes to the tangent: at 1e-6 they are the same to 1e-8 px."""
    ours = FovCamera(1280, 960, 685.7, 689.2, 631.3, 485.1, 1e-6)
    assert_same_pixels(ours, PinholeCamera(1280, 960, 685.7, 689.2, 631.3, 485.1), 1e-8)


def test_fov_ends_before_a_right_angle() -> None:
    """A ray at 88.9° has a pixel, one at 89.1° has none, and no pixel beyond has a ray."""
    camera = FovCamera(3000, 800, 600.0, 600.0, 1499.5, 399.5, 1.2)
    pixel, seen = camera.pixel_from_camera_point(at(88.9, 89.1, 95.0))
    assert seen.tolist() == [True, False, False]
    assert np.isnan(pixel[1:]).all()
    ray, seen = camera.camera_ray_from_pixel(pixel[0] + [[0.0, 0.0], [5.0, 0.0]])
    assert seen.tolist() == [True, False]
    assert np.isnan(ray[1]).all()
    assert math.isnan(camera.horizontal_fov_rad)
