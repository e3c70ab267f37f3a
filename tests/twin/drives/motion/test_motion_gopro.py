"""The gyro of a GoPro video, beside the fixes of the car's own antenna."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from moving_car import MovingCar, motion_of, settings_of
from small_camera import entry, gps5_packet, gyro_packet, write_video

from twin.errors import DriveError

NS = 1_000_000_000
HZ = 200


def film(car: MovingCar, *, fix: int = 3) -> None:
    """A video over the whole drive: 200 rates a second, of which the second one written points down."""
    n_packets = int(car.seconds[-1])
    at_s = np.arange(n_packets * HZ) / HZ + 0.5 / HZ
    turn = np.interp(at_s, car.seconds, car.turn_rad_s)
    data = []
    for k in range(n_packets):
        rates = [(0.01, -rate, 0.02) for rate in turn[k * HZ : (k + 1) * HZ].tolist()]
        places = [(63.41, 10.45, 60.0)] * 18
        fixes = gps5_packet(int(car.epoch_ns[0]) + k * NS, places, fix=fix)
        data.append((1000 * k, fixes + gyro_packet(rates)))
    stamps = car.epoch_ns[0] + np.arange(3, dtype=np.int64) * NS // 30
    write_video(car.trip / "GX010001.MP4", stamps, int(car.epoch_ns[0]), data=data)


def test_gyro_is_averaged_and_timed_by_the_fixes(car: MovingCar) -> None:
    """Its axis is asked for; rates are those of the car at 100 Hz, and the clock is the video's start."""
    film(car)
    with pytest.raises(DriveError, match="turn_rate_axis"):
        motion_of(car, settings_of(file='"GX010001.MP4"'))
    with pytest.raises(DriveError, match='turn_rate_axis = "-y"'):
        motion_of(car, settings_of(file='"GX010001.MP4"', turn_rate_axis='"y"'))
    motion = motion_of(car, settings_of(file='"GX010001.MP4"', turn_rate_axis='"-y"')).motion
    assert motion is not None
    assert motion.turn_rate is not None
    rate = motion.turn_rate
    assert rate.lag_sigma_s == pytest.approx(0.3)
    assert np.median(np.diff(rate.epoch_ns)) == pytest.approx(NS / 100, rel=0.01)
    at_s = (rate.epoch_ns - car.epoch_ns[0]) / 1e9
    truth = np.interp(at_s, car.seconds, car.turn_rad_s)
    assert np.abs(rate.values - truth)[5:-5].max() < 1.0 / 939 + 0.002


def test_video_without_fixes_or_gyro_says_so(car: MovingCar) -> None:
    """Without fixes its start is asked for; a video of pictures alone has no gyro."""
    film(car, fix=0)
    with pytest.raises(DriveError, match="time_zero"):
        motion_of(car, settings_of(file='"GX010001.MP4"', turn_rate_axis='"-y"'))
    stamps = car.epoch_ns[0] + np.arange(3, dtype=np.int64) * NS // 30
    none = entry(b"DEVC", b"\0", 1, entry(b"DVID", b"L", 4, struct.pack(">I", 1)))
    write_video(car.trip / "GX010001.MP4", stamps, int(car.epoch_ns[0]), data=[(0, none)])
    with pytest.raises(DriveError, match="has no gyro"):
        motion_of(car, settings_of(file='"GX010001.MP4"', turn_rate_axis='"-y"'))
