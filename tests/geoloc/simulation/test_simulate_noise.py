"""How noisy the simulator is: as much as it says."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from geoloc.simulation.car import ANTENNAS, CAMERAS
from geoloc.simulation.flat_frame import LocalFrame
from geoloc.simulation.noise import damped_oscillation, draw_errors, gauss_markov, stream
from geoloc.simulation.simulate import NoiseSpec, scenario, simulate_drive


def test_gnss_noise_is_as_large_as_stated() -> None:
    """Over 400 s of standing still the spreads of the baseline and of the stamps are as specified."""
    still = scenario("still")
    world = replace(still, motion=replace(still.motion, duration_s=400.0), annotate_every=3000)
    noise, drive = world.noise, simulate_drive(world, 11)
    left, right = drive.gnss
    frame = LocalFrame(world.road.latitude_deg, world.road.longitude_deg, world.road.height_m)
    a, b = (frame.enu_from_geographic(f.latitude_deg, f.longitude_deg, f.height_m) for f in (left, right))
    # Slow noise is common and cancels; white noise and multipath of two antennas remain.
    plan = np.sqrt(2.0 * (noise.gnss_white_horizontal_m**2 + noise.gnss_multipath_m**2))
    up = np.sqrt(2.0 * (noise.gnss_white_vertical_m**2 + noise.gnss_multipath_m**2))
    # 2 011 epochs with multipath correlated over 8 s: 12 % is four sigma of the spread's own error.
    assert (a - b).std(axis=0) == pytest.approx([plan, plan, up], rel=0.12)
    delay_ms = (left.host_ns - left.epoch_ns) / 1e6
    assert delay_ms.mean() == pytest.approx(noise.link_delay_ms, abs=0.3)
    assert delay_ms.std() == pytest.approx(noise.link_jitter_ms, rel=0.07)
    jitter_ms = (drive.frame_host_ns["C3_tricam120"] - drive.frame_epoch_ns) / 1e6
    assert jitter_ms.mean() == pytest.approx(drive.drawn.frame_offset_ms, abs=0.02)
    assert jitter_ms.std() == pytest.approx(noise.frame_jitter_ms, rel=0.05)


def test_annotation_noise_is_as_large_as_stated() -> None:
    """Pixels scatter by 1.5 px about the true ones, and half a per cent are blunders of 20 to 60 px."""
    world = scenario("urban", 25.0)
    drives = [simulate_drive(world, seed) for seed in range(3)]
    error = np.concatenate([d.sightings.pixel_px - d.sightings.true_pixel_px for d in drives])
    blunder = np.concatenate([d.sightings.blunder for d in drives])
    # About 5 500 sightings: the spread is known to 1 %, the count of blunders to 19 %.
    assert error[~blunder].std(axis=0) == pytest.approx([1.5, 1.5], rel=0.04)
    assert np.abs(error[~blunder].mean(axis=0)).max() < 0.1
    assert blunder.mean() == pytest.approx(0.005, rel=0.6)
    jump = np.linalg.norm(error[blunder], axis=-1)
    assert jump.min() > 12.0
    assert jump.max() < 68.0


def test_errors_drawn_once_have_the_stated_spread() -> None:
    """Over 400 drives mounting, clock, lens and lever-arm errors have the specification's sigmas."""
    spec = NoiseSpec()
    drawn = [draw_errors(spec, seed, tuple(CAMERAS), tuple(ANTENNAS)) for seed in range(400)]
    spread = {
        "boresight_deg": np.std([d.boresight_deg[c] for d in drawn for c in CAMERAS]),
        "camera_position_m": np.std([d.camera_position_m[c] for d in drawn for c in CAMERAS]),
        "focal_relative": np.std([d.focal_relative[c] for d in drawn for c in CAMERAS]),
        "principal_point_px": np.std([d.principal_point_px[c] for d in drawn for c in CAMERAS]),
        "lever_arm_m": np.std([np.diff(list(d.lever_arm_m.values()), axis=0) for d in drawn]) / np.sqrt(2.0),
        "frame_offset_ms": np.std([d.frame_offset_ms for d in drawn]),
        "slip_sigma_deg_per_mps2": np.std([d.slip_deg_per_mps2 for d in drawn]),
    }
    shared = np.std([sum(d.lever_arm_m.values()) / len(ANTENNAS) for d in drawn])
    assert shared == pytest.approx(np.hypot(spec.rig_origin_m, spec.lever_arm_m / np.sqrt(2.0)), rel=0.12)
    for name, value in spread.items():
        # The smallest sample, 400 offsets, knows its spread to 3.5 %.
        assert value == pytest.approx(getattr(spec, name), rel=0.12), name


def test_gauss_markov_forgets_with_its_correlation_time() -> None:
    """The autocorrelation falls to 1/e after tau and the spread stays sigma, also with uneven epochs."""
    rng = stream(1, "test")
    epoch = np.cumsum(rng.uniform(0.05, 0.15, 60_000))
    x = gauss_markov(rng, epoch, 2.0, 1.0)
    assert x.std() == pytest.approx(2.0, rel=0.05)
    lag = 10
    assert np.mean(x[lag:] * x[:-lag]) / x.var() == pytest.approx(np.exp(-1.0), abs=0.05)


def test_body_oscillates_at_its_natural_frequency() -> None:
    """The body's autocorrelation is exp(-zeta omega tau) cos(omega tau): negative after half a period."""
    x = damped_oscillation(stream(1, "test"), 100_000, 0.01, 1.4, 0.3)
    assert x.std() == pytest.approx(1.0, rel=0.05)
    for lag_s in (0.1, 0.36, 0.71):
        lag, omega = round(lag_s / 0.01), 2.0 * np.pi * 1.4
        expected = np.exp(-0.3 * omega * lag_s) * np.cos(omega * lag_s)
        assert np.mean(x[lag:] * x[:-lag]) == pytest.approx(expected, abs=0.05)


def test_no_noise_means_no_noise() -> None:
    """Every amplitude of `NoiseSpec.none` is zero, and of the default those alone that `as_stated` draws."""
    times = {"gnss_slow_tau_s", "gnss_multipath_tau_s", "body_frequency_hz", "body_damping"}
    stated = {"bounce_lasts_s", "pitch_unrest_deg", "roll_unrest_deg", "pitching_axis"}
    stated |= {"sideways_mps", "sideways_deg"}
    for field in fields(NoiseSpec):
        assert (getattr(NoiseSpec(), field.name) > 0.0) == (field.name not in stated)
        assert (getattr(NoiseSpec.none(), field.name) > 0.0) == (field.name in times)
