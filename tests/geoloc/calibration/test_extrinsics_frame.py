"""Where the rig frame comes from: wheels and floor, corners of a board, coordinates measured one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from yard_scene import MODELS, RIG, WIDE, off, pictures_of

from geoloc.calibration.extrinsics import Pose, Tag, TagPicture, calibrate_extrinsics
from geoloc.calibration.extrinsics.doubts import doubts
from geoloc.errors import CalibrationError
from geoloc.rig.rig import RigCamera
from geoloc.simulation.pictures.yard import Yard, draw_yard, seen_tags

TRACK_M, RADIUS_M = 1.58, 0.33


def looking(eye: np.ndarray, at: np.ndarray) -> RigCamera:
    """The wide camera held level at a place, looking at another."""
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward], axis=1)
    return replace(RIG.cameras[WIDE], rig_R_camera=turn, rig_t_camera_m=eye)


def with_hubs(yard: Yard) -> Yard:
    """The yard with a tag on each rear wheel's hub, measured by the car's drawing: track and radius."""
    tags, poses = dict(yard.tags), dict(yard.poses)
    for number, side in ((101, 1.0), (102, -1.0)):
        into, down = np.array([0.0, -side, 0.0]), np.array([0.0, 0.0, -1.0])
        place = np.array([0.0, side * TRACK_M / 2.0, RADIUS_M])
        poses[number] = Pose(np.stack([np.cross(down, into), down, into], axis=1), place)
        tags[number] = Tag(number, 0.3, place, 0.0005)
    return Yard(tags, poses)


def carried(yard: Yard) -> list[TagPicture]:
    """Pictures of a camera that is carried around: on either side one of the wheel and the tags ahead."""
    rng, found = np.random.default_rng(1), []
    for side in (1.0, -1.0):
        for x in (-1.5, -0.5):
            camera = looking(np.array([x, 3.2 * side, 1.5]), np.array([6.0, -0.8 * side, 0.7]))
            name = f"{side:+.0f}{x:+.1f}.png"
            found.append(replace(seen_tags(yard, camera, rng), camera="hand", on_car=False, name=name))
    return found


def test_wheel_hubs_and_floor_tags_give_the_rig_frame() -> None:
    """Two hubs and a floor, and no other measured place: every camera to 0.1 degrees and 1 cm."""
    yard = with_hubs(draw_yard(np.random.default_rng(21)))
    free = {
        i: tag if tag.on_floor or i > 100 else replace(tag, centre_m=np.full(3, np.nan))
        for i, tag in yard.tags.items()
    }
    hand = carried(yard)
    assert {101, 102} <= {tag for picture in hand for tag in picture.tag_ids.tolist()}
    pictures = pictures_of(yard, 2)
    found = calibrate_extrinsics({**MODELS, "hand": MODELS[WIDE]}, [*pictures, *hand], free)
    for camera in RIG.cameras:
        assert np.abs(off(found, camera)[:3]).max() < 0.1
        assert np.abs(off(found, camera)[3:]).max() < 0.01
    assert doubts(found) == ()


def test_corners_of_one_tag_give_the_rig_frame() -> None:
    """Three measured corners of one lying tag settle what its middle alone leaves open."""
    yard = draw_yard(np.random.default_rng(22))
    lying = next(i for i, tag in yard.tags.items() if tag.on_floor and i == 30)
    corners = yard.tags[lying].corners_m()[:3]
    pose = yard.poses[lying]
    measured = Tag(
        lying, 0.6, centre_sigma_m=1e-4, marks_m=corners, mark_places_m=corners @ pose.R.T + pose.t_m
    )
    picture = seen_tags(yard, RIG.cameras[WIDE], np.random.default_rng(3), sigma_px=0.0)
    found = calibrate_extrinsics(MODELS, [picture], {lying: measured})
    assert np.abs(off(found, WIDE)[:3]).max() < 1e-3
    assert np.abs(off(found, WIDE)[3:]).max() < 1e-4
    middle = Tag(lying, 0.6, pose.t_m, 1e-4, on_floor=True)
    alone = calibrate_extrinsics(MODELS, [picture], {lying: middle})
    assert any("yaw" in text and "not determined" in text for text in doubts(alone))


def test_slip_of_the_tape_at_a_corner_is_named() -> None:
    """A corner that is 10 cm wrong is told by its tag, as a wrong middle is."""
    yard = draw_yard(np.random.default_rng(23))
    tag, pose = yard.tags[3], yard.poses[3]
    corner = tag.corners_m()[1:2]
    wrong = corner @ pose.R.T + pose.t_m + [0.0, 0.1, 0.0]
    tags = {**yard.tags, 3: replace(tag, marks_m=corner, mark_places_m=wrong)}
    pictures = pictures_of(yard, 4)
    found = calibrate_extrinsics(MODELS, pictures, tags)
    assert list(found.misplaced) == [3]
    assert found.misplaced[3] == pytest.approx(0.1, abs=0.01)


def test_single_coordinates_need_no_rough_pose() -> None:
    """Tags of which one or two coordinates were measured are enough, where no camera's place is known."""
    yard = draw_yard(np.random.default_rng(24))
    shown = {0: [0, 1], 5: [1, 2], 8: [0, 2], 10: [0, 1, 2], 12: [2], 20: [0, 1]}
    tags = {i: replace(tag, on_floor=False, centre_m=np.full(3, np.nan)) for i, tag in yard.tags.items()}
    for i, axes in shown.items():
        centre = np.full(3, np.nan)
        centre[axes] = yard.tags[i].centre_m[axes]
        tags[i] = replace(tags[i], centre_m=centre, centre_sigma_m=0.001)
    pictures = pictures_of(yard, 5)
    found = calibrate_extrinsics(MODELS, pictures, tags)
    assert np.abs(off(found, WIDE)[:3]).max() < 0.1
    assert np.abs(off(found, WIDE)[3:]).max() < 0.02
    assert found.misplaced == {}


def test_tags_alike_are_told_as_weak() -> None:
    """One camera that sees three small tags side by side far away is told to be weakly determined."""
    yard = draw_yard(np.random.default_rng(25))
    far = {i: replace(yard.tags[i], centre_sigma_m=0.005) for i in (17, 18, 19)}
    pictures = [seen_tags(yard, RIG.cameras[WIDE], np.random.default_rng(6))]
    told = " ".join(doubts(calibrate_extrinsics(MODELS, pictures, far)))
    assert f"{WIDE}: " in told
    assert "weakly determined" in told
    assert "its tags are too few or too alike" in told


def test_pictures_that_do_not_fit_are_refused_by_camera() -> None:
    """A camera that saw one tag, half covered, ends it: the sentence names that camera."""
    yard = draw_yard(np.random.default_rng(26))
    covered, *others = pictures_of(yard, 7)
    corners = covered.corners_px[:1].copy()
    corners[0, 0] += 15.0
    covered = replace(covered, tag_ids=covered.tag_ids[:1], corners_px=corners)
    with pytest.raises(CalibrationError, match=rf"corners of {covered.camera} are off by \d+\.\d px"):
        calibrate_extrinsics(MODELS, [covered, *others], yard.tags)


def test_lean_is_told_where_floor_tags_lie_close_together() -> None:
    """The car stands on the floor too: half a degree shows in tags a metre from one another, 4 m ahead."""
    yard = draw_yard(np.random.default_rng(28), floor_lean_deg=0.5)
    near = {i: tag for i, tag in yard.tags.items() if not tag.on_floor or 3.9 < yard.poses[i].t_m[0] < 5.9}
    pictures = pictures_of(yard, 9)
    found = calibrate_extrinsics(MODELS, pictures, near)
    assert found.floor is not None
    assert found.floor.lean_deg == pytest.approx(0.5, abs=0.1)
    assert found.bumps == {}
    assert any("The floor leans by 0." in text for text in doubts(found))
