"""What is special to each camera model: hand-worked numbers, OpenCV's answers, faults that are refused."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from calibration_samples import FISHEYE624, FOV
from hypothesis import given
from hypothesis import strategies as st

from geoloc.cameras import (
    CameraModel,
    Fisheye624Camera,
    FisheyeCamera,
    FThetaCamera,
    OcamCamera,
    OmniCamera,
    PinholeCamera,
)
from geoloc.cameras.monotonic import invert_rising_polynomial, polynomial, rising_limit
from geoloc.errors import CalibrationError

WIDE = (0.0, 1.0e-3, 2.0e-8, 4.0e-11, 1.2e-14)
DISTORTIONS = [
    (-0.28, 0.09, 9e-4, -4e-4),
    (0.1, -0.05, -2e-3, 1e-3, 0.01),
    (0.4, 0.1, 3e-4, -2e-4, 0.01, 0.75, 0.25, 0.03),
    (-0.28, 0.09, 9e-4, -4e-4, 0.0, 0.0, 0.0, 0.0, 1e-3, -5e-4, -2e-3, 4e-4),
]


def pixels_on(camera: CameraModel, shape: tuple[int, ...]) -> np.ndarray:
    """Draw pixels over the whole image."""
    size = np.array([camera.width_px, camera.height_px])
    return np.random.default_rng(7).uniform(0.0, size - 1.0, (*shape, 2))


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle that stays exact for small values, unlike the arc cosine."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


def sphere(xi: float, **more: float) -> OmniCamera:
    """An omni camera of f = 700 px."""
    return OmniCamera(1280, 960, xi, 700.0, 700.0, 640.0, 480.0, **more)


def right(angle_rad: float) -> tuple[float, float, float]:
    """Direction of a ray this far to the right of the axis."""
    return (math.sin(angle_rad), 0.0, math.cos(angle_rad))


def assert_sees_one_alone(camera: CameraModel, seen_rad: float, blind_rad: float) -> None:
    """Of two rays to the right the first has a pixel, the second none."""
    pixel, seen = camera.pixel_from_camera_point(np.array([right(seen_rad), right(blind_rad)]))
    assert seen.tolist() == [True, False]
    assert np.isnan(pixel[1]).all()


RISING = (0.0, 1e-3, 1e-7)
BOWL = OcamCamera(752, 480, 390.0, 240.0, (-200.0, 0.0, 0.002))


@pytest.mark.parametrize(
    ("camera", "pixel", "expected", "atol"),
    [
        # r = 500 px, θ = 0.001 · 500 + 1e-7 · 500² = 0.525 rad, direction (0.6, 0.8). Taylor by hand:
        # sin 0.525 = 0.525 - 0.024117188 + 0.000332365 - 0.000002181 + 0.000000008 = 0.501213005,
        # cos 0.525 = 1 - 0.1378125 + 0.003165381 - 0.000029082 + 0.000000143 = 0.865323942.
        (
            FThetaCamera(1920, 1208, 960.0, 600.0, theta_from_r=RISING),
            (1260.0, 1000.0),
            (0.300727803, 0.400970404, 0.865323942),
            3e-9,
        ),
        # Offset (60, 80): ρ = 100, f = -200 + 0.002 · 100² = -180, so the ray is along (60, 80, 180).
        (BOWL, (450.0, 320.0), np.array([60.0, 80.0, 180.0]) / math.sqrt(60**2 + 80**2 + 180**2), 1e-14),
    ],
    ids=["ftheta", "ocam"],
)
def test_ray_agrees_with_a_hand_worked_one(
    camera: CameraModel, pixel: tuple[float, float], expected: tuple[float, ...], atol: float
) -> None:
    """The direction of one pixel, worked out beside it."""
    ray, seen = camera.camera_ray_from_pixel(np.array(pixel))
    assert seen
    np.testing.assert_allclose(ray, expected, rtol=0, atol=atol)


@pytest.mark.parametrize(
    ("camera", "point", "expected", "atol"),
    [
        # A ray 0.5 rad to the right with r = 1000 θ + 40 θ².
        (
            FThetaCamera(1920, 1080, 960.0, 540.0, r_from_theta=(0.0, 1000.0, 40.0)),
            right(0.5),
            (1470.0, 540.0),
            1e-10,
        ),
        (BOWL, (0.6, 0.8, 1.8), (450.0, 320.0), 1e-10),
        # 60° to the right: sin 60° / (cos 60° + ξ); with ξ = 1 that is tan 30°, the stereographic projection.
        (sphere(0.5), right(math.pi / 3), (640.0 + 700.0 * math.sqrt(3.0) / 2.0, 480.0), 1e-10),
        (sphere(1.0), right(math.pi / 3), (640.0 + 700.0 / math.sqrt(3.0), 480.0), 1e-10),
        (sphere(1.5), right(math.pi / 3), (640.0 + 700.0 * math.sqrt(3.0) / 4.0, 480.0), 1e-10),
        # Double sphere, along (3, 4, 12) / 13: w = 12/13 + 0.2 = 1.1230769,
        # d = sqrt(25/169 + w²) = sqrt(0.1479290 + 1.2613018) = 1.1871103; (d + w) / 2 = 1.1550936.
        (
            sphere(0.2, alpha=0.5),
            (3.0, 4.0, 12.0),
            (640.0 + 700.0 * 3 / 13 / 1.1550936, 480.0 + 700.0 * 4 / 13 / 1.1550936),
            2e-5,
        ),
        # Extended: d = sqrt(1.5 · 25 + 144) = 13.4721935, depth 0.6 · d + 0.4 · 12 = 12.8833161.
        (
            sphere(0.0, alpha=0.6, beta=1.5),
            (3.0, 4.0, 12.0),
            (640.0 + 2100.0 / 12.8833161, 480.0 + 2800.0 / 12.8833161),
            2e-5,
        ),
    ],
    ids=["ftheta", "ocam", "omni 0.5", "omni 1", "omni 1.5", "double sphere", "extended"],
)
def test_pixel_agrees_with_a_hand_worked_one(
    camera: CameraModel, point: tuple[float, ...], expected: tuple[float, float], atol: float
) -> None:
    """Where one point falls, worked out beside it; five times as far it falls there too."""
    for scale in (1.0, 5.0):
        pixel, _ = camera.pixel_from_camera_point(scale * np.array(point))
        np.testing.assert_allclose(pixel, expected, rtol=0, atol=atol)


FTHETA = FThetaCamera(1920, 1208, 960.0, 600.0, (0.0, 1e-3))
PINHOLE = PinholeCamera(1280, 720, 900.0, 900.0, 640.0, 360.0)
FISHEYE = FisheyeCamera(1280, 800, 600.0, 600.0, 639.5, 399.5)


@pytest.mark.parametrize(
    ("camera", "change", "message"),
    [
        (FTHETA, {"theta_from_r": None}, "needs a polynomial"),
        (FTHETA, {"theta_from_r": (0.0, -1e-3)}, "does not rise"),
        (FTHETA, {"theta_from_r": (0.0, 0.0, 1e-6)}, "does not rise"),
        (FTHETA, {"theta_from_r": (0.1, 1e-3)}, "constant term"),
        (FTHETA, {"theta_from_r": (0.0,)}, "constant term"),
        (FTHETA, {"theta_from_r": (0.0, math.nan)}, "finite"),
        (FTHETA, {"r_from_theta": (0.0, 900.0)}, "differ by up to"),
        (FTHETA, {"cx_px": math.inf}, "finite"),
        (FTHETA, {"width_px": 0}, "is not one"),
        (FTHETA, {"c": 0.5, "d": 1.0, "e": 0.5}, "singular"),
        (PINHOLE, {"fx_px": 0.0}, "must be positive"),
        (PINHOLE, {"height_px": -1}, "must be positive"),
        (PINHOLE, {"cy_px": math.nan}, "finite"),
        (PINHOLE, {"distortion": (0.1, 0.2)}, "2 distortion coefficients"),
        (PINHOLE, {"distortion": (0.1, 0.2, 0.0, math.inf)}, "finite"),
        (FISHEYE, {"distortion": (0.01,) * 5}, "5 fisheye coefficients"),
        (FISHEYE, {"fy_px": -600.0}, "both must be positive"),
        (FISHEYE624, {"distortion": (1e-3,) * 13}, "13 fisheye624 coefficients"),
        (FISHEYE624, {"fy_px": 0.0}, "both must be positive"),
        (FOV, {"omega_rad": 0.0}, "omega"),
        (FOV, {"omega_rad": -0.9}, "omega"),
        (FOV, {"omega_rad": 3.2}, "omega"),
        (FOV, {"omega_rad": math.nan}, "omega|finite"),
        (BOWL, {"polynomial": ()}, "negative constant"),
        (BOWL, {"polynomial": (200.0, 0.0, -0.002)}, "negative constant"),
        (BOWL, {"polynomial": (-200.0, 0.1)}, "linear term"),
        (BOWL, {"polynomial": (-200.0, 0.0, math.nan)}, "an ocam parameter is not a finite number"),
        (BOWL, {"polynomial": (-200.0, 0.0, 1e300)}, "check their order and units"),
        (BOWL, {"width_px": 0}, "is not one"),
        (BOWL, {"c": 0.0}, "singular"),
        (sphere(2.0), {"xi": -1.1}, "is none"),
        (sphere(2.0), {"fx_px": 0.0}, "is none"),
        (sphere(2.0), {"alpha": 1.5}, "is none"),
        (sphere(2.0), {"beta": 0.0}, "is none"),
    ],
)
def test_parameters_that_make_no_camera_are_refused(
    camera: CameraModel, change: dict[str, object], message: str
) -> None:
    """Calibrations that cannot be one are refused when the camera is built, with the reason."""
    with pytest.raises(CalibrationError, match=message):
        replace(camera, **change)  # type: ignore[type-var]  # every model is a dataclass


def test_ftheta_linear_terms_agree_with_a_hand_worked_ray() -> None:
    """Plane (300, 400) moves to u - cx = 1.01 · 300 + 0.002 · 400, v - cy = -0.003 · 300 + 400: same ray."""
    straight = FThetaCamera(1920, 1208, 960.0, 600.0, theta_from_r=(0.0, 1e-3, 1e-7))
    sheared = FThetaCamera(
        1920, 1208, 960.0, 600.0, theta_from_r=(0.0, 1e-3, 1e-7), c=1.01, d=0.002, e=-0.003
    )
    expected, _ = straight.camera_ray_from_pixel(np.array([1260.0, 1000.0]))
    ray, _ = sheared.camera_ray_from_pixel(np.array([960.0 + 303.8, 600.0 + 399.1]))
    np.testing.assert_allclose(ray, expected, atol=1e-15)


def test_camera_takes_coefficients_in_any_sequence() -> None:
    """Arrays, as calibrations return them, make the same hashable camera as tuples."""
    for coefficients in ([0.0, 1e-3, 1e-9], np.array([0.0, 1e-3, 1e-9])):
        camera = FThetaCamera(10, 10, 5.0, 5.0, theta_from_r=coefficients)  # type: ignore[arg-type]  # on purpose
        assert hash(camera) == hash(FThetaCamera(10, 10, 5.0, 5.0, theta_from_r=(0.0, 1e-3, 1e-9)))
    pinhole = PinholeCamera(10, 10, 9.0, 9.0, 5.0, 5.0, np.zeros(5))  # type: ignore[arg-type]  # on purpose
    assert hash(pinhole) == hash(PinholeCamera(10, 10, 9.0, 9.0, 5.0, 5.0, (0.0,) * 5))


def test_ftheta_linear_terms_of_zero_mean_none() -> None:
    """Files that never calibrated the linear terms write three zeros."""
    assert FThetaCamera(10, 10, 5.0, 5.0, (0.0, 1e-3), c=0.0) == FThetaCamera(10, 10, 5.0, 5.0, (0.0, 1e-3))


def test_ftheta_inverse_agrees_with_brents_method() -> None:
    """Our Newton iteration and SciPy's independent root finder give the same radius to 1e-9 px."""
    from scipy.optimize import brentq

    camera = FThetaCamera(1920, 1208, 960.0, 600.0, theta_from_r=WIDE)
    for theta in np.linspace(0.01, 1.1, 23):
        expected = brentq(
            lambda r, t=theta: np.polyval(WIDE[::-1], r) - t, 0.0, 1500.0, xtol=1e-12, rtol=1e-15
        )
        pixel, _ = camera.pixel_from_camera_point(np.array([math.sin(theta), 0.0, math.cos(theta)]))
        assert pixel[0] - 960.0 == pytest.approx(expected, abs=1e-9)


def test_ftheta_directions_are_inverses() -> None:
    """A camera given by the fitted inverse of another's polynomial sees the same to the fit's residual."""
    backward = FThetaCamera(1920, 1208, 960.0, 600.0, theta_from_r=WIDE)
    radius = np.linspace(0.0, 1150.0, 400)
    powers = polynomial(WIDE, radius)[:, np.newaxis] ** np.arange(1, 8)
    fitted = np.linalg.lstsq(powers, radius, rcond=None)[0]
    residual = np.abs(powers @ fitted - radius).max()
    forward = FThetaCamera(1920, 1208, 960.0, 600.0, r_from_theta=(0.0, *fitted))
    point = backward.camera_ray_from_pixel(pixels_on(backward, (300,)))[0]
    apart = forward.pixel_from_camera_point(point)[0] - backward.pixel_from_camera_point(point)[0]
    assert residual < 0.01
    assert np.linalg.norm(apart, axis=-1).max() <= residual + 1e-6


def test_ftheta_is_blind_where_its_polynomial_folds_back() -> None:
    """θ = 0.001 r - 1e-9 r³ turns at r = 577 px: pixels and rays beyond are NaN, not their mirror image."""
    camera = FThetaCamera(1920, 1208, 960.0, 600.0, theta_from_r=(0.0, 1e-3, 0.0, -1e-9))
    assert camera.r_max_px == pytest.approx(1e3 / math.sqrt(3.0), rel=1e-3)
    assert camera.theta_max_rad == pytest.approx(2.0 / 3.0 / math.sqrt(3.0), rel=1e-3)
    ray, seen = camera.camera_ray_from_pixel(np.array([[1530.0, 600.0], [1560.0, 600.0]]))
    assert seen.tolist() == [True, False]
    assert np.isnan(ray[1]).all()
    assert_sees_one_alone(camera, 0.38, 0.39)
    assert math.isnan(camera.horizontal_fov_rad)


def test_ftheta_prefers_pixel_to_angle_where_both_are_given() -> None:
    """Both polynomials: the first is the reference, and closes, though the second is a rough inverse."""
    rough = (0.0, 999.0, 20.0)
    camera = FThetaCamera(960, 600, 480.0, 300.0, theta_from_r=(0.0, 1e-3, -2e-8), r_from_theta=rough)
    alone = FThetaCamera(960, 600, 480.0, 300.0, theta_from_r=(0.0, 1e-3, -2e-8))
    point = alone.camera_ray_from_pixel(pixels_on(alone, (40,)))[0]
    np.testing.assert_array_equal(
        camera.pixel_from_camera_point(point)[0], alone.pixel_from_camera_point(point)[0]
    )


@pytest.mark.parametrize("distortion", DISTORTIONS, ids=len)
def test_pinhole_agrees_with_opencv(distortion: tuple[float, ...]) -> None:
    """Projection and rays are OpenCV's to 1e-8 px and 1e-9 rad, for 4, 5, 8 and 12 coefficients."""
    camera = PinholeCamera(1280, 720, 900.0, 905.0, 645.1, 352.7, distortion)
    matrix = np.array([[900.0, 0.0, 645.1], [0.0, 905.0, 352.7], [0.0, 0.0, 1.0]])
    pixel = pixels_on(camera, (500,))
    ray, seen = camera.camera_ray_from_pixel(pixel)
    projected, _ = cv2.projectPoints(20.0 * ray, np.zeros(3), np.zeros(3), matrix, np.array(distortion))
    np.testing.assert_allclose(projected[:, 0], pixel, atol=1e-8)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-13)
    arguments = (pixel[:, np.newaxis], matrix, np.array(distortion))
    if hasattr(cv2, "undistortPointsIter"):
        # OpenCV 4 takes the criteria here alone.
        plane = cv2.undistortPointsIter(*arguments, np.eye(3), np.eye(3), criteria)[:, 0]
    else:
        plane = cv2.undistortPoints(*arguments, criteria=criteria)[:, 0]
    opencv_ray = np.column_stack([plane, np.ones(len(plane))])
    assert seen.all()
    assert angle_between(ray, opencv_ray).max() < 1e-9


def test_pinhole_field_of_view_is_the_textbook_one() -> None:
    """A lens without distortion: atan of each half width over the focal length."""
    camera = PinholeCamera(1000, 600, 500.0, 500.0, 399.5, 299.5)
    assert camera.horizontal_fov_rad == pytest.approx(math.atan(400 / 500) + math.atan(600 / 500), abs=1e-12)


def test_pinhole_is_blind_where_its_distortion_folds_back() -> None:
    """A barrel lens without higher terms folds a ray at 60° into the image: OpenCV shows it, we do not."""
    camera = PinholeCamera(1280, 720, 900.0, 900.0, 639.5, 359.5, (-0.3, 0.0, 0.0, 0.0))
    # d/dr of r - 0.3 r³ is zero at r = 1.054.
    assert camera.r_max == pytest.approx(1.0 / math.sqrt(0.9), rel=1e-3)
    point = np.array([[math.tan(math.radians(60.0)), 0.0, 1.0]])
    matrix = np.array([[900.0, 0.0, 639.5], [0.0, 900.0, 359.5], [0.0, 0.0, 1.0]])
    folded = cv2.projectPoints(point, np.zeros(3), np.zeros(3), matrix, np.array([-0.3, 0.0, 0.0, 0.0]))[0]
    assert 0.0 < folded[0, 0, 0] < 1279.0
    pixel, seen = camera.pixel_from_camera_point(point)
    assert np.isnan(pixel).all()
    assert not seen.any()


def test_pinhole_pixels_beyond_the_fold_have_no_ray() -> None:
    """Corners that no ray reaches are NaN, with and without tangential terms, and the rest still closes."""
    for tangential in ((0.0, 0.0), (1e-3, -5e-4)):
        camera = PinholeCamera(1920, 1080, 800.0, 800.0, 959.5, 539.5, (-0.3, 0.0, *tangential))
        u, v = np.meshgrid(np.linspace(0.0, 1919.0, 60), np.linspace(0.0, 1079.0, 40))
        pixel = np.stack([u, v], axis=-1)
        ray, seen = camera.camera_ray_from_pixel(pixel)
        again, _ = camera.pixel_from_camera_point(ray)
        assert 0.3 < seen.mean() < 0.7
        assert np.isnan(ray[~seen]).all()
        np.testing.assert_allclose(again[seen], pixel[seen], atol=1e-9)


@given(
    slope=st.floats(0.1, 10.0),
    higher=st.lists(st.floats(-3.0, 3.0), max_size=5),
    parts=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20),
)
def test_inverse_of_a_rising_polynomial_closes(slope: float, higher: list[float], parts: list[float]) -> None:
    """Whatever the coefficients, y → x → y closes to rounding on the part where the polynomial rises."""
    coefficients = (0.0, slope, *higher)
    upper = rising_limit(coefficients, 5.0)
    top = float(polynomial(coefficients, np.array(upper)))
    y = np.array(parts) * top
    x = invert_rising_polynomial(coefficients, y, upper)
    # Rounding of each term of the sum, not of its small result.
    scale = float(polynomial(np.abs(coefficients).tolist(), np.array(upper)))
    assert ((x >= 0.0) & (x <= upper)).all()
    np.testing.assert_allclose(polynomial(coefficients, x), y, rtol=0, atol=1e-14 * scale + 1e-300)


def test_inverse_outside_the_range_is_nan() -> None:
    """Values that the polynomial does not reach have no inverse."""
    x = invert_rising_polynomial((0.0, 2.0), np.array([-1e-9, 0.0, 4.0, 4.1, np.nan]), 2.0)
    np.testing.assert_array_equal(x, [np.nan, 0.0, 2.0, np.nan, np.nan])


@pytest.mark.parametrize("turn", [1e-6, 1e-2, 1.0, 577.0, 1e6])
def test_rising_limit_finds_the_turn_at_any_scale(turn: float) -> None:
    """The slope of x - x³ / (3 t²) ends at t, even where the range searched is a trillion times wider."""
    limit = rising_limit((0.0, 1.0, 0.0, -1.0 / (3.0 * turn**2)), 1e7)
    # 1 - (x / t)² is down to a thousandth there.
    assert limit == pytest.approx(turn * math.sqrt(0.999), rel=1e-12)


def test_fisheye_agrees_with_opencv() -> None:
    """Projection is ``cv2.fisheye.projectPoints`` to 1e-9 px, up to 90° from the axis, where OpenCV ends."""
    distortion = (0.0034, 0.0007, -0.002, 0.0002)
    camera = FisheyeCamera(1280, 1024, 470.3, 472.1, 651.2, 498.7, distortion)
    matrix = np.array([[470.3, 0.0, 651.2], [0.0, 472.1, 498.7], [0.0, 0.0, 1.0]])
    pixel = pixels_on(camera, (500,))
    ray, seen = camera.camera_ray_from_pixel(pixel)
    ahead = ray[:, 2] > 0.0
    points = (20.0 * ray[ahead])[:, np.newaxis]
    projected, _ = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(distortion))
    assert seen.all()
    assert 470 < ahead.sum() < 500
    np.testing.assert_allclose(projected[:, 0], pixel[ahead], rtol=0, atol=1e-9)


def test_fisheye_takes_fewer_coefficients_and_no_more() -> None:
    """What is not given is zero; a fifth coefficient belongs to another model."""
    short = FisheyeCamera(1280, 800, 600.0, 600.0, 639.5, 399.5, (0.01,))
    whole = FisheyeCamera(1280, 800, 600.0, 600.0, 639.5, 399.5, (0.01, 0.0, 0.0, 0.0))
    point = np.array([1.0, 0.4, 0.7])
    np.testing.assert_array_equal(
        short.pixel_from_camera_point(point)[0], whole.pixel_from_camera_point(point)[0]
    )


@pytest.mark.parametrize("model", [FisheyeCamera, Fisheye624Camera])
def test_fisheye_is_blind_where_its_polynomial_folds_back(
    model: type[FisheyeCamera | Fisheye624Camera],
) -> None:
    """θ - 0.2 θ³ turns at θ = 1.29 rad: a ray at 80° (1.40 rad) has no pixel, one at 70° has."""
    camera = model(1280, 800, 400.0, 400.0, 639.5, 399.5, (-0.2,))
    assert camera.theta_max_rad == pytest.approx(1.0 / math.sqrt(0.6), rel=1e-3)
    assert_sees_one_alone(camera, *np.radians([70.0, 80.0]))


def test_ocam_sees_behind_itself() -> None:
    """The depth 200 - 0.002 ρ² is zero at ρ = 316.2: a pixel farther out looks backwards."""
    camera = OcamCamera(752, 480, 375.5, 239.5, (-200.0, 0.0, 0.002))
    ray, seen = camera.camera_ray_from_pixel(np.array([[375.5 + 316.0, 239.5], [375.5 + 330.0, 239.5]]))
    assert seen.all()
    assert ray[0, 2] > 0.0 > ray[1, 2]
    assert camera.horizontal_fov_rad > math.pi


def test_omni_without_xi_is_a_pinhole_camera() -> None:
    """ξ = 0 puts the eye into the middle of the sphere: the same pixels, whatever the distortion."""
    for distortion in ((), DISTORTIONS[0]):
        omni = OmniCamera(1280, 720, 0.0, 900.0, 905.0, 645.1, 352.7, distortion)
        pinhole = PinholeCamera(1280, 720, 900.0, 905.0, 645.1, 352.7, distortion)
        pixel = pixels_on(omni, (200,))
        ray = pinhole.camera_ray_from_pixel(pixel)[0]
        np.testing.assert_allclose(omni.camera_ray_from_pixel(pixel)[0], ray, rtol=0, atol=1e-14)
        np.testing.assert_allclose(omni.pixel_from_camera_point(ray)[0], pixel, rtol=0, atol=1e-9)


def test_omni_ends_at_the_outline_of_its_sphere() -> None:
    """ξ = 2 sees r = sin θ / (cos θ + 2), which is largest at θ = 120°: beyond, pixels and rays are NaN."""
    camera = OmniCamera(1280, 960, 2.0, 700.0, 700.0, 639.5, 479.5)
    edge = 700.0 / math.sqrt(3.0)
    ray, seen = camera.camera_ray_from_pixel(
        np.array([[639.5 + 0.999 * edge, 479.5], [639.5 + edge + 1, 479.5]])
    )
    assert seen.tolist() == [True, False]
    assert np.isnan(ray[1]).all()
    assert_sees_one_alone(camera, *np.radians([115.0, 125.0]))
