"""Camera models: one contract for all of them, then what is special to each."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoloc.cameras import CameraModel, FThetaCamera, PinholeCamera
from geoloc.cameras.monotonic import invert_rising_polynomial, polynomial, rising_limit
from geoloc.errors import CalibrationError

WIDE = (0.0, 1.0e-3, 2.0e-8, 4.0e-11, 1.2e-14)

Camera = FThetaCamera | PinholeCamera
CAMERAS: dict[str, Camera] = {
    "ftheta-60": FThetaCamera(
        1920, 1208, 850.3, 664.8, theta_from_r=(0.0, 5.4e-4, 1.3e-8, -1.4e-11, 3.0e-15)
    ),
    "ftheta-120-linear": FThetaCamera(
        1920, 1208, 968.2, 611.5, theta_from_r=WIDE, c=1.001, d=-2.0e-3, e=1.5e-3
    ),
    "ftheta-forward": FThetaCamera(
        1920, 1080, 954.2, 548.7, r_from_theta=(0.0, 1571.3, 96.9, -255.4, 150.8, 97.9)
    ),
    "ftheta-fisheye-200": FThetaCamera(1280, 960, 640.0, 480.0, r_from_theta=(0.0, 365.0, 0.0, -4.0)),
    "pinhole-ideal": PinholeCamera(1280, 720, 900.0, 905.0, 645.1, 352.7),
    "pinhole-barrel": PinholeCamera(1280, 720, 900.0, 905.0, 645.1, 352.7, (-0.2, 0.05, 8.0e-4, -1.2e-3)),
    "pinhole-pincushion": PinholeCamera(
        1280, 720, 900.0, 905.0, 645.1, 352.7, (0.12, -0.03, -1e-3, 5e-4, 0.02)
    ),
    "pinhole-rational": PinholeCamera(
        1920, 1080, 820.0, 822.0, 955.0, 548.0, (0.4, 0.1, 3e-4, -2e-4, 0.01, 0.75, 0.25, 0.03)
    ),
}
EVERY_CAMERA = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
EVERY_SHAPE = pytest.mark.parametrize("shape", [(), (7,), (3, 4), (0,)])
DISTORTIONS = [
    (-0.28, 0.09, 9e-4, -4e-4),
    (0.1, -0.05, -2e-3, 1e-3, 0.01),
    (0.4, 0.1, 3e-4, -2e-4, 0.01, 0.75, 0.25, 0.03),
]


def pixels_on(camera: Camera, shape: tuple[int, ...]) -> np.ndarray:
    """Draw pixels over the whole image."""
    size = np.array([camera.width_px, camera.height_px])
    return np.random.default_rng(7).uniform(0.0, size - 1.0, (*shape, 2))


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle that stays exact for small values, unlike the arc cosine."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


@EVERY_CAMERA
def test_camera_satisfies_the_protocol(camera: Camera) -> None:
    """Every model has all that the protocol asks for."""
    assert isinstance(camera, CameraModel)
    assert camera.model in {"ftheta", "pinhole"}


@EVERY_CAMERA
@EVERY_SHAPE
def test_camera_closes_from_pixel_to_ray_to_pixel(camera: Camera, shape: tuple[int, ...]) -> None:
    """A pixel's ray, at any distance, falls on that pixel to 1e-9 px, in any batch shape."""
    pixel = pixels_on(camera, shape)
    ray, seen = camera.camera_ray_from_pixel(pixel)
    distance = np.random.default_rng(8).uniform(0.1, 500.0, (*shape, 1))
    again, on_image = camera.pixel_from_camera_point(distance * ray)
    assert ray.shape == (*shape, 3)
    assert again.shape == (*shape, 2)
    assert seen.shape == on_image.shape == shape
    assert seen.all()
    assert on_image.all()
    np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1.0, atol=1e-14)
    np.testing.assert_allclose(again, pixel, rtol=0, atol=1e-9)


@EVERY_CAMERA
def test_camera_closes_from_ray_to_pixel_to_ray(camera: Camera) -> None:
    """Every direction that falls on the image comes back to 1e-12 rad from its pixel."""
    direction = np.random.default_rng(9).normal((0.0, 0.0, 1.5), size=(4000, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    pixel, seen = camera.pixel_from_camera_point(direction)
    ray, on_image = camera.camera_ray_from_pixel(pixel[seen])
    assert 300 < seen.sum() < 4000
    assert on_image.all()
    assert angle_between(ray, direction[seen]).max() < 1e-12


@EVERY_CAMERA
def test_camera_projection_ignores_the_distance(camera: Camera) -> None:
    """Points on one ray share a pixel, from a millimetre to a light-second."""
    ray, _ = camera.camera_ray_from_pixel(pixels_on(camera, (50,)))
    near, _ = camera.pixel_from_camera_point(1e-3 * ray)
    far, _ = camera.pixel_from_camera_point(3e8 * ray)
    np.testing.assert_allclose(near, far, rtol=0, atol=1e-9)


@EVERY_CAMERA
def test_camera_looks_along_z_at_its_principal_point(camera: Camera) -> None:
    """The optical axis falls on the principal point, both ways."""
    centre = np.array([camera.cx_px, camera.cy_px])
    ray, seen = camera.camera_ray_from_pixel(centre)
    pixel, on_image = camera.pixel_from_camera_point(np.array([0.0, 0.0, 12.0]))
    assert seen
    assert on_image
    np.testing.assert_array_equal(ray, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(pixel, centre)


@EVERY_CAMERA
def test_camera_right_is_x_and_down_is_y(camera: Camera) -> None:
    """A pixel to the lower right of the principal point looks to the right and down."""
    ray, _ = camera.camera_ray_from_pixel(np.array([camera.cx_px + 80.0, camera.cy_px + 60.0]))
    assert ray[0] > 0.0
    assert ray[1] > 0.0
    assert ray[2] > 0.9


@EVERY_CAMERA
@pytest.mark.parametrize("azimuth", np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False))
def test_camera_angle_grows_outwards(camera: Camera, azimuth: float) -> None:
    """From the principal point outwards the angle from the axis rises strictly to the image's edge."""
    steps = np.linspace(0.0, 2500.0, 1000)[:, np.newaxis]
    line = np.array([camera.cx_px, camera.cy_px]) + steps * [np.cos(azimuth), np.sin(azimuth)]
    ray, seen = camera.camera_ray_from_pixel(line)
    angle = angle_between(ray[seen], np.array([0.0, 0.0, 1.0]))
    assert seen.sum() > 100
    assert not seen[np.flatnonzero(~seen)[0] :].any()
    assert (np.diff(angle) > 0.0).all()


@EVERY_CAMERA
def test_camera_image_reaches_half_a_pixel_beyond_its_outermost_centres(camera: Camera) -> None:
    """Corners of the image are on it, a thousandth of a pixel farther out is not."""
    w, h = camera.width_px, camera.height_px
    corners = np.array([[-0.5, -0.5], [w - 0.5, -0.5], [-0.5, h - 0.5], [w - 0.5, h - 0.5]])
    outward = np.sign(corners - [w / 2, h / 2])
    assert camera.camera_ray_from_pixel(corners)[1].all()
    for direction in (outward, outward * [1.0, 0.0], outward * [0.0, 1.0]):
        assert not camera.camera_ray_from_pixel(corners + 1e-3 * direction)[1].any()
    beyond, _ = camera.camera_ray_from_pixel(corners + 5.0 * outward)
    assert np.isfinite(beyond).all()
    assert not camera.pixel_from_camera_point(beyond)[1].any()


@EVERY_CAMERA
def test_camera_answers_nan_with_nan(camera: Camera) -> None:
    """Pixels and points with a NaN or an infinity give NaN and false; their neighbours are not touched."""
    for bad in (np.nan, np.inf, -np.inf):
        for axis in range(3):
            point = np.array([[0.1, 0.05, 2.0], [0.1, 0.05, 2.0]])
            point[0, axis] = bad
            pixel, seen = camera.pixel_from_camera_point(point)
            assert np.isnan(pixel[0]).all()
            assert seen.tolist() == [False, True]
        for axis in range(2):
            pixel = np.array([[700.0, 400.0], [700.0, 400.0]])
            pixel[0, axis] = bad
            ray, seen = camera.camera_ray_from_pixel(pixel)
            assert np.isnan(ray[0]).all()
            assert seen.tolist() == [False, True]


@EVERY_CAMERA
def test_camera_sees_neither_behind_itself_nor_its_own_centre(camera: Camera) -> None:
    """The backward axis is not on the image, and the camera's centre has no pixel."""
    assert not camera.pixel_from_camera_point(np.array([0.0, 0.0, -5.0]))[1]
    pixel, seen = camera.pixel_from_camera_point(np.zeros(3))
    assert np.isnan(pixel).all()
    assert not seen


@EVERY_CAMERA
def test_camera_leaves_its_arguments_alone(camera: Camera) -> None:
    """Read-only arrays are accepted, so nothing is written into them, and integers are."""
    pixel, point = np.array([[700, 400]]), np.array([[1, 1, 9]])
    for array in (pixel, point):
        array.setflags(write=False)
    assert camera.camera_ray_from_pixel(pixel)[1].all()
    assert camera.pixel_from_camera_point(point)[1].all()


@EVERY_CAMERA
def test_camera_field_of_view_is_the_sum_of_small_steps(camera: Camera) -> None:
    """Steps from ray to ray along the principal row add up to the field of view, beyond 180° too."""
    u = np.linspace(-0.5, camera.width_px - 0.5, 4001)
    ray, seen = camera.camera_ray_from_pixel(np.stack([u, np.full_like(u, camera.cy_px)], axis=-1))
    assert seen.all()
    # Tangential distortion bends the row of these cameras: the way along it is this much longer.
    assert angle_between(ray[1:], ray[:-1]).sum() == pytest.approx(camera.horizontal_fov_rad, abs=5e-5)


def test_ftheta_agrees_with_a_hand_worked_ray() -> None:
    """Offset (300, 400): r = 500 px, θ = 0.001 · 500 + 1e-7 · 500² = 0.525 rad, direction (0.6, 0.8)."""
    camera = FThetaCamera(1920, 1208, 960.0, 600.0, theta_from_r=(0.0, 1e-3, 1e-7))
    ray, _ = camera.camera_ray_from_pixel(np.array([1260.0, 1000.0]))
    # Taylor by hand: sin 0.525 = 0.525 - 0.024117188 + 0.000332365 - 0.000002181 + 0.000000008 = 0.501213005,
    # cos 0.525 = 1 - 0.1378125 + 0.003165381 - 0.000029082 + 0.000000143 = 0.865323942.
    np.testing.assert_allclose(ray, [0.300727803, 0.400970404, 0.865323942], rtol=0, atol=3e-9)


def test_ftheta_linear_terms_agree_with_a_hand_worked_ray() -> None:
    """Plane (300, 400) moves to u - cx = 1.01 · 300 + 0.002 · 400, v - cy = -0.003 · 300 + 400: same ray."""
    straight = FThetaCamera(1920, 1208, 960.0, 600.0, theta_from_r=(0.0, 1e-3, 1e-7))
    sheared = FThetaCamera(
        1920, 1208, 960.0, 600.0, theta_from_r=(0.0, 1e-3, 1e-7), c=1.01, d=0.002, e=-0.003
    )
    expected, _ = straight.camera_ray_from_pixel(np.array([1260.0, 1000.0]))
    ray, _ = sheared.camera_ray_from_pixel(np.array([960.0 + 303.8, 600.0 + 399.1]))
    np.testing.assert_allclose(ray, expected, atol=1e-15)


def test_ftheta_forward_polynomial_agrees_with_a_hand_worked_pixel() -> None:
    """A ray 0.5 rad to the right with r = 1000 θ + 40 θ² falls 510 px right of the principal point."""
    camera = FThetaCamera(1920, 1080, 960.0, 540.0, r_from_theta=(0.0, 1000.0, 40.0))
    pixel, _ = camera.pixel_from_camera_point(np.array([math.sin(0.5), 0.0, math.cos(0.5)]))
    np.testing.assert_allclose(pixel, [1470.0, 540.0], atol=1e-10)


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
    point = np.array([[math.sin(angle), 0.0, math.cos(angle)] for angle in (0.38, 0.39)])
    pixel, seen = camera.pixel_from_camera_point(point)
    assert seen.tolist() == [True, False]
    assert np.isnan(pixel[1]).all()
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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"theta_from_r": None}, "needs a polynomial"),
        ({"theta_from_r": (0.0, -1e-3)}, "does not rise"),
        ({"theta_from_r": (0.0, 0.0, 1e-6)}, "does not rise"),
        ({"theta_from_r": (0.1, 1e-3)}, "constant term"),
        ({"theta_from_r": (0.0,)}, "constant term"),
        ({"theta_from_r": (0.0, math.nan)}, "finite"),
        ({"r_from_theta": (0.0, 900.0)}, "differ by up to"),
        ({"cx_px": math.inf}, "finite"),
        ({"width_px": 0}, "empty"),
        ({"c": 0.5, "d": 1.0, "e": 0.5}, "singular"),
    ],
)
def test_ftheta_refuses_parameters_that_make_no_camera(change: dict[str, object], message: str) -> None:
    """Calibrations that cannot be one are refused when the camera is built, with the reason."""
    good: dict[str, object] = {
        "width_px": 1920,
        "height_px": 1208,
        "cx_px": 960.0,
        "cy_px": 600.0,
        "theta_from_r": (0.0, 1e-3),
    }
    with pytest.raises(CalibrationError, match=message):
        FThetaCamera(**{**good, **change})  # type: ignore[arg-type]  # wrong on purpose


@pytest.mark.parametrize("distortion", DISTORTIONS, ids=len)
def test_pinhole_agrees_with_opencv(distortion: tuple[float, ...]) -> None:
    """Projection and rays are OpenCV's to 1e-8 px and 1e-9 rad, for 4, 5 and 8 coefficients."""
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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx_px": 0.0}, "must be positive"),
        ({"height_px": -1}, "must be positive"),
        ({"cy_px": math.nan}, "finite"),
        ({"distortion": (0.1, 0.2)}, "2 distortion coefficients"),
        ({"distortion": (0.1, 0.2, 0.0, math.inf)}, "finite"),
    ],
)
def test_pinhole_refuses_parameters_that_make_no_camera(change: dict[str, object], message: str) -> None:
    """Calibrations that cannot be one are refused when the camera is built, with the reason."""
    good: dict[str, object] = {
        "width_px": 1280,
        "height_px": 720,
        "fx_px": 900.0,
        "fy_px": 900.0,
        "cx_px": 640.0,
        "cy_px": 360.0,
    }
    with pytest.raises(CalibrationError, match=message):
        PinholeCamera(**{**good, **change})  # type: ignore[arg-type]  # wrong on purpose


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


def plausible_camera(rng: np.random.Generator) -> Camera:
    """Draw a camera with distortion stronger than lenses have, of either model and polynomial direction."""
    focal = rng.uniform(300.0, 3000.0)
    cx, cy = rng.uniform(0.0, [1920.0, 1080.0])
    kind = rng.integers(3)
    if kind == 0:
        scale = np.array([1.0, 1.0, 5e-3, 5e-3, 1.0, 1.0, 1.0, 1.0]) * rng.choice([0.05, 0.2, 0.5])
        distortion = tuple((scale * rng.normal(size=8)).tolist())
        return PinholeCamera(1920, 1080, focal, focal * rng.uniform(0.9, 1.1), cx, cy, distortion)
    c, d, e = rng.normal([1.0, 0.0, 0.0], 0.02)
    if kind == 1:
        higher = rng.normal(size=4) / focal / np.array([1e3, 1e6, 1e9, 1e12])
        return FThetaCamera(1920, 1080, cx, cy, (0.0, 1.0 / focal, *higher.tolist()), c=c, d=d, e=e)
    higher = 0.5 * focal * rng.normal(size=4)
    return FThetaCamera(1920, 1080, cx, cy, None, (0.0, focal, *higher.tolist()), c=c, d=d, e=e)


@pytest.mark.parametrize("seed", range(60))
def test_camera_of_any_plausible_parameters_closes(seed: int) -> None:
    """Both ways and to 1e-6 px and 1e-9 rad, wherever the camera says that it can see."""
    rng = np.random.default_rng(seed)
    camera = plausible_camera(rng)
    pixel = rng.uniform(-0.5, [1919.5, 1079.5], (200, 2))
    ray, seen = camera.camera_ray_from_pixel(pixel)
    again, _ = camera.pixel_from_camera_point(3.0 * ray[seen])
    assert seen.any()
    assert np.isnan(ray[~seen]).all()
    np.testing.assert_allclose(again, pixel[seen], rtol=0, atol=1e-6)
    direction = rng.normal((0.0, 0.0, 1.0), size=(200, 3))
    pixel, seen = camera.pixel_from_camera_point(direction)
    assert (angle_between(camera.camera_ray_from_pixel(pixel[seen])[0], direction[seen]) < 1e-9).all()
