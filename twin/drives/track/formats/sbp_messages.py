"""SwiftNav SBP recordings, binary or JSON → the messages that say where and when.

Binary frames are found one by one, so that a recording that begins in the middle of a frame, has other
protocols between its frames, or is damaged in places is read as far as it goes. Layouts are those of Swift's
specification (https://github.com/swift-nav/libsbp/tree/master/docs); the tests hold them against Swift's own
Python package.
"""

from __future__ import annotations

import binascii
import io
import json
import math
import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

GPS_TIME = 0x0102
UTC_TIME = 0x0103
POS_LLH = 0x020A
POS_LLH_COV = 0x0211
POS_LLH_GNSS = 0x022A
POS_LLH_COV_GNSS = 0x0231
ORIENT_QUAT = 0x0220
ORIENT_EULER = 0x0221
BASELINE_HEADING = 0x020F
VEL_NED = 0x020E
VEL_NED_COV = 0x0212
VEL_NED_GNSS = 0x022E
VEL_NED_COV_GNSS = 0x0232


class _Layout(NamedTuple):
    """Fields of a message type in order, and how they lie in its payload."""

    names: tuple[str, ...]
    packed: struct.Struct


def _layout(packed: str, names: str) -> _Layout:
    return _Layout(tuple(names.split()), struct.Struct("<" + packed))


_ACCURACY = _layout("IdddHHBB", "tow lat lon height h_accuracy v_accuracy n_sats flags")
_COVARIANCE = _layout(
    "IdddffffffBB", "tow lat lon height cov_n_n cov_n_e cov_n_d cov_e_e cov_e_d cov_d_d n_sats flags"
)
_VELOCITY = _layout("IiiiHHBB", "tow n e d h_accuracy v_accuracy n_sats flags")
_VELOCITY_COVARIANCE = _layout(
    "IiiiffffffBB", "tow n e d cov_n_n cov_n_e cov_n_d cov_e_e cov_e_d cov_d_d n_sats flags"
)
LAYOUTS: Mapping[int, _Layout] = {
    GPS_TIME: _layout("HIiB", "wn tow ns_residual flags"),
    UTC_TIME: _layout("BIHBBBBBI", "flags tow year month day hours minutes seconds ns"),
    POS_LLH: _ACCURACY,
    POS_LLH_GNSS: _ACCURACY,
    POS_LLH_COV: _COVARIANCE,
    POS_LLH_COV_GNSS: _COVARIANCE,
    ORIENT_QUAT: _layout("IiiiiffffB", "tow w x y z w_accuracy x_accuracy y_accuracy z_accuracy flags"),
    ORIENT_EULER: _layout("IiiifffB", "tow roll pitch yaw roll_accuracy pitch_accuracy yaw_accuracy flags"),
    BASELINE_HEADING: _layout("IIBB", "tow heading n_sats flags"),
    VEL_NED: _VELOCITY,
    VEL_NED_GNSS: _VELOCITY,
    VEL_NED_COV: _VELOCITY_COVARIANCE,
    VEL_NED_COV_GNSS: _VELOCITY_COVARIANCE,
}
"""Message types that say where and when; others are passed by."""
IMU_RAW = 0x0900
IMU_AUX = 0x0901
ODOMETRY = 0x0903
WHEELTICK = 0x0904
ANGULAR_RATE = 0x0222
MOTION_LAYOUTS: Mapping[int, _Layout] = {
    IMU_RAW: _layout("IBhhhhhh", "tow tow_f acc_x acc_y acc_z gyr_x gyr_y gyr_z"),
    IMU_AUX: _layout("BhB", "imu_type temp imu_conf"),
    ODOMETRY: _layout("IiB", "tow velocity flags"),
    WHEELTICK: _layout("QBBi", "time flags source ticks"),
    ANGULAR_RATE: _layout("IiiiB", "tow x y z flags"),
}
"""Those that say how the car moved."""

_PREAMBLE = b"\x55"
_HEADER = struct.Struct("<HHB")
_CRC = struct.Struct("<H")
_FRAMES_IN_HEAD = 2
_JSON_TYPE = re.compile(rb'"msg_type"\s*:\s*(\d{1,5})\b')


class Message(NamedTuple):
    """One sound message of a type in `LAYOUTS`; every value is a finite number."""

    kind: int
    sender: int
    field: Mapping[str, float]


def looks_like_sbp(head: bytes) -> bool:
    """Whether the beginning of a file holds SBP frames with sound checksums, or SBP messages as JSON."""
    if _is_json(head):
        return _JSON_TYPE.search(head) is not None
    frames = (frame for frame in _frames(head) if isinstance(frame, tuple))
    return sum(1 for _ in zip(frames, range(_FRAMES_IN_HEAD), strict=False)) == _FRAMES_IN_HEAD


def iter_messages(
    content: bytes, faults: Counter[str], layouts: Mapping[int, _Layout] = LAYOUTS
) -> Iterator[Message]:
    """Yield every sound message of the types in `layouts`; count what is none in `faults`."""
    of_content = _from_json if _is_json(content[:65_536]) else _from_binary
    yield from of_content(content, faults, layouts)


def _is_json(head: bytes) -> bool:
    return head.lstrip()[:1] == b"{"


def _from_binary(content: bytes, faults: Counter[str], layouts: Mapping[int, _Layout]) -> Iterator[Message]:
    for frame in _frames(content):
        if not isinstance(frame, tuple):
            faults["stretch of bytes that is no SBP frame"] += 1
        elif frame[0] in layouts:
            yield from _decoded(*frame, faults, layouts[frame[0]])


class MessageStream:
    """Bytes as a receiver sends them → messages, each as soon as it is whole.

    Attributes
    ----------
    readable, unreadable : int
        Frames so far, of any type, and stretches of bytes that are none.
    """

    def __init__(self, layouts: Mapping[int, _Layout] = LAYOUTS) -> None:
        self.readable = self.unreadable = 0
        self._layouts, self._held = layouts, b""

    def feed(self, data: bytes) -> list[Message]:
        """Take what has come; what may be the beginning of a frame waits for its rest."""
        content, faults, end, messages = self._held + data, Counter[str](), 0, list[Message]()
        for frame, ends in _frames_and_ends(content, is_whole=False):
            end = ends
            if frame is None:
                self.unreadable += 1
                continue
            self.readable += 1
            if frame[0] in self._layouts:
                messages += _decoded(*frame, faults, self._layouts[frame[0]])
        self._held = content[end:]
        return messages


def _frames(content: bytes) -> Iterator[tuple[int, int, bytes] | None]:
    """Type, sender and payload of each frame with a sound checksum; None for each stretch of other bytes."""
    return (frame for frame, _ in _frames_and_ends(content, is_whole=True))


def _frames_and_ends(
    content: bytes, *, is_whole: bool
) -> Iterator[tuple[tuple[int, int, bytes] | None, int]]:
    """Each frame, or None for a stretch of other bytes, and where it ends.

    What is not `is_whole` may go on: a frame that its end cuts is then no stretch of other bytes.
    """
    at, end = 0, 0
    while (at := content.find(_PREAMBLE, at)) >= 0:
        if at + 1 + _HEADER.size > len(content):
            break
        kind, sender, length = _HEADER.unpack_from(content, at + 1)
        crc_at = at + 1 + _HEADER.size + length
        if not is_whole and kind and crc_at + _CRC.size > len(content):
            break
        # The checksum is CRC-16/XMODEM over all but the preamble. That of zeros is zero, so that a number 85
        # of eight bytes would be a frame; but no message has type 0.
        if (
            not kind
            or crc_at + _CRC.size > len(content)
            or binascii.crc_hqx(content[at + 1 : crc_at], 0) != _CRC.unpack_from(content, crc_at)[0]
        ):
            at += 1
            continue
        if at > end:
            yield None, at
        end = crc_at + _CRC.size
        yield (kind, sender, content[crc_at - length : crc_at]), end
        at = end
    rest = len(content) if is_whole or at < 0 else at
    if end < rest:
        yield None, rest


def _decoded(
    kind: int, sender: int, payload: bytes, faults: Counter[str], layout: _Layout
) -> Iterator[Message]:
    names, packed = layout
    if len(payload) < packed.size:
        faults["message too short"] += 1
        return
    yield from _checked(kind, sender, dict(zip(names, packed.unpack_from(payload), strict=True)), faults)


def _from_json(content: bytes, faults: Counter[str], layouts: Mapping[int, _Layout]) -> Iterator[Message]:
    for line in io.BytesIO(content):
        kind = _JSON_TYPE.search(line)
        if kind is None:
            faults["line that is no SBP message"] += bool(line.strip())
        elif int(kind.group(1)) in layouts:
            yield from _json_message(line, faults, layouts)


def _json_message(line: bytes, faults: Counter[str], layouts: Mapping[int, _Layout]) -> Iterator[Message]:
    try:
        document = json.loads(line)
    except (ValueError, RecursionError):
        faults["line that is not JSON"] += 1
        return
    # Swift's console wraps each message: {"time": …, "data": {…}}.
    message = document.get("data", document)
    kind, sender = (message.get(name) for name in ("msg_type", "sender")) if _is_table(message) else (0, 0)
    if kind in layouts and isinstance(sender, int):
        yield from _checked(kind, sender, {name: message.get(name) for name in layouts[kind].names}, faults)
    else:
        faults["line that is no SBP message"] += 1


def _is_table(value: object) -> bool:
    return isinstance(value, dict)


def _checked(kind: int, sender: int, field: Mapping[str, Any], faults: Counter[str]) -> Iterator[Message]:
    numbers = [value for value in field.values() if isinstance(value, int | float)]
    # A whole number of JSON can be larger than any float.
    if len(numbers) < len(field) or not all(abs(n) < 1e300 and math.isfinite(n) for n in numbers):
        faults["message with a field that is no number"] += 1
        return
    yield Message(kind, sender, field)
