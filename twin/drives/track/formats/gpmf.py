"""GoPro's own GNSS track and gyro: GPMF in a data stream of the MP4.

Each packet, about a second, is a tree of entries: a name of four letters, a type, a size and a count, all
padded to four bytes. Fixes are ``GPS5`` (HERO5 to 10: 18 a second, of which only the packet has a time,
``GPSU``) or ``GPS9`` (HERO11 and later: 10 a second, each with its own time).

GoPro, "GPMF Introduction", https://github.com/gopro/gpmf-parser/blob/main/README.md.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from twin.drives.track.fixes import Fix, FixesRead, LeftOutError, check_epoch, check_position, fixes_read
from twin.drives.track.formats.recording import Recording
from twin.drives.track.sea_level import above_ellipsoid
from twin.errors import DriveError

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.stream import Stream

    from twin.drives.folder.drive_toml import DriveSettings

_NS = 1_000_000_000
_NESTED = 0
_SINGLE = 1
_FEWEST_FIX = 2
_BYTES_OF_HEADER = 8
_MOST_PACKETS = 200_000
_LETTERS = {ord("l"): "i", ord("L"): "I", ord("s"): "h", ord("S"): "H", ord("J"): "Q"}
_EPOCH_2000 = datetime(2000, 1, 1, tzinfo=UTC)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_SUFFIXES = (".mp4", ".mov", ".360", ".lrv")
_LEAST_SIGMA_M, _SIGMA_A_DOP_M = 2.0, 1.5
"""Single fixes without corrections: 2 m under an open sky, and 1.5 m a unit of dilution (DOP)."""
START_SIGMA_S = 0.3
"""How well the time of fixes fits that of frames in a file: a packet of a second, and the receiver's lag."""
_HEAD_BYTES = 1 << 20
_LOOK_PACKETS = 5
_MOST_RATES_HZ = 100.0
"""A gyro of 200 to 3,200 samples a second is averaged to this: no car turns faster."""


class _Entry(NamedTuple):
    name: str
    kind: int
    size: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class StartByGps:
    """When a video began by the fixes in it."""

    epoch_ns: int
    why: str
    sigma_s: float = START_SIGMA_S


class GyroOfVideo(NamedTuple):
    """Samples of a gyro since the first packet: nanoseconds, rates as they are written, the unit."""

    offset_ns: IntArray
    rates: FloatArray
    unit: str


class _Packet(NamedTuple):
    """Fixes of one packet, and its time since the first frame."""

    offset_ns: int
    fixes: list[Fix]
    is_sea_level: bool
    left_out: int


def is_gopro_video(recording: Recording) -> bool:
    """Whether a video has a data stream of GPMF."""
    if recording.is_folder or not recording.name.lower().endswith(_SUFFIXES):
        return False
    try:
        with _opened(recording) as container:
            return _stream(container) is not None
    except DriveError:
        return False


def fixes_of_video(recording: Recording, antenna: str, _settings: DriveSettings) -> FixesRead:
    """Read the fixes of a GoPro video.

    Raises
    ------
    DriveError
        If it is damaged, or holds no usable fix (the camera had no reception, or GPS was off).
    """
    recording.folder.beginning(recording.name, _HEAD_BYTES)
    packets = _timed(list(_packets(recording)))
    faults = Counter({"no fix": sum(packet.left_out for packet in packets)})
    rows = []
    for fix in (fix for packet in packets for fix in packet.fixes):
        try:
            check_position(fix.latitude_deg, fix.longitude_deg, fix.height_m)
            check_epoch(fix.epoch_ns)
        except LeftOutError as reason:
            faults[str(reason)] += 1
            continue
        rows.append(fix)
    warnings: list[str] = []
    if any(packet.is_sea_level for packet in packets):
        rows, warnings = above_ellipsoid(rows, recording.where)
    cure = "switch GPS on in the camera and wait for reception, or give a GPX of another receiver"
    return fixes_read(rows, antenna, recording.where, faults=faults, cure=cure, warnings=warnings)


def start_by_gps(recording: Recording) -> StartByGps | None:
    """Say when a video began by the time of its fixes; None where none has one."""
    starts = sorted(
        packet.fixes[0].epoch_ns - packet.offset_ns
        for packet in _timed(list(_packets(recording)))
        if packet.fixes
    )
    if not starts:
        return None
    middle = starts[len(starts) // 2]
    spread_s = (starts[-1 - len(starts) // 10] - starts[len(starts) // 10]) / _NS
    why = f"the UTC of the fixes in it, which agree on that to {spread_s:.2f} s"
    return StartByGps(middle, why, max(START_SIGMA_S, spread_s / 2.0))


@contextmanager
def _opened(recording: Recording) -> Iterator[InputContainer]:
    import av

    with recording.folder.open(recording.name) as file:
        try:
            with av.open(file, mode="r", metadata_errors="replace") as container:
                yield container
        except (av.FFmpegError, ValueError, OSError) as error:  # OSError of an empty file
            said = f"{recording.where} cannot be read as a video ({error}): copy it again."
            raise DriveError(said) from error


def _stream(container: InputContainer) -> Stream | None:
    """The data stream whose packets are GPMF, by the first one's content."""
    streams = [one for one in container.streams if one.type == "data"]
    for packet in container.demux(streams) if streams else ():
        if packet.size:
            found = packet.stream if bytes(packet)[:4] == b"DEVC" else None
            streams = [one for one in streams if one.index != packet.stream.index]
            if found is not None or not streams:
                return found
    return None


def gyro_of_video(recording: Recording) -> GyroOfVideo | None:
    """Rates of turn of a video's gyro, averaged to `_MOST_RATES_HZ`; None where it has none.

    A packet's samples are spread evenly to the next packet's time.

    Raises
    ------
    DriveError
        If it cannot be read as a video.
    """
    found = [
        (offset_ns, rates, unit)
        for content, offset_ns in _contents(recording)
        for rates, unit in _rates_of(content)
        if len(rates)
    ]
    if not found:
        return None
    stamps, values, step_ns = [], [], _NS
    for (offset_ns, rates, _), after in zip(found, [*found[1:], None], strict=True):
        to_next_ns = after[0] - offset_ns if after else 0
        step_ns = to_next_ns if 0 < to_next_ns < 3 * _NS else step_ns
        count = max(1, min(len(rates), round(step_ns / _NS * _MOST_RATES_HZ)))
        blocks = np.array_split(rates, count)
        ends = np.cumsum([len(block) for block in blocks])
        middles = (ends - np.array([len(block) for block in blocks]) / 2.0) / len(rates)
        stamps.append(offset_ns + np.round(middles * step_ns).astype(np.int64))
        values.append(np.array([block.mean(axis=0) for block in blocks]))
    return GyroOfVideo(np.concatenate(stamps), np.concatenate(values), found[0][2])


def has_gyro(recording: Recording) -> bool:
    """Whether the first packets of a video hold samples of a gyro."""
    first = itertools.islice(_contents(recording), _LOOK_PACKETS)
    return any(len(rates) for content, _ in first for rates, _unit in _rates_of(content))


def _rates_of(content: bytes) -> Iterator[tuple[FloatArray, str]]:
    """Samples ``(n, 3)`` of each gyro of a packet, and their unit."""
    for device in _entries(content):
        for stream in _entries(device.payload) if device.kind == _NESTED else ():
            entries = {one.name: one for one in _entries(stream.payload)} if stream.kind == _NESTED else {}
            numbers, scales = _numbers(entries.get("GYRO")), _scales(entries, 3)
            if numbers and scales:
                rows = np.array(numbers[: len(numbers) // 3 * 3], np.float64).reshape(-1, 3)
                unit = entries["SIUN"].payload.strip(b"\0 ").decode("latin-1") if "SIUN" in entries else ""
                yield rows / np.array(scales, np.float64), unit


def _packets(recording: Recording) -> Iterator[_Packet]:
    for content, offset_ns in _contents(recording):
        yield from _fixes_of(content, offset_ns)


def _contents(recording: Recording) -> Iterator[tuple[bytes, int]]:
    """Packets of a video, each with its time since the first."""
    with _opened(recording) as container:
        stream = _stream(container)
        base = None if stream is None else stream.time_base
        if stream is None or base is None:
            return
        container.seek(0, backward=True)
        first = stream.start_time or 0
        for count, packet in enumerate(container.demux(stream)):
            if packet.pts is None or not packet.size:
                continue
            if count > _MOST_PACKETS:
                said = f"{recording.where} has more than {_MOST_PACKETS:,} packets of data: cut it."
                raise DriveError(said)
            offset_ns = int((packet.pts - first) * base.numerator * _NS // base.denominator)
            yield bytes(packet), offset_ns


def _fixes_of(content: bytes, offset_ns: int) -> Iterator[_Packet]:
    """Fixes of each stream of a packet that has some."""
    for device in _entries(content):
        for stream in _entries(device.payload) if device.kind == _NESTED else ():
            entries = {one.name: one for one in _entries(stream.payload)} if stream.kind == _NESTED else {}
            if "GPS9" in entries:
                yield _gps9(entries, offset_ns)
            elif "GPS5" in entries:
                yield _gps5(entries, offset_ns)


def _entries(content: bytes) -> Iterator[_Entry]:
    """Entries side by side; what is damaged ends them."""
    at = 0
    while at + _BYTES_OF_HEADER <= len(content):
        name = content[at : at + 4]
        kind, size = content[at + 4], content[at + 5]
        (repeat,) = struct.unpack_from(">H", content, at + 6)
        end = at + _BYTES_OF_HEADER + size * repeat
        if end > len(content) or not name.strip(b"\0"):
            return
        yield _Entry(name.decode("latin-1"), kind, size, content[at + _BYTES_OF_HEADER : end])
        at = at + _BYTES_OF_HEADER + -(-size * repeat // 4) * 4


def _numbers(entry: _Entry | None) -> list[int]:
    letter = None if entry is None else _LETTERS.get(entry.kind)
    if entry is None or letter is None:
        return []
    count = len(entry.payload) // struct.calcsize(f">{letter}")
    return list(struct.unpack_from(f">{count}{letter}", entry.payload))


def _scales(entries: dict[str, _Entry], count: int) -> list[int]:
    scales = _numbers(entries.get("SCAL"))
    scales = scales * count if len(scales) == 1 else scales
    return scales if len(scales) == count and all(scales) else []


def _is_sea_level(entries: dict[str, _Entry]) -> bool:
    return "GPSA" in entries and entries["GPSA"].payload.strip(b"\0 ") == b"MSLV"


def _gps5(entries: dict[str, _Entry], offset_ns: int) -> _Packet:
    """Fixes whose packet alone has a time: all have that of its beginning, until `_timed`."""
    values, scales = _numbers(entries["GPS5"]), _scales(entries, 5)
    rows = [values[k : k + 5] for k in range(0, len(values) - 4, 5)]
    fix = (_numbers(entries.get("GPSF")) or [0])[0]
    dop = (_numbers(entries.get("GPSP")) or [0])[0] / 100.0
    epoch_ns = _epoch_ns(entries["GPSU"].payload) if "GPSU" in entries else None
    if fix < _FEWEST_FIX or epoch_ns is None or not scales:
        return _Packet(offset_ns, [], _is_sea_level(entries), len(rows))
    fixes = [_fix(epoch_ns, [v / s for v, s in zip(row, scales, strict=True)], dop) for row in rows]
    return _Packet(offset_ns, fixes, _is_sea_level(entries), 0)


def _gps9(entries: dict[str, _Entry], offset_ns: int) -> _Packet:
    """Fixes with a time each: days since 2000 and seconds of the day."""
    scales, row = _scales(entries, 9), struct.Struct(">7i2H")
    fixes, left_out = [], 0
    payload = entries["GPS9"].payload
    for values in row.iter_unpack(payload[: len(payload) // row.size * row.size]):
        *place, days, seconds, dop, fix = (v / s for v, s in zip(values, scales, strict=False))
        if not scales or fix < _FEWEST_FIX:
            left_out += 1
            continue
        moment = _EPOCH_2000 + timedelta(days=days, microseconds=round(1e6 * seconds))
        fixes.append(_fix((moment - _EPOCH) // timedelta(microseconds=1) * 1000, place, dop))
    return _Packet(offset_ns, fixes, _is_sea_level(entries), left_out)


def _fix(epoch_ns: int, place: list[float], dop: float) -> Fix:
    """A fix of latitude, longitude, height and speeds, of which the speeds lack a direction."""
    sigma_m = max(_LEAST_SIGMA_M, _SIGMA_A_DOP_M * dop if math.isfinite(dop) else 0.0)
    return Fix(epoch_ns, epoch_ns, place[0], place[1], place[2], _SINGLE, sigma_m, 2.0 * sigma_m)


def _epoch_ns(text: bytes) -> int | None:
    """Epoch of ``yymmddhhmmss.sss``."""
    try:
        moment = datetime.strptime(text.strip(b"\0 ").decode("ascii"), "%y%m%d%H%M%S.%f").replace(tzinfo=UTC)
    except (UnicodeDecodeError, ValueError):
        return None
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000


def _timed(packets: list[_Packet]) -> list[_Packet]:
    """Spread fixes that share a packet's time evenly to the next packet's."""
    timed, step_ns = [], _NS
    for packet, after in zip(packets, [*packets[1:], None], strict=False):  # there may be none at all
        fixes = packet.fixes
        if len(fixes) > 1 and fixes[0].epoch_ns == fixes[-1].epoch_ns:
            to_next_ns = after.fixes[0].epoch_ns - fixes[0].epoch_ns if after and after.fixes else 0
            step_ns = to_next_ns if 0 < to_next_ns < 3 * _NS else step_ns
            fixes = [
                fix._replace(epoch_ns=fix.epoch_ns + k * step_ns // len(fixes)) for k, fix in enumerate(fixes)
            ]
            fixes = [fix._replace(host_ns=fix.epoch_ns) for fix in fixes]
        timed.append(packet._replace(fixes=fixes))
    return timed
