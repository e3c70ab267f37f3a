"""A car's motion from SBP, from comma's folders, and from what DriveWorks' tools write."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from moving_car import MovingCar, motion_of, nearly, settings_of
from sbp.imu import MsgImuAux, MsgImuRaw
from sbp.orientation import MsgAngularRate
from sbp.vehicle import MsgOdometry, MsgWheeltick
from track_writers import GPS_EPOCH_S, LEAP_S, WEEK_S, S, sbp_clock, sbp_time

from twin.drives.folder.notes import ReadingNotes
from twin.errors import DriveError

METRES_PER_TICK = 0.002


def write_sbp(car: MovingCar, *, gps_time: bool = True) -> None:
    """Odometry, ticks of one wheel, rates in the vehicle's frame, and raw ones of a device on its side."""
    frames = [sbp_clock(int(car.epoch_ns[0])), MsgImuAux(imu_type=0, temp=0, imu_conf=3 << 4).to_binary()]
    ticks = np.cumsum(np.gradient(car.seconds) * car.speed_mps) / METRES_PER_TICK
    rows = np.column_stack([car.speed_mps, np.degrees(car.turn_rad_s), ticks]).tolist()
    for epoch_ns, (v, turn_deg_s, count) in zip(car.epoch_ns.tolist(), rows, strict=True):
        tow_ns = sbp_time(epoch_ns)[1] * 1_000_000 + sbp_time(epoch_ns)[2]
        tow, rest_ns = divmod(tow_ns, 1_000_000)
        source = 1 if gps_time else 2
        raw = round(turn_deg_s / 250.0 * 32768)
        frames += [
            MsgOdometry(tow=tow, velocity=round(1000 * v), flags=source).to_binary(),
            MsgWheeltick(time=tow_ns // 1000, flags=source, source=7, ticks=round(count)).to_binary(),
            MsgAngularRate(tow=tow, x=0, y=0, z=round(-1e6 * turn_deg_s), flags=1).to_binary(),
            MsgImuRaw(
                tow=tow,
                tow_f=rest_ns * 256 // 1_000_000,
                acc_x=0,
                acc_y=0,
                acc_z=0,
                gyr_x=3,
                gyr_y=raw,
                gyr_z=5,
            ).to_binary(),
        ]
    (car.trip / "ins.sbp").write_bytes(b"".join(frames))


def test_sbp_is_on_the_receivers_own_time(car: MovingCar) -> None:
    """Odometry and the rate about the vehicle's z, which points down, in UTC."""
    write_sbp(car)
    motion = motion_of(car, settings_of(file='"ins.sbp"')).motion
    assert motion is not None
    assert motion.speed is not None
    assert motion.turn_rate is not None
    assert np.abs(motion.speed.epoch_ns - car.epoch_ns).max() <= 1_000_000
    assert nearly(motion.speed.values, car.speed_mps, 0.0006)
    assert nearly(motion.turn_rate.values, car.turn_rad_s, 1e-7)


def test_sbp_ticks_and_raw_rates_need_what_they_do_not_say(car: MovingCar) -> None:
    """How long a tick is, and which axis of the device points up."""
    write_sbp(car)
    ticks = {"file": '"ins.sbp"', "speed": '"WHEELTICK"'}
    with pytest.raises(DriveError, match="metres_per_tick"):
        motion_of(car, settings_of(**ticks))
    motion = motion_of(car, settings_of(**ticks, metres_per_tick=str(METRES_PER_TICK))).motion
    assert motion is not None
    assert motion.speed is not None
    assert np.abs(motion.speed.values - car.speed_mps[1:]).max() < METRES_PER_TICK * 30.0 * 1.01
    assert motion.speed.epoch_ns[0] - car.epoch_ns[0] == pytest.approx(16_666_666, abs=2_000)

    raw = {"file": '"ins.sbp"', "turn_rate": '"IMU_RAW"'}
    with pytest.raises(DriveError, match="turn_rate_axis"):
        motion_of(car, settings_of(**raw))
    motion = motion_of(car, settings_of(**raw, turn_rate_axis='"y"')).motion
    assert motion is not None
    assert motion.turn_rate is not None
    assert nearly(motion.turn_rate.values, car.turn_rad_s, np.radians(250.0 / 32768))
    assert np.abs(motion.turn_rate.epoch_ns - car.epoch_ns).max() < 10_000


def test_sbp_of_another_clock_is_left_out(car: MovingCar) -> None:
    """What a processor stamped by its own time is counted, and nothing is left of it."""
    write_sbp(car, gps_time=False)
    with pytest.raises(DriveError, match="holds no usable ODOMETRY"):
        motion_of(car, settings_of(file='"ins.sbp"', speed='"ODOMETRY"'))
    with pytest.raises(DriveError, match=r"names VELOCITY as the speed .*ODOMETRY, WHEELTICK"):
        motion_of(car, settings_of(file='"ins.sbp"', speed='"VELOCITY"'))


def write_comma(car: MovingCar, *, poses: bool = True, receiver: bool = False) -> Path:
    """A segment as comma2k19 has it: arrays without a suffix, times since the device started."""
    boot_s = car.epoch_ns[0] / 1e9 - 1000.0
    t_s = car.seconds + 1000.0
    zeros = np.zeros_like(t_s)
    arrays = {
        "processed_log/CAN/speed/t": t_s,
        "processed_log/CAN/speed/value": 0.99 * car.speed_mps[:, np.newaxis],
        "processed_log/CAN/wheel_speed/t": t_s,
        "processed_log/CAN/wheel_speed/value": np.column_stack(
            [car.speed_mps + 2.0, car.speed_mps + 2.0, car.speed_mps + 0.1, car.speed_mps - 0.1]
        ),
        "processed_log/IMU/gyro/t": t_s,
        "processed_log/IMU/gyro/value": np.column_stack([zeros, zeros, -car.turn_rad_s]),
    }
    if poses:
        gps_s = car.epoch_ns / 1e9 - GPS_EPOCH_S + LEAP_S
        arrays["global_pose/frame_times"] = t_s
        arrays["global_pose/frame_gps_times"] = np.column_stack(divmod(gps_s, WEEK_S))
    if receiver:
        utc = t_s + boot_s
        arrays["processed_log/GNSS/live_gnss_ublox/t"] = t_s
        arrays["processed_log/GNSS/live_gnss_ublox/value"] = np.column_stack([zeros, zeros, zeros, 1e3 * utc])
    for name, array in arrays.items():
        path = car.trip / "segment" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            np.save(file, array)
    return car.trip / "segment"


@pytest.mark.parametrize(("poses", "receiver"), [(True, False), (False, True)])
def test_comma_folder_is_read_in_utc(car: MovingCar, poses: bool, receiver: bool) -> None:
    """Rear wheels, the gyro's downward axis, and the device's clock by the GPS times in the folder."""
    write_comma(car, poses=poses, receiver=receiver)
    motion = motion_of(car, settings_of(file='"segment"')).motion
    assert motion is not None
    assert motion.speed is not None
    assert motion.turn_rate is not None
    assert np.abs(motion.speed.epoch_ns - car.epoch_ns).max() < 1_000_000
    assert nearly(motion.speed.values, car.speed_mps, 1e-9)
    assert nearly(motion.turn_rate.values, car.turn_rad_s, 1e-12)
    named = motion_of(car, settings_of(file='"segment/processed_log"', speed='"CAN/speed"')).motion
    assert named is not None
    assert named.turn_rate is None
    assert named.speed is not None
    assert nearly(named.speed.values, 0.99 * car.speed_mps, 1e-9)


def test_comma_folder_without_a_clock_or_with_a_program_in_it_is_refused(car: MovingCar) -> None:
    """Times since a start that nobody knows are asked for, and a pickle is never run."""
    segment = write_comma(car, poses=False)
    with pytest.raises(DriveError, match="time_zero"):
        motion_of(car, settings_of(file='"segment"'))
    (segment / "processed_log/IMU/gyro/value").write_bytes(b"\x80\x04K\x01.")
    with pytest.raises(DriveError, match="is no NumPy array of numbers"):
        motion_of(car, settings_of(file='"segment"', turn_rate='"IMU/gyro"'))


def framedata(car: MovingCar) -> list[dict[str, object]]:
    """CAN signals as ``ingest_framedata`` writes them."""
    records: list[dict[str, object]] = []
    for epoch_ns, v in zip(car.epoch_ns.tolist(), car.speed_mps.tolist(), strict=True):
        for name, value, unit in (("Speed", 3.6 * v, "km/h"), ("Wipers", 1.0, "")):
            payload = {
                "message_index": 1,
                "signal_index": 2,
                "signal_name": name,
                "value": value,
                "unit": unit,
            }
            records.append({"timestamp_us": epoch_ns // 1000, "payload": payload})
    return records


@pytest.mark.parametrize("lines", [False, True])
def test_driveworks_signals_have_their_units(car: MovingCar, lines: bool) -> None:
    """One document with metadata at its top, or one a line; the signal is named."""
    records = framedata(car)
    whole = {"metadata": {"fileType": "can"}, "frames": records}
    text = "\n".join(map(json.dumps, records)) if lines else json.dumps(whole)
    (car.trip / "can.json").write_text(text)
    with pytest.raises(DriveError, match="its signals: Speed, Wipers"):
        motion_of(car, settings_of(file='"can.json"', speed_unit='"km/h"'))
    with pytest.raises(DriveError, match="the nearest is Speed"):
        motion_of(car, settings_of(file='"can.json"', speed='"Sped"'))
    motion = motion_of(car, settings_of(file='"can.json"', speed='"Speed"')).motion
    assert motion is not None
    assert motion.speed is not None
    assert nearly(motion.speed.values, car.speed_mps, 1e-9)
    assert np.abs(motion.speed.epoch_ns - car.epoch_ns).max() < 1_000


def test_driveworks_imu_needs_its_axis(car: MovingCar) -> None:
    """The rates are about the sensor's own axes, which NVIDIA leaves to the device."""
    rows = zip(car.epoch_ns.tolist(), car.turn_rad_s.tolist(), strict=True)
    records = [{"timestamp_us": t // 1000, "payload": {"turnrate": [0.0, 0.0, -turn]}} for t, turn in rows]
    (car.trip / "imu.json").write_text(json.dumps(records))
    with pytest.raises(DriveError, match="turn_rate_axis"):
        motion_of(car, settings_of(file='"imu.json"'))
    motion = motion_of(car, settings_of(file='"imu.json"', turn_rate_axis='"-z"')).motion
    assert motion is not None
    assert motion.turn_rate is not None
    assert nearly(motion.turn_rate.values, car.turn_rad_s, 1e-12)


def test_driveworks_egomotion_gives_the_speed(car: MovingCar) -> None:
    """Steps of centimetres ten times a second are a speed with a sigma of 4 cm/s, without a sign."""
    every = slice(None, None, 3)
    at_m = np.cumsum(np.gradient(car.seconds) * car.speed_mps)[every]
    rows = zip(car.epoch_ns[every].tolist(), at_m.tolist(), strict=True)
    (car.trip / "ego.txt").write_text("".join(f"{t // 1000},{m:.2f},0.00,0.00\n" for t, m in rows))
    notes = ReadingNotes()
    motion = motion_of(car, settings_of(file='"ego.txt"'), notes).motion
    assert motion is not None
    assert motion.speed is not None
    assert np.median(motion.speed.sigma) == pytest.approx(0.041, abs=0.002)
    assert np.abs(motion.speed.values - car.speed_mps[1::3][: len(motion.speed.values)]).max() < 0.15
    assert any("no sign" in str(warning) for warning in notes.warnings)
    assert motion.speed.epoch_ns[0] > car.epoch_ns[0] + S // 100
