"""Clocks: what a host stamped is brought to UTC by what it stamped of the fixes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from moving_car import TABLE, MovingCar, motion_of, settings_of

from twin.drives.folder.notes import DriveDoubt, ReadingNotes

NS = 1_000_000_000


def test_host_on_gps_time_is_brought_to_utc(car: MovingCar) -> None:
    """A host 18 s ahead stamps fixes and bus alike: its motion is moved back to 0.1 s, and less trusted."""
    ahead = tuple(replace(fixes, host_ns=fixes.host_ns + 18 * NS) for fixes in car.drive.gnss)
    car = MovingCar(replace(car.drive, gnss=ahead), car.trip)
    car.table(car.trip / "can.csv", late_s=18.0)
    notes = ReadingNotes()
    motion = motion_of(car, settings_of(**TABLE), notes).motion
    assert motion is not None
    assert motion.speed is not None
    assert np.abs(motion.speed.epoch_ns - car.epoch_ns).max() < 150_000_000
    assert motion.speed.lag_sigma_s == 0.25
    assert any("moved by -18.0" in str(w) for w in notes.warnings if w.kind is DriveDoubt.CLOCK)


@pytest.mark.parametrize("ahead_s", [7200, 18])
def test_logger_with_a_right_clock_is_left_alone(car: MovingCar, ahead_s: int) -> None:
    """Another computer stamped the fixes, hours off or on GPS time: what fits as stamped is not moved."""
    ahead = tuple(replace(fixes, host_ns=fixes.host_ns + ahead_s * NS) for fixes in car.drive.gnss)
    car = MovingCar(replace(car.drive, gnss=ahead), car.trip)
    car.table(car.trip / "can.csv")
    keys = {key: value for key, value in TABLE.items() if key.startswith(("file", "time", "turn"))}
    notes = ReadingNotes()
    motion = motion_of(car, settings_of(**keys), notes).motion
    assert motion is not None
    assert motion.turn_rate is not None
    assert motion.turn_rate.epoch_ns.tolist() == car.epoch_ns.tolist()
    assert notes.warnings == []
