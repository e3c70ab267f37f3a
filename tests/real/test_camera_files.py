"""Calibrations that others made with their tools: what is in them, against OpenCV and their own inverses."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from checkout import REAL

from geoloc.calibration_files import calibration_kind, read_cameras
from geoloc.cameras import CameraModel, FisheyeCamera, OcamCamera, PinholeCamera
from geoloc.errors import CalibrationError

FILES = REAL / "camera_models"

pytestmark = pytest.mark.skipif(
    not FILES.exists(), reason="the real camera files are not beside the checkout"
)


def content(name: str) -> bytes:
    """Bytes of one file."""
    return (FILES / name).read_bytes()


def the_ocam(name: str) -> OcamCamera:
    """The one camera of an OCamCalib or Lafida file."""
    (camera,) = read_cameras(content(name), name).values()
    assert isinstance(camera.model, OcamCamera)
    return camera.model


def pixels_within(camera: CameraModel, radius_px: float) -> np.ndarray:
    """Pixels of the image within a circle about its middle."""
    u, v = np.meshgrid(np.linspace(0, camera.width_px - 1, 60), np.linspace(0, camera.height_px - 1, 40))
    pixel = np.column_stack([u.ravel(), v.ravel()])
    middle = [0.5 * (camera.width_px - 1), 0.5 * (camera.height_px - 1)]
    return pixel[np.hypot(*(pixel - middle).T) < radius_px]


def test_every_file_is_told_by_its_content() -> None:
    """The folder holds these files, and each is recognised without its name."""
    kinds = {path.name: calibration_kind(path.read_bytes()) for path in sorted(FILES.iterdir())}
    assert kinds == {
        "InteriorOrientationFisheye0.yaml": "ocam-yaml",
        "InteriorOrientationFisheye1.yaml": "ocam-yaml",
        "InteriorOrientationFisheye2.yaml": "ocam-yaml",
        "calib_results_1920x1280.txt": "ocamcalib",
        "calib_results_752x480.txt": "ocamcalib",
        "euroc_mav_camchain.yaml": "kalibr",
        "opensfm_rig_cameras.json": "opensfm",
        "tum_vi_camchain.yaml": "kalibr",
    }


@pytest.mark.parametrize(
    ("name", "size", "centre", "focal", "fov_deg"),
    [
        ("calib_results_752x480.txt", (752, 480), (394.552874, 241.800066), 206.517, 240.0),
        ("calib_results_1920x1280.txt", (1920, 1280), (955.965708, 638.550401), 508.4606, 188.2),
    ],
)
def test_ocamcalib_results_are_known(
    name: str, size: tuple[int, int], centre: tuple[float, float], focal: float, fov_deg: float
) -> None:
    """Size, centre (columns first, though the file has rows first), focal length and field of view."""
    camera = the_ocam(name)
    assert (camera.width_px, camera.height_px) == size
    assert (camera.cx_px, camera.cy_px) == centre
    # The file's own constant: the model's is scaled by c.
    assert -camera.polynomial[0] * camera.c == pytest.approx(focal, rel=1e-12)
    assert np.degrees(camera.horizontal_fov_rad) == pytest.approx(fov_deg, abs=0.1)


@pytest.mark.parametrize(
    ("name", "radius_px", "agreement_px"),
    [("calib_results_752x480.txt", 330.0, 0.02), ("calib_results_1920x1280.txt", 900.0, 0.03)],
)
def test_ocamcalib_results_agree_with_their_own_inverse(
    name: str, radius_px: float, agreement_px: float
) -> None:
    """The inverse polynomial in the file, used as OCamCalib's ``world2cam``, finds our pixels again."""
    camera = the_ocam(name)
    rows = [line.split() for line in content(name).decode().splitlines() if line and not line.startswith("#")]
    rows = [row for row in rows if row]
    inverse = np.array(rows[1][1:], dtype=float)
    (xc, yc), (c, d, e) = (np.array(row, dtype=float) for row in rows[2:4])
    pixel = pixels_within(camera, radius_px)
    ray, seen = camera.camera_ray_from_pixel(pixel)
    down, right, backward = ray[:, 1], ray[:, 0], -ray[:, 2]
    across = np.hypot(down, right)
    rho = np.polynomial.polynomial.polyval(np.arctan2(backward, across), inverse)
    x, y = down / across * rho, right / across * rho
    theirs = np.column_stack([e * x + y + yc, c * x + d * y + xc])
    assert seen.all()
    assert np.abs(theirs - pixel).max() < agreement_px


@pytest.mark.parametrize(
    ("number", "centre", "constant"),
    [
        (0, (392.219508388648, 243.494438476351), -209.200757992065),
        (1, (378.722262294544, 253.62515782861), -209.071570423477),
        (2, (372.796912405235, 225.645071214684), -208.409533164304),
    ],
)
def test_lafida_cameras_agree_with_their_own_inverse(
    number: int, centre: tuple[float, float], constant: float
) -> None:
    """754 x 480 fisheyes; their backward polynomial, as MultiCol-SLAM uses it, finds our pixels to 0.1 px."""
    name = f"InteriorOrientationFisheye{number}.yaml"
    camera = the_ocam(name)
    assert (camera.width_px, camera.height_px) == (754, 480)
    assert (camera.cx_px, camera.cy_px) == centre
    assert camera.polynomial[0] == constant
    inverse = [float(text) for text in re.findall(r"pol\d+:\s*(\S+)", content(name).decode())]
    assert len(inverse) == 12
    pixel = pixels_within(camera, 330.0)
    ray, seen = camera.camera_ray_from_pixel(pixel)
    across = np.hypot(ray[:, 0], ray[:, 1])
    rho = np.polynomial.polynomial.polyval(np.arctan2(-ray[:, 2], across), inverse)
    x, y = ray[:, 0] / across * rho, ray[:, 1] / across * rho
    theirs = np.column_stack([camera.c * x + camera.d * y + centre[0], camera.e * x + y + centre[1]])
    assert seen.all()
    assert np.abs(theirs - pixel).max() < 0.1


def test_euroc_cameras_agree_with_opencv() -> None:
    """EuRoC: two pinhole cameras of 752 x 480, whose rays are OpenCV's, 0.11 m apart."""
    cameras = read_cameras(content("euroc_mav_camchain.yaml"), "euroc")
    assert list(cameras) == ["cam0", "cam1"]
    first, second = cameras["cam0"], cameras["cam1"]
    distortion = (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)
    assert first.model == PinholeCamera(752, 480, 458.654, 457.296, 367.215, 248.375, distortion)
    assert first.body == second.body == "imu"
    pixel = pixels_within(first.model, 1e4)
    ray, seen = first.model.camera_ray_from_pixel(pixel)
    matrix = np.array([[458.654, 0.0, 367.215], [0.0, 457.296, 248.375], [0.0, 0.0, 1.0]])
    theirs, _ = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), matrix, np.array(distortion))
    assert seen.all()
    np.testing.assert_allclose(theirs[:, 0], pixel, rtol=0, atol=1e-8)
    assert first.camera_T_body is not None
    assert second.camera_T_body is not None
    between = second.camera_T_body @ np.linalg.inv(first.camera_T_body)
    # The stereo baseline of EuRoC's VI sensor, to the left of the second camera.
    assert np.linalg.norm(between[:3, 3]) == pytest.approx(0.110, abs=5e-4)
    assert between[0, 3] == pytest.approx(-0.110, abs=5e-4)


def test_tum_vi_cameras_agree_with_opencv() -> None:
    """TUM VI: two equidistant fisheyes of 512 x 512, whose rays are ``cv2.fisheye``'s, 0.10 m apart."""
    cameras = read_cameras(content("tum_vi_camchain.yaml"), "tum")
    assert list(cameras) == ["cam0", "cam1"]
    first, second = cameras["cam0"], cameras["cam1"]
    assert isinstance(first.model, FisheyeCamera)
    assert (first.model.width_px, first.model.height_px) == (512, 512)
    assert first.model.fx_px == 190.97847715128717
    assert np.degrees(first.model.horizontal_fov_rad) == pytest.approx(153.8, abs=0.1)
    pixel = pixels_within(first.model, 240.0)
    ray, seen = first.model.camera_ray_from_pixel(pixel)
    m = first.model
    matrix = np.array([[m.fx_px, 0.0, m.cx_px], [0.0, m.fy_px, m.cy_px], [0.0, 0.0, 1.0]])
    theirs, _ = cv2.fisheye.projectPoints(
        ray[:, np.newaxis], np.zeros(3), np.zeros(3), matrix, np.array(m.distortion)
    )
    assert seen.all()
    assert (ray[:, 2] > 0.0).all()
    np.testing.assert_allclose(theirs[:, 0], pixel, rtol=0, atol=1e-8)
    assert first.camera_T_body is not None
    assert second.camera_T_body is not None
    between = second.camera_T_body @ np.linalg.inv(first.camera_T_body)
    assert np.linalg.norm(between[:3, 3]) == pytest.approx(0.101, abs=1e-3)


def test_opensfm_rig_cameras_hold_no_intrinsics() -> None:
    """The file holds the pose of ``rig_camera`` alone, and says where the intrinsics are."""
    name = "opensfm_rig_cameras.json"
    with pytest.raises(
        CalibrationError, match=r"poses of rig_camera, and no intrinsics.*camera_models\.json"
    ):
        read_cameras(content(name), name)
