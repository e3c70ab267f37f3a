"""Camera models: one contract for all of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from geoloc.cameras import (
    CameraModel,
    Fisheye624Camera,
    FisheyeCamera,
    FovCamera,
    FThetaCamera,
    OcamCamera,
    OmniCamera,
    PinholeCamera,
)
from geoloc.cameras.base import sin_cos

WIDE = (0.0, 1.0e-3, 2.0e-8, 4.0e-11, 1.2e-14)

Camera = FThetaCamera | PinholeCamera | FisheyeCamera | Fisheye624Camera | FovCamera | OcamCamera | OmniCamera
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
    "pinhole-thin-prism": PinholeCamera(
        1280,
        720,
        900.0,
        905.0,
        645.1,
        352.7,
        (-0.2, 0.05, 8e-4, -1.2e-3, 0.0, 0.0, 0.0, 0.0, 1e-3, -4e-4, -8e-4, 3e-4),
    ),
    "fisheye-150": FisheyeCamera(1280, 1024, 470.3, 472.1, 651.2, 498.7, (0.0034, 0.0007, -0.002, 0.0002)),
    "fisheye-ideal": FisheyeCamera(1280, 800, 600.0, 600.0, 639.5, 399.5),
    "fisheye62": Fisheye624Camera(
        1280,
        960,
        460.0,
        461.5,
        636.2,
        483.7,
        (0.4e-2, -0.6e-2, 0.5e-2, -2e-3, 3e-4, -2e-5, 3e-4, -2e-4),
    ),
    "fisheye624-square": Fisheye624Camera(
        1408,
        1408,
        611.0,
        611.0,
        710.4,
        699.8,
        (0.38, -0.33, 0.1, 0.02, -0.01, 1e-3, 5e-4, -7e-4, -6e-4, 3e-4, 7e-4, -2e-4),
    ),
    "fov": FovCamera(1280, 960, 685.7, 689.2, 631.3, 485.1, 0.898),
    "fov-wide": FovCamera(1280, 720, 680.0, 672.0, 645.1, 352.7, 1.4),
    "ocam-fisheye-190": OcamCamera(
        752, 480, 394.6, 241.8, (-206.5, 0.0, 2.2e-3, -4.9e-6, 1.9e-8), 1.0003, 2e-4, -3e-4
    ),
    "ocam-sheared": OcamCamera(
        1920, 1280, 956.0, 638.6, (-508.0, 0.0, 4.7e-4, -2.5e-7, 4.2e-10), 1.01, 5e-3, -4e-3
    ),
    "omni-pinhole": OmniCamera(1280, 720, 0.0, 900.0, 905.0, 645.1, 352.7, (-0.2, 0.05, 8.0e-4, -1.2e-3)),
    "omni-stereographic": OmniCamera(1280, 960, 1.0, 800.0, 802.0, 640.2, 480.4, (0.01, -0.01, 5e-4, 2e-4)),
    "omni-double-sphere": OmniCamera(1280, 960, -0.18, 370.0, 371.0, 640.2, 480.4, alpha=0.58),
    "omni-extended": OmniCamera(1280, 960, 0.0, 420.0, 421.0, 640.2, 480.4, alpha=0.6, beta=1.1),
    "omni-fisheye": OmniCamera(1280, 960, 1.6, 1300.0, 1299.0, 640.2, 480.4, (-0.2, 0.1, 5e-4, 2e-4)),
}
EVERY_CAMERA = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
EVERY_SHAPE = pytest.mark.parametrize("shape", [(), (7,), (3, 4), (0,)])


def pixels_on(camera: Camera, shape: tuple[int, ...]) -> np.ndarray:
    """Draw pixels over the whole image."""
    size = np.array([camera.width_px, camera.height_px])
    return np.random.default_rng(7).uniform(0.0, size - 1.0, (*shape, 2))


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle that stays exact for small values, unlike the arc cosine."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


@EVERY_CAMERA
def test_camera_satisfies_the_protocol(camera: Camera) -> None:
    """Every model has all that the protocol asks for, and a name that no other model has."""
    assert isinstance(camera, CameraModel)
    assert all((one.model == camera.model) == (type(one) is type(camera)) for one in CAMERAS.values())


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
    assert ray[2] > 0.8


@EVERY_CAMERA
def test_camera_angle_grows_outwards(camera: Camera) -> None:
    """From the principal point outwards, eight ways, the angle from the axis rises strictly to the edge."""
    steps = np.linspace(0.0, 2500.0, 1000)[:, np.newaxis]
    for azimuth in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        line = np.array([camera.cx_px, camera.cy_px]) + steps * [np.cos(azimuth), np.sin(azimuth)]
        ray, seen = camera.camera_ray_from_pixel(line)
        angle = angle_between(ray[seen], np.array([0.0, 0.0, 1.0]))
        assert seen.sum() > 50, azimuth
        assert not seen[np.flatnonzero(~seen)[0] :].any(), azimuth
        assert (np.diff(angle) > 0.0).all(), azimuth


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


@EVERY_CAMERA
def test_camera_rays_by_component_are_those_of_the_pixels(camera: Camera) -> None:
    """Rays and masks agree with `camera_ray_from_pixel`, off the image too, slopes with differences of it."""
    size, step = np.array([camera.width_px, camera.height_px]), 1e-2
    pixel = np.random.default_rng(2).uniform(-20.0, size + 20.0, (2000, 2))
    pixel[:3] = [[camera.cx_px, camera.cy_px], [camera.cx_px, camera.cy_px + 1e-9], [np.nan, 5.0]]
    expected, mask = camera.camera_ray_from_pixel(pixel)
    with np.errstate(all="ignore"):
        rays = camera.rays(pixel[:, 0], pixel[:, 1], slopes=True)
        assert camera.rays(pixel[:, 0], pixel[:, 1]).by_u is None
    np.testing.assert_array_equal(rays.inside, mask)
    np.testing.assert_allclose(np.stack(rays.ray, axis=1)[mask], expected[mask], rtol=0, atol=1e-14)
    for axis, by in enumerate((rays.by_u, rays.by_v)):
        assert by is not None
        offset = step * np.eye(2)[axis]
        ahead, behind = (camera.camera_ray_from_pixel(pixel + sign * offset)[0] for sign in (1.0, -1.0))
        off = np.abs(np.stack(by, axis=1) - (ahead - behind) / (2.0 * step))
        assert off[2:][mask[2:]].max() < 3e-11  # rounding
        # On the axis the quadratic term of f-theta, 2.5e-8 px⁻² at most, has a kink.
        assert off[:2].max() < 3e-8 * step


def test_sin_cos_are_numpys() -> None:
    """Over three turns, at quarter turns, and NaN for NaN."""
    angle = np.concatenate([np.linspace(-10.0, 10.0, 10_001), np.arange(-4, 5) * np.pi / 2.0, [np.nan]])
    sin, cos = sin_cos(angle)
    np.testing.assert_allclose(sin, np.sin(angle), rtol=0, atol=1e-15)
    np.testing.assert_allclose(cos, np.cos(angle), rtol=0, atol=1e-15)


def plausible_camera(rng: np.random.Generator) -> Camera:
    """Draw a camera with distortion stronger than lenses have, of any model and polynomial direction."""
    focal = rng.uniform(300.0, 3000.0)
    cx, cy = rng.uniform(0.0, [1920.0, 1080.0]).tolist()
    fy = focal * rng.uniform(0.9, 1.1)
    scale = np.array([1.0, 1.0, 5e-3, 5e-3, 1.0, 1.0, 1.0, 1.0]) * rng.choice([0.05, 0.2, 0.5])
    brown = tuple((scale * rng.normal(size=8)).tolist())
    prism = tuple((scale[2] * rng.normal(size=4)).tolist())
    c, d, e = rng.normal([1.0, 0.0, 0.0], 0.02).tolist()
    higher = (rng.normal(size=4) / focal / np.array([1e3, 1e6, 1e9, 1e12])).tolist()
    angles = (0.5 * focal * rng.normal(size=4)).tolist()
    omega = rng.uniform(0.01, 2.5)
    spheres = [(rng.uniform(0, 2.5), 0, 1), (rng.uniform(-0.5, 0.5), 0.6, 1), (0, 0.7, 1.2)]
    xi, alpha, beta = rng.choice(spheres)
    f = focal * (1 + xi)
    makers: list[Callable[[], Camera]] = [
        lambda: PinholeCamera(1920, 1080, focal, fy, cx, cy, brown),
        lambda: PinholeCamera(1920, 1080, focal, fy, cx, cy, (*brown, *prism)),
        lambda: FThetaCamera(1920, 1080, cx, cy, (0.0, 1.0 / focal, *higher), c=c, d=d, e=e),
        lambda: FThetaCamera(1920, 1080, cx, cy, None, (0.0, focal, *angles), c=c, d=d, e=e),
        lambda: FisheyeCamera(1920, 1080, focal, fy, cx, cy, brown[4:]),
        lambda: Fisheye624Camera(
            1920, 1080, focal, fy, cx, cy, (*brown[4:], *brown[:2], *brown[2:4], *prism)
        ),
        lambda: FovCamera(1920, 1080, focal, fy, cx, cy, omega),
        lambda: OcamCamera(1920, 1080, cx, cy, (-focal, 0.0, *higher), c, d, e),
        lambda: OmniCamera(1920, 1080, xi, f, fy * (1 + xi), cx, cy, brown[:4], alpha, beta),
    ]
    return makers[rng.integers(len(makers))]()


def test_camera_of_any_plausible_parameters_closes() -> None:
    """Both ways and to 1e-6 px and 1e-9 rad, wherever the camera says that it can see: 200 cameras."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        camera = plausible_camera(rng)
        pixel = rng.uniform(-0.5, [1919.5, 1079.5], (200, 2))
        ray, seen = camera.camera_ray_from_pixel(pixel)
        again, _ = camera.pixel_from_camera_point(3.0 * ray[seen])
        assert seen.any(), seed
        assert np.isnan(ray[~seen]).all(), seed
        np.testing.assert_allclose(again, pixel[seen], rtol=0, atol=1e-6, err_msg=f"seed {seed}")
        direction = rng.normal((0.0, 0.0, 1.0), size=(200, 3))
        pixel, seen = camera.pixel_from_camera_point(direction)
        off = angle_between(camera.camera_ray_from_pixel(pixel[seen])[0], direction[seen])
        assert (off < 1e-9).all(), seed
