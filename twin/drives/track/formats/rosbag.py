"""ROS 1 bags, ROS 2 databases (.db3) and MCAP recordings → fixes of an antenna, or full poses.

Conventions are those of ROS (REP 103, REP 105 and the message definitions of ``sensor_msgs``): positions are
geographic with ellipsoidal height, attitudes turn forward, left, up into east, north, up, so that yaw 0 looks
east; stamps are those of the message's header.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from twin.drives.epochs import credible
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings
from twin.drives.track.attitudes import attitudes_from_rows, poses_of_fixes, rpy_deg_from_quaternion
from twin.drives.track.fixes import (
    Fix,
    FixesRead,
    LeftOutError,
    PosesRead,
    check_epoch,
    check_position,
    fixes_read,
    sigma_or_nan,
)
from twin.drives.track.formats.recording import Recording
from twin.errors import DriveError

POSITION_TYPE = "sensor_msgs/msg/NavSatFix"
ATTITUDE_TYPES = ("sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry")
SUFFIXES = (".bag", ".mcap", ".db3")
_ROS2_SUFFIXES = (".mcap", ".db3")
ROS2_METADATA = "metadata.yaml"
LARGEST_CHUNK_BYTES = 256_000_000
"""No recorder writes larger chunks (they write some 4 MB): what grows beyond it when unpacked is a bomb."""

_SINGLE, _DIFFERENTIAL, _FIXED, _FLOAT = 1, 2, 4, 5
_SBAS_FIX, _GBAS_FIX = 1, 2
_FIXED_BELOW_M = 0.05
_ROLL, _PITCH, _YAW = 21, 28, 35  # on the diagonal of Odometry's 6 x 6 covariance


def looks_like_rosbag(head: bytes) -> bool:
    """Whether a file begins as a ROS 1 bag, an MCAP file, or an SQLite database."""
    return head.startswith((b"#ROSBAG V2", b"\x89MCAP0\r\n", b"SQLite format 3\0"))


def is_ros_recording(recording: Recording) -> bool:
    """Whether it is a file of a recording under a name that ROS gives, or a folder of ROS 2."""
    if recording.is_folder:
        return recording.folder.has(f"{recording.name}/{ROS2_METADATA}")
    return looks_like_rosbag(recording.head) and recording.name.lower().endswith(SUFFIXES)


def fixes_of_recording(recording: Recording, antenna: str, settings: DriveSettings) -> FixesRead:
    """Read the positions of an antenna, of the topic that ``drive.toml`` names for it."""
    return read_rosbag(paths_of(recording), antenna, recording.where, settings.gnss_topics.get(antenna))


def poses_of_recording(recording: Recording, settings: DriveSettings) -> PosesRead:
    """Read full poses, of the topics that ``drive.toml`` names."""
    return read_rosbag_poses(paths_of(recording), recording.where, settings.pose_topics)


def paths_of(recording: Recording, *, track: bool = True) -> list[Path]:
    """Files of a recording: of a ROS 2 folder those of its parts, in order.

    Parameters
    ----------
    track : bool
        Whether it says where the car was (:meth:`twin.drives.folder.files.DriveFolder.content`).

    Raises
    ------
    DriveError
        If it is a folder without any.
    """
    if not recording.is_folder:
        return [recording.folder.recording(recording.name, track=track)]
    files = recording.folder.names_in(recording.name, *_ROS2_SUFFIXES)
    if not files:
        raise DriveError(
            f"{recording.name} is a ROS 2 recording without .mcap or .db3 files: unpack those that are"
            " compressed (zstd -d), or add them."
        )
    # Part 10 comes after part 9.
    in_order = sorted(files, key=lambda file: (len(file), file))
    return [recording.folder.recording(file, track=track) for file in in_order]


def read_rosbag(paths: Sequence[Path], antenna: str, where: str, topic: str | None = None) -> FixesRead:
    """Read the positions (NavSatFix) of an antenna.

    Quality follows the status: 1 for a fix, 2 with SBAS, with GBAS (which RTK receivers report) 4 where the
    covariance is not worse than 5 cm, else 5. Sigmas are those of the covariance where its type is known.

    Parameters
    ----------
    paths : sequence of Path
        The files of one recording, in order.
    antenna, where : str
    topic : str, optional
        Needed where the recording holds several of this type.

    Raises
    ------
    DriveError
        If it is not a sound recording, which topic is meant is not clear, or no position can be used.
    """
    key = f"[gnss] topics = {{{antenna!r} = …}}"
    chosen = _topic(recorded_topics(paths, where), (POSITION_TYPE,), topic, key, where)
    return _fixes(paths, antenna, where, chosen)


def read_rosbag_poses(paths: Sequence[Path], where: str, topics: Mapping[str, str]) -> PosesRead:
    """Read positions (NavSatFix) with the attitudes of an Imu or Odometry topic at their epochs.

    Parameters
    ----------
    paths, where
        As of `read_rosbag`.
    topics : mapping
        ``position`` and ``attitude``, needed where the recording holds several that could be meant.

    Raises
    ------
    DriveError
        As `read_rosbag`, or if no attitude can be used.
    """
    there = recorded_topics(paths, where)
    position = _topic(
        there, (POSITION_TYPE,), topics.get("position"), "[poses] topics = {position = …}", where
    )
    attitude = _topic(there, ATTITUDE_TYPES, topics.get("attitude"), "[poses] topics = {attitude = …}", where)
    fixes = _fixes(paths, "", where, position)
    faults: Counter[str] = Counter()
    rows: list[tuple[int, tuple[float, ...]]] = []
    for _, message in messages_of(paths, where, [attitude], faults):
        try:
            rows.append((stamp_ns_of(message), attitude_of(message)))
        except LeftOutError as reason:
            faults[str(reason)] += 1
    cure = f"name a topic whose attitude is against north under [poses] topics in {SETTINGS_FILE}"
    return poses_of_fixes(fixes, attitudes_from_rows(rows, where, faults, cure=cure), where, faults)


def _fixes(paths: Sequence[Path], antenna: str, where: str, topic: str) -> FixesRead:
    faults: Counter[str] = Counter()
    rows = []
    for host_ns, message in messages_of(paths, where, [topic], faults):
        try:
            rows.append(fix_of(message, host_ns))
        except LeftOutError as reason:
            faults[str(reason)] += 1
    cure = f"check that {topic} is the position of this drive"
    return fixes_read(rows, antenna, where, faults=faults, cure=cure)


def fix_of(message: Any, host_ns: int) -> Fix:
    """Return the fix of a NavSatFix message; see `read_rosbag`.

    Raises
    ------
    LeftOutError
        If it is none.
    """
    if message.status.status < 0:
        raise LeftOutError("no fix by its status")
    place = (float(message.latitude), float(message.longitude), float(message.altitude))
    check_position(*place)
    epoch_ns = stamp_ns_of(message)
    horizontal = vertical = math.nan
    if message.position_covariance_type:
        east, north, up = (max(float(message.position_covariance[i]), 0.0) for i in (0, 4, 8))
        horizontal, vertical = sigma_or_nan(math.sqrt((east + north) / 2)), sigma_or_nan(math.sqrt(up))
    quality = {_SBAS_FIX: _DIFFERENTIAL, _GBAS_FIX: _FLOAT if horizontal > _FIXED_BELOW_M else _FIXED}.get(
        int(message.status.status), _SINGLE
    )
    host_ns = host_ns if credible(host_ns) else epoch_ns
    return Fix(epoch_ns, host_ns, *place, quality, horizontal, vertical)


def stamp_ns_of(message: Any) -> int:
    """Stamp of a message's header.

    Raises
    ------
    LeftOutError
        If no recording of a car has it.
    """
    stamp = message.header.stamp
    epoch_ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
    check_epoch(epoch_ns)
    return epoch_ns


def attitude_of(message: Any) -> tuple[float, ...]:
    """Attitude that an Imu or Odometry message states.

    Returns
    -------
    roll, pitch, heading, sigma of roll and pitch, sigma of heading : float
        Degrees, ISO 8855, heading clockwise from north; sigmas are 0 where the message does not say.

    Raises
    ------
    LeftOutError
        If it states none.
    """
    if hasattr(message, "orientation"):
        q, covariance, at = message.orientation, message.orientation_covariance, (0, 4, 8)
        if covariance[0] == -1:
            raise LeftOutError("Imu message without an attitude")
    else:
        q, covariance, at = message.pose.pose.orientation, message.pose.covariance, (_ROLL, _PITCH, _YAW)
    roll, pitch, yaw = rpy_deg_from_quaternion(q.w, q.x, q.y, q.z)
    sigma = [math.degrees(math.sqrt(max(float(covariance[i]), 0.0))) for i in at]
    return roll, pitch, 90.0 - yaw, max(sigma[:2]), sigma[2]


def _topic(there: Mapping[str, str], types: Collection[str], wanted: str | None, key: str, where: str) -> str:
    """Choose the topic by its type, or check the one that is named."""
    fitting = sorted(topic for topic, kind in there.items() if kind in types)
    if wanted in fitting:
        return wanted
    if wanted is None and len(fitting) == 1:
        return fitting[0]
    kinds = " or ".join(kind.rpartition("/")[2] for kind in types)
    if not fitting:
        seen = ", ".join(f"{topic} ({kind.rpartition('/')[2]})" for topic, kind in sorted(there.items())[:8])
        raise DriveError(f"{where} has no topic of {kinds}: it has {seen or 'none at all'}; record one.")
    why = f"has no topic {wanted} of {kinds}" if wanted else f"has several topics of {kinds}"
    raise DriveError(f"{where} {why}: name one of {', '.join(fitting)} in {SETTINGS_FILE}, {key}.")


def recorded_topics(paths: Sequence[Path], where: str) -> dict[str, str]:
    """Type of each topic that has messages, over all files of a recording.

    Raises
    ------
    DriveError
        If it is not a sound recording.
    """
    topics: dict[str, str] = {}
    for path in paths:
        with _as_drive_errors(where), _reader(path)[0] as reader:
            topics |= {c.topic: c.msgtype for c in reader.connections if c.msgcount}
    return topics


def messages_of(
    paths: Sequence[Path], where: str, topics: Collection[str], faults: Counter[str]
) -> Iterator[tuple[int, Any]]:
    """When each message was recorded, and the message; what cannot be unpacked is counted."""
    for path in paths:
        with _as_drive_errors(where):
            opened, unpacked = _reader(path)
            with opened as reader:
                wanted = [c for c in reader.connections if c.topic in topics]
                for connection, log_ns, raw in reader.messages(wanted) if wanted else ():
                    try:
                        message = unpacked(raw, connection.msgtype)
                    except Exception:
                        faults["message unreadable"] += 1
                        continue
                    yield log_ns, message


def _reader(path: Path) -> tuple[Any, Callable[[bytes, str], Any]]:
    """A closed reader of the recording, and what unpacks its messages.

    Messages are unpacked by the definitions that rosbags ships: those in the recording would be turned into
    code that runs.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.typesys import Stores, get_typestore

    _bound_unpacking()
    if path.suffix == ".bag":
        return Reader1(path), get_typestore(Stores.ROS1_NOETIC).deserialize_ros1
    return Reader2(path), get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr


@contextmanager
def _as_drive_errors(where: str) -> Iterator[None]:
    try:
        yield
    except DriveError:
        raise
    except Exception as error:  # damage shows in rosbags as errors of nearly every kind
        raise DriveError(
            f"{where} cannot be read as a ROS recording ({type(error).__name__}: {error}): repair it with"
            " rosbag reindex, ros2 bag reindex or mcap recover, or record it again."
        ) from error


def _bound_unpacking() -> None:
    """Let rosbags unpack chunks no further than `LARGEST_CHUNK_BYTES`: it has no such bound itself."""
    import sys
    from bz2 import BZ2Decompressor

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import storage_mcap as mcap

    ros1.decompressors["bz2"] = lambda data: _unpacked(BZ2Decompressor(), data)
    ros1.decompressors["lz4"] = lambda data: _unpacked(LZ4FrameDecompressor(), data)
    mcap.DECOMPRESSORS["lz4"] = lambda data, _: _unpacked(LZ4FrameDecompressor(), data)
    mcap.DECOMPRESSORS["zstd"] = lambda data, _: _unpacked(zstd.ZstdDecompressor(), data)


def _unpacked(decompressor: Any, data: bytes) -> bytes:
    content: bytes = decompressor.decompress(data, max_length=LARGEST_CHUNK_BYTES)
    if not decompressor.eof:
        raise DriveError(
            f"A chunk of the recording is cut short, or larger than the {LARGEST_CHUNK_BYTES / 1e6:.0f} MB"
            " that one may have when unpacked: record it again."
        )
    return content
