"""What ``twin inspect`` tells of a car's motion, and that ``ingest-drive`` gets it."""

from __future__ import annotations

import json

import can
import numpy as np
import pytest
from command_line import Twin
from moving_car import TABLE, MovingCar
from sbp.orientation import MsgAngularRate
from small_camera import gyro_packet, write_video
from track_writers import Ros, sbp_clock

from twin.drives.read import read_drive


def drive_toml(whole: MovingCar, **keys: str) -> None:
    """Write the settings of the table."""
    lines = "\n".join(f"{key} = {value}" for key, value in (TABLE | keys).items())
    (whole.trip / "drive.toml").write_text(f"[motion]\n{lines}\n")


def test_motion_is_a_sensor_with_its_rate_unit_and_fit(whole: MovingCar, twin: Twin) -> None:
    """Rate, span, unit, how it fits the fixes; the drive has it, under the same id as without."""
    before = read_drive(whole.trip).drive_id
    whole.table(whole.trip / "can.csv")
    drive_toml(whole)
    document = twin("inspect", whole.trip, "--json").json
    assert document["ready"]
    (table,) = (file for file in document["files"] if file["name"] == "can.csv")
    assert (table["kind"], table["used"]) == ("read as drive.toml says", True)
    by_name = {one["name"]: one for one in document["sensors"] if one["kind"] == "motion"}
    assert set(by_name) == {"speed", "turn_rate", "wheel_angle"}
    assert by_name["speed"]["rate_hz"] == pytest.approx(30.0, abs=0.1)
    assert by_name["speed"]["unit"] == "km/h"
    assert by_name["speed"]["of_fixes"] == pytest.approx(1.0, abs=0.02)
    assert by_name["turn_rate"]["first_ns"] == whole.epoch_ns[0]
    shown = twin("inspect", whole.trip).out
    assert "deg/s" in shown
    drive = read_drive(whole.trip)
    assert drive.motion is not None
    assert drive.motion.turn_rate is not None
    assert drive.drive_id == before


def test_wrong_unit_is_refused_by_inspect(whole: MovingCar, twin: Twin) -> None:
    """A ratio of 3.6 is km/h."""
    whole.table(whole.trip / "can.csv")
    drive_toml(whole, speed_unit='"m/s"')
    answer = twin("inspect", whole.trip)
    assert answer.code == 4
    assert 'speed_unit = "km/h"' in " ".join(answer.err.split())


def test_settings_that_cannot_be_read_are_not_told_to_lack_a_key(whole: MovingCar, twin: Twin) -> None:
    """A misspelt key of the motion is the one thing said; annotations may well be said to be complete."""
    (whole.trip / "drive.toml").write_text('annotations_complete = true\n[motion]\nspede = "can.csv"\n')
    answer = twin("inspect", whole.trip)
    assert answer.code == 4
    assert "spede" in answer.err + answer.out
    assert "does not say annotations_complete" not in answer.err + answer.out


def test_what_is_not_used_or_cannot_be_read_is_named_with_the_cure(whole: MovingCar, twin: Twin) -> None:
    """Raw DriveWorks recordings, by name or by the rig, MDF, openpilot; a log and topics that could be."""
    rig = json.loads((whole.trip / "rig.json").read_text())
    rig["rig"]["sensors"].append(
        {"name": "bus", "protocol": "can.virtual", "parameter": "file=bus7.bin", "properties": None}
    )
    (whole.trip / "rig.json").write_text(json.dumps(rig))
    for name in ("can_vehicle0.bin", "imu_vehicle.bin", "bus7.bin", "rlog.zst"):
        (whole.trip / name).write_bytes(b"\x01\x02\x03\x04" * 50)
    (whole.trip / "bus.mf4").write_bytes(b"MDF     4.10")
    with can.Logger(whole.trip / "bus.asc") as log:
        log.on_message_received(can.Message(timestamp=whole.epoch_ns[0] / 1e9, data=b"12"))
    ros = Ros(2)
    ros.write(
        whole.trip / "bag", [("/imu", int(whole.epoch_ns[0]), ros.gyro(int(whole.epoch_ns[0]), (0, 0, 0.1)))]
    )
    rate = MsgAngularRate(tow=1, x=0, y=0, z=0, flags=1).to_binary()
    (whole.trip / "ins.sbp").write_bytes(sbp_clock(int(whole.epoch_ns[0])) + rate)
    packets = [(0, gyro_packet([(0.0, 0.0, 0.1)] * 20))]
    write_video(whole.trip / "GX010001.MP4", whole.epoch_ns[:3], int(whole.epoch_ns[0]), data=packets)
    (whole.trip / "drive.toml").write_text('[gnss]\nfiles = {"gnss50:vehicle" = "gnss50_vehicle.bin"}\n')
    document = twin("inspect", whole.trip, "--json").json
    said = {warning.split()[0]: warning for warning in document["warnings"]}
    for name in ("can_vehicle0.bin", "bus7.bin"):
        assert "cannot be read (DriveWorks' own recording of a CAN bus)" in said[name]
        assert "ingest_framedata" in said[name]
        assert "ASC" in said[name]
    assert "of an IMU" in said["imu_vehicle.bin"]
    assert "export carState" in said["rlog.zst"]
    assert "ASC" in said["bus.mf4"]
    assert "not used (log of a CAN bus)" in said["bus.asc"]
    assert "/imu (Imu)" in said["bag"]
    assert "ANGULAR_RATE" in said["ins.sbp"]
    assert "gyro of the camera" in said["GX010001.MP4"]
    kinds = {file["name"]: file["kind"] for file in document["files"]}
    assert kinds["can_vehicle0.bin"] == "DriveWorks' own recording of a CAN bus, not read"
    assert document["ready"]


def test_rig_gives_wheelbase_and_radius(whole: MovingCar) -> None:
    """DriveWorks' vehicle data: axles along x, radii of the rear wheels; a speed in rad/s becomes m/s."""
    rig = json.loads((whole.trip / "rig.json").read_text())
    axle = {"wheelRadiusLeft": 0.33, "wheelRadiusRight": 0.33}
    axles = {"axleFront": {"position": 2.72, **axle}, "axleRear": {"position": 0.02, **axle}}
    rig["rig"]["vehicle"] = {"valid": True, "value": {**axles, "body": {"length": 4.4}}}
    (whole.trip / "rig.json").write_text(json.dumps(rig))
    rows = [f"{t},{v / 0.33}" for t, v in zip(whole.epoch_ns.tolist(), whole.speed_mps.tolist(), strict=True)]
    (whole.trip / "turns.csv").write_text("\n".join(["t,w", *rows]))
    (whole.trip / "drive.toml").write_text(
        '[motion]\nfile = "turns.csv"\ntime = "t"\ntime_unit = "ns"\nspeed = "w"\nspeed_unit = "rad/s"\n'
    )
    motion = read_drive(whole.trip).motion
    assert motion is not None
    assert motion.speed is not None
    assert motion.wheelbase_m == pytest.approx(2.7)
    assert np.abs(motion.speed.values - whole.speed_mps).max() < 1e-6
