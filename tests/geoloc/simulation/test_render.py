"""Rendered plates: corners stand where the camera model puts them, whatever the light does."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoloc.cameras import CameraModel, FThetaCamera, PinholeCamera
from geoloc.simulation.pictures.board_views import draw_board_poses
from geoloc.simulation.pictures.render import Plane, render_planes

WIDE = FThetaCamera(480, 302, 243.0, 157.0, theta_from_r=(0.0, 3.97e-3, 4.8e-7, 3.2e-9, 5.7e-13))
PINHOLE = PinholeCamera(480, 302, 400.0, 400.0, 239.5, 150.5, (-0.2, 0.05, 0.0, 0.0))
CAMERAS = pytest.mark.parametrize("camera", [WIDE, PINHOLE], ids=["ftheta", "pinhole"])
FACING = np.eye(3)


def plain(grey: int = 200) -> np.ndarray:
    """A texture of one colour."""
    return np.full((30, 40), grey, dtype=np.uint8)


def clean(camera: CameraModel, planes: list[Plane], **options: object) -> np.ndarray:
    """Without noise or uneven light."""
    settings = {"noise": 0.0, "light": 0.0, "blur_px": 0.0, "background": 50.0, **options}
    return render_planes(camera, planes, rng=np.random.default_rng(0), **settings).astype(np.float64)  # type: ignore[arg-type]


@CAMERAS
def test_edge_of_a_plate_stands_where_the_model_projects_it(camera: CameraModel) -> None:
    """A bright plate's grey values along rows add up to its width in pixels, to 0.02 px."""
    rotation = Rotation.from_euler("yx", [25.0, -10.0], degrees=True).as_matrix()
    plane = Plane(plain(), (0.4, 0.3), rotation, np.array([-0.2, -0.15, 0.9]))
    rows = np.arange(140, 160)
    part = (clean(camera, [plane], supersample=8)[rows] - 50.0) / 150.0
    edges = []
    for x in (0.0, 0.4):
        y = np.linspace(0.0, 0.3, 3001)
        point = np.column_stack([np.full_like(y, x), y, np.zeros_like(y)]) @ rotation.T
        pixel, _ = camera.pixel_from_camera_point(point + plane.camera_t_plane_m)
        edges.append(np.interp(rows, pixel[:, 1], pixel[:, 0]))
    left, right = edges
    assert part.sum(axis=1).mean() == pytest.approx((right - left).mean(), abs=0.02)
    middle = (part * np.arange(480)).sum(axis=1) / part.sum(axis=1)
    assert middle.mean() == pytest.approx((0.5 * (left + right)).mean(), abs=0.02)


@CAMERAS
def test_texture_lies_as_it_is_read(camera: CameraModel) -> None:
    """Seen straight on, the texture's top-left quarter is at the top left of the image."""
    texture = plain(100)
    texture[:15, :20] = 240
    image = clean(camera, [Plane(texture, (0.4, 0.3), FACING, np.array([-0.2, -0.15, 1.0]))])
    bright = np.argwhere(image > 170)
    assert (bright.mean(axis=0) < (150.0, 240.0)).all()
    assert image[:145, :230].max() == 240.0


def test_nearest_plate_hides_the_others() -> None:
    """Whatever their order, the nearer of two plates is seen."""
    near = Plane(plain(220), (0.2, 0.15), FACING, np.array([-0.1, -0.075, 0.8]))
    far = Plane(plain(120), (0.8, 0.6), FACING, np.array([-0.4, -0.3, 1.2]))
    one, other = clean(WIDE, [near, far]), clean(WIDE, [far, near])
    np.testing.assert_array_equal(one, other)
    assert one[151, 240] == 220.0
    assert one[151, 180] == 120.0
    assert one[5, 5] == 50.0


def test_back_of_a_plate_and_plates_behind_the_camera_are_not_seen() -> None:
    """A plate turned away, and one behind, leave the background as it is."""
    turned = Rotation.from_euler("y", 180.0, degrees=True).as_matrix()
    away = Plane(plain(), (0.4, 0.3), turned, np.array([0.2, -0.15, 1.0]))
    behind = Plane(plain(), (0.4, 0.3), FACING, np.array([-0.2, -0.15, -1.0]))
    assert (clean(WIDE, [away, behind]) == 50.0).all()


def test_bent_plate_is_seen_where_its_surface_is() -> None:
    """The middle line of a bent plate stands back by the sagitta: it projects as points there do."""
    texture = plain(100)
    texture[:, 19:21] = 250
    plane = Plane(texture, (0.4, 0.3), FACING, np.array([0.05, -0.15, 0.6]), sagitta_m=0.05)
    image = clean(WIDE, [plane])
    line = image[157] - 100.0
    middle = np.array([[0.25, 0.0, 0.65]])
    expected = WIDE.pixel_from_camera_point(middle)[0][0, 0]
    weight = np.where(line > 20.0, line, 0.0)
    assert (weight * np.arange(480)).sum() / weight.sum() == pytest.approx(expected, abs=0.05)
    flat = WIDE.pixel_from_camera_point(np.array([[0.25, 0.0, 0.6]]))[0][0, 0]
    assert abs(flat - expected) > 3.0


def test_light_is_uneven_and_noise_has_its_sigma() -> None:
    """Light falls across the image and to its corners; noise is white with the sigma asked for."""
    rng = np.random.default_rng(4)
    lit = render_planes(WIDE, [], rng=rng, noise=0.0, light=0.4, background=200.0).astype(np.float64)
    assert np.ptp(lit) > 60.0
    assert lit.max() <= 200.0
    noisy = render_planes(WIDE, [], rng=rng, noise=3.0, light=0.0, background=120.0).astype(np.float64)
    assert noisy.std() == pytest.approx(3.0, rel=0.05)


def test_same_seed_gives_the_same_picture() -> None:
    """A picture depends on its arguments and the generator alone."""
    plane = Plane(plain(), (0.4, 0.3), FACING, np.array([-0.2, -0.15, 1.0]))
    one, other = (render_planes(WIDE, [plane], rng=np.random.default_rng(9)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_fine_texture_is_averaged_not_sampled() -> None:
    """Stripes far finer than a pixel come out as their mean, without a pattern."""
    stripes = np.zeros((600, 800), dtype=np.uint8)
    stripes[:, ::2] = 200
    image = clean(WIDE, [Plane(stripes, (0.1, 0.075), FACING, np.array([-0.05, -0.04, 1.5]))])
    inside = image[153:157, 237:241]
    np.testing.assert_allclose(inside, 100.0, atol=2.0)


@CAMERAS
def test_drawn_poses_show_the_board_spread_and_tilted(camera: CameraModel) -> None:
    """Whole boards are on the image, all over it, from the front, with tilts in the range asked for."""
    size = (0.4, 0.3)
    poses = draw_board_poses(
        camera, size, 20, np.random.default_rng(1), fill=(0.25, 0.4), tilt_deg=(10.0, 40.0)
    )
    outline = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.4, 0.3, 0.0], [0.0, 0.3, 0.0], [0.2, 0.15, 0.0]])
    middles = []
    for rotation, position in poses:
        point = outline @ rotation.T + position
        pixel, seen = camera.pixel_from_camera_point(point)
        assert seen.all()
        tilt = np.degrees(np.arccos(rotation[:, 2] @ point[4] / np.linalg.norm(point[4])))
        assert 9.9 < tilt < 40.1
        middles.append(pixel[4])
    assert (np.ptp(middles, axis=0) > (200.0, 100.0)).all()


def test_board_that_cannot_be_shown_whole_is_refused() -> None:
    """A board larger than the image has no whole pose."""
    with pytest.raises(ValueError, match="show it smaller"):
        draw_board_poses(PINHOLE, (0.4, 0.3), 1, np.random.default_rng(1), fill=(3.0, 3.0))
