"""SwiftNav SBP: ODOMETRY, WHEELTICK, ANGULAR_RATE and IMU_RAW, on the receiver's own GPS time.

What is stamped by another clock than the receiver's is left out and counted. ANGULAR_RATE is in the vehicle's
frame, whose z points down; the axes of IMU_RAW are those drawn on the device.

Layouts and units: https://github.com/swift-nav/libsbp/tree/master/docs; IMU_AUX's range of the gyro is that
of the BMI160 in Piksi Multi and Duro.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSource, Quantity
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.samples import TICK, MotionRead, Samples
from twin.drives.track.fixes import LeftOutError
from twin.drives.track.formats import sbp_messages as sbp
from twin.drives.track.formats.sbp import Clock, clock_of
from twin.drives.track.formats.sbp_messages import MOTION_LAYOUTS, looks_like_sbp
from twin.errors import DriveError

_NAMES = {
    "ODOMETRY": sbp.ODOMETRY,
    "WHEELTICK": sbp.WHEELTICK,
    "ANGULAR_RATE": sbp.ANGULAR_RATE,
    "IMU_RAW": sbp.IMU_RAW,
}
_OF_QUANTITY = {Quantity.SPEED: ("ODOMETRY", "WHEELTICK"), Quantity.TURN_RATE: ("ANGULAR_RATE", "IMU_RAW")}
_GPS_TIME = 1
_TIME_STATUS, _TIME = 0xC000_0000, 0x3FFF_FFFF
_WIDEST_DEG_S, _NARROWEST = 2000.0, 4
_COUNTS = 32_768.0
_MS_NS = 1_000_000


class _Row(NamedTuple):
    """One message: time of the week in nanoseconds, and its values."""

    tow_ns: int
    values: tuple[float, ...]


def is_sbp(folder: DriveFolder, source: MotionSource) -> bool:
    """Whether a file is an SBP recording."""
    return not folder.is_folder(source.file) and looks_like_sbp(folder.head(source.file))


def read(folder: DriveFolder, source: MotionSource) -> MotionRead:
    """Read the messages that ``drive.toml`` names, or the best of each kind.

    Raises
    ------
    DriveError
        If there is none, or no message says which week it was.
    """
    for quantity in source.named:
        unknown = [n for n in source.of(quantity).names if n not in _OF_QUANTITY.get(quantity, ())]
        if unknown:
            raise DriveError(
                f"{SETTINGS_FILE} names {', '.join(unknown)} as the {quantity} of {source.file}, an SBP"
                f" recording: it has {', '.join(_OF_QUANTITY.get(quantity, ())) or 'none'}; correct"
                f" [{source.table}]."
            )
    content, faults = folder.content(source.file), Counter[str]()
    clock = clock_of(content)
    rows, range_deg_s = _rows(content, faults)
    samples: dict[Quantity, list[Samples]] = {}
    for quantity, names in _OF_QUANTITY.items():
        named = source.of(quantity).names if source.named else names
        found = next((name for name in named if rows.get(name)), None)
        if found is None:
            continue
        if clock is None:
            raise DriveError(
                f"{source.file} holds {found} but neither GPS_TIME nor UTC_TIME, so that its week is not"
                " known: switch the message GPS_TIME on in the receiver."
            )
        samples[quantity] = [_samples(rows[found], found, clock, range_deg_s, faults)]
    if not samples:
        raise DriveError(
            f"{source.file} holds no usable {' or '.join(_NAMES)}: switch them on in the receiver, or take it"
            f" out of [{source.table}]."
        )
    return MotionRead(samples, faults=faults)


def messages_of_motion(head: bytes) -> list[str]:
    """Names of the messages at the beginning of a recording that say how the car moved."""
    kinds = {message.kind for message in sbp.iter_messages(head, Counter(), MOTION_LAYOUTS)}
    return [name for name, kind in _NAMES.items() if kind in kinds]


def _rows(content: bytes, faults: Counter[str]) -> tuple[Mapping[str, list[_Row]], float | None]:
    """Messages by name, of several wheels those of the most, and the range of the gyro."""
    by_source: dict[str, dict[int, list[_Row]]] = defaultdict(lambda: defaultdict(list))
    range_deg_s = None
    for kind, sender, field in sbp.iter_messages(content, Counter(), MOTION_LAYOUTS):
        if kind == sbp.IMU_AUX:
            range_deg_s = _range_deg_s(int(field["imu_conf"]))
            continue
        name = next(name for name, its in _NAMES.items() if its == kind)
        try:
            wheel, row = _READERS[kind](field)
        except LeftOutError as reason:
            faults[str(reason)] += 1
            continue
        by_source[name][sender << 8 | wheel].append(row)
    rows = {}
    for name, sources in by_source.items():
        most = max(sources, key=lambda one, of=sources: len(of[one]))  # type: ignore[misc]
        faults["message of another wheel or sender"] += sum(len(r) for s, r in sources.items() if s != most)
        rows[name] = sources[most]
    return rows, range_deg_s


def _odometry(field: Mapping[str, float]) -> tuple[int, _Row]:
    flags = int(field["flags"])
    if flags & 0b111 != _GPS_TIME:
        raise LeftOutError("odometry that is not stamped in GPS time")
    return flags >> 3 & 0b11, _Row(round(field["tow"]) * _MS_NS, (field["velocity"] / 1000.0,))


def _wheeltick(field: Mapping[str, float]) -> tuple[int, _Row]:
    if int(field["flags"]) & 0b11 != _GPS_TIME:
        raise LeftOutError("wheel ticks that are not stamped in GPS time")
    return int(field["source"]), _Row(int(field["time"]) * 1000, (float(field["ticks"]),))


def _angular_rate(field: Mapping[str, float]) -> tuple[int, _Row]:
    if not int(field["flags"]) & 0b111:
        raise LeftOutError("rate of turn that the receiver calls invalid")
    return 0, _Row(round(field["tow"]) * _MS_NS, tuple(field[axis] * 1e-6 for axis in "xyz"))


def _imu_raw(field: Mapping[str, float]) -> tuple[int, _Row]:
    tow = int(field["tow"])
    if tow & _TIME_STATUS:
        raise LeftOutError("IMU sample that is not stamped in GPS time")
    tow_ns = (tow & _TIME) * _MS_NS + round(field["tow_f"] * _MS_NS / 256)
    return 0, _Row(tow_ns, tuple(float(field[f"gyr_{axis}"]) for axis in "xyz"))


_READERS: Mapping[int, Callable[[Mapping[str, float]], tuple[int, _Row]]] = {
    sbp.ODOMETRY: _odometry,
    sbp.WHEELTICK: _wheeltick,
    sbp.ANGULAR_RATE: _angular_rate,
    sbp.IMU_RAW: _imu_raw,
}


def _range_deg_s(imu_conf: int) -> float | None:
    """Full range of the gyro; None where the setting is none of the BMI160's."""
    setting = imu_conf >> 4
    return _WIDEST_DEG_S / 2**setting if setting <= _NARROWEST else None


def _samples(
    rows: list[_Row], name: str, clock: Clock, range_deg_s: float | None, faults: Counter[str]
) -> Samples:
    stamps, values = [], []
    for row in rows:
        tow_ms, rest_ns = divmod(row.tow_ns, _MS_NS)
        try:
            stamps.append(clock.utc_ns(tow_ms) + rest_ns)
        except LeftOutError as reason:
            faults[str(reason)] += 1
            continue
        values.append(row.values)
    stamp_ns, numbers = np.array(stamps, np.int64), np.array(values, np.float64)
    if name in ("ODOMETRY", "WHEELTICK"):
        return Samples(stamp_ns, numbers.ravel(), "m/s" if name == "ODOMETRY" else TICK, of_receiver=True)
    if name == "ANGULAR_RATE":
        return Samples(stamp_ns, numbers.reshape(-1, 3), "deg/s", "-z", of_receiver=True)
    if range_deg_s is None:
        raise DriveError(
            "IMU_RAW without IMU_AUX says nothing of its unit: switch IMU_AUX on in the receiver."
        )
    return Samples(stamp_ns, numbers.reshape(-1, 3) * range_deg_s / _COUNTS, "deg/s", of_receiver=True)
