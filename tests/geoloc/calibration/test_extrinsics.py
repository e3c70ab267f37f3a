"""Extrinsics of cameras from AprilTags around the car."""

from dataclasses import replace

import numpy as np
import pytest
from yard_scene import MODELS, RIG, WIDE, off, pictures_of

from geoloc.calibration.extrinsics import Pose, Sigmas, Tag, calibrate_extrinsics
from geoloc.calibration.extrinsics.doubts import doubts
from geoloc.calibration.extrinsics.initial_guess import tag_poses
from geoloc.calibration.extrinsics.network import Network, NetworkState
from geoloc.errors import CalibrationError
from geoloc.simulation.pictures.yard import Yard, draw_yard, seen_tags


def without_places(yard: Yard, but: int = 0) -> dict[int, Tag]:
    """Tags of which no place was measured, except of the first few."""
    return {
        i: tag if i < but or tag.on_floor else replace(tag, centre_m=np.full(3, np.nan))
        for i, tag in yard.tags.items()
    }


def test_extrinsics_are_exact_without_noise():
    """Perfect corners and perfect places give back every camera's pose to a micrometre."""
    yard = draw_yard(np.random.default_rng(0), sigma_m=1e-9)
    found = calibrate_extrinsics(MODELS, pictures_of(yard, sigma_px=0.0), yard.tags)
    for camera in RIG.cameras:
        assert np.abs(off(found, camera)).max() < 1e-6
    assert doubts(found) == ()


@pytest.mark.slow
def test_extrinsics_sigmas_hold_over_many_yards():
    """The squared error over its covariance is that of a normal error: NEES / 6 near one."""
    squares = []
    for seed in range(8):
        yard = draw_yard(np.random.default_rng(seed))
        found = calibrate_extrinsics(MODELS, pictures_of(yard, seed), yard.tags)
        for camera, pose in found.cameras.items():
            error = off(found, camera)
            error[:3] = np.radians(error[:3])
            squares.append(error @ np.linalg.solve(pose.covariance, error) / 6.0)
    # Cameras of one yard share its measured places: as uncertain as 8 draws of 6, sigma 0.2.
    assert 0.4 < np.mean(squares) < 1.6


def test_extrinsics_need_no_rough_pose():
    """The start comes from the tags alone: a nominal pose changes nothing in the result."""
    yard = draw_yard(np.random.default_rng(3))
    pictures = pictures_of(yard)
    wrong = {name: Pose(np.eye(3), np.zeros(3)) for name in MODELS}
    alone = calibrate_extrinsics(MODELS, pictures, yard.tags)
    told = calibrate_extrinsics(MODELS, pictures, yard.tags, nominal=wrong)
    assert np.abs(off(alone, WIDE) - off(told, WIDE)).max() < 1e-6


def test_jacobian_equals_finite_differences():
    """Every column of the analytic Jacobian agrees with central differences."""
    yard = draw_yard(np.random.default_rng(4))
    found = calibrate_extrinsics(MODELS, pictures_of(yard), yard.tags)
    sightings = found.sightings[:6]
    tags = {s.tag: yard.tags[s.tag] for s in sightings}
    tags[max(yard.tags)] = yard.tags[max(yard.tags)]
    network = Network(sightings, tags, Sigmas(), dict.fromkeys(MODELS, 0.1))
    state = NetworkState(
        {name: found.state.views[name] for name in network.view_names},
        {tag: found.state.tags[tag] for tag in network.tag_ids},
        scale=0.002,
    )
    jacobian = network.equations(state).jacobian.toarray()
    step = 1e-6
    for column in range(network.n_unknowns):
        move = np.zeros(network.n_unknowns)
        move[column] = step
        ahead, back = (network.equations(network.moved(state, sign * move)).residual for sign in (1.0, -1.0))
        # A view seen sideways changes by second order in the ray's difference: rays are not planes.
        assert jacobian[:-1, column] == pytest.approx((ahead - back)[:-1] / (2.0 * step), rel=2e-3, abs=0.2)


def test_tag_pose_is_among_the_two_of_its_square():
    """One of the two poses that fit a square's four rays is the true one."""
    yard = draw_yard(np.random.default_rng(5))
    found = calibrate_extrinsics(MODELS, pictures_of(yard, sigma_px=0.0), yard.tags)
    for sighting in found.sightings:
        true, camera = yard.poses[sighting.tag], RIG.cameras[sighting.camera]
        place = camera.rig_R_camera.T @ (true.t_m - camera.rig_t_camera_m)
        assert min(np.linalg.norm(p.t_m - place) for p in tag_poses(sighting)) < 1e-3


def test_tags_without_a_place_tie_cameras_together():
    """Four measured tags are enough for all cameras when free tags are shared."""
    yard = draw_yard(np.random.default_rng(6))
    tags = without_places(yard, but=4)
    found = calibrate_extrinsics(MODELS, pictures_of(yard), tags)
    for camera in RIG.cameras:
        assert np.abs(off(found, camera)[:3]).max() < 0.1
        assert np.abs(off(found, camera)[3:]).max() < 0.02


def test_carried_camera_brings_a_tag_behind_the_car_into_the_frame():
    """Pictures of a camera that was carried around tie tags that no camera on the car sees."""
    yard = draw_yard(np.random.default_rng(7))
    behind = Pose(np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([-2.0, 0.3, 1.0]))
    poses = {**yard.poses, 100: behind}
    tags = {**yard.tags, 100: Tag(100, 0.6)}
    model = MODELS[WIDE]
    eye = np.array([1.0, 9.0, 1.6])
    look = np.array([2.0, -9.0, -0.8])
    forward = look / np.linalg.norm(look)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    carried = replace(
        RIG.cameras[WIDE],
        rig_R_camera=np.stack([right, np.cross(forward, right), forward], axis=1),
        rig_t_camera_m=eye,
    )
    everything = Yard(tags, {k: replace(p, R=p.R) for k, p in poses.items()})
    rng = np.random.default_rng(8)
    hand = replace(seen_tags(everything, carried, rng), camera="hand", on_car=False, name="a.png")
    assert len(hand.tag_ids) >= 2
    found = calibrate_extrinsics({**MODELS, "hand": model}, [*pictures_of(yard), hand], tags)
    assert np.linalg.norm(found.state.views["hand/a.png"].t_m - eye) < 0.02
    if 100 in found.state.tags:
        assert np.linalg.norm(found.state.tags[100].t_m - behind.t_m) < 0.05


def test_wrong_size_is_named_with_its_factor():
    """Tags printed 3 % smaller than the layout says are told as 3 % smaller."""
    yard = draw_yard(np.random.default_rng(9))
    tags = {i: replace(t, size_m=t.size_m * 1.03) for i, t in yard.tags.items()}
    found = calibrate_extrinsics(MODELS, pictures_of(yard), tags)
    told = " ".join(doubts(found))
    assert "2.9 % smaller" in told or "3.0 % smaller" in told or "2.8 % smaller" in told


def test_slip_of_the_tape_is_named_and_left_out():
    """A place that is 10 cm wrong is told by its tag, and the cameras stay where they are."""
    yard = draw_yard(np.random.default_rng(10))
    slip = yard.tags[3].centre_m + np.array([0.1, 0.0, 0.0])
    tags = {**yard.tags, 3: replace(yard.tags[3], centre_m=slip)}
    found = calibrate_extrinsics(MODELS, pictures_of(yard), tags)
    assert list(found.misplaced) == [3]
    assert found.misplaced[3] == pytest.approx(0.1, abs=0.01)
    assert any(text.startswith(f"Tag 3 stands {found.misplaced[3]:.3f} m") for text in doubts(found))
    assert np.abs(off(found, WIDE)[:3]).max() < 0.03


def test_leaning_floor_is_named_and_not_used():
    """Half a degree of slope under the floor tags is found, and does not turn the cameras."""
    yard = draw_yard(np.random.default_rng(11), floor_lean_deg=0.5)
    found = calibrate_extrinsics(MODELS, pictures_of(yard), yard.tags)
    assert found.floor is not None
    assert found.floor.leans
    assert found.floor.lean_deg == pytest.approx(0.5, abs=0.1)
    assert any("floor leans by 0." in text for text in doubts(found))
    assert np.abs(off(found, WIDE)[:3]).max() < 0.03


def test_bump_under_a_floor_tag_is_named():
    """A floor tag on a 3 cm board is told by its height, and does not count as floor."""
    yard = draw_yard(np.random.default_rng(12))
    tag = next(i for i, t in yard.tags.items() if t.on_floor) + 7
    high = replace(yard.poses[tag], t_m=yard.poses[tag].t_m + np.array([0.0, 0.0, 0.03]))
    found = calibrate_extrinsics(
        MODELS, pictures_of(replace(yard, poses={**yard.poses, tag: high})), yard.tags
    )
    assert found.bumps[tag] == pytest.approx(0.03, abs=0.005)
    assert any(f"tag {tag} at +" in text for text in doubts(found))


def test_moved_tag_is_left_out_of_that_picture():
    """A tag that stood elsewhere for one camera is told, and left out there alone."""
    yard = draw_yard(np.random.default_rng(14))
    pictures = pictures_of(yard)
    corners = pictures[0].corners_px.copy()
    corners[2] += 15.0
    pictures[0] = replace(pictures[0], corners_px=corners)
    found = calibrate_extrinsics(MODELS, pictures, yard.tags)
    tag = int(pictures[0].tag_ids[2])
    assert any(text.startswith(f"Tag {tag} does not fit in 1 of") for text in doubts(found))
    assert int((~found.used).sum()) == 1


def test_bent_tag_is_named():
    """A tag that is bent by 3 cm fits no flat square, and is told."""
    yard = draw_yard(np.random.default_rng(15))
    pictures = pictures_of(yard)
    tag, camera = int(pictures[0].tag_ids[1]), RIG.cameras[pictures[0].camera]
    bent = yard.tags[tag].corners_m() + np.outer([1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.03])
    pose = yard.poses[tag]
    changed = []
    for picture in pictures:
        camera = RIG.cameras[picture.camera]
        corners = picture.corners_px.copy()
        for row in np.flatnonzero(picture.tag_ids == tag):
            points = bent @ pose.R.T + pose.t_m
            corners[row] = camera.model.pixel_from_camera_point(
                (points - camera.rig_t_camera_m) @ camera.rig_R_camera
            )[0]
        changed.append(replace(picture, corners_px=corners))
    found = calibrate_extrinsics(MODELS, changed, yard.tags)
    assert any(text.startswith(f"Tag {tag} ") for text in doubts(found))
    assert np.abs(off(found, WIDE)[:3]).max() < 0.03


def test_floor_tags_alone_leave_yaw_and_place_open():
    """Without a measured place nothing says which way the car looks: told, with the cure."""
    yard = draw_yard(np.random.default_rng(16))
    found = calibrate_extrinsics(MODELS, pictures_of(yard), without_places(yard))
    told = [text for text in doubts(found) if "not determined" in text]
    assert len(told) == len(RIG.cameras)
    assert all("yaw, x, y are not determined" in text for text in told)


def test_tag_that_is_there_twice_is_refused():
    """Two tags of one id in a picture cannot be told apart: refused by name."""
    yard = draw_yard(np.random.default_rng(17))
    pictures = pictures_of(yard)
    ids = pictures[0].tag_ids.copy()
    ids[1] = ids[0]
    pictures[0] = replace(pictures[0], tag_ids=ids)
    with pytest.raises(CalibrationError, match=rf"{pictures[0].name} shows tag {ids[0]} twice"):
        calibrate_extrinsics(MODELS, pictures, yard.tags)


def test_pictures_without_a_known_tag_are_refused():
    """Tags that the layout does not name are no tags."""
    yard = draw_yard(np.random.default_rng(18))
    with pytest.raises(CalibrationError, match="No camera on the car sees a tag"):
        calibrate_extrinsics(MODELS, pictures_of(yard), {500: Tag(500, 0.6)})


@pytest.mark.parametrize("factor", [1.02, 0.98])
def test_one_tag_of_another_size_is_named_with_it(factor: float) -> None:
    """A tag that was printed 2 % off is told by its own size, and not as moved, bent or badly measured."""
    yard = draw_yard(np.random.default_rng(3))
    printed = {**yard.tags, 9: replace(yard.tags[9], size_m=factor * yard.tags[9].size_m)}
    found = calibrate_extrinsics(MODELS, pictures_of(Yard(printed, yard.poses), 5), yard.tags)
    (told,) = doubts(found)
    assert f"Tag 9 does not fit as stated, and fits with a black square of {0.6 * factor:.3f} m" in told
    for camera in RIG.cameras:
        assert np.abs(off(found, camera)[:3]).max() < 0.01
