"""Drives of minutes: what is wrong with them all the way must not come out as certain."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import recorded

from geoloc.locate.accuracy import nees

URBAN_AND_HIGHWAY = pytest.mark.parametrize(
    ("name", "seed"), [pytest.param("urban", 13, marks=pytest.mark.slow), ("highway", 14)]
)


@URBAN_AND_HIGHWAY
def test_length_makes_no_bias_certain(name: str, seed: int) -> None:
    """After five minutes clock, boresight and places are as good as their sigmas say.

    A crown, verges, crossfall, the antennas' heights and slip are the same all the way.
    """
    recording = recorded(name, seed=seed, minutes=5.0)
    adjusted = recording.adjusted()
    assert not adjusted.doubts
    clock, drawn = adjusted.time_offset_ms, recording.drive.drawn
    assert abs(clock.value + drawn.frame_offset_ms) < 3.0 * clock.sigma
    for camera, corrections in adjusted.boresight_deg.items():
        true = recording.drive.rig.camera(camera).rig_R_camera.T @ drawn.boresight_deg[camera]
        # The lens's own errors, 0.3 px of its centre, are 0.01 degrees.
        off = [(c.value - t) / np.hypot(c.sigma, 0.01) for c, t in zip(corrections, true, strict=True)]
        assert np.abs(off).max() < 3.5
    error = recording.errors_m(adjusted)
    inside = nees(error[:, :2], adjusted.covariance_m2) < 5.991
    assert np.mean(inside) > 0.85
    assert np.median(np.hypot(*error[:, :2].T)) < 0.2


@URBAN_AND_HIGHWAY
def test_coarse_annotations_look_like_no_slower_shutter(name: str, seed: int) -> None:
    """The noise of a row is in its residual too: together they were 2 and 2.5 sigmas of readout."""
    recording = recorded(name, seed=seed, minutes=5.0)
    noise_px = np.random.default_rng(1).normal(size=recording.pixel_px.shape) * 4.0
    readout = recording._replace(pixel_px=recording.pixel_px + noise_px).adjusted().readout_ms
    true_ms = 1e-3 * recording.drive.scenario.noise.row_delay_us * 1208
    assert abs(readout.value - true_ms) < readout.sigma


def test_car_that_pitches_on_a_leaning_road_rolls_no_camera() -> None:
    """About its axles or about a level axis: the difference, frame by frame, is no roll of the cameras."""
    recording = recorded(
        "highway",
        seed=4,
        minutes=2.0,
        crossfall_percent=6.0,
        pitch_jitter_deg=0.3,
        annotation_px=0.5,
        boresight_deg=0.0,
    )
    for _, _, roll in recording.adjusted().boresight_deg.values():
        assert abs(roll.value) < roll.sigma


def test_ground_that_rises_under_all_feet_is_no_pitch() -> None:
    """Kerbs of 25 cm under every pole are found as what they share, and the cameras stay where they are."""
    recording = recorded("highway", seed=2, minutes=2.0, ins=True, kerb_everywhere_m=0.25)
    adjusted = recording.adjusted()
    height_m = adjusted.height_m - recording.drive.objects.height_m[adjusted.object]
    assert abs(np.mean(height_m)) < 0.05
    assert np.mean((height_m / adjusted.sigma_height_m) ** 2) < 2.5
    for camera, (pitch, _, _) in adjusted.boresight_deg.items():
        true = recording.drive.rig.camera(camera).rig_R_camera.T @ recording.drive.drawn.boresight_deg[camera]
        assert abs(pitch.value - true[0]) < 3.0 * pitch.sigma


def test_a_body_that_bounces_rolls_no_camera() -> None:
    """Thousands of bounces, each free, rolled all cameras by 0.13 degrees in these five minutes."""
    recording = recorded(
        "urban",
        seed=2,
        minutes=5.0,
        pitch_jitter_deg=0.6,
        roll_jitter_deg=0.6,
        boresight_deg=0.0,
    )
    for camera, corrections in recording.adjusted().boresight_deg.items():
        in_rig = recording.drive.rig.camera(camera).rig_R_camera @ [one.value for one in corrections]
        assert abs(in_rig[0]) < 0.05
