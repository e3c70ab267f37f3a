"""Intrinsics from corners: what is found, how sure it is, and which faults are named."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoloc.calibration.intrinsics import Intrinsics, View, angle_between, calibrate_intrinsics
from geoloc.calibration.intrinsics.bundle import AdjustedBundle, Bundle, shaped
from geoloc.calibration.intrinsics.comparison import best
from geoloc.calibration.intrinsics.fit import fit
from geoloc.calibration.intrinsics.initial_guess import first_guess
from geoloc.calibration.intrinsics.radial_lenses import FThetaLens
from geoloc.calibration.intrinsics.views import Corners, corners_of
from geoloc.cameras import CameraModel, FisheyeCamera, FThetaCamera, OcamCamera, PinholeCamera
from geoloc.errors import CalibrationError
from geoloc.simulation.pictures.board_views import draw_board_poses

WIDE = FThetaCamera(1920, 1208, 971.0, 630.0, theta_from_r=(0.0, 9.9e-4, 3.0e-8, 5.0e-11, 2.2e-15))
NARROW = FThetaCamera(1920, 1208, 880.0, 640.0, theta_from_r=(0.0, 5.3e-4, 1.3e-8, -1.4e-11, 3.0e-15))
FISHEYE = FisheyeCamera(1920, 1208, 1004.0, 1001.0, 968.0, 618.0, (-0.021, -0.008, 0.004, -0.0013))
PINHOLE = PinholeCamera(1920, 1208, 1500.0, 1504.0, 955.0, 600.0, (-0.21, 0.06, 8e-4, -6e-4, 0.01))
OCAM = OcamCamera(1920, 1208, 962.0, 611.0, (-980.0, 0.0, 2.6e-4, -1.1e-7, 9.0e-11))
SQUARE_M = 0.08
BOARD_M = SQUARE_M * (np.argwhere(np.ones((9, 6))).astype(np.float64) + 1.0)
SIZE_M = (0.80, 0.56)


def board_views(
    camera: CameraModel,
    n: int,
    *,
    noise_px: float = 0.1,
    shape: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    seed: int = 0,
    fill: tuple[float, float] = (0.4, 0.8),
) -> list[View]:
    """Views of a 9 x 6 board, projected by the camera model itself."""
    rng = np.random.default_rng(seed)
    flat = Corners(BOARD_M, np.zeros_like(BOARD_M), np.zeros(len(BOARD_M), dtype=np.int64))
    board, _ = shaped(flat, np.array(shape))
    views = []
    for number, (rotation, position) in enumerate(draw_board_poses(camera, SIZE_M, n, rng, fill=fill)):
        pixel, seen = camera.pixel_from_camera_point(board @ rotation.T + position)
        assert seen.all()
        views.append(View(f"view {number}", BOARD_M, pixel + rng.normal(scale=noise_px, size=pixel.shape)))
    return views


def rays_off_deg(made: Intrinsics, camera: CameraModel) -> tuple[np.ndarray, np.ndarray]:
    """Angles between calibrated and true rays over the image, and which of them are covered."""
    u, v = np.meshgrid(np.arange(0.0, 1920.0, 30.0), np.arange(0.0, 1208.0, 30.0))
    pixel = np.column_stack([u.ravel(), v.ravel()])
    true, ours = camera.camera_ray_from_pixel(pixel)[0], made.camera.camera_ray_from_pixel(pixel)[0]
    return np.degrees(angle_between(true, ours)), made.coverage.covers(pixel)


def kinds(made: Intrinsics) -> list[str]:
    """Kinds of the faults but for coverage: a small board that is always whole leaves edges out."""
    return [fault.kind for fault in made.faults if fault.kind != "poor_coverage"]


@pytest.fixture(scope="module")
def wide() -> Intrinsics:
    """The wide camera from 25 good views."""
    return calibrate_intrinsics(board_views(WIDE, 25), 1920, 1208, models=["ftheta", "pinhole"])


@pytest.mark.parametrize(
    ("camera", "model"),
    [(NARROW, "ftheta"), (FISHEYE, "fisheye"), (PINHOLE, "pinhole"), (OCAM, "ocam")],
    ids=["ftheta", "fisheye", "pinhole", "ocam"],
)
def test_exact_corners_give_the_exact_camera(camera: CameraModel, model: str) -> None:
    """Without noise every model finds its own lens to 1e-6 degrees, wherever the principal point is."""
    views = board_views(camera, 8, noise_px=0.0)
    corners = corners_of(views)
    made = calibrate_intrinsics(views, 1920, 1208, models=[model])
    assert made.camera.model == model
    off, covered = rays_off_deg(made, camera)
    assert off[covered].max() < 1e-6
    assert made.fit.adjusted.sigma_px < 1e-6
    assert len(made.fit.adjusted.inlier) == len(corners.view)


@pytest.mark.slow
def test_auto_takes_the_simplest_of_the_models_that_are_best(wide: Intrinsics) -> None:
    """A four-term f-theta lens is found to be one, although a fifth term fits as well."""
    assert wide.fit.label == "ftheta, degree 4"
    errors = {c.label: c.held_out_deg for c in wide.candidates}
    assert errors["ftheta, degree 5"] == pytest.approx(errors["ftheta, degree 4"], rel=0.01)
    assert errors["pinhole"] > 3.0 * errors["ftheta, degree 4"]


@pytest.mark.slow
def test_auto_leaves_f_theta_where_another_model_is_better() -> None:
    """A lens with tangential distortion is no round one: held-out views say pinhole."""
    camera = replace(PINHOLE, distortion=(-0.21, 0.06, 4e-3, -3e-3, 0.01))
    made = calibrate_intrinsics(board_views(camera, 15), 1920, 1208, models=["ftheta", "pinhole"])
    assert made.camera.model == "pinhole"
    assert best(made.candidates) is made.chosen


def test_calibrated_rays_are_right_where_covered(wide: Intrinsics) -> None:
    """With 0.1 px of noise the rays in the covered region are off by 0.01 degrees on average at most."""
    off, covered = rays_off_deg(wide, WIDE)
    assert covered.mean() > 0.5
    assert off[covered].mean() < 0.01
    assert off[covered].max() < 0.03
    assert kinds(wide) == []


def test_stated_sigmas_hold() -> None:
    """Over 20 draws of noise the parameters' errors have the covariance that is stated (NEES)."""
    views = board_views(WIDE, 12, noise_px=0.0)
    corners, lens = corners_of(views), FThetaLens(1920, 1208)
    curve, poses = first_guess(corners, 1920, 1208)
    true = np.array([971.0, 630.0, *(WIDE.theta_from_r or ())[1:]]) / lens.units
    rng, total = np.random.default_rng(5), 0.0
    for _ in range(20):
        noise = rng.normal(scale=0.1, size=corners.pixel_px.shape)
        made = fit(lens, replace(corners, pixel_px=corners.pixel_px + noise), curve, poses).adjusted
        off = made.state.lens - true
        total += float(off @ np.linalg.solve(made.covariance, off))
    # 120 degrees of freedom: 99.9 % of χ² / 120 lies between 0.62 and 1.48.
    assert 0.62 < total / 120.0 < 1.48


@pytest.mark.slow
def test_stated_sigmas_hold_where_corners_of_a_view_are_off_alike() -> None:
    """Views whose corners share a smooth error have sigmas that say so: NEES stays near one."""
    views = board_views(WIDE, 20, noise_px=0.0)
    corners, lens = corners_of(views), FThetaLens(1920, 1208)
    curve, poses = first_guess(corners, 1920, 1208)
    true = np.array([971.0, 630.0, *(WIDE.theta_from_r or ())[1:]]) / lens.units
    x, y = 2.0 * (BOARD_M - BOARD_M.mean(axis=0)).T / np.ptp(BOARD_M, axis=0).max()
    smooth = np.column_stack([x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3])
    rng, squares, white = np.random.default_rng(5), [], []
    for _ in range(16):
        shared = [smooth @ rng.normal(scale=0.05, size=(smooth.shape[1], 2)) for _ in views]
        noise = rng.normal(scale=0.1, size=corners.pixel_px.shape) + np.concatenate(shared)
        made = fit(lens, replace(corners, pixel_px=corners.pixel_px + noise), curve, poses).adjusted
        off = made.state.lens - true
        squares.append(off @ np.linalg.solve(made.covariance, off) / len(off))
        alone = _independent_covariance(Bundle(lens, corners), made)
        white.append(off @ np.linalg.solve(alone, off) / len(off))
    assert np.mean(white) > 1.6
    assert 0.6 < np.mean(squares) < 1.5


def _independent_covariance(bundle: Bundle, made: AdjustedBundle) -> np.ndarray:
    """The covariance that the corners would give were they independent, from the whole dense problem."""
    _, by_common, by_pose, _ = bundle.residuals(made.state)
    n, n_views = len(bundle.corners.view), bundle.corners.n_views
    design = np.zeros((n, 2, by_common.shape[2] + 6 * n_views))
    design[:, :, : by_common.shape[2]] = by_common
    for view in range(n_views):
        mine, first = bundle.corners.view == view, by_common.shape[2] + 6 * view
        design[mine, :, first : first + 6] = by_pose[mine]
    whole = design[made.inlier].reshape(-1, design.shape[2])
    p = by_common.shape[2]
    return np.asarray(made.sigma_px**2 * np.linalg.inv(whole.T @ whole)[:p, :p])


@pytest.mark.slow
def test_ray_sigma_is_the_spread_of_the_rays() -> None:
    """The stated sigma of single rays agrees with the spread of their errors over draws of noise."""
    views = board_views(WIDE, 12, noise_px=0.0)
    corners, lens = corners_of(views), FThetaLens(1920, 1208)
    curve, poses = first_guess(corners, 1920, 1208)
    pixel = np.array([[960.0, 604.0], [300.0, 300.0], [1700.0, 900.0]])
    true, rng, squares, stated = WIDE.camera_ray_from_pixel(pixel)[0], np.random.default_rng(6), [], []
    for _ in range(20):
        noise = rng.normal(scale=0.1, size=corners.pixel_px.shape)
        made = fit(lens, replace(corners, pixel_px=corners.pixel_px + noise), curve, poses)
        squares.append(angle_between(made.camera.camera_ray_from_pixel(pixel)[0], true) ** 2)
        stated.append(np.trace(made.ray_covariance(pixel), axis1=1, axis2=2))
    ratio = np.mean(squares, axis=0) / np.mean(stated, axis=0)
    assert (ratio > 0.4).all()
    assert (ratio < 1.9).all()


def test_pixels_that_are_not_square_are_found_without_being_asked_for() -> None:
    """C, d and e of a lens come back but for the turn of the image, which boards cannot tell."""
    camera = replace(WIDE, c=1.003, d=1.5e-3, e=-0.5e-3)
    made = calibrate_intrinsics(board_views(camera, 12), 1920, 1208, models=["ftheta"])
    assert made.fit.label == "ftheta, degree 4, with c and d"
    assert isinstance(made.camera, FThetaCamera)
    assert made.camera.c == pytest.approx(1.003, abs=5e-4)
    # Half of what d and e have together is no turn.
    assert made.camera.d == made.camera.e == pytest.approx(0.5e-3, abs=3e-4)
    assert "misfit" not in kinds(made)


# OCamCalib's files as their owners published them: of a spherical camera and of a small drone's fisheye.
OCAM_KODAK = OcamCamera(
    *(1440, 1440, 729.090632, 728.648728, (-271.6972, 0.0, -2.741744e-06, 1.840940e-06, -8.024838e-10)),
    c=1.0 / 1.001407,
    d=0.000221,
    e=-0.000818,
)
OCAM_DRONE = OcamCamera(
    *(752, 480, 394.552874, 241.800066, (-206.5170, 0.0, 2.207161e-03, -4.879622e-06, 1.865656e-08)),
    c=1.0 / 1.000330,
    d=0.000257,
    e=0.000219,
)


@pytest.mark.parametrize(
    ("camera", "other"), [(OCAM_KODAK, "fisheye"), pytest.param(OCAM_DRONE, "ftheta", marks=pytest.mark.slow)]
)
def test_real_ocam_lenses_meet_the_bar(camera: OcamCamera, other: str) -> None:
    """Two real lenses with c, d and e: but for a turn rays are right to 0.01° on average, 0.05° at most."""
    rng, views = np.random.default_rng(1), []
    board = SQUARE_M * (np.argwhere(np.ones((16, 11))).astype(np.float64) + 1.0)
    poses = draw_board_poses(camera, (1.36, 0.96), 20, rng, fill=(0.5, 1.0), inside=0.7)
    for number, (rotation, position) in enumerate(poses):
        point = np.column_stack([board, np.zeros(len(board))]) @ rotation.T + position
        pixel = _ocamcalib_pixels(camera, point) + rng.normal(scale=0.1, size=(len(board), 2))
        seen = ((pixel >= 0.0) & (pixel <= [camera.width_px - 1.0, camera.height_px - 1.0])).all(axis=1)
        views.append(View(f"view {number}", board[seen], pixel[seen]))
    made = calibrate_intrinsics(views, camera.width_px, camera.height_px, models=[other, "ocam"])
    u, v = np.meshgrid(np.arange(0.0, camera.width_px, 16.0), np.arange(0.0, camera.height_px, 16.0))
    pixel = np.column_stack([u.ravel(), v.ravel()])
    pixel = pixel[made.coverage.covers(pixel)]
    true, ours = camera.camera_ray_from_pixel(pixel)[0], made.camera.camera_ray_from_pixel(pixel)[0]
    turn, _ = Rotation.align_vectors(true, ours)
    off = np.degrees(angle_between(true, turn.apply(ours)))
    assert made.fit.label.startswith("ocam")
    assert off.mean() < 0.01
    assert off.max() < 0.05
    assert "misfit" not in kinds(made)


def _ocamcalib_pixels(camera: OcamCamera, point: np.ndarray) -> np.ndarray:
    """Pixels by Scaramuzza's formulas, written plainly: the smallest radius at which ray and point agree."""
    found = []
    for x, y, z in point.tolist():
        across = math.hypot(x, y)
        # rho / -f(rho) = across / z, as a polynomial of rho.
        roots = np.roots([*(across * a for a in camera.polynomial[:1:-1]), z, across * camera.polynomial[0]])
        real = [root.real for root in roots if abs(root.imag) < 1e-6 and root.real > 0.0]
        rho = min(real, default=1e6)
        plane = np.array([x, y]) / across * rho
        matrix = np.array([[camera.c, camera.d], [camera.e, 1.0]])
        found.append(matrix @ plane + [camera.cx_px, camera.cy_px])
    return np.array(found)


def test_wrong_corners_are_rejected_and_counted() -> None:
    """Corners that are off by pixels are left out, named by number, and do no harm."""
    views = board_views(WIDE, 15)
    wrong = views[3].pixel_px + np.where(np.arange(54)[:, np.newaxis] < 5, 4.0, 0.0)
    made = calibrate_intrinsics(
        [*views[:3], replace(views[3], pixel_px=wrong), *views[4:]], 1920, 1208, models=["ftheta"]
    )
    assert (~made.fit.adjusted.inlier).sum() == 5
    off, covered = rays_off_deg(made, WIDE)
    assert off[covered].mean() < 0.015


def test_view_that_fits_no_camera_is_left_out_by_name() -> None:
    """A view whose corners are shaken is left out as a whole, and the report says why."""
    views = board_views(WIDE, 15)
    shaken = views[7].pixel_px + np.random.default_rng(1).normal(scale=8.0, size=(54, 2))
    made = calibrate_intrinsics(
        [*views[:7], replace(views[7], pixel_px=shaken), *views[8:]], 1920, 1208, models=["ftheta"]
    )
    assert list(made.left_out) == ["view 7"]
    assert "moving" in made.left_out["view 7"]
    assert len(made.views) == 14


def test_bent_board_is_named_measured_and_taken_into_account() -> None:
    """A board bent by 4 mm is found with its size, and the camera is right all the same."""
    bend = 0.004 / 0.32
    made = calibrate_intrinsics(
        board_views(WIDE, 25, shape=(0.0, bend, 0.0, 0.0)), 1920, 1208, models=["ftheta"]
    )
    assert "bent_board" in kinds(made)
    value, sigma = made.fit.shape["bend_xx"]
    assert abs(value - bend) < 4.0 * sigma < 0.3 * bend
    assert any(re.search(r"stand [34]\.\d+ ± 0\.0*[1-9] mm", fault.sentence) for fault in made.faults)
    off, covered = rays_off_deg(made, WIDE)
    assert off[covered].mean() < 0.01


def test_stretched_board_is_named() -> None:
    """Squares that are 1 % higher than wide are a printer's doing, not the lens's."""
    made = calibrate_intrinsics(
        board_views(WIDE, 20, shape=(0.01, 0.0, 0.0, 0.0)), 1920, 1208, models=["ftheta"]
    )
    assert kinds(made) == ["stretched_board"]
    assert made.fit.shape["stretch"][0] == pytest.approx(0.01, abs=1e-3)
    assert any("higher than wide" in fault.sentence for fault in made.faults)


@pytest.mark.slow
def test_measured_distance_tells_a_wrong_square_size() -> None:
    """Squares of 10 cm that are stated as 8 cm: one measured distance names the right size."""
    views = board_views(WIDE, 15)
    right = calibrate_intrinsics(views, 1920, 1208, models=["ftheta"])
    poses, middle = right.fit.adjusted.state.poses, np.append(right.fit.bundle.corners.middle_m, 0.0)
    distance = float(np.linalg.norm(poses.position_m[2] + poses.rotation[2] @ middle))
    for measured, found in ((distance, []), (1.25 * distance, ["wrong_square_size"])):
        made = calibrate_intrinsics(views, 1920, 1208, models=["ftheta"], distances_m={"view 2": measured})
        assert kinds(made) == found
    assert any("rather 0.1000 m" in fault.sentence for fault in made.faults)
    away = np.linalg.norm(poses.position_m + poses.rotation @ middle, axis=1)
    # Five taped distances, each 5 mm wrong or so, of squares that are 2 % larger than stated.
    taped = {f"view {n}": 1.02 * away[n] + 0.005 * (-1.0) ** n for n in range(5)}
    made = calibrate_intrinsics(views, 1920, 1208, models=["ftheta"], distances_m=taped)
    assert kinds(made) == ["wrong_square_size"]
    (factor,) = (float(m) for f in made.faults for m in re.findall(r"rather (0\.\d+) m", f.sentence))
    assert factor == pytest.approx(1.02 * SQUARE_M, rel=0.007)


def test_mirrored_board_is_refused() -> None:
    """Pictures flipped left to right show the board from behind, which no print allows."""
    flipped = [
        replace(v, pixel_px=np.column_stack([1919.0 - v.pixel_px[:, 0], v.pixel_px[:, 1]]))
        for v in board_views(WIDE, 8)
    ]
    with pytest.raises(CalibrationError, match=r"mirrored in 8 of 8 views: flip the pictures back"):
        calibrate_intrinsics(flipped, 1920, 1208)


def test_few_views_are_named_and_fewer_refused() -> None:
    """Seven views give a camera with a warning, four give none."""
    views = board_views(WIDE, 7)
    assert "few_views" in kinds(calibrate_intrinsics(views, 1920, 1208, models=["ftheta"]))
    with pytest.raises(CalibrationError, match=r"There are 4 views of the board and 5 are the least"):
        calibrate_intrinsics(views[:4], 1920, 1208)


def test_part_of_the_image_without_boards_is_not_vouched_for() -> None:
    """Boards on the left half alone: the right half is not covered, and the report names it."""
    views = [v for v in board_views(WIDE, 60, fill=(0.3, 0.45)) if v.pixel_px[:, 0].max() < 1000.0][:12]
    made = calibrate_intrinsics(views, 1920, 1208, models=["ftheta"])
    assert "poor_coverage" in [fault.kind for fault in made.faults]
    assert {"top right", "right", "bottom right"} <= set(made.coverage.missing())
    assert not made.coverage.covers(np.array([1800.0, 600.0]))
    assert np.isnan(made.sigma_deg[75, 225])


def test_views_without_tilt_are_named_weak() -> None:
    """Boards that all face a narrow camera leave its principal point open, and the fault says so."""
    rng, views = np.random.default_rng(3), []
    for number in range(12):
        position = np.array([*rng.uniform(-0.5, 0.0, 2), rng.uniform(1.9, 2.1)])
        point = np.column_stack([BOARD_M, np.zeros(54)]) + position
        pixel, seen = NARROW.pixel_from_camera_point(point)
        assert seen.all()
        views.append(View(f"view {number}", BOARD_M, pixel + rng.normal(scale=0.1, size=pixel.shape)))
    made = calibrate_intrinsics(views, 1920, 1208, models=["ftheta"])
    assert "weak_geometry" in kinds(made)


def test_unknown_model_is_refused() -> None:
    """A model that cannot be fitted is named with those that can."""
    with pytest.raises(CalibrationError, match=r"no camera model brown to fit: choose from ftheta"):
        calibrate_intrinsics(board_views(WIDE, 6), 1920, 1208, models=["brown"])


@pytest.mark.parametrize(
    ("board", "pixel", "message"),
    [
        (BOARD_M[:5], np.zeros((5, 2)), "has 5 corners: give at least 8"),
        (BOARD_M, np.zeros((9, 2)), r"both must be \(n, 2\)"),
        (BOARD_M, np.full((54, 2), np.nan), "not a finite number"),
    ],
)
def test_malformed_view_is_refused(board: np.ndarray, pixel: np.ndarray, message: str) -> None:
    """A view says what is wrong with it when it is made."""
    with pytest.raises(CalibrationError, match=message):
        View("a.png", board, pixel)


def test_pixels_beyond_the_stated_size_are_refused() -> None:
    """Corners that are not on an image of that size ask for the right one."""
    with pytest.raises(CalibrationError, match="view 0 has corners outside of an image of 192 x 120"):
        calibrate_intrinsics(board_views(WIDE, 6), 192, 120)
