"""The joint adjustment: laws of its equations, and truth recovered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import FloatArray, Recording, length, recorded
from scipy.sparse import vstack

from geoloc.adjustment.build_model import Placed, model_of, scene_of
from geoloc.adjustment.covariance import spread
from geoloc.adjustment.model import Model
from geoloc.adjustment.result import AdjustmentDoubt
from geoloc.adjustment.scene import bodies_at, lasting_m2, rays_of
from geoloc.adjustment.solve import solve
from geoloc.adjustment.unknowns import Layout, Prior, prior_of
from geoloc.cameras.base import CameraModel
from geoloc.cameras.nominal import LensSigmas, NominalLens
from geoloc.earth.geodesy import enu_offset
from geoloc.locate.combine import combine
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import ErrorBudget, locate_single_frame
from geoloc.trajectory.poses import LastingRoll
from geoloc.trajectory.trajectory import PoseTrack, trajectory_from_poses


def single_frame_errors(recording: Recording) -> FloatArray:
    """Errors of single frames, combined."""
    poses = recording.trajectory.poses_at(recording.epoch_ns)
    sightings = Sightings(recording.camera, recording.pixel_px)
    combined = combine(locate_single_frame(recording.drive.rig, sightings, poses), recording.object)
    truth = recording.drive.objects
    east, north = enu_offset(
        truth.latitude_deg[combined.group],
        truth.longitude_deg[combined.group],
        combined.latitude_deg,
        combined.longitude_deg,
    )
    return np.hypot(east, north)


def problem(recording: Recording) -> tuple[Model, Prior]:
    """The model of a recording before it is solved."""
    sightings = Sightings(recording.camera, recording.pixel_px)
    rays = rays_of(recording.drive.rig, sightings)
    bodies, _ = bodies_at(recording.trajectory, recording.epoch_ns)
    rows = np.flatnonzero(rays.rejected == "")
    objects, point = np.unique(recording.object[rows], return_inverse=True)
    feet = np.ones(objects.size, dtype=bool)
    sigma = np.full(recording.camera.size, 1.5)
    placed = Placed(rows, point, objects, feet, recording.epoch_ns, bodies, rays, sigma)
    scene = scene_of(recording.drive.rig, recording.camera, placed, ErrorBudget())
    return model_of(scene, recording.trajectory, ErrorBudget(), 0.02)


# -- the equations -----------------------------------------------------------------------------------------


def test_derivatives_of_rays_and_ground_equal_finite_differences() -> None:
    """Every analytic derivative agrees with a central difference, away from zero corrections too."""
    model, _ = problem(recorded("approach"))
    rng = np.random.default_rng(3)
    x = rng.normal(size=model.layout.size) * 1e-3
    for part in (model.rays, model.heights):
        linear = part(x)
        dense = np.zeros((linear.residual.size, model.layout.size))
        np.add.at(dense, (np.arange(len(dense))[:, None], linear.column), linear.derivative)
        for unknown in range(model.layout.size):
            step = np.zeros_like(x)
            step[unknown] = 1e-6
            numeric = (part(x + step).residual - part(x - step).residual) / 2e-6
            scale = max(1.0, np.abs(numeric).max())
            np.testing.assert_allclose(dense[:, unknown], numeric, atol=3e-5 * scale)


def test_error_that_grows_adds_to_what_was_there() -> None:
    """Errors of a standing car keep their sigmas, and the later one is the earlier one and something new."""
    sigma = np.array([0.1, 0.2, 0.15])
    prior = prior_of(
        Layout(0, 0, sigma.size, 1),
        ErrorBudget(),
        np.zeros(sigma.size),
        np.repeat(sigma[:, None], 8, axis=1),
        LastingRoll(),
        0.03,
        np.zeros(1, dtype=np.int64),
        np.ones((1, 3)),
        np.empty((0, 4)),
    )
    layout = Layout(0, 0, sigma.size, 1)
    rows = np.zeros((prior.constant.size, layout.size))
    np.add.at(rows, (prior.row, prior.column), prior.value)
    roll = layout.node(np.arange(sigma.size))[:, 0]
    covariance = np.linalg.inv(rows.T @ rows)[np.ix_(roll, roll)]
    np.testing.assert_allclose(np.diag(covariance), sigma**2, rtol=1e-6)
    smaller = np.minimum(sigma[:-1], sigma[1:])
    np.testing.assert_allclose(np.diag(covariance, 1), smaller**2, rtol=1e-6)


def test_residual_is_the_difference_of_pixels() -> None:
    """To first order the residual of a ray is the pixel that was seen minus the one expected, in sigmas."""
    recording = recorded("approach", ins=True, silent=True)
    moved = recording._replace(pixel_px=recording.pixel_px + np.array([2.0, -1.0]))
    model, _ = problem(recording)
    other, _ = problem(moved)
    other = replace(
        other,
        scene=replace(other.scene, start_m=model.scene.start_m, anchor_deg=model.scene.anchor_deg),
        origin_m=model.origin_m,
    )
    change = other.ray_residuals(np.zeros(other.layout.size)) - model.ray_residuals(
        np.zeros(model.layout.size)
    )
    np.testing.assert_allclose(change * 1.5, np.tile([-2.0, 1.0], (len(change), 1)), atol=0.03)


def waiting(recording: Recording) -> Recording:
    """The car stands on, and 100 s later the same feet are marked again, as other objects."""
    later, step = 100_000_000_000, 500_000_000
    poses = recording.drive.poses
    stands = poses.epoch_ns >= recording.epoch_ns.min() - step
    again = poses.epoch_ns[stands] + later
    idle = np.arange(poses.epoch_ns[-1] + step, again[0], step)
    names = ("latitude_deg", "longitude_deg", "height_m", "roll_deg", "pitch_deg", "heading_deg")
    columns = {}
    for name in names:
        value = getattr(poses, name)
        columns[name] = np.concatenate([value, np.repeat(value[-1:], idle.size), value[stands]])
    size = poses.epoch_ns.size + idle.size + again.size
    track = PoseTrack(
        epoch_ns=np.concatenate([poses.epoch_ns, idle, again]),
        **columns,
        sigma_horizontal_m=np.full(size, 0.02),
        sigma_vertical_m=np.full(size, 0.03),
        sigma_roll_pitch_deg=np.full(size, 0.5),
        sigma_heading_deg=np.full(size, 0.3),
    )
    return Recording(
        recording.drive,
        trajectory_from_poses(track),
        np.tile(recording.camera, 2),
        np.tile(recording.pixel_px, (2, 1)),
        np.concatenate([recording.object, recording.object + 100]),
        np.concatenate([recording.epoch_ns, recording.epoch_ns + later]),
    )


def in_two_halves(recording: Recording) -> Recording:
    """The same drive, its second half 300 s later, with other objects: nothing was marked meanwhile."""
    later = 300_000_000_000
    poses = recording.drive.poses
    middle = poses.epoch_ns[poses.epoch_ns.size // 2]
    n = poses.epoch_ns.size
    track = replace(
        poses,
        epoch_ns=poses.epoch_ns + np.where(poses.epoch_ns > middle, later, 0),
        sigma_horizontal_m=np.full(n, 0.02),
        sigma_vertical_m=np.full(n, 0.03),
        sigma_roll_pitch_deg=np.full(n, 0.5),
        sigma_heading_deg=np.full(n, 0.3),
    )
    epoch = recording.epoch_ns + np.where(recording.epoch_ns > middle, later, 0)
    whole = recording._replace(trajectory=trajectory_from_poses(track), epoch_ns=epoch)
    valid = whole.trajectory.poses_at(epoch).valid
    seen_before = np.unique(recording.object[recording.epoch_ns <= middle])
    tied = np.isin(recording.object, seen_before) & (recording.epoch_ns > middle)
    return whole.rows(valid & ~tied)


@pytest.mark.parametrize("name", ["approach", "sample", "sample in two halves", "still waiting"])
def test_covariance_and_its_sources_equal_those_of_the_dense_inverse(name: str) -> None:
    """Solving far points in one column gives what the whole inverse gives, source by source.

    Also where the car stands meanwhile: its errors do not fade then, however long it waits.
    """
    recording = recorded(name.split(maxsplit=1)[0])
    recording = recording.rows(np.arange(0, recording.camera.size, 3 if name == "approach" else 9))
    later = {"sample in two halves": in_two_halves, "still waiting": waiting}
    model, prior = problem(later[name](recording) if name in later else recording)
    solution = solve(model, prior)
    found = spread(model, solution)
    equations = solution.equations
    rows = vstack([solution.system.jacobian, equations.fixed, *equations.ground(solution.x)]).toarray()
    dense = np.linalg.inv(rows.T @ rows)
    assert np.isfinite(dense).all()
    for point in range(model.layout.n_points):
        places = equations.place[model.layout.point(np.array(point))]
        exact = dense[np.ix_(places, places)]
        np.testing.assert_allclose(found.covariance_m2[point], exact, atol=2e-4 * exact.max())
        for source in np.unique(prior.source):
            rows = equations.fixed[np.flatnonzero(prior.source == source)].toarray() @ dense[:, places]
            part = found.by_source[str(source)][point]
            np.testing.assert_allclose(part, rows.T @ rows, atol=2e-4 * exact.max())


def test_sources_add_up_to_the_covariance() -> None:
    """The error budget is a partition: its parts sum to the covariance, and each is a covariance."""
    adjusted = recorded("urban").adjusted()
    np.testing.assert_allclose(np.sum(list(adjusted.by_source.values()), axis=0), adjusted.covariance_m2)
    for part in adjusted.by_source.values():
        assert np.linalg.eigvalsh(part).min() > -1e-9


def test_height_is_no_surer_than_the_track_above_which_it_was_found() -> None:
    """What lifts all fixes of a drive, or its antennas on the roof, lifts all objects: no ray shows it."""
    recording = recorded("urban")
    fixes_m2 = lasting_m2(np.nanmin(recording.trajectory.knots.sigma_vertical_m), is_fitted=True)
    least_m = np.sqrt(fixes_m2 + ErrorBudget().lever_arm_m ** 2)
    assert (recording.adjusted().sigma_height_m > least_m).all()


def test_order_of_sightings_does_not_matter() -> None:
    """Sightings may come in any order."""
    recording = recorded("urban")
    shuffled = recording.rows(np.random.default_rng(0).permutation(recording.camera.size))
    one, other = recording.adjusted(), shuffled.adjusted()
    np.testing.assert_allclose(one.latitude_deg, other.latitude_deg, atol=1e-9)
    # A thousandth of the smallest variance: some covariances of east and north are next to nothing.
    np.testing.assert_allclose(one.covariance_m2, other.covariance_m2, rtol=0.02, atol=1e-6)


# -- what it finds -----------------------------------------------------------------------------------------


def test_noise_free_drive_gives_the_truth() -> None:
    """Without noise, and with true poses, every foot comes out within millimetres of its place."""
    recording = recorded("urban", ins=True, silent=True)
    error = recording.errors_m(recording.adjusted(pole_radius_m=0.0))
    assert length(error).max() < 0.01


def test_boresight_of_every_camera_is_found() -> None:
    """Mounting errors of 0.2° come out within four sigma, and surer than the calibration was."""
    recording = recorded("highway", 60.0, ins=True)
    adjusted = recording.adjusted()
    for name, corrections in adjusted.boresight_deg.items():
        rotation = recording.drive.rig.camera(name).rig_R_camera
        drawn = rotation.T @ recording.drive.drawn.boresight_deg[name]
        for axis in (0, 1):
            assert abs(corrections[axis].value - drawn[axis]) < 4.0 * corrections[axis].sigma
            assert corrections[axis].sigma < 0.1


def test_rolling_shutter_is_found_at_speed() -> None:
    """A readout of 31 ms shows in near feet of a fast drive, and is told with its sigma."""
    recording = recorded("highway", 80.0, ins=True, row_delay_us=26.0)
    found = recording.adjusted().readout_ms
    assert found.sigma < 8.0
    assert abs(found.value - 26e-3 * 1208) < 3.0 * found.sigma


def test_stated_rolling_shutter_is_kept() -> None:
    """What the drive states is taken off, and hardly moves."""
    recording = recorded("highway", 80.0, ins=True, silent=True, row_delay_us=26.0)
    stated = recording.adjusted(readout_ms=26e-3 * 1208, pole_radius_m=0.0)
    assert stated.readout_ms.value == pytest.approx(26e-3 * 1208, abs=0.5)
    assert stated.readout_ms.sigma < 1.0
    assert length(recording.errors_m(stated)).max() < 0.01


def test_radius_of_the_pole_lies_behind_the_foot_that_is_seen() -> None:
    """The front of a pole 0.2 m thick is seen by a standing car: its middle lies a radius further away."""
    recording = recorded("still", ins=True, silent=True, pole_radius_m=0.1)
    known = recording.errors_m(recording.adjusted(pole_radius_m=0.1))
    unknown = recording.errors_m(recording.adjusted(pole_radius_m=0.0))
    assert length(known)[0] < 0.03
    # Some of the radius is taken for ground that rises: then nobody knows better.
    assert 0.04 < length(known - unknown)[0] < 0.11


def test_clock_offset_is_found_where_the_car_turns() -> None:
    """A camera clock 30 ms late shows in the bends of a street, and moves no position then."""
    recording = recorded("urban", 40.0, ins=True, silent=True)
    late = recording._replace(epoch_ns=recording.epoch_ns + 30_000_000)
    adjusted = late.adjusted(budget=ErrorBudget(time_ms=50.0), pole_radius_m=0.0)
    assert adjusted.time_offset_ms.value == pytest.approx(-30.0, abs=3.0)
    assert adjusted.time_offset_ms.sigma < 25.0
    assert np.median(length(late.errors_m(adjusted))) < 0.05


@pytest.mark.slow
def test_clock_that_cannot_be_is_told() -> None:
    """A clock 200 ms off is found out in a street with bends; an honest one raises no doubt."""
    recording = recorded("urban")
    assert recording.adjusted().doubts == ()
    late = recording._replace(epoch_ns=recording.epoch_ns + 200_000_000)
    adjusted = late.adjusted()
    assert AdjustmentDoubt.CLOCK in {doubt.kind for doubt in adjusted.doubts}
    assert adjusted.time_offset_ms.value == pytest.approx(-200.0, abs=30.0)


@pytest.mark.parametrize(
    ("name", "speed", "median", "worst"),
    [("urban", 25.0, 0.10, 0.30), ("highway", 45.0, 0.12, 0.35), ("approach", 15.0, 0.20, 0.40)],
)
def test_errors_are_a_tenth_of_a_metre(name: str, speed: float, median: float, worst: float) -> None:
    """Positions of a moving car meet the bars, and are better than single frames combined."""
    errors, single = [], []
    for seed in (1, 2, 3):
        recording = recorded(name, speed, seed)
        errors.append(length(recording.errors_m(recording.adjusted())))
        single.append(single_frame_errors(recording))
    error = np.concatenate(errors)
    assert np.median(error) < median
    assert np.percentile(error, 95) < worst
    assert np.median(error) < max(np.median(np.concatenate(single)), median)


# -- lenses that nobody calibrated -------------------------------------------------------------------------

WIDE = "C3_tricam120"


def with_lens(recording: Recording, model: CameraModel, lens: LensSigmas) -> Recording:
    """The wide camera alone, with another lens in the rig than that which took the pictures."""
    camera = replace(recording.drive.rig.camera(WIDE), model=model, lens=lens, ego_mask=None)
    rows = recording.camera == WIDE
    return recording._replace(
        drive=replace(recording.drive, rig=replace(recording.drive.rig, cameras={WIDE: camera})),
        camera=recording.camera[rows],
        pixel_px=recording.pixel_px[rows],
        object=recording.object[rows],
        epoch_ns=recording.epoch_ns[rows],
    )


def test_derivatives_by_the_lens_equal_finite_differences() -> None:
    """So do those of an unknown focal length, centre and distortion."""
    lens = LensSigmas(0.05, 19.0, 0.04)
    recording = recorded("approach")
    rough = with_lens(recording, recording.drive.rig.camera(WIDE).model, lens)
    model, _ = problem(rough)
    assert model.layout.has_lenses
    x = np.random.default_rng(3).normal(size=model.layout.size) * 1e-3
    linear = model.rays(x)
    dense = np.zeros((linear.residual.size, model.layout.size))
    np.add.at(dense, (np.arange(len(dense))[:, None], linear.column), linear.derivative)
    for unknown in model.layout.lens(np.array(0)).tolist():
        step = np.zeros_like(x)
        step[unknown] = 1e-6
        numeric = (model.rays(x + step).residual - model.rays(x - step).residual) / 2e-6
        np.testing.assert_allclose(dense[:, unknown], numeric, atol=1e-4 * np.abs(numeric).max())


@pytest.mark.parametrize("off", [0.95, 1.0, 1.05])
def test_focal_length_that_is_off_is_found_and_what_is_left_is_in_the_ellipses(off: float) -> None:
    """5 % cost metres to a lens that is taken as exact; stated to 6 %, feet lie inside their ellipses."""
    recording = recorded("urban")
    true = recording.drive.rig.camera(WIDE).model
    nominal = NominalLens.of_fov(off * float(np.degrees(true.horizontal_fov_rad)))
    size = true.width_px, true.height_px
    model, lens = nominal.camera(*size), nominal.sigmas(*size)
    rough = with_lens(recording, model, lens)
    adjusted = rough.adjusted()
    placed = np.isfinite(adjusted.latitude_deg)
    error = rough.errors_m(adjusted)[placed]
    squares = np.einsum("ni,nij,nj->n", error, np.linalg.inv(adjusted.covariance_m2[placed]), error)
    assert np.mean(squares < 5.991) >= 0.85
    assert np.median(length(error)) < 0.2
    assert "lens" in adjusted.by_source
    exact = with_lens(recording, model, LensSigmas())
    if off != 1.0:
        assert np.nanmedian(length(exact.errors_m(exact.adjusted()))) > 2.0 * np.median(length(error))
