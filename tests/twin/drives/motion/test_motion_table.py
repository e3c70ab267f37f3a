"""A car's motion from a table (CSV): units, signs and times are stated, and held against the fixes."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from moving_car import TABLE, WHEELBASE_M, MovingCar, motion_of, nearly, settings_of

from twin.drives.folder.notes import ReadingNotes
from twin.errors import DriveError


def test_table_is_read_into_si_units(car: MovingCar) -> None:
    """km/h, degrees and a steering wheel become m/s and radians of the front wheels, at the same epochs."""
    car.table(car.trip / "can.csv")
    read = motion_of(car, settings_of(**TABLE, lag_ms="20", lag_sigma_ms="5", speed_sigma_mps="0.1"))
    motion = read.motion
    assert motion is not None
    assert motion.speed is not None
    assert motion.turn_rate is not None
    assert motion.wheel_angle is not None
    assert motion.wheelbase_m == WHEELBASE_M
    assert motion.speed.epoch_ns.tolist() == car.epoch_ns.tolist()
    assert nearly(motion.speed.values, car.speed_mps, 1e-6)
    assert nearly(motion.turn_rate.values, car.turn_rad_s, 1e-6)
    assert nearly(motion.wheel_angle.values, car.wheel_rad, 1e-6)
    assert set(motion.speed.sigma) == {0.1}
    assert np.isnan(motion.turn_rate.sigma).all()
    assert (motion.speed.lag_s, motion.speed.lag_sigma_s) == (0.02, 0.005)
    ratios = {str(one.quantity): one.check.ratio for one in read.seen}
    assert ratios["speed"] == pytest.approx(1.0, abs=0.02)
    assert ratios["turn_rate"] == pytest.approx(1.0, abs=0.1)
    assert ratios["wheel_angle"] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"speed_unit": '"m/s"'}, 'speed is 3.60 times.*speed_unit = "km/h"'),
        ({"turn_rate_positive": '"right"'}, 'turn_rate_positive = "right"'),
        ({"turn_rate_unit": '"rad/s"'}, 'turn_rate_unit = "deg/s"'),
        ({"steering_ratio": "1.0"}, "steering_ratio, the car's own, about 1[45]"),
        ({"speed": '"v_kph"'}, "names the column v_kph .*the nearest is v_kmh"),
        ({"time_unit": '"ms"'}, "no years 2000–2099 .*time_zero"),
        ({"time_unit": '"iso"'}, "no iso"),
        ({"wheel_angle_unit": '"grad"'}, "wheel_angle_unit"),
        ({"turn_rate": '"v_kmh"'}, "turn_rate"),
    ],
)
def test_wrong_settings_are_refused_with_the_cure(car: MovingCar, change: dict[str, str], told: str) -> None:
    """What would spoil the trajectory in silence contradicts the fixes; the sentence says what to write."""
    car.table(car.trip / "can.csv")
    with pytest.raises(DriveError, match=told):
        motion_of(car, settings_of(**(TABLE | change)))


@pytest.mark.parametrize(
    "missing", ["speed_unit", "turn_rate_unit", "time_unit", "time", "wheelbase_m", "file"]
)
def test_what_a_table_cannot_say_is_asked_for(car: MovingCar, missing: str) -> None:
    """No unit is guessed."""
    car.table(car.trip / "can.csv")
    with pytest.raises(DriveError, match=missing):
        motion_of(car, settings_of(**{key: value for key, value in TABLE.items() if key != missing}))


def test_times_that_count_from_the_start_need_it(car: MovingCar) -> None:
    """Seconds since somebody pressed a button say nothing of UTC: an instant with its zone does."""
    zero = car.epoch_ns[0] // 10**9 * 10**9
    car.table(car.trip / "can.csv", zero_ns=int(zero))
    with pytest.raises(DriveError, match="time_zero"):
        motion_of(car, settings_of(**TABLE))
    moment = datetime.fromtimestamp(zero // 10**9, UTC)
    read = motion_of(car, settings_of(**TABLE, time_zero=f'"{moment.isoformat()}"'))
    assert read.motion is not None
    assert read.motion.speed is not None
    assert read.motion.speed.epoch_ns.tolist() == car.epoch_ns.tolist()


def test_gps_time_and_local_time_become_utc(car: MovingCar) -> None:
    """GPS time has no leap seconds, and a clock on the wall has a zone, which is asked for."""
    text = car.table(car.trip / "can.csv").read_text().splitlines()
    gps = [f"{float(line.split(',')[0]) - 315_964_800 + 18:.3f},{line.split(',')[1]}" for line in text[1:]]
    (car.trip / "can.csv").write_text("\n".join(["t_s,v_kmh", *gps]))
    only = {key: value for key, value in TABLE.items() if key.startswith(("file", "time", "speed"))}
    read = motion_of(car, settings_of(**only, time_zero='"gps"'))
    assert read.motion is not None
    assert read.motion.speed is not None
    assert np.abs(read.motion.speed.epoch_ns - car.epoch_ns).max() < 1_000_000

    local = [
        datetime.fromtimestamp(ns / 1e9 + 7200, UTC).replace(tzinfo=None) for ns in car.epoch_ns.tolist()
    ]
    rows = [f"{t.isoformat()},{line.split(',')[1]}" for t, line in zip(local, text[1:], strict=True)]
    (car.trip / "can.csv").write_text("\n".join(["t_s,v_kmh", *rows]))
    only["time_unit"] = '"iso"'
    with pytest.raises(DriveError, match="utc_offset_hours"):
        motion_of(car, settings_of(**only))
    with pytest.raises(DriveError, match="2 h, as local time"):
        motion_of(car, settings_of(**only, utc_offset_hours="0"))
    read = motion_of(car, settings_of(**only, utc_offset_hours="2"))
    assert read.motion is not None
    assert read.motion.speed is not None
    assert np.abs(read.motion.speed.epoch_ns - car.epoch_ns).max() < 2_000


def test_late_stamps_are_told_with_their_lag(car: MovingCar) -> None:
    """A logger that is 0.8 s behind is used, and its lag said."""
    car.table(car.trip / "can.csv", late_s=0.8)
    notes = ReadingNotes()
    motion_of(car, settings_of(**TABLE), notes)
    (told,) = {str(w) for w in notes.warnings if "late against the fixes" in str(w)}
    assert "+0.8" in told


def test_damaged_rows_are_left_out_and_counted(car: MovingCar) -> None:
    """A row without a number, a short one and one that goes back in time cost themselves alone."""
    file = car.table(car.trip / "can.csv")
    lines = file.read_text().splitlines()
    lines[10] = lines[10].replace(",", ",x", 1)
    lines[20] = lines[20].split(",")[0]
    lines[30] = lines[5]
    file.write_text("\n".join(lines))
    notes = ReadingNotes()
    only = {key: value for key, value in TABLE.items() if key.startswith(("file", "time", "speed"))}
    read = motion_of(car, settings_of(**only), notes)
    assert read.motion is not None
    assert read.motion.speed is not None
    assert len(read.motion.speed.values) == len(lines) - 1 - 3
    counts = {s.reason: s.count for s in notes.skipped if s.where == "can.csv"}
    assert counts == {"row too short": 1, "not a number": 1, "stamp not after the sample before": 1}
