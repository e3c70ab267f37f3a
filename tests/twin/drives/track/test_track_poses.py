"""Poses of one drive, recorded in every format: the rig's origin and attitude come back."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from posed_trip import write_posed_trip
from sbp.orientation import MsgOrientEuler
from track_writers import Recorded, Ros, sbp_clock, sbp_position, sbp_time

from geoloc.earth.geodesy import enu_offset, geographic_from_enu, rotation_enu_from_rig
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.errors import DriveError

ARM = (1.2, -0.4, 1.5)


def posed(recorded: Recorded, folder: Path, name: str, arm: tuple[float, float, float] = ARM) -> Path:
    """The folder of the drive, its poses being those of an INS's point in another file."""
    write_posed_trip(recorded.drive, folder)
    settings = (folder / "drive.toml").read_text(encoding="utf-8")
    table = f'file = "{name}"\nlever_arm = {list(arm)}'
    (folder / "drive.toml").write_text(settings.replace('file = "poses.csv"', table), encoding="utf-8")
    return folder


def ins_point(recorded: Recorded) -> list[tuple[int, tuple[float, float, float], tuple[float, float, float]]]:
    """Epoch, place of the INS's point, and roll, pitch, heading of the car (ISO 8855), of the true poses."""
    poses = recorded.drive.poses
    turn = rotation_enu_from_rig(poses.heading_deg, poses.pitch_deg, poses.roll_deg)
    east, north, up = (turn @ np.array(ARM)).T
    latitude, longitude = geographic_from_enu(poses.latitude_deg, poses.longitude_deg, east, north)
    place = np.stack([latitude, longitude, poses.height_m + up], axis=1)
    angles = np.stack([poses.roll_deg, poses.pitch_deg, poses.heading_deg], axis=1)
    rows = zip(poses.epoch_ns.tolist(), place.tolist(), angles.tolist(), strict=True)
    return [(t - t % 1_000_000, tuple(p), tuple(a)) for t, p, a in rows]  # SBP's clock has milliseconds


def assert_true_poses(drive: Drive, recorded: Recorded) -> None:
    """The rig's origin and attitude are back, to 1 mm and a thousandth of a degree."""
    assert drive.poses is not None
    truth = recorded.drive.poses
    at = drive.poses.epoch_ns
    # Within the millisecond that SBP's clock cuts off, 20 km/h are 6 mm.
    rows = np.searchsorted(truth.epoch_ns, at)
    east, north = enu_offset(
        truth.latitude_deg[rows],
        truth.longitude_deg[rows],
        drive.poses.latitude_deg,
        drive.poses.longitude_deg,
    )
    assert np.hypot(east, north).max() < 1e-3
    assert np.abs(drive.poses.height_m - truth.height_m[rows]).max() < 1e-3
    for name in ("roll_deg", "pitch_deg", "heading_deg"):
        off = getattr(drive.poses, name) - getattr(truth, name)[rows]
        assert np.abs((off + 180) % 360 - 180).max() < 1e-3, name


def test_sbp_poses_are_moved_to_the_rigs_origin(recorded: Recorded, tmp_path: Path) -> None:
    """A Duro Inertial: positions of its point, angles north, east, down."""
    content = b""
    for t, place, (roll, pitch, heading) in ins_point(recorded):
        accuracy = dict.fromkeys(("roll_accuracy", "pitch_accuracy", "yaw_accuracy"), 0.1)
        yaw = (heading + 180) % 360 - 180
        angles = {"roll": round(roll * 1e6), "pitch": round(-pitch * 1e6), "yaw": round(yaw * 1e6)}
        euler = MsgOrientEuler(tow=sbp_time(t)[1], flags=1, **angles, **accuracy)
        content += sbp_clock(t) + sbp_position(t, *place, mode=4 | 1 << 3) + bytes(euler.to_binary())
    folder = posed(recorded, tmp_path / "drive", "ins.sbp")
    (folder / "ins.sbp").write_bytes(content)
    assert_true_poses(read_drive(folder), recorded)


def test_ros_poses_are_moved_to_the_rigs_origin(recorded: Recorded, tmp_path: Path) -> None:
    """NavSatFix and Imu of one MCAP: east, north, up."""
    from scipy.spatial.transform import Rotation

    ros = Ros(2)
    messages = []
    for t, place, (roll, pitch, heading) in ins_point(recorded):
        q = Rotation.from_euler("ZYX", [90 - heading, pitch, roll], degrees=True).as_quat()
        messages += [("/fix", t, ros.fix(t, *place)), ("/imu", t, ros.imu(t, q.tolist()))]
    folder = posed(recorded, tmp_path / "drive", "ins")
    ros.write(folder / "ins", messages)
    assert_true_poses(read_drive(folder), recorded)


def test_poses_csv_of_another_point_is_moved_as_well(recorded: Recorded, tmp_path: Path) -> None:
    """Lever arm (1.2, -0.4, 1.5) takes every position that far back, turned with the car."""
    folder = posed(recorded, tmp_path / "drive", "poses.csv")
    moved, plain = read_drive(folder).poses, recorded.drive.poses
    assert moved is not None
    east, north = enu_offset(plain.latitude_deg, plain.longitude_deg, moved.latitude_deg, moved.longitude_deg)
    away = np.sqrt(east**2 + north**2 + (moved.height_m - plain.height_m) ** 2)
    assert away == pytest.approx(np.full(away.shape, np.linalg.norm(ARM)), abs=2e-4)


def test_pose_file_is_found_where_there_is_no_recording(recorded: Recorded, tmp_path: Path) -> None:
    """Without a [poses] table; two of them need one."""
    folder = tmp_path / "drive"
    write_posed_trip(recorded.drive, folder)
    settings = (folder / "drive.toml").read_text(encoding="utf-8")
    (folder / "drive.toml").write_text(settings.replace('[poses]\nfile = "poses.csv"', ""), encoding="utf-8")
    assert read_drive(folder).poses is not None
    shutil.copy(folder / "poses.csv", folder / "other.csv")
    with pytest.raises(
        DriveError, match=r"other.csv and poses.csv both hold poses: name one under \[poses\]"
    ):
        read_drive(folder)


def test_poses_of_an_ins_without_lever_arm_are_told(recorded: Recorded, tmp_path: Path) -> None:
    """Its point is hardly ever the ground below the rear axle."""
    folder = posed(recorded, tmp_path / "drive", "ins")
    settings = (folder / "drive.toml").read_text(encoding="utf-8")
    (folder / "drive.toml").write_text(settings.replace(f"lever_arm = {list(ARM)}\n", ""), encoding="utf-8")
    ros = Ros(2)
    east = (0.0, 0.0, 0.0, 1.0)
    messages = []
    for t, place, _ in ins_point(recorded):
        messages += [("/fix", t, ros.fix(t, *place)), ("/imu", t, ros.imu(t, east))]
    ros.write(folder / "ins", messages)
    assert any(
        "give [poses] lever_arm in drive.toml" in warning.sentence for warning in read_drive(folder).warnings
    )
