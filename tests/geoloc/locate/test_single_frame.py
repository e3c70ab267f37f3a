"""Single sightings: closure on known points, and honest covariances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from single_frame_rig import (
    EXACT,
    HEIGHT,
    LAT0,
    LON0,
    NARROW,
    RIG,
    camera,
    feet_in_view,
    metres,
    pixels_of,
    poses_of,
)

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import (
    geographic_from_enu,
    rotation_enu_from_rig,
)
from geoloc.errors import CalibrationError
from geoloc.locate.accuracy import nees
from geoloc.locate.feet import BLOCK
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import ErrorBudget, locate_paper, locate_single_frame
from geoloc.reasons import Reason
from geoloc.rig.rig import RigCamera
from geoloc.trajectory.poses import part


@pytest.mark.parametrize("name", list(RIG.cameras))
@pytest.mark.parametrize("heading", [0.0, 33.0, 135.0, 270.0, 359.9])
def test_foot_of_known_position_is_found_within_a_millimetre(name: str, heading: float) -> None:
    """Projecting feet of the road and locating their pixels closes, also on a tilted road; heights too."""
    one = RIG.cameras[name]
    foot = feet_in_view(one, 50, seed=1)
    poses = poses_of(50, heading_deg=heading, pitch_deg=-3.1, roll_deg=1.4)
    found = locate_single_frame(RIG, Sightings(np.full(50, name), pixels_of(foot, one)), poses)
    truth = foot @ rotation_enu_from_rig(heading, -3.1, 1.4).T
    assert found.valid.all()
    np.testing.assert_allclose(metres(found), truth[:, :2], atol=1e-3)
    np.testing.assert_allclose(found.height_m, HEIGHT + truth[:, 2], atol=1e-3)
    reach = np.linalg.norm((foot - one.rig_t_camera_m)[:, :2], axis=1)
    np.testing.assert_allclose(found.range_m, reach, atol=1e-6)


def test_cameras_may_be_mixed_in_any_order() -> None:
    """Sightings of several cameras give the same positions, row by row, as each camera alone."""
    names = np.array(["wide", "side", "narrow", "wide", "narrow"])
    pixel = np.array([[900, 800], [1000, 700], [950.0, 800], [400, 900], [1200, 900]])
    poses = poses_of(5, heading_deg=70.0, sigma_heading_deg=0.2, sigma_horizontal_m=0.02, speed_mps=12.0)
    mixed = locate_single_frame(RIG, Sightings(names, pixel), poses)
    assert mixed.valid.all()
    for i, name in enumerate(names):
        alone = locate_single_frame(
            RIG,
            Sightings(names[i : i + 1], pixel[i : i + 1]),
            poses_of(1, heading_deg=70.0, sigma_heading_deg=0.2, sigma_horizontal_m=0.02, speed_mps=12.0),
        )
        np.testing.assert_allclose(metres(mixed)[i], metres(alone)[0], atol=1e-8)
        np.testing.assert_allclose(mixed.covariance_m2[i], alone.covariance_m2[0], rtol=1e-9)
        own = [k for k, source in enumerate(mixed.source) if source == f"boresight pitch {name}"]
        assert np.abs(mixed.systematic_m[i, :, own]).max() > 0


def test_sightings_that_cannot_be_located_are_nan_with_a_reason() -> None:
    """Sky, off the image, NaN, the car's own body and a missing pose are each rejected by name."""
    mask = np.zeros((302, 480), dtype=bool)
    mask[280:] = True
    rig = replace(RIG, cameras={"wide": replace(RIG.cameras["wide"], ego_mask=mask)})
    pixel = np.array(
        [[950, 300], [-5, 700], [np.nan, 700], [950, 1190], [950, 800], [950, 548.0], [950, 800]]
    )
    poses = poses_of(7, sigma_heading_deg=0.1)
    poses.valid[4] = False
    poses.reason[4] = Reason.AFTER_LAST_FIX
    for column in ("latitude_deg", "longitude_deg", "height_m", "heading_deg"):
        getattr(poses, column)[4] = np.nan
    found = locate_single_frame(rig, Sightings(np.full(7, "wide"), pixel), poses)
    assert found.rejected.tolist() == [
        Reason.ABOVE_HORIZON,
        Reason.OUTSIDE_CAMERA,
        Reason.OUTSIDE_CAMERA,
        Reason.ON_CAR,
        Reason.AFTER_LAST_FIX,
        Reason.ABOVE_HORIZON,
        "",
    ]
    bad = ~found.valid
    for values in (
        found.latitude_deg,
        found.height_m,
        found.covariance_m2,
        found.systematic_m,
        found.range_m,
    ):
        assert np.isnan(values[bad]).all()
        assert np.isfinite(values[~bad]).all()


def test_feet_beyond_the_range_cap_are_rejected() -> None:
    """A foot at 30 m is located by default and refused with a cap of 25 m."""
    one = RIG.cameras["narrow"]
    pixel = pixels_of(np.array([[one.rig_t_camera_m[0] + 30.0, 0.0, 0.0]]), one)
    sighting = Sightings(np.array(["narrow"]), pixel)
    assert locate_single_frame(RIG, sighting, poses_of(1)).valid.all()
    capped = locate_single_frame(RIG, sighting, poses_of(1), max_range_m=25.0)
    assert capped.rejected.tolist() == [Reason.TOO_FAR]


def test_blocks_of_sightings_are_located_as_each_alone() -> None:
    """Where one block of rows ends and the next begins, two cameras mixed, nothing changes."""
    n = BLOCK + 500
    rng = np.random.default_rng(4)
    pixel = rng.uniform([-5.0, 300.0], [1925.0, 1215.0], (n, 2))
    names = rng.choice(list(RIG.cameras), n)
    poses = poses_of(n, sigma_heading_deg=0.1)
    whole = locate_single_frame(RIG, Sightings(names, pixel), poses)
    assert 0.2 < whole.valid.mean() < 0.9
    rows = slice(BLOCK - 200, BLOCK + 200)
    cut = locate_single_frame(RIG, Sightings(names[rows], pixel[rows]), part(poses, rows))
    for name in ("rejected", "latitude_deg", "longitude_deg", "height_m", "range_m", "covariance_m2"):
        np.testing.assert_array_equal(getattr(whole, name)[rows], getattr(cut, name))


def test_camera_that_the_rig_lacks_is_an_error() -> None:
    """An annotated camera without calibration is a contradiction, not a bad row."""
    with pytest.raises(CalibrationError, match="C9"):
        locate_single_frame(RIG, Sightings(np.array(["C9"]), np.array([[900.0, 800.0]])), poses_of(1))


def test_nothing_to_locate_gives_empty_arrays() -> None:
    """No sightings make no rows."""
    found = locate_single_frame(RIG, Sightings(np.zeros(0, dtype="U4"), np.zeros((0, 2))), poses_of(0))
    assert found.valid.shape == (0,)
    assert found.covariance_m2.shape == (0, 2, 2)


@dataclass(frozen=True)
class _World:
    """A foot, a camera and a car whose true state may differ from what the estimator believes."""

    foot: FloatArray
    one: RigCamera
    heading: float = 50.0
    pitch: float = -1.5
    roll: float = 0.8
    speed: float = 15.0

    def seen(
        self,
        boresight: FloatArray | None = None,
        body: FloatArray | None = None,
        camera_up: float = 0.0,
        foot_up: float = 0.0,
        slope: float = 0.0,
        pixel: FloatArray | None = None,
    ) -> FloatArray:
        """Pixel of the foot under these true deviations (radians, metres, pixels)."""
        rotation, at = self.one.rig_R_camera, self.one.rig_t_camera_m + np.array([0.0, 0.0, camera_up])
        if boresight is not None:
            rotation = rotation @ _turn(boresight)
        point = self.foot + np.array([0.0, 0.0, foot_up + slope * np.hypot(*self.foot[:2])])
        if body is not None:
            point = _turn(body).T @ point
        value, seen = self.one.model.pixel_from_camera_point((point - at) @ rotation)
        assert seen
        return np.asarray(value + (np.zeros(2) if pixel is None else pixel))


def _turn(vector: FloatArray) -> FloatArray:
    """Rotation by a small rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


def _shift(world: _World, pixel: FloatArray, **pose: float) -> FloatArray:
    """Where the estimator puts this pixel, minus where it puts the undisturbed one."""
    state = {
        "heading_deg": world.heading,
        "pitch_deg": world.pitch,
        "roll_deg": world.roll,
        "speed_mps": world.speed,
    }
    names = np.array([world.one.name])
    nominal = locate_single_frame(RIG, Sightings(names, world.seen()[None]), poses_of(1, **state), EXACT)
    moved = locate_single_frame(RIG, Sightings(names, pixel[None]), poses_of(1, **(state | pose)), EXACT)
    return np.asarray((metres(moved) - metres(nominal))[0])


_STEP = 1e-5
_DISTURBED: dict[str, Callable[[_World], FloatArray]] = {
    "boresight pitch": lambda w: w.seen(boresight=np.array([_STEP, 0, 0])),
    "boresight yaw": lambda w: w.seen(boresight=np.array([0, _STEP, 0])),
    "boresight roll": lambda w: w.seen(boresight=np.array([0, 0, _STEP])),
    "camera height": lambda w: w.seen(camera_up=_STEP),
    "ground height": lambda w: w.seen(foot_up=_STEP),
    "ground slope": lambda w: w.seen(slope=_STEP),
}


@pytest.mark.parametrize("source", list(_DISTURBED))
@pytest.mark.parametrize("name", list(RIG.cameras))
def test_systematic_columns_equal_disturbed_projections(name: str, source: str) -> None:
    """Each column is what happens when the world differs by one sigma while the estimator does not know.

    The oracle moves the camera or the ground and projects; a column may have either sign.
    """
    one = RIG.cameras[name]
    world = _World(feet_in_view(one, 1, seed=11, near=9.0, far=12.0)[0], one)
    budget = ErrorBudget(
        ground_height_m=1.0,
        ground_slope_deg=np.degrees(1.0),
        boresight_deg=np.degrees(1.0),
        camera_position_m=1.0,
    )
    poses = poses_of(1, heading_deg=world.heading, pitch_deg=world.pitch, roll_deg=world.roll)
    found = locate_single_frame(RIG, Sightings(np.array([name]), world.seen()[None]), poses, budget)
    label = source if source.startswith("ground") else f"{source} {name}"
    column = found.systematic_m[0, :, found.source.index(label)]
    moved = _shift(world, _DISTURBED[source](world)) / _STEP
    # Feet that rise along the normal of a tilted road move sideways themselves.
    rise = {"ground height": 1.0, "ground slope": float(np.hypot(*world.foot[:2]))}.get(source, 0.0)
    moved -= rise * rotation_enu_from_rig(world.heading, world.pitch, world.roll)[:2, 2]
    assert min(np.abs(column - moved).max(), np.abs(column + moved).max()) < 2e-3 * np.abs(moved).max() + 1e-3


@pytest.mark.parametrize(
    ("source", "pose", "per_unit"),
    [("heading", "heading_deg", 1.0), ("pose pitch", "pitch_deg", 1.0), ("pose roll", "roll_deg", 1.0)],
)
def test_pose_columns_equal_disturbed_poses(source: str, pose: str, per_unit: float) -> None:
    """The columns of heading, pitch and roll are the moves of the point when the pose turns."""
    one = RIG.cameras["wide"]
    world = _World(feet_in_view(one, 1, seed=12)[0], one)
    start = {"heading_deg": world.heading, "pitch_deg": world.pitch, "roll_deg": world.roll}
    poses = poses_of(
        1, **start, sigma_heading_deg=per_unit, sigma_roll_deg=per_unit, sigma_pitch_deg=per_unit
    )
    found = locate_single_frame(RIG, Sightings(np.array(["wide"]), world.seen()[None]), poses)
    column = found.systematic_m[0, :, found.source.index(source)]
    moved = _shift(world, world.seen(), **{pose: start[pose] + 1e-3}) / 1e-3
    assert min(np.abs(column - moved).max(), np.abs(column + moved).max()) < 5e-3 * np.abs(moved).max() + 1e-4


def test_time_moves_the_point_along_the_heading() -> None:
    """5 ms at 15 m/s are 0.075 m along the heading and nothing across."""
    poses = poses_of(1, heading_deg=90.0, speed_mps=15.0)
    found = locate_single_frame(RIG, Sightings(np.array(["wide"]), np.array([[950.0, 800.0]])), poses)
    np.testing.assert_allclose(found.systematic_m[0, :, found.source.index("time")], [0.075, 0.0], atol=1e-12)


def test_range_sigma_of_pitch_is_the_error_budgets() -> None:
    """At 15 m from a camera 1.5 m high, 0.25° of boresight are (d² + h²) / h δ = 0.66 m of range.

    Across the ray they are d δ = 0.065 m.
    """
    level = replace(
        RIG,
        cameras={"level": camera("level", NARROW, (0.0, 0.0, 1.5), (0.0, 0.0, 0.0))},
    )
    pixel = pixels_of(np.array([[15.0, 0.0, 0.0]]), level.cameras["level"])
    budget = replace(EXACT, boresight_deg=0.25)
    found = locate_single_frame(level, Sightings(np.array(["level"]), pixel), poses_of(1), budget)
    assert np.sqrt(found.covariance_m2[0, 1, 1]) == pytest.approx(0.66, abs=0.005)
    assert np.sqrt(found.covariance_m2[0, 0, 0]) == pytest.approx(15.0 * np.radians(0.25), rel=0.01)


@pytest.mark.parametrize("name", ["wide", "narrow"])
def test_predicted_covariance_matches_the_spread_of_located_feet(name: str) -> None:
    """Monte Carlo: with every source drawn at once the NEES averages 2 and the parts are as predicted.

    4 000 draws at 9 to 14 m; the standard error of the mean NEES is 0.032, the tolerance 0.2 leaves room for
    the curvature of the ray's slope (second order).
    """
    one, n = RIG.cameras[name], 4000
    rng = np.random.default_rng(21)
    budget = ErrorBudget(pixel_px=1.0, pitch_jitter_deg=0.08, roll_jitter_deg=0.08, boresight_deg=0.08)
    world = _World(feet_in_view(one, 1, seed=13, near=9.0, far=14.0)[0], one)
    draw = rng.normal(size=(n, 10))
    small = np.radians([budget.pitch_jitter_deg, budget.boresight_deg])
    pixel = np.stack(
        [
            world.seen(
                boresight=small[1] * d[0:3],
                body=small[0] * np.array([d[3], d[4], 0.0]),
                camera_up=budget.camera_position_m * d[5],
                foot_up=0.03 * d[6],
                slope=np.radians(0.1) * d[7],
                pixel=budget.pixel_px * d[8:10],
            )
            for d in draw
        ]
    )
    poses = poses_of(n, pitch_deg=world.pitch, roll_deg=world.roll, speed_mps=world.speed)
    error_pose = rng.normal(size=(n, 6))
    true_offset = 0.02 * error_pose[:, 0:2] + _along(world.heading) * (
        world.speed * budget.time_ms * 1e-3 * error_pose[:, 2:3]
    )
    lever = budget.lever_arm_m * error_pose[:, 3:5] @ np.stack([_along(world.heading), _left(world.heading)])
    lat, lon = geographic_from_enu(LAT0, LON0, *(true_offset + lever).T)
    poses = replace(
        poses,
        latitude_deg=lat,
        longitude_deg=lon,
        heading_deg=world.heading + 0.2 * error_pose[:, 5],
        sigma_horizontal_m=np.full(n, 0.02),
        sigma_heading_deg=np.full(n, 0.2),
    )
    settled = replace(budget, ground_height_m=0.03, ground_slope_deg=0.1, ground_fall=0.0)
    found = locate_single_frame(RIG, Sightings(np.full(n, name), pixel), poses, settled)
    truth = (rotation_enu_from_rig(world.heading, world.pitch, world.roll) @ world.foot)[:2]
    error = metres(found) - truth
    assert nees(error, found.covariance_m2).mean() == pytest.approx(2.0, abs=0.2)
    np.testing.assert_allclose(
        np.cov(error.T), found.covariance_m2.mean(axis=0), rtol=0.12, atol=0.05 * np.cov(error.T).max()
    )


def _along(heading_deg: float) -> FloatArray:
    return np.array([np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))])


def _left(heading_deg: float) -> FloatArray:
    return np.array([-np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))])


def test_covariance_is_random_plus_systematic_squared() -> None:
    """The contract of `Located`, and a covariance that is symmetric and positive definite."""
    pixel = np.random.default_rng(3).uniform([300, 700], [1600, 1100], (200, 2))
    poses = poses_of(200, heading_deg=10.0, speed_mps=10.0, sigma_horizontal_m=0.02, sigma_heading_deg=0.3)
    for found in (
        locate_single_frame(RIG, Sightings(np.full(200, "wide"), pixel), poses),
        locate_paper(RIG, Sightings(np.full(200, "wide"), pixel), poses),
    ):
        s = found.systematic_m
        assert s.shape == (200, 2, len(found.source))
        np.testing.assert_allclose(found.covariance_m2, found.random_m2 + s @ np.swapaxes(s, 1, 2))
        assert (np.linalg.eigvalsh(found.covariance_m2) > 0).all()
