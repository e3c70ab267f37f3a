"""Recorded poses that do not say how good they are."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from geoloc.earth.geodesy import enu_offset, geographic_from_enu
from geoloc.simulation.noise import gauss_markov
from geoloc.simulation.simulate import scenario, simulate_drive
from geoloc.trajectory.pose_noise import SIGMA_FLOORS, UNKNOWN, with_estimated_sigmas
from geoloc.trajectory.trajectory import PoseTrack

TRUE = simulate_drive(scenario("urban", None, 3), 3).poses


def noisy(sigma_m: float, sigma_deg: float, tau_s: float) -> PoseTrack:
    """True poses with errors that last so long (0: each its own), and no sigmas."""
    rng, time_s = np.random.default_rng(1), (TRUE.epoch_ns - TRUE.epoch_ns[0]) / 1e9
    drawn = [
        gauss_markov(rng, time_s, 1.0, tau_s) if tau_s else rng.normal(size=time_s.size) for _ in range(6)
    ]
    lat, lon = geographic_from_enu(
        TRUE.latitude_deg, TRUE.longitude_deg, sigma_m * drawn[0], sigma_m * drawn[1]
    )
    nothing = np.full(time_s.size, np.nan)
    return replace(
        TRUE,
        latitude_deg=lat,
        longitude_deg=lon,
        height_m=TRUE.height_m + sigma_m * drawn[2],
        roll_deg=TRUE.roll_deg + sigma_deg * drawn[3],
        pitch_deg=TRUE.pitch_deg + sigma_deg * drawn[4],
        heading_deg=np.mod(TRUE.heading_deg + sigma_deg * drawn[5], 360.0),
        sigma_horizontal_m=nothing,
        sigma_vertical_m=nothing,
        sigma_roll_pitch_deg=nothing,
        sigma_heading_deg=nothing,
    )


def test_noise_of_each_pose_is_smoothed_away() -> None:
    """Thirty poses a second of 0.3 m each say far better where the car was."""
    smooth, _ = with_estimated_sigmas(noisy(0.3, 0.5, 0.0))
    off = np.hypot(
        *enu_offset(TRUE.latitude_deg, TRUE.longitude_deg, smooth.latitude_deg, smooth.longitude_deg)
    )
    assert np.sqrt(np.mean(off**2) / 2.0) < 0.1
    turned = (smooth.heading_deg - TRUE.heading_deg + 180.0) % 360.0 - 180.0
    assert np.sqrt(np.mean(turned**2)) < 0.2


@pytest.mark.parametrize(("sigma_m", "sigma_deg"), [(0.1, 0.2), (0.3, 0.5)])
def test_errors_that_last_seconds_are_found_by_what_they_are(sigma_m: float, sigma_deg: float) -> None:
    """Within a factor of 2.5, from what the track steps aside of its own heading."""
    _, taken = with_estimated_sigmas(noisy(sigma_m, sigma_deg, 5.0))
    assert taken is not None
    wanted = np.array([sigma_m, sigma_m, sigma_deg, sigma_deg])
    assert (np.abs(np.log(np.array(taken) / wanted)) < np.log(2.5)).all()


def test_a_track_without_noise_is_taken_for_a_good_one() -> None:
    """Not better than any INS is by itself, and not moved by a centimetre."""
    track = noisy(0.0, 0.0, 0.0)
    smooth, taken = with_estimated_sigmas(track)
    assert taken is not None
    assert (np.array(taken) >= SIGMA_FLOORS).all()
    assert taken.horizontal_m < 0.05
    off = enu_offset(TRUE.latitude_deg, TRUE.longitude_deg, smooth.latitude_deg, smooth.longitude_deg)
    assert np.abs(off).max() < 0.01


def test_stated_sigmas_stay_and_empty_cells_take_their_median() -> None:
    """What a column states of some poses holds for the others; the poses stay as they are."""
    track = noisy(0.1, 0.1, 5.0)
    stated = np.full(track.epoch_ns.size, 0.07)
    stated[::3] = np.nan
    columns = [field.name for field in fields(PoseTrack) if field.name.startswith("sigma")]
    known, taken = with_estimated_sigmas(replace(track, **dict.fromkeys(columns, stated)))
    assert taken is None
    assert all((getattr(known, name) == 0.07).all() for name in columns)
    assert np.array_equal(known.latitude_deg, track.latitude_deg)
    _, rest = with_estimated_sigmas(replace(track, sigma_heading_deg=stated))
    assert rest is not None
    assert np.array_equal(np.isnan(rest), [False, False, False, True])


def test_a_track_that_shows_nothing_is_taken_for_a_poor_one() -> None:
    """Five poses tell nothing of their errors."""
    track = noisy(0.0, 0.0, 0.0)
    few = replace(track, **{field.name: getattr(track, field.name)[:5] for field in fields(PoseTrack)})
    _, taken = with_estimated_sigmas(few)
    assert taken == UNKNOWN
