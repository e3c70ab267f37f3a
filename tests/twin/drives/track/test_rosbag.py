"""ROS 1 bags, ROS 2 databases and MCAP recordings."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from left_out import counts
from track_writers import Ros, S, Timed

from geoloc.earth.geodesy import rotation_enu_from_rig
from twin.drives.track.formats import rosbag
from twin.drives.track.formats.rosbag import looks_like_rosbag, read_rosbag, read_rosbag_poses
from twin.errors import DriveError

START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * S
PLACE = (63.42, 10.4, 80.0)
KINDS = [(1, ""), (1, "bz2"), (1, "lz4"), (2, ""), (2, "zstd"), (2, "db3")]


def recorded(
    folder: Path, ros: Ros, messages: Iterator[Timed] | list[Timed], compression: str = ""
) -> list[Path]:
    """Write a recording; give the files that hold its messages."""
    path = ros.write(folder / ("a.bag" if ros.version == 1 else "a"), messages, compression)
    return [path] if path.is_file() else sorted(p for p in path.iterdir() if p.suffix != ".yaml")


def drive(ros: Ros, n: int = 5, topic: str = "/fix", **options: Any) -> Iterator[Timed]:
    """Fixes at 5 Hz, recorded 20 ms late, between messages of another kind."""
    for i in range(n):
        epoch_ns = START_NS + i * S // 5
        yield "/chatter", epoch_ns, ros.text("hello")
        yield topic, epoch_ns + 20_000_000, ros.fix(epoch_ns, *PLACE, **options)


@pytest.mark.parametrize(("version", "compression"), KINDS)
def test_rosbag_fixes_are_those_recorded(tmp_path: Path, version: int, compression: str) -> None:
    """Every container gives the same: stamp of the header, place, sigmas, and when it was recorded."""
    ros = Ros(version)
    paths = recorded(tmp_path, ros, drive(ros, sigma_m=(0.01, 0.02, 0.03)), compression)
    assert looks_like_rosbag(paths[0].read_bytes()[:64])
    read = read_rosbag(paths, "roof", "a")
    fixes = read.fixes
    assert fixes.epoch_ns.tolist() == [START_NS + i * S // 5 for i in range(5)]
    assert set((fixes.host_ns - fixes.epoch_ns).tolist()) == {20_000_000}
    assert (fixes.latitude_deg[0], fixes.longitude_deg[0], fixes.height_m[0]) == PLACE
    assert fixes.sigma_horizontal_m == pytest.approx([math.sqrt(2.5e-4)] * 5)
    assert fixes.sigma_vertical_m == pytest.approx([0.03] * 5)
    assert set(fixes.quality.tolist()) == {4}
    assert read.skipped == ()


@pytest.mark.parametrize(
    ("status", "sigma_m", "quality"),
    [(0, (), 1), (1, (), 2), (2, (), 4), (2, (0.3, 0.3, 0.5), 5), (0, (0.01, 0.01, 0.02), 1)],
)
def test_rosbag_status_becomes_a_gga_quality(
    tmp_path: Path, status: int, sigma_m: tuple[float, ...], quality: int
) -> None:
    """GBAS is what RTK receivers report: fixed where the covariance is good."""
    ros = Ros(2)
    paths = recorded(tmp_path, ros, drive(ros, 1, status=status, sigma_m=sigma_m))
    assert read_rosbag(paths, "a", "a").fixes.quality.tolist() == [quality]


def test_rosbag_messages_that_cannot_be_used_are_counted(tmp_path: Path) -> None:
    """No fix, no number, no date: each has its reason."""
    ros = Ros(2)
    bad = [
        ros.fix(START_NS + S, *PLACE, status=-1),
        ros.fix(START_NS + S, math.nan, math.nan, math.nan),
        ros.fix(0, *PLACE),
        ros.fix(START_NS - S, *PLACE),
    ]
    messages = [*drive(ros, 3), *(("/fix", START_NS + 2 * S, message) for message in bad)]
    read = read_rosbag(recorded(tmp_path, ros, messages), "a", "a")
    assert len(read.fixes.epoch_ns) == 3
    assert counts(read.skipped) == {
        "no fix by its status": 1,
        "position not finite": 1,
        "stamp outside the years 2000–2099": 1,
        "epoch not after the fix before": 1,
    }


def test_rosbag_with_two_antennas_asks_which(tmp_path: Path) -> None:
    """The topics are named, with the key; the one that is named is read."""
    ros = Ros(2)
    paths = recorded(tmp_path, ros, [*drive(ros, 2, "/left"), *drive(ros, 3, "/right")])
    with pytest.raises(
        DriveError, match=r"several topics of NavSatFix: name one of /left, /right.*\[gnss\] topics"
    ):
        read_rosbag(paths, "a", "a")
    with pytest.raises(DriveError, match="has no topic /roof of NavSatFix: name one of /left, /right"):
        read_rosbag(paths, "a", "a", "/roof")
    assert len(read_rosbag(paths, "a", "a", "/right").fixes.epoch_ns) == 3


def test_rosbag_without_positions_names_what_it_has(tmp_path: Path) -> None:
    """The refusal lists the topics with their types."""
    ros = Ros(1)
    paths = recorded(tmp_path, ros, [("/chatter", START_NS, ros.text("hello"))])
    with pytest.raises(DriveError, match=r"a\.bag has no topic of NavSatFix: it has /chatter \(String\)"):
        read_rosbag(paths, "a", "a.bag")


def turned(yaw_deg: float, pitch_deg: float, roll_deg: float) -> tuple[float, float, float, float]:
    """Quaternion x, y, z, w of ``Rz(yaw) Ry(pitch) Rx(roll)``."""
    y, p, r = (math.radians(a) / 2 for a in (yaw_deg, pitch_deg, roll_deg))
    sy, sp, sr, cy, cp, cr = math.sin(y), math.sin(p), math.sin(r), math.cos(y), math.cos(p), math.cos(r)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def test_rosbag_attitude_is_against_east_north_up(tmp_path: Path) -> None:
    """Yaw 30° is a heading of 60°: the bonnet points east and a little north; positive pitch is nose down."""
    ros = Ros(2)
    imu = [("/imu", START_NS, ros.imu(START_NS + i * S // 100, turned(30.0, 2.0, 1.0))) for i in range(100)]
    paths = recorded(tmp_path, ros, [*drive(ros), *imu])
    track = read_rosbag_poses(paths, "a", {}).track
    assert len(track.epoch_ns) == 5
    assert track.heading_deg == pytest.approx([60.0] * 5)
    assert track.pitch_deg == pytest.approx([2.0] * 5)
    assert track.roll_deg == pytest.approx([1.0] * 5)
    assert track.sigma_heading_deg == pytest.approx([math.degrees(1e-3)] * 5)
    forward = rotation_enu_from_rig(track.heading_deg, track.pitch_deg, track.roll_deg)[0, :, 0]
    assert forward == pytest.approx([0.8655, 0.4997, -0.0349], abs=1e-4)


def test_rosbag_odometry_is_taken_where_it_is_named(tmp_path: Path) -> None:
    """An Imu and an Odometry could both be the attitude: drive.toml says which."""
    ros = Ros(1)
    both = [
        message
        for i in range(10)
        for message in (
            ("/imu", START_NS, ros.imu(START_NS + i * S // 10, turned(30.0, 0.0, 0.0))),
            ("/odom", START_NS, ros.odometry(START_NS + i * S // 10, turned(-90.0, 0.0, 0.0))),
        )
    ]
    paths = recorded(tmp_path, ros, [*drive(ros), *both])
    with pytest.raises(DriveError, match=r"several topics of Imu or Odometry: name one of /imu, /odom"):
        read_rosbag_poses(paths, "a", {})
    track = read_rosbag_poses(paths, "a", {"attitude": "/odom"}).track
    assert track.heading_deg == pytest.approx([180.0] * 5)


def test_rosbag_imu_without_attitude_gives_no_poses(tmp_path: Path) -> None:
    """A covariance that begins with -1 says that the sensor has none."""
    ros = Ros(1)
    imu = [("/imu", START_NS, ros.imu(START_NS + i * S // 10, (0.0, 0.0, 0.0, 1.0), -1.0)) for i in range(3)]
    paths = recorded(tmp_path, ros, [*drive(ros), *imu])
    with pytest.raises(DriveError, match=r"no usable attitude \(3 × Imu message without an attitude\)"):
        read_rosbag_poses(paths, "a", {})


@pytest.mark.parametrize(("version", "compression"), KINDS)
def test_rosbag_that_is_cut_is_refused_with_the_cure(tmp_path: Path, version: int, compression: str) -> None:
    """A recorder that was killed leaves a file without its index."""
    ros = Ros(version)
    (path,) = recorded(tmp_path, ros, drive(ros, 40), compression)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])
    with pytest.raises(DriveError, match=r"cannot be read as a ROS recording.*repair it"):
        read_rosbag([path], "a", "a")


def test_rosbag_chunk_that_grows_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a chunk unpacks to is bounded, also where the file says that it is small."""
    ros = Ros(2)
    (path,) = recorded(tmp_path, ros, drive(ros, 400), "zstd")
    assert len(read_rosbag([path], "a", "a").fixes.epoch_ns) == 400
    monkeypatch.setattr(rosbag, "LARGEST_CHUNK_BYTES", 10_000)
    with pytest.raises(DriveError, match="larger than the 0 MB"):
        read_rosbag([path], "a", "a")


def test_rosbag_huge_declared_length_costs_no_memory(tmp_path: Path) -> None:
    """A record that declares 2^60 bytes is a damaged file."""
    ros = Ros(2)
    (path,) = recorded(tmp_path, ros, drive(ros))
    content = bytearray(path.read_bytes())
    content[9:17] = struct.pack("<Q", 2**60)
    path.write_bytes(content)
    with pytest.raises(DriveError, match="cannot be read as a ROS recording"):
        read_rosbag([path], "a", "a")


def test_rosbag_stamped_by_gps_time_is_told(tmp_path: Path) -> None:
    """Recorded 18 s before its own stamps: one of the two clocks is not UTC."""
    ros = Ros(2)
    messages = [("/fix", t - 18 * S, ros.fix(t, *PLACE)) for t in (START_NS, START_NS + S)]
    read = read_rosbag(recorded(tmp_path, ros, messages), "a", "a")
    assert "-18.0 s from the UTC of its fixes (18 s would be GPS time" in read.warnings[0]
