"""The rig of the NTNU car itself: eight f-theta cameras and two antennas, as DriveWorks wrote them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from checkout import REAL

from geoloc.cameras import FThetaCamera
from geoloc.rig.rig import Rig, looks_like_rig, read_rig, rig_document, rig_from_document

NAPLAB = REAL / "naplab"
FULL = NAPLAB / "ntnu_naplab_rig_carlo.json"
SMALL = NAPLAB / "ntnu_naplab_nobadcam.json"

pytestmark = pytest.mark.skipif(not FULL.exists(), reason="the NTNU rig files are not on this machine")

EXPECTED_AZIMUTH_DEG = {
    # Counter-clockwise from straight ahead, as the cameras' names say: front, rear, right and left.
    "C1_front60Single": 0.0,
    "C2_tricam60": 0.0,
    "C3_tricam120": 0.0,
    "C4_rearCam": 180.0,
    "C5_R1": -135.0,
    "C6_L1": 120.0,
    "C7_L2": 50.0,
    "C8_R2": -60.0,
}


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    """The rig file as JSON."""
    content: dict[str, Any] = json.loads(FULL.read_text(encoding="utf-8"))
    return content


@pytest.fixture(scope="module")
def rig() -> Rig:
    """The rig as read."""
    return read_rig(FULL)


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between vectors along the last axis."""
    cross = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.degrees(np.arctan2(cross, np.sum(a * b, axis=-1))))


def test_rig_of_the_ntnu_car_reads_whole(rig: Rig, document: dict[str, Any]) -> None:
    """Eight cameras with their recordings and two antennas with theirs; only CAN is left out."""
    assert looks_like_rig(document)
    assert list(rig.cameras) == list(EXPECTED_AZIMUTH_DEG)
    assert rig.unsupported == {}
    for name, camera in rig.cameras.items():
        assert camera.video == f"{name}.h264"
        assert camera.timestamps == f"{name}.h264.timestamps"
        assert (camera.model.model, camera.model.width_px, camera.model.height_px) == ("ftheta", 1920, 1208)
    assert {antenna.name: antenna.file for antenna in rig.antennas.values()} == {
        "gnss50:vehicle": "gnss50_vehicle.bin",
        "gnss52:vehicle": "gnss52_vehicle.bin",
    }


def test_rig_of_the_ntnu_car_has_no_lever_arms(rig: Rig) -> None:
    """The file knows nothing of where the antennas are: a drive must bring their lever arms."""
    for antenna in rig.antennas.values():
        np.testing.assert_array_equal(antenna.rig_t_antenna_m, 0.0)


def test_rig_cameras_look_out_of_the_ntnu_car(rig: Rig, document: dict[str, Any]) -> None:
    """Every camera sits on the side of the body to which it looks, and looks where its name says."""
    body = document["rig"]["vehicle"]["value"]["body"]
    centre = np.array([body["boundingBoxPosition"][0] + body["length"] / 2.0, 0.0])
    for name, camera in rig.cameras.items():
        axis = camera.rig_R_camera[:, 2]
        assert axis[:2] @ (camera.rig_t_camera_m[:2] - centre) > 0.0
        named = np.radians(EXPECTED_AZIMUTH_DEG[name])
        assert angle_deg(axis, np.array([np.cos(named), np.sin(named), 0.0])) < 9.0


def test_rig_cameras_of_the_ntnu_car_are_upright_and_above_the_road(rig: Rig) -> None:
    """Image down is down, within the roll of the mounts, and every camera is at a height a Kia Niro has."""
    for camera in rig.cameras.values():
        assert camera.rig_R_camera[2, 1] < -0.99
        assert 1.1 < camera.rig_t_camera_m[2] < 1.6
        np.testing.assert_allclose(camera.rig_R_camera @ camera.rig_R_camera.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(camera.rig_R_camera) == pytest.approx(1.0, abs=1e-14)


def test_rig_camera_pitch_of_the_ntnu_car_points_down(rig: Rig) -> None:
    """The file's pitch of +2.83° puts the front camera's axis 2.83° below the horizon: nose down."""
    axis = rig.camera("C1_front60Single").rig_R_camera[:, 2]
    assert np.degrees(np.arcsin(axis[2])) == pytest.approx(-2.83, abs=0.01)


def test_rig_cameras_of_the_ntnu_car_close_over_the_whole_image(rig: Rig) -> None:
    """Pixel → ray → pixel closes to 1e-6 px on a dense grid of every camera, corners included."""
    u, v = np.meshgrid(np.linspace(-0.5, 1919.5, 241), np.linspace(-0.5, 1207.5, 152))
    pixel = np.stack([u, v], axis=-1)
    for camera in rig.cameras.values():
        ray, seen = camera.model.camera_ray_from_pixel(pixel)
        again, _ = camera.model.pixel_from_camera_point(25.0 * ray)
        assert seen.all()
        assert np.abs(again - pixel).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "left_deg", "right_deg", "focal_px"),
    [("C1_front60Single", 26.2, 33.1, 1863.7), ("C3_tricam120", 60.4, 57.8, 1006.5)],
)
def test_rig_camera_fields_of_view_of_the_ntnu_car(
    rig: Rig, name: str, left_deg: float, right_deg: float, focal_px: float
) -> None:
    """Angles to the image edges and focal length at the centre, as computed independently of this code."""
    model = rig.camera(name).model
    assert isinstance(model, FThetaCamera)
    # The published angles run from u = 0 to u = 1920 and are rounded to 0.1°.
    edges = np.array([[0.0, model.cy_px], [1920.0, model.cy_px]])
    ray, _ = model.camera_ray_from_pixel(edges)
    np.testing.assert_allclose(angle_deg(ray, np.array([0.0, 0.0, 1.0])), [left_deg, right_deg], atol=0.05)
    assert np.degrees(model.horizontal_fov_rad) == pytest.approx(left_deg + right_deg, abs=0.1)
    # So near the axis the radius is the focal length times the angle.
    pixel, _ = model.pixel_from_camera_point(np.array([1e-5, 0.0, 1.0]))
    assert 1e5 * (pixel[0] - model.cx_px) == pytest.approx(focal_px, abs=0.1)


def test_rig_car_mask_of_the_ntnu_car_decodes(rig: Rig) -> None:
    """Exactly 480 x 302 pixels of which 7.7 % show the car, mostly in the lower half."""
    for camera in rig.cameras.values():
        mask = camera.ego_mask
        assert mask is not None
        assert mask.shape == (302, 480)
        assert mask.mean() == pytest.approx(0.077, abs=0.0005)
        assert mask[151:].sum() > 3 * mask[:151].sum()


def test_rig_of_the_ntnu_car_survives_writing(rig: Rig) -> None:
    """Written and read again, the real rig is the same."""
    again = rig_from_document(json.loads(json.dumps(rig_document(rig))), rig.source)
    for name, camera in rig.cameras.items():
        other = again.camera(name)
        assert other.model == camera.model
        np.testing.assert_allclose(other.rig_R_camera, camera.rig_R_camera, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(other.rig_t_camera_m, camera.rig_t_camera_m)
        assert (other.video, other.timestamps) == (camera.video, camera.timestamps)
        assert camera.ego_mask is not None
        np.testing.assert_array_equal(other.ego_mask, camera.ego_mask)
    assert list(again.antennas) == list(rig.antennas)


def test_rig_of_three_cameras_agrees_with_the_full_one(rig: Rig) -> None:
    """The smaller rig file of the same car describes its cameras alike."""
    if not SMALL.exists():
        pytest.skip("the smaller NTNU rig file is not on this machine")
    small = read_rig(SMALL)
    assert list(small.cameras) == ["C1_front60Single", "C2_tricam60", "C4_rearCam"]
    for name, camera in small.cameras.items():
        assert camera.model == rig.camera(name).model
        np.testing.assert_array_equal(camera.rig_R_camera, rig.camera(name).rig_R_camera)
