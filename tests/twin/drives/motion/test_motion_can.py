"""A car's motion from logs of its CAN bus, which python-can writes, and a DBC, which cantools encodes by."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import can
import cantools.database
import numpy as np
import pytest
from moving_car import WHEELBASE_M, MovingCar, motion_of, nearly, settings_of

from twin.drives.folder.notes import ReadingNotes
from twin.errors import DriveError

DBC = """VERSION ""
BU_: A
BO_ 291 WHEELS: 8 A
 SG_ REAR_LEFT : 0|16@1+ (0.01,0) [0|300] "km/h" A
 SG_ REAR_RIGHT : 16|16@1+ (0.01,0) [0|300] "km/h" A
 SG_ TURNS : 32|16@1+ (0.01,0) [0|600] "rad/s" A
BO_ 2147484000 ESC: 8 A
 SG_ YAW : 0|16@1- (0.005,0) [-100|100] "deg/s" A
 SG_ STEERING : 16|16@1- (0.05,0) [-800|800] "" A
"""
KEYS = {
    "dbc": '"car.dbc"',
    "speed": '["WHEELS.REAR_LEFT", "WHEELS.REAR_RIGHT"]',
    "turn_rate": '"ESC.YAW"',
}
ZERO_S = 1_781_078_000


def write_log(car: MovingCar, name: str, *, late_s: float = 0.0, zero_s: float = 0.0) -> Path:
    """Write both messages at every frame; the left wheel is faster by 1 km/h than the right one."""
    database = cantools.database.load_string(DBC, "dbc")
    path = car.trip / name
    (car.trip / "car.dbc").write_text(DBC)
    with can.Logger(path) as writer:
        columns = car.speed_mps, car.turn_rad_s, car.wheel_rad
        for epoch_ns, v, turn, wheel in zip(
            car.epoch_ns.tolist(), *map(np.ndarray.tolist, columns), strict=True
        ):
            wheels = {"REAR_LEFT": 3.6 * v + 0.5, "REAR_RIGHT": 3.6 * v - 0.5, "TURNS": v / 0.33}
            esc = {"YAW": np.degrees(turn), "STEERING": 15.0 * np.degrees(wheel)}
            for message, said in (("WHEELS", wheels), ("ESC", esc)):
                its = database.get_message_by_name(message)
                writer.on_message_received(
                    can.Message(
                        timestamp=epoch_ns / 1e9 + late_s - zero_s,
                        arbitration_id=its.frame_id,
                        is_extended_id=its.is_extended_frame,
                        data=its.encode(said),
                        channel=0,
                    )
                )
    return path


@pytest.mark.parametrize(
    ("name", "zone"), [("a.asc", True), ("a.blf", True), ("a.log", False), ("a.trc", True)]
)
def test_every_kind_of_log_gives_what_the_bus_said(car: MovingCar, name: str, zone: bool) -> None:
    """Units are the DBC's, the two rear wheels' mean is the axle's speed, and a clock's zone is asked for."""
    write_log(car, name)
    if zone:
        with pytest.raises(DriveError, match="utc_offset_hours"):
            motion_of(car, settings_of(file=f'"{name}"', **KEYS))
    offset = {"utc_offset_hours": "0"} if zone else {}
    if name == "a.asc":  # its writer takes the zone of the machine, and its format has none
        machine = datetime.fromtimestamp(ZERO_S, UTC).astimezone().utcoffset()
        assert machine is not None
        offset = {"utc_offset_hours": str(machine.total_seconds() / 3600.0)}
    read = motion_of(car, settings_of(file=f'"{name}"', **KEYS, **offset))
    motion = read.motion
    assert motion is not None
    assert motion.speed is not None
    assert motion.turn_rate is not None
    # Milliseconds are all that some of these formats keep of the start.
    assert np.abs(motion.speed.epoch_ns - car.epoch_ns).max() < 1_500_000
    assert nearly(motion.speed.values, car.speed_mps, 0.01 / 3.6)
    assert nearly(motion.turn_rate.values, car.turn_rad_s, np.radians(0.005))


def test_unit_that_the_dbc_lacks_is_asked_for(car: MovingCar) -> None:
    """An angle without a unit is read once drive.toml states it; wheels that turn need a radius."""
    write_log(car, "a.log")
    angle = {"file": '"a.log"', "dbc": '"car.dbc"', "wheel_angle": '"ESC.STEERING"'}
    with pytest.raises(DriveError, match="wheel_angle_unit"):
        motion_of(car, settings_of(**angle))
    angle |= {"wheel_angle_unit": '"deg"', "steering_ratio": "15", "wheelbase_m": str(WHEELBASE_M)}
    read = motion_of(car, settings_of(**angle))
    assert read.motion is not None
    assert read.motion.wheel_angle is not None
    assert nearly(read.motion.wheel_angle.values, car.wheel_rad, np.radians(0.05 / 15))
    turns = {"file": '"a.log"', "dbc": '"car.dbc"', "speed": '"WHEELS.TURNS"'}
    with pytest.raises(DriveError, match="wheel_radius_m"):
        motion_of(car, settings_of(**turns))
    read = motion_of(car, settings_of(**turns, wheel_radius_m="0.33"))
    assert read.motion is not None
    assert read.motion.speed is not None
    assert nearly(read.motion.speed.values, car.speed_mps, 0.01 * 0.33)


def test_log_from_its_start_needs_an_instant(car: MovingCar) -> None:
    """``candump -t z`` counts from the first message: time_zero says when that was."""
    write_log(car, "a.log", zero_s=ZERO_S)
    with pytest.raises(DriveError, match="time_zero"):
        motion_of(car, settings_of(file='"a.log"', **KEYS))
    zero = datetime.fromtimestamp(ZERO_S, UTC).isoformat()
    read = motion_of(car, settings_of(file='"a.log"', **KEYS, time_zero=f'"{zero}"'))
    assert read.motion is not None
    assert read.motion.speed is not None
    assert np.abs(read.motion.speed.epoch_ns - car.epoch_ns).max() < 1_500


def test_damage_costs_what_it_hits(car: MovingCar) -> None:
    """A log that is cut is read as far as it goes, and a value outside the DBC's range is none."""
    path = write_log(car, "a.log")
    text = path.read_bytes()
    lines = text.splitlines(keepends=True)
    lines[4] = lines[4].partition(b"#")[0] + b"#FFFFFFFFFFFFFFFF\n"
    path.write_bytes(b"".join(lines)[: len(text) // 2])
    notes = ReadingNotes()
    read = motion_of(car, settings_of(file='"a.log"', **KEYS), notes)
    assert read.motion is not None
    assert read.motion.speed is not None
    assert len(car.epoch_ns) // 2 - 5 < len(read.motion.speed.values) < len(car.epoch_ns) // 2 + 5
    reasons = {s.reason for s in notes.skipped if s.where == "a.log"}
    assert "value outside the range of the DBC" in reasons


@pytest.mark.parametrize(
    ("files", "keys", "told"),
    [
        ({}, {"speed": '"WHEELS.REAR"'}, "names the signal WHEELS.REAR, .*the nearest is WHEELS.REAR_"),
        ({"car.dbc": b"BO_ 291 WHEELS"}, {}, "cannot be read as a DBC"),
        ({"a.log": b"\0\1\2"}, {}, "cannot be read as a CAN log"),
        ({"a.log": b""}, {}, "holds no value of WHEELS.REAR_LEFT"),
        ({"a.mf4": b"MDF"}, {"file": '"a.mf4"'}, "export it as ASC"),
        ({}, {"dbc": '"none.dbc"'}, "none.dbc is not in the drive folder"),
    ],
)
def test_what_cannot_be_read_is_said_in_one_sentence(
    car: MovingCar, files: dict[str, bytes], keys: dict[str, str], told: str
) -> None:
    """What is wrong, where, and what to do."""
    write_log(car, "a.log")
    for name, content in files.items():
        (car.trip / name).write_bytes(content)
    with pytest.raises(DriveError, match=told):
        motion_of(car, settings_of(**({"file": '"a.log"'} | KEYS | keys)))


def test_a_log_without_its_dbc_asks_for_it(car: MovingCar) -> None:
    """A log by its name alone is known as one."""
    write_log(car, "a.log")
    with pytest.raises(DriveError, match=r"\[motion\] dbc"):
        motion_of(car, settings_of(file='"a.log"'))
