"""The joint adjustment of odd drives: little to go by, wrong pixels, faces instead of feet, a terrain."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import Recording, length, recorded
from simulated_raster import rasterised

from geoloc.adjustment.adjust import adjust
from geoloc.adjustment.result import Adjusted
from geoloc.arrays import BoolArray, FloatArray
from geoloc.earth.geodesy import enu_offset
from geoloc.earth.terrain import Terrain
from geoloc.locate.records import Kind
from geoloc.reasons import Reason
from geoloc.simulation.road import Road


def test_one_frame_of_one_camera_gives_a_position_with_a_wide_ellipse() -> None:
    """A single sighting is solved as well as a single frame can be, along its ray."""
    recording = recorded("approach")
    one = recording.rows(np.flatnonzero(recording.camera == "C3_tricam120")[:1])
    adjusted = one.adjusted()
    assert adjusted.reason[0] == ""
    offset, covariance = one.errors_m(adjusted)[0], adjusted.covariance_m2[0]
    assert offset @ np.linalg.solve(covariance, offset) < 9.2
    assert 0.3 < np.sqrt(np.linalg.eigvalsh(covariance)[1]) < 3.0


def test_standing_still_is_solved_by_the_ground() -> None:
    """A car that stands has no parallax: the ground says how far away the objects are."""
    recording = recorded("still")
    error = recording.errors_m(recording.adjusted())
    assert length(error).max() < 1.0


@pytest.mark.parametrize("antennas", [1, 2])
def test_one_camera_and_one_antenna_are_enough(antennas: int) -> None:
    """A single 120° camera, with or without an antenna baseline, stays within the bars."""
    recording = recorded("urban", antennas=antennas)
    one = recording.rows(recording.camera == "C3_tricam120")
    assert np.median(length(one.errors_m(one.adjusted()))) < 0.2


def test_one_object_alone_is_solved() -> None:
    """A drive with one object has nothing to calibrate by, and still a position."""
    recording = recorded("urban")
    one = recording.rows(recording.object == 4)
    assert length(one.errors_m(one.adjusted()))[0] < 0.3


def test_a_fifth_of_wrong_pixels_is_left_out() -> None:
    """Clicks 15 to 300 px off are found, and the positions hold."""
    recording = recorded("urban")
    rng = np.random.default_rng(5)
    wrong = rng.random(recording.camera.size) < 0.2
    jump = rng.uniform(15.0, 300.0, wrong.sum()) * np.exp(1j * rng.uniform(0, 2 * np.pi, wrong.sum()))
    pixel = recording.pixel_px.copy()
    pixel[wrong] += np.stack([jump.real, jump.imag], axis=1)
    spoilt = recording._replace(pixel_px=pixel)
    adjusted = spoilt.adjusted()
    usable = np.isin(adjusted.rejected, ["", Reason.OUTLIER])
    assert (adjusted.rejected[wrong & usable] == Reason.OUTLIER).mean() > 0.97
    assert (adjusted.rejected[~wrong & usable] == "").mean() > 0.97
    assert np.median(length(spoilt.errors_m(adjusted))) < 0.12


def test_a_track_that_jumps_to_another_sign_keeps_the_larger_part() -> None:
    """Of a track that holds two signs the one with more sightings wins, the rest is left out."""
    recording = recorded("urban")
    rows = np.flatnonzero(np.isin(recording.object, [4, 5]))
    second = rows[recording.object[rows] == 5]
    few = second[: (recording.object == 4).sum() // 2]
    mixed = recording._replace(
        object=np.where(np.isin(np.arange(recording.object.size), few), 4, recording.object)
    )
    adjusted = mixed.adjusted()
    assert length(mixed.errors_m(adjusted))[4] < 0.3
    assert (adjusted.rejected[few] == Reason.OUTLIER).mean() > 0.9


def test_an_id_that_marks_three_signs_draws_no_other_along() -> None:
    """Of an object whose better half of sightings contradicts itself nothing is learnt about the others."""
    recording = recorded("urban")
    taken = np.isin(recording.object, [6, 7]) & (np.random.default_rng(1).random(recording.object.size) < 0.6)
    mixed = recording._replace(object=np.where(taken, 5, recording.object))
    adjusted, alone = mixed.adjusted(), recording.adjusted()
    moved = np.abs(length(mixed.errors_m(adjusted)) - length(recording.errors_m(alone)))
    assert np.delete(moved, 5).max() < 0.05
    assert abs(adjusted.noise - alone.noise) < 0.1


def test_road_that_leans_moves_no_foot() -> None:
    """On 3 % more crossfall than expected the roof leans 5 cm aside; the cameras see that, and feet stay."""
    recording = recorded("urban", antennas=1, silent=True, kerbs=False, crossfall_percent=5.0)
    error = length(recording.errors_m(recording.adjusted(pole_radius_m=0.0)))
    assert np.median(error) < 0.02


def test_faces_are_placed_by_bearings_alone() -> None:
    """The middle of a face 2.5 m up is placed where rays cross: no ground is needed."""
    recording = recorded("urban", ins=True, silent=True)
    faces = _faces(recording, up_m=2.5)
    adjusted = _adjust_faces(faces)
    assert np.nanmedian(length(faces.errors_m(adjusted))) < 0.02


def test_a_face_in_one_frame_has_no_position() -> None:
    """One bearing says nothing about the distance, and the reason says so."""
    recording = recorded("approach")
    one = recording.rows(np.array([0]))
    adjusted = _adjust_faces(one)
    assert adjusted.reason[0] == Reason.NO_POSITION
    assert np.isnan(adjusted.latitude_deg[0])
    assert not adjusted.used.any()


def test_foot_far_below_the_road_is_placed_by_its_rays() -> None:
    """Of a foot below a bridge the road's plane says nothing; it comes out right, and its neighbours stay."""
    up_m = -12.0
    recording = recorded("urban", ins=True, silent=True)
    mine = recording.object == 6
    lifted_px, seen = _raised_px(recording, up_m)
    pixel = np.where(mine[:, None], lifted_px, recording.pixel_px)
    clicked = pixel + np.random.default_rng(3).normal(0.0, 1.5, pixel.shape)
    keep = ~mine | seen
    lifted = recording._replace(pixel_px=clicked).rows(keep)
    adjusted = lifted.adjusted()
    error = length(lifted.errors_m(adjusted))
    assert error[6] < 0.2
    assert adjusted.used[mine[keep]].mean() > 0.8
    assert np.delete(error, 6).max() < 0.05
    height = recording.drive.objects.height_m[6] + up_m
    assert abs(adjusted.height_m[6] - height) < 3.0 * adjusted.sigma_height_m[6]


def test_terrain_says_how_high_a_far_foot_stands() -> None:
    """From one frame on a hilly road the raster places a foot that the plane of the road misplaces."""
    recording = recorded("sample", silent=True, ins=True, kerbs=False)
    farthest = recording.drive.sightings.range_m
    near = (farthest > 14.0) & (farthest < 22.0)
    rows = [np.flatnonzero((recording.object == g) & near)[:1] for g in range(15)]
    far = recording.rows(np.concatenate(rows))
    drive = far.drive
    grid = rasterised(Road(drive.scenario.road, drive.seed), 0.5)
    plane = length(far.errors_m(far.adjusted(pole_radius_m=0.0)))
    raster = length(far.errors_m(far.adjusted(pole_radius_m=0.0, terrain=Terrain(*grid[:2], 0.5, grid[2]))))
    assert np.isfinite(raster).all()
    assert np.median(raster) < 0.3 * np.nanmedian(plane)


def test_terrain_that_lies_elsewhere_is_told_and_not_used() -> None:
    """A raster 50 m too high moves nothing, and a doubt says that it was not used."""
    recording = recorded("approach")
    drive = recording.drive
    east, north, heights = rasterised(Road(drive.scenario.road, drive.seed), 0.5)
    wrong = recording.adjusted(terrain=Terrain(east, north, 0.5, heights + 50.0))
    assert any("used for 0 of 1 feet" in doubt.sentence for doubt in wrong.doubts)
    np.testing.assert_array_equal(wrong.latitude_deg, recording.adjusted().latitude_deg)


def test_sightings_without_pose_or_object_are_named() -> None:
    """What cannot take part says why, and the rest is solved."""
    recording = recorded("approach")
    epoch, number = recording.epoch_ns.copy(), recording.object.copy()
    epoch[0] += 10**12
    number[1] = -1
    adjusted = recording._replace(epoch_ns=epoch, object=number).adjusted()
    assert adjusted.rejected[0] == Reason.AFTER_LAST_FIX
    assert adjusted.rejected[1] == Reason.NO_OBJECT
    assert adjusted.reason[0] == ""


def test_nothing_to_see_is_no_error() -> None:
    """A drive without a usable sighting gives objects without positions."""
    recording = recorded("approach")
    adjusted = recording._replace(epoch_ns=recording.epoch_ns + 10**12).adjusted()
    assert adjusted.reason.tolist() == [Reason.NO_POSITION]
    assert np.isinf(adjusted.time_offset_ms.sigma)


def _faces(recording: Recording, up_m: float) -> Recording:
    """Project a point above each foot with the true poses: sightings of faces."""
    pixel, seen = _raised_px(recording, up_m)
    return recording._replace(pixel_px=pixel).rows(seen)


def _raised_px(recording: Recording, up_m: float) -> tuple[FloatArray, BoolArray]:
    """Pixels (n, 2) of points above each foot by the trajectory's poses, and which are in the picture."""
    drive = recording.drive
    poses = recording.trajectory.poses_at(recording.epoch_ns)
    from geoloc.earth.geodesy import rotation_enu_from_rig

    enu_R_rig = rotation_enu_from_rig(poses.heading_deg, poses.pitch_deg, poses.roll_deg)
    truth = drive.objects
    east, north = enu_offset(
        poses.latitude_deg,
        poses.longitude_deg,
        truth.latitude_deg[recording.object],
        truth.longitude_deg[recording.object],
    )
    up = truth.height_m[recording.object] + up_m - poses.height_m
    rig = np.einsum("nji,nj->ni", enu_R_rig, np.stack([east, north, up], axis=1))
    pixel, seen = np.empty_like(recording.pixel_px), np.empty(recording.camera.size, dtype=bool)
    for name in np.unique(recording.camera):
        rows = recording.camera == name
        camera = drive.rig.camera(str(name))
        point = (rig[rows] - camera.rig_t_camera_m) @ camera.rig_R_camera
        pixel[rows], seen[rows] = camera.model.pixel_from_camera_point(point)
    return pixel, seen


def _adjust_faces(recording: Recording) -> Adjusted:
    return adjust(
        recording.observations(Kind.BOX),
        size_px=np.full(recording.camera.size, 30.0),
    )
