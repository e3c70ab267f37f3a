"""Small GNSS recordings in every format, written by other people's libraries where there are any."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from sbp.navigation import MsgGPSTime, MsgPosLLH, MsgUtcTime, MsgVelNED
from sbp.orientation import MsgBaselineHeading

from geoloc.simulation.simulate import SimulatedDrive
from geoloc.trajectory.trajectory import GnssFixes

S = 1_000_000_000
GPS_EPOCH_S, LEAP_S, WEEK_S = 315_964_800, 18, 604_800
GGA_FROM_SWIFT = {4: 4, 5: 3, 2: 2, 1: 1, 6: 5}

Timed = tuple[str, int, Any]
"""A topic, when its message was recorded, and the message."""


@dataclass(frozen=True)
class Recorded:
    """A simulated drive and the folder of its NMEA recording."""

    drive: SimulatedDrive
    trip: Path
    fixes: tuple[GnssFixes, ...]
    """Of its two antennas, as the NMEA recording gives them."""


def sbp_time(epoch_ns: int) -> tuple[int, int, int]:
    """GPS week, milliseconds of the week, and what is left in nanoseconds."""
    gps_ns = epoch_ns - (GPS_EPOCH_S - LEAP_S) * S
    week, rest_ns = divmod(gps_ns, WEEK_S * S)
    tow_ms = (rest_ns + 500_000) // 1_000_000
    return int(week), int(tow_ms), int(rest_ns - tow_ms * 1_000_000)


def sbp_clock(epoch_ns: int, *, utc: bool = True) -> bytes:
    """GPS_TIME, and UTC_TIME where asked for."""
    week, tow, residual = sbp_time(epoch_ns)
    frames = MsgGPSTime(wn=week, tow=tow, ns_residual=residual, flags=1).to_binary()
    if utc:
        moment = datetime.fromtimestamp(epoch_ns // S, UTC)
        parts = dict(
            zip(("year", "month", "day", "hours", "minutes", "seconds"), moment.timetuple(), strict=False)
        )
        frames += MsgUtcTime(flags=1 | 2 << 3, tow=tow, ns=epoch_ns % S, **parts).to_binary()
    return bytes(frames)


def sbp_position(epoch_ns: int, *place: float, mode: int = 4, accuracy_mm: tuple[int, int] = (0, 0)) -> bytes:
    """POS_LLH of latitude, longitude and ellipsoidal height."""
    latitude, longitude, height = place
    message = MsgPosLLH(
        tow=sbp_time(epoch_ns)[1],
        lat=latitude,
        lon=longitude,
        height=height,
        h_accuracy=accuracy_mm[0],
        v_accuracy=accuracy_mm[1],
        n_sats=14,
        flags=mode,
    )
    return bytes(message.to_binary())


def sbp_velocity(epoch_ns: int, *enu_mps: float, accuracy_mmps: tuple[int, int] = (0, 0)) -> bytes:
    """VEL_NED of a velocity east, north and up."""
    east, north, up = (round(1000 * v) for v in enu_mps)
    message = MsgVelNED(
        tow=sbp_time(epoch_ns)[1],
        n=north,
        e=east,
        d=-up,
        h_accuracy=accuracy_mmps[0],
        v_accuracy=accuracy_mmps[1],
        n_sats=14,
        flags=1,
    )
    return bytes(message.to_binary())


def sbp_heading(epoch_ns: int, heading_deg: float, mode: int = 4) -> bytes:
    """BASELINE_HEADING, clockwise from true north."""
    tow, heading = sbp_time(epoch_ns)[1], round(1000 * heading_deg)
    return bytes(MsgBaselineHeading(tow=tow, heading=heading, n_sats=14, flags=mode).to_binary())


def sbp_recording(fixes: GnssFixes) -> bytes:
    """Fixes as a Piksi or Duro writes them."""
    frames = []
    for i, epoch_ns in enumerate(fixes.epoch_ns.tolist()):
        place = (fixes.latitude_deg[i], fixes.longitude_deg[i], fixes.height_m[i])
        mode = GGA_FROM_SWIFT[int(fixes.quality[i])]
        frames += [sbp_clock(epoch_ns), sbp_position(epoch_ns, *map(float, place), mode=mode)]
    return b"".join(frames)


def gpx_document(points: Iterable[str]) -> bytes:
    """Wrap a GPX 1.1 document around track points."""
    return (
        '<?xml version="1.0"?><gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<trk><trkseg>{''.join(points)}</trkseg></trk></gpx>"
    ).encode()


def gpx_point(epoch_ns: int, latitude: float, longitude: float, height: float) -> str:
    """Return one track point."""
    moment = datetime.fromtimestamp(epoch_ns // S, UTC)
    time = f"{moment:%Y-%m-%dT%H:%M:%S}.{epoch_ns % S // 1000:06d}Z"
    inside = f"<ele>{height:.4f}</ele><time>{time}</time>"
    return f'<trkpt lat="{latitude:.10f}" lon="{longitude:.10f}">{inside}</trkpt>'


class Ros:
    """Makes messages of one ROS version and writes them."""

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)

    def _of(self, kind: str, *parts: Any) -> Any:
        return self.store.types[kind](*parts)

    def header(self, epoch_ns: int) -> Any:
        """Return a header with this stamp."""
        stamp = self._of("builtin_interfaces/msg/Time", epoch_ns // S, epoch_ns % S)
        sequence = (0,) if self.version == 1 else ()
        return self._of("std_msgs/msg/Header", *sequence, stamp, "base_link")

    def fix(self, epoch_ns: int, *place: float, status: int = 2, sigma_m: Sequence[float] = ()) -> Any:
        """Return a NavSatFix; `sigma_m` are those of east, north and up."""
        covariance = np.diag(np.square(sigma_m or [0.0, 0.0, 0.0])).ravel()
        state = self._of("sensor_msgs/msg/NavSatStatus", status, 1)
        kind = "sensor_msgs/msg/NavSatFix"
        return self._of(kind, self.header(epoch_ns), state, *place, covariance, 2 if sigma_m else 0)

    def imu(self, epoch_ns: int, quaternion: Sequence[float], variance: float = 1e-6) -> Any:
        """Return an Imu message with an attitude (x, y, z, w); a variance of -1 says that there is none."""
        q = self._of("geometry_msgs/msg/Quaternion", *quaternion)
        zero = self._of("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        spread, none = np.diag([variance] * 3).ravel(), np.zeros(9)
        return self._of("sensor_msgs/msg/Imu", self.header(epoch_ns), q, spread, zero, none, zero, none)

    def odometry(self, epoch_ns: int, quaternion: Sequence[float], variance: float = 1e-6) -> Any:
        """Return an Odometry message at the origin of its own frame, with an attitude (x, y, z, w)."""
        spread = np.diag([variance] * 6).ravel()
        place = self._of("geometry_msgs/msg/Point", 0.0, 0.0, 0.0)
        pose = self._of(
            "geometry_msgs/msg/Pose", place, self._of("geometry_msgs/msg/Quaternion", *quaternion)
        )
        zero = self._of("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        twist = self._of("geometry_msgs/msg/Twist", zero, zero)
        spread_pose = self._of("geometry_msgs/msg/PoseWithCovariance", pose, spread)
        spread_twist = self._of("geometry_msgs/msg/TwistWithCovariance", twist, spread)
        header = self.header(epoch_ns)
        return self._of("nav_msgs/msg/Odometry", header, "base_link", spread_pose, spread_twist)

    def gyro(self, epoch_ns: int, rate_rad_s: Sequence[float], sigma_rad_s: float = 0.0) -> Any:
        """Return an Imu message with rates of turn about its three axes, and no attitude."""
        q = self._of("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
        zero = self._of("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        rate = self._of("geometry_msgs/msg/Vector3", *rate_rad_s)
        without, none = np.array([-1.0, *[0.0] * 8]), np.zeros(9)
        spread = np.diag([sigma_rad_s**2] * 3).ravel()
        kind = "sensor_msgs/msg/Imu"
        return self._of(kind, self.header(epoch_ns), q, without, rate, spread, zero, none)

    def twist(self, epoch_ns: int, speed_mps: float, turn_rad_s: float, frame: str = "base_link") -> Any:
        """Return a TwistStamped of a car."""
        linear = self._of("geometry_msgs/msg/Vector3", speed_mps, 0.0, 0.0)
        angular = self._of("geometry_msgs/msg/Vector3", 0.0, 0.0, turn_rad_s)
        header = dataclasses.replace(self.header(epoch_ns), frame_id=frame)
        twist = self._of("geometry_msgs/msg/Twist", linear, angular)
        return self._of("geometry_msgs/msg/TwistStamped", header, twist)

    def moving_odometry(self, epoch_ns: int, speed_mps: float, turn_rad_s: float, sigma_mps: float) -> Any:
        """Return an Odometry message with a twist."""
        still = self.odometry(epoch_ns, (0.0, 0.0, 0.0, 1.0))
        twist = self.twist(epoch_ns, speed_mps, turn_rad_s).twist
        spread = np.diag([sigma_mps**2] * 6).ravel()
        kind = "geometry_msgs/msg/TwistWithCovariance"
        return dataclasses.replace(still, twist=self._of(kind, twist, spread))

    def text(self, text: str) -> Any:
        """Return a message of a type that twin does not read."""
        return self._of("std_msgs/msg/String", text)

    def write(self, path: Path, messages: Iterable[Timed], compression: str = "") -> Path:
        """Write a ROS 1 bag, or a ROS 2 folder (``mcap``, ``zstd`` for packed MCAP, ``db3``)."""
        if self.version == 1:
            bag: Any = Writer1(path)
            if compression:
                bag.set_compression(Writer1.CompressionFormat[compression.upper()])
            pack = self.store.serialize_ros1
        else:
            plugin = StoragePlugin.SQLITE3 if compression == "db3" else StoragePlugin.MCAP
            bag = Writer2(path, version=9, storage_plugin=plugin)
            if compression == "zstd":
                bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            pack = self.store.serialize_cdr
        connections: dict[str, Any] = {}
        with bag:
            for topic, log_ns, message in messages:
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, kind, typestore=self.store)
                bag.write(connections[topic], log_ns, bytes(pack(message, kind)))
        return path


def jpeg(gps: dict[int, Any] | None = None, exif: dict[int, Any] | None = None) -> bytes:
    """Return a small JPEG with these GPS and EXIF tags."""
    tags = Image.Exif()
    if gps:
        tags.get_ifd(0x8825).update(gps)
    if exif:
        tags.get_ifd(0x8769).update(exif)
    file = io.BytesIO()
    Image.new("RGB", (8, 8)).save(file, "JPEG", exif=tags if gps or exif else b"")
    return file.getvalue()


def gps_tags(
    latitude: float, longitude: float, height: float, time: tuple[float, ...], date: str
) -> dict[int, Any]:
    """GPS tags as a telephone writes them."""
    return {
        1: "S" if latitude < 0 else "N",
        2: _sexagesimal(abs(latitude)),
        3: "W" if longitude < 0 else "E",
        4: _sexagesimal(abs(longitude)),
        5: b"\1" if height < 0 else b"\0",
        6: abs(height),
        7: time,
        29: date,
    }


def _sexagesimal(angle: float) -> tuple[float, float, float]:
    minutes, rest = divmod(angle * 60, 1)
    return minutes // 60, minutes % 60, rest * 60
