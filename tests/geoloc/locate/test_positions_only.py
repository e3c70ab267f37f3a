"""The fast way to positions: the same answers as the slow one, over blocks, cameras and rejections."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from geoloc.cameras.base import CameraModel, sin_cos
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.cameras.pinhole import PinholeCamera
from geoloc.earth.geodesy import rotation_from_rpy
from geoloc.errors import CalibrationError
from geoloc.locate.feet import BLOCK
from geoloc.locate.positions_only import Places, place, place_at
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import ErrorBudget, locate_paper, locate_single_frame
from geoloc.reasons import Reason
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera
from geoloc.trajectory.poses import Poses, PoseTrack, part
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_poses

MODELS: dict[str, CameraModel] = {
    "f-theta": FThetaCamera(1920, 1208, 951.0, 612.0, theta_from_r=(0.0, 9.9e-4, 2e-9, -1.1e-11)),
    "f-theta, sheared": FThetaCamera(
        1920, 1208, 951.0, 612.0, theta_from_r=(0.0, 9.9e-4, 2e-9), c=1.002, d=3e-3, e=-2e-3
    ),
    "f-theta from angles": FThetaCamera(1920, 1208, 951.0, 612.0, r_from_theta=(0.0, 1000.0, 2.0, 30.0)),
    "pinhole": PinholeCamera(1920, 1208, 1870.0, 1868.0, 948.0, 617.0),
    "pinhole, distorted": PinholeCamera(1920, 1208, 1870.0, 1868.0, 948.0, 617.0, (-0.31, 0.12, 1e-4, -2e-4)),
}


def rig() -> Rig:
    """One camera of each model; the first sees the car's bonnet."""
    mask = np.zeros((302, 480), dtype=bool)
    mask[280:] = True
    cameras = {
        name: RigCamera(
            name,
            model,
            rotation_from_rpy(0.4, 2.6, 15.0 * k) @ FLU_R_RDF,
            np.array([1.8, 0.1 * k, 1.45]),
            ego_mask=mask if k == 0 else None,
        )
        for k, (name, model) in enumerate(MODELS.items())
    }
    return Rig(cameras, {}, "test rig")


def trajectory() -> Trajectory:
    """A minute at 5 Hz, winding and rolling, with a gap of 2 s."""
    t = np.arange(0.0, 60.0, 0.2)
    t = t[(t < 30.0) | (t > 32.0)]
    full = np.ones_like(t)
    track = PoseTrack(
        epoch_ns=1_780_000_000_000_000_000 + np.rint(t * 1e9).astype(np.int64),
        latitude_deg=63.4 + 1.2e-4 * t,
        longitude_deg=10.4 + 1e-4 * np.sin(t / 5.0),
        height_m=60.0 + np.sin(t / 9.0),
        roll_deg=1.5 * np.sin(t / 7.0),
        pitch_deg=2.0 * np.sin(t / 11.0),
        heading_deg=(30.0 * np.cos(t / 5.0)) % 360.0,
        sigma_horizontal_m=0.02 * full,
        sigma_vertical_m=0.03 * full,
        sigma_roll_pitch_deg=0.2 + 0.1 * np.sin(t),
        sigma_heading_deg=0.15 * full,
    )
    return trajectory_from_poses(track)


def sighted(n: int, names: list[str]) -> tuple[NDArray[np.int64], Sightings]:
    """Epochs in no order, some outside the drive, and pixels on and off the image, road and car."""
    rng = np.random.default_rng(4)
    epoch = 1_780_000_000_000_000_000 + rng.integers(-500_000_000, 60_500_000_000, n)
    return epoch, Sightings(rng.choice(names, n), rng.uniform([-5.0, 560.0], [1925.0, 1215.0], (n, 2)))


@pytest.mark.parametrize("names", [["f-theta"], list(MODELS)])
def test_places_are_those_of_locate_single_frame(names: list[str]) -> None:
    """Positions, covariances and reasons agree row by row, over several blocks, models and rejections."""
    epoch, sightings = sighted(BLOCK + 500, names)
    track, budget = trajectory(), ErrorBudget()
    slow = locate_single_frame(rig(), sightings, track.poses_at(epoch), budget)
    assert 0.2 < slow.valid.mean() < 0.9
    found = place_at(rig(), sightings, track, epoch, budget)
    for fast in (found, place(rig(), sightings, track.poses_at(epoch), budget)):
        np.testing.assert_array_equal(fast.rejected, slow.rejected)
        np.testing.assert_allclose(fast.latitude_deg, slow.latitude_deg, rtol=0, atol=1e-13)
        np.testing.assert_allclose(fast.longitude_deg, slow.longitude_deg, rtol=0, atol=1e-13)
        np.testing.assert_allclose(fast.height_m, slow.height_m, rtol=0, atol=1e-9)
        np.testing.assert_allclose(fast.range_m, slow.range_m, rtol=1e-12)
        assert fast.covariance_m2 is not None
        np.testing.assert_allclose(fast.covariance_m2, slow.covariance_m2, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("names", [["f-theta"], list(MODELS)])
def test_places_of_shared_frames_are_those_of_each_row(names: list[str]) -> None:
    """Sightings in the order of frames share poses, valid and rejected ones alike: nothing else changes."""
    epoch, sightings = sighted(2000, names)
    epoch = np.sort(np.repeat(epoch[::20], 20))
    track, budget = trajectory(), ErrorBudget()
    shared, alone = place_at(rig(), sightings, track, epoch, budget), track.poses_at(epoch)
    own = place(rig(), sightings, alone, budget)
    assert 0.2 < own.valid.mean() < 0.9
    assert not alone.valid.all()
    np.testing.assert_array_equal(shared.rejected, own.rejected)
    for name in ("latitude_deg", "longitude_deg", "height_m", "covariance_m2"):
        np.testing.assert_array_equal(getattr(shared, name), getattr(own, name))


def test_places_without_a_budget_have_no_covariance() -> None:
    """Positions do not depend on whether covariances are asked for."""
    epoch, sightings = sighted(300, list(MODELS))
    bare: Places = place_at(rig(), sightings, trajectory(), epoch)
    full = place_at(rig(), sightings, trajectory(), epoch, ErrorBudget())
    assert bare.covariance_m2 is None
    np.testing.assert_array_equal(bare.latitude_deg, full.latitude_deg)
    np.testing.assert_array_equal(bare.valid, full.valid)


def test_place_of_nothing_is_empty_and_of_an_unknown_camera_an_error() -> None:
    """No sightings make no rows; a camera without calibration is a contradiction."""
    epoch, sightings = sighted(0, ["f-theta"])
    assert place_at(rig(), sightings, trajectory(), epoch, ErrorBudget()).valid.shape == (0,)
    epoch, sightings = sighted(3, ["C9"])
    with pytest.raises(CalibrationError, match="C9"):
        place_at(rig(), sightings, trajectory(), epoch)


def test_paper_without_a_field_of_view_says_so() -> None:
    """A camera whose image edge lies outside its model has no linear bearing: rows that hit are rejected."""
    narrow = FThetaCamera(1920, 1208, 951.0, 612.0, theta_from_r=(0.0, 1e-3, 0.0, -4.5e-10))
    assert np.isnan(narrow.horizontal_fov_rad)
    one = RigCamera("n", narrow, rotation_from_rpy(0.0, 2.0, 0.0) @ FLU_R_RDF, np.array([1.8, 0.0, 1.5]))
    poses = part(trajectory().poses_at(trajectory().epoch_ns), slice(0, 2))
    pixel = np.array([[951.0, 800.0], [951.0, 300.0]])
    found = locate_paper(Rig({"n": one}, {}, "test rig"), Sightings(np.array(["n", "n"]), pixel), poses)
    assert found.rejected.tolist() == [
        Reason.WIDER_THAN_MODEL,
        Reason.ABOVE_HORIZON,
    ]
    assert np.isnan(found.systematic_m).all()


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


def test_poses_in_blocks_are_those_of_all_at_once() -> None:
    """However the epochs are cut, each row is the same; without sigmas only those are missing."""
    track = trajectory()
    epoch, _ = sighted(1000, ["f-theta"])
    epoch[:2] = np.iinfo(np.int64).min, np.iinfo(np.int64).max
    whole = track.poses_at(epoch)
    assert 0.5 < whole.valid.mean() < 1.0
    for sigmas in (True, False):
        for k, (block, _) in enumerate(track.poses_in_blocks(epoch, 300, sigmas=sigmas)):
            expected: Poses = part(whole, slice(300 * k, 300 * (k + 1)))
            np.testing.assert_array_equal(block.valid, expected.valid)
            np.testing.assert_array_equal(block.reason, expected.reason)
            np.testing.assert_array_equal(block.heading_deg, expected.heading_deg)
            np.testing.assert_array_equal(block.latitude_deg, expected.latitude_deg)
            assert np.isnan(block.sigma_heading_deg).all() != sigmas


def test_sin_cos_are_numpys() -> None:
    """Over three turns, at quarter turns, and NaN for NaN."""
    angle = np.concatenate([np.linspace(-10.0, 10.0, 10_001), np.arange(-4, 5) * np.pi / 2.0, [np.nan]])
    sin, cos = sin_cos(angle)
    np.testing.assert_allclose(sin, np.sin(angle), rtol=0, atol=1e-15)
    np.testing.assert_allclose(cos, np.cos(angle), rtol=0, atol=1e-15)
