"""Cameras against objects at known positions."""

import numpy as np
import pytest

from geoloc.calibration.verify_mounting import KnownSightings, camera_turns, mounting_part, rig_turned, turned
from geoloc.simulation.car import simulated_rig

RIG = simulated_rig()
WIDE = "C3_tricam120"


def sightings(turn_deg: tuple[float, float, float], seed: int = 0, sigma_px: float = 0.5) -> KnownSightings:
    """Nine poles seen by a wide camera that is turned away from the rig file."""
    rng = np.random.default_rng(seed)
    place = np.column_stack([rng.uniform(7.0, 25.0, 9), rng.uniform(-6.0, 6.0, 9), np.zeros(9)])
    points = np.repeat(place, 20, axis=0)
    camera = turned(RIG.cameras[WIDE], *turn_deg)
    pixel, seen = camera.model.pixel_from_camera_point((points - camera.rig_t_camera_m) @ camera.rig_R_camera)
    assert seen.all()
    return KnownSightings(
        camera=np.full(len(points), WIDE),
        pixel_px=pixel + rng.normal(scale=sigma_px, size=pixel.shape),
        rig_point_m=points,
        object=np.repeat(np.arange(9), 20),
    )


def test_turn_of_a_camera_is_found_about_each_axis() -> None:
    """Pitch, yaw and roll come back with their signs, to a hundredth of a degree."""
    found = camera_turns(RIG, sightings((0.30, -0.20, 0.15)))[WIDE]
    assert (found.pitch_deg, found.yaw_deg, found.roll_deg) == pytest.approx((0.30, -0.20, 0.15), abs=0.02)
    assert found.after_px < 1.0 < found.before_px


def test_positive_pitch_looks_further_up() -> None:
    """A camera turned by positive pitch sees a point lower in its picture: rows grow downwards."""
    point = np.array([[10.0, 0.0, 1.0]])

    def row(pitch: float) -> float:
        camera = turned(RIG.cameras[WIDE], pitch, 0.0, 0.0)
        return float(
            camera.model.pixel_from_camera_point((point - camera.rig_t_camera_m) @ camera.rig_R_camera)[0][
                0, 1
            ]
        )

    assert row(1.0) > row(0.0)


def test_corrected_rig_leaves_nothing_to_find() -> None:
    """With the rig turned as advised the same sightings ask for no further turn."""
    known = sightings((0.4, 0.4, -0.2))
    again = camera_turns(rig_turned(RIG, camera_turns(RIG, known)), known)[WIDE]
    # The prior of the roll pulls once more, by its own small part.
    assert max(abs(again.pitch_deg), abs(again.yaw_deg), abs(again.roll_deg)) < 2e-3


def test_slips_of_the_annotator_do_not_turn_the_camera() -> None:
    """A fifth of the pixels 60 px off leaves the turn within a few hundredths of a degree."""
    known = sightings((0.2, 0.1, 0.0))
    wrong = known.pixel_px.copy()
    wrong[::5, 1] += 60.0
    found = camera_turns(RIG, KnownSightings(known.camera, wrong, known.rig_point_m, known.object))[WIDE]
    assert (found.pitch_deg, found.yaw_deg) == pytest.approx((0.2, 0.1), abs=0.05)


def test_sigma_counts_objects_and_not_sightings() -> None:
    """When each object's place is wrong by 5 cm, sigmas over many draws cover the true turn."""
    inside = 0
    for seed in range(40):
        known = sightings((0.0, 0.0, 0.0), seed, sigma_px=0.2)
        shift = np.random.default_rng(100 + seed).normal(scale=0.05, size=(9, 3)) * [1.0, 1.0, 0.0]
        moved = known.rig_point_m + np.repeat(shift, 20, axis=0)
        found = camera_turns(RIG, KnownSightings(known.camera, known.pixel_px, moved, known.object))[WIDE]
        inside += abs(found.yaw_deg) < 2.0 * found.sigma_yaw_deg
    # 95 % of a normal error; nine objects make the sigma itself uncertain.
    assert inside >= 32


def test_camera_with_too_few_sightings_is_left_alone() -> None:
    """Two sightings are no ground to turn a camera."""
    known = sightings((0.3, 0.0, 0.0))
    few = KnownSightings(known.camera[:2], known.pixel_px[:2], known.rig_point_m[:2], known.object[:2])
    assert camera_turns(RIG, few) == {}


AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
RIGHT = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])


def test_common_turn_is_shared_out_as_cameras_drives_and_noise_vary() -> None:
    """Over drawn rigs what is left of the mounting is as small, and helps as often, as is promised."""
    rng, cameras = np.random.default_rng(4), np.array([AHEAD, RIGHT, AHEAD])
    mounting, noise = 0.2, np.array([0.03, 0.02, 0.05])
    drive_sigma = np.array([1.2, 0.15, 0.3])
    squares, nearer, chances, left, before = [], [], [], [], []
    for _ in range(300):
        own = rng.normal(scale=mounting, size=(3, 3))
        drive = rng.normal(size=3) * drive_sigma
        # Four fifths of each camera's noise are in all of them.
        both, alone = rng.normal(size=3), rng.normal(size=(3, 3))
        seen = own + drive + noise[:, np.newaxis] * (np.sqrt(0.8) * both + np.sqrt(0.2) * alone)
        found = mounting_part(
            cameras,
            np.einsum("nji,nj->ni", cameras, seen),
            noise[:, np.newaxis, np.newaxis] ** 2 * np.eye(3),
            drive_sigma,
            mounting,
        )
        true = np.einsum("nji,nj->ni", cameras, own)
        off = true - found.turn_deg
        squares += [o @ np.linalg.solve(c, o) / 3.0 for o, c in zip(off, found.covariance_deg2, strict=True)]
        nearer += (np.linalg.norm(off, axis=1) < np.linalg.norm(true, axis=1)).tolist()
        chances += found.chance.tolist()
        left.append(np.square(np.einsum("nij,nj->ni", cameras, off)))
        before.append(np.square(own))
    # The differences of three cameras tell two thirds of the variance even where the drive knows nothing.
    assert np.mean(squares) == pytest.approx(1.0, abs=0.1)
    assert np.mean(nearer) == pytest.approx(np.mean(chances), abs=0.04)
    rms, as_it_was = (np.sqrt(np.mean(values, axis=(0, 1))) for values in (left, before))
    assert (rms < as_it_was * [0.65, 0.5, 0.6]).all()


def test_turn_of_one_camera_alone_is_weighed_against_the_drive() -> None:
    """Of 0.3° of pitch the camera gets its variance's share: 0.2² beside the drive's and the noise's."""
    turn, noise = np.array([[0.3, 0.0, 0.0]]), 0.02**2 * np.eye(3)[np.newaxis]
    for sigma in (0.01, 0.2, 2.0):
        found = mounting_part(AHEAD[np.newaxis], turn, noise, np.full(3, sigma))
        share = 0.04 / (0.04 + sigma**2 + 0.0004)
        assert found.turn_deg[0] == pytest.approx([0.3 * share, 0.0, 0.0], abs=1e-9)
        assert found.covariance_deg2[0, 0, 0] == pytest.approx(0.04 * (1.0 - share), rel=1e-9)


def test_three_objects_do_not_make_sigmas_of_nothing() -> None:
    """Three poles each surveyed 3 cm off: over 60 draws the turns are off by about what their sigmas say."""
    squares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        place = np.column_stack([[8.0, 11.0, 18.0], rng.uniform(-3.0, 3.0, 3), np.zeros(3)])
        points = np.repeat(place, 30, axis=0)
        camera = RIG.cameras[WIDE]
        pixel, _ = camera.model.pixel_from_camera_point(
            (points - camera.rig_t_camera_m) @ camera.rig_R_camera
        )
        survey = np.repeat(rng.normal(scale=0.03, size=(3, 3)) * [1.0, 1.0, 0.0], 30, axis=0)
        known = KnownSightings(
            np.full(90, WIDE),
            pixel + rng.normal(scale=1.0, size=pixel.shape),
            points + survey,
            np.repeat(np.arange(3), 30),
        )
        found = camera_turns(RIG, known)[WIDE]
        turn = np.array([found.pitch_deg, found.yaw_deg, found.roll_deg])
        squares.append(turn @ np.linalg.solve(np.array(found.covariance_deg2), turn) / 3.0)
    assert 0.25 < np.mean(squares) < 1.5
