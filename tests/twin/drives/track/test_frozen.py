"""Receivers that repeat a position while the car drives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from twin.drives.epochs import clock_hint
from twin.drives.track.fixes import FROZEN, frozen, never_moves
from twin.drives.track.formats.poses_csv import read_poses

S = 1_000_000_000
METRES_PER_DEGREE = 111_400.0


def held(north_m: NDArray[np.float64], rate_hz: int) -> list[int]:
    """Numbers of the positions that are taken for repeats, of a car on its way north."""
    epoch_ns = np.arange(north_m.size) * (S // rate_hz)
    level = np.zeros(north_m.size)
    return np.flatnonzero(frozen(epoch_ns, 63.4 + north_m / METRES_PER_DEGREE, level, level)).tolist()


@pytest.mark.parametrize("rate_hz", [1, 5, 10])
@pytest.mark.parametrize("speed_mps", [5.0, 14.0, 30.0])
def test_repeats_of_a_driving_car_are_found(rate_hz: int, speed_mps: float) -> None:
    """Four seconds of one position, then where the car really is: all but the first were not measured."""
    north_m = speed_mps * np.arange(12 * rate_hz) / rate_hz
    north_m[4 * rate_hz : 8 * rate_hz + 1] = north_m[4 * rate_hz]
    assert held(north_m, rate_hz) == list(range(4 * rate_hz + 1, 8 * rate_hz + 1))


def test_repeats_up_to_the_end_are_found() -> None:
    """From 50 km/h to nothing within a fifth of a second."""
    north_m = 14.0 * np.arange(60) / 5.0
    north_m[30:] = north_m[30]
    assert held(north_m, 5) == list(range(31, 60))


@pytest.mark.parametrize("rate_hz", [1, 5, 10])
def test_car_that_brakes_stands_and_starts_keeps_its_positions(rate_hz: int) -> None:
    """8 m/s² is an emergency stop; a receiver that holds its position while the car stands is right."""
    seconds = np.arange(0, 20 * rate_hz) / rate_hz
    speed = np.clip(np.minimum(16.0, 8.0 * np.abs(seconds - 10.0) - 24.0), 0.0, None)
    north_m = np.cumsum(speed) / rate_hz
    assert np.count_nonzero(np.diff(north_m) == 0) >= 5
    assert held(north_m, rate_hz) == []


def test_few_repeats_are_those_of_a_logger() -> None:
    """A 1 Hz receiver that is asked four times a second gives each position four times."""
    north_m = np.repeat(10.0 * np.arange(20), 4).astype(np.float64)
    assert held(north_m, 4) == []


@pytest.mark.parametrize("count", [0, 1, 4])
def test_few_positions_say_nothing(count: int) -> None:
    """Neither that they are repeats, nor that the car stood."""
    position = np.zeros(count)
    assert held(position, 5) == []
    assert not never_moves(position, position, position)


def test_recording_of_one_place_never_moves() -> None:
    """To the last digit: a receiver's noise is motion here."""
    position = np.full(9, 63.4)
    assert never_moves(position, position, position)
    assert not never_moves(position + 1e-9 * np.arange(9), position, position)


@pytest.mark.parametrize(
    ("shift_s", "said"),
    [
        (18, "camera_offset_ms = -18000"),
        (-18, "camera_offset_ms = 18000"),
        (7200, "camera_offset_ms = -7200000"),
        (-3600, "camera_offset_ms = 3600000"),
        (86_400, ""),
        (600, ""),
    ],
)
def test_usual_mistake_of_clocks_is_named(shift_s: int, said: str) -> None:
    """GPS time and local time explain frames outside the track, where the whole span then fits."""
    hint = clock_hint(((100 + shift_s) * S, (110 + shift_s) * S), (95 * S, 115 * S))
    assert said in hint
    assert bool(said) is bool(hint)


def test_frozen_poses_are_left_out_and_counted() -> None:
    """A pose file repeats its position for four seconds at 14 m/s."""
    header = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg"
    north_m = 14.0 * np.minimum(np.arange(50), 30) / 5.0
    start_ns = 1_781_078_400 * S
    rows = [
        f"{start_ns + i * S // 5},{63.4 + m / METRES_PER_DEGREE:.9f},10.4,80,0,0,0"
        for i, m in enumerate(north_m)
    ]
    read = read_poses("\n".join([header, *rows]).encode(), "poses.csv")
    assert len(read.track.epoch_ns) == 31
    assert [(one.count, one.reason) for one in read.skipped] == [(19, FROZEN)]
