"""Positions that cameras write into their pictures (EXIF) → fixes, one a picture.

Only the EXIF segment is looked at: no picture is decoded. Tags are those of the Exif 2.32 standard
(CIPA DC-008), 4.6.6 for GPS.
"""

from __future__ import annotations

import math
import struct
import warnings
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

from twin.drives.folder.drive_toml import DriveSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.frames.images import HEAD_BYTES, exif_epoch, exif_needs_zone
from twin.drives.track.fixes import (
    Fix,
    FixesRead,
    LeftOutError,
    check_epoch,
    check_position,
    fixes_read,
    sigma_or_nan,
)
from twin.drives.track.formats.recording import Recording
from twin.drives.track.sea_level import above_ellipsoid

JPEG_SUFFIXES = (".jpg", ".jpeg")
_SINGLE, _DIFFERENTIAL = 1, 2
_GPS_IFD = 0x8825
_LATITUDE_REF, _LATITUDE, _LONGITUDE_REF, _LONGITUDE, _ALTITUDE_REF, _ALTITUDE, _TIME = range(1, 8)
_STATUS, _DATE, _DIFFERENTIAL_TAG, _HORIZONTAL_ERROR = 9, 29, 30, 31
_BELOW = (1, 3, b"\x01", b"\x03")
_ELLIPSOIDAL = (2, 3, b"\x02", b"\x03")
_SEGMENT = struct.Struct(">2sH")


def looks_like_jpeg(head: bytes) -> bool:
    """Whether a file begins as a JPEG."""
    return head.startswith(b"\xff\xd8\xff")


def has_exif_position(head: bytes) -> bool:
    """Whether the beginning of a JPEG holds EXIF with a GPS position."""
    try:
        return _LATITUDE in _gps_tags(head)
    except LeftOutError:
        return False


def is_folder_of_pictures(recording: Recording) -> bool:
    """Whether it is a folder with pictures in it that may hold EXIF."""
    return recording.is_folder and bool(recording.folder.names_in(recording.name, *JPEG_SUFFIXES))


def holds_pictures_with_positions(folder: DriveFolder) -> bool:
    """Whether one of the first pictures directly in a drive folder says where it was taken."""
    heads = (folder.head(name, HEAD_BYTES) for name in folder.names(*JPEG_SUFFIXES)[:3])
    return any(looks_like_jpeg(head) and has_exif_position(head) for head in heads)


def fixes_of_recording(recording: Recording, antenna: str, _settings: DriveSettings) -> FixesRead:
    """Read the positions of the pictures of a folder, of each no more than its beginning."""
    names = recording.folder.names_in(recording.name, *JPEG_SUFFIXES)
    heads = (recording.folder.beginning(name, HEAD_BYTES) for name in names)
    return read_exif_positions(heads, antenna, recording.where)


def read_exif_positions(heads: Iterable[bytes], antenna: str, where: str) -> FixesRead:
    """Read the position of each picture of a folder.

    The epoch is GPSDateStamp with GPSTimeStamp, which are UTC, else DateTimeOriginal with the zone that the
    camera writes beside it; a local time without zone cannot be used. Heights are above sea level unless the
    picture says that they are ellipsoidal (Exif 3.0).

    Parameters
    ----------
    heads : iterable of bytes
        The first `twin.drives.frames.images.HEAD_BYTES` of each picture.
    antenna, where : str
        Name of the antenna, and of the folder for messages.

    Raises
    ------
    DriveError
        If no picture has a usable position.
    """
    faults: Counter[str] = Counter()
    above_sea: list[Fix] = []
    ellipsoidal: list[Fix] = []
    for head in heads:
        try:
            fix, is_ellipsoidal = _fix(head)
        except LeftOutError as reason:
            faults[str(reason)] += 1
            continue
        (ellipsoidal if is_ellipsoidal else above_sea).append(fix)
    moved, remarks = above_ellipsoid(above_sea, where)
    # Names need not be in order of time; positions must be.
    rows = sorted([*moved, *ellipsoidal], key=lambda row: row.epoch_ns)
    cure = "the camera must write position, altitude and GPS time (or a time with zone) into its pictures"
    return fixes_read(rows, antenna, where, faults=faults, cure=cure, what="pictures", warnings=remarks)


def _fix(head: bytes) -> tuple[Fix, bool]:
    gps = _gps_tags(head)
    if _LATITUDE not in gps:
        raise LeftOutError("no EXIF position")
    if gps.get(_STATUS) == "V":
        raise LeftOutError("position that the camera calls void")
    latitude = _angle(gps, _LATITUDE, _LATITUDE_REF, "NS")
    longitude = _angle(gps, _LONGITUDE, _LONGITUDE_REF, "EW")
    if _ALTITUDE not in gps:
        raise LeftOutError("no altitude")
    reference = gps.get(_ALTITUDE_REF, 0)
    height = _number(gps[_ALTITUDE]) * (-1 if reference in _BELOW else 1)
    check_position(latitude, longitude, height)
    epoch_ns = _epoch_ns(gps, head)
    check_epoch(epoch_ns)
    quality = _DIFFERENTIAL if gps.get(_DIFFERENTIAL_TAG) == 1 else _SINGLE
    error_m = _number(gps[_HORIZONTAL_ERROR]) if _HORIZONTAL_ERROR in gps else math.nan
    fix = Fix(epoch_ns, epoch_ns, latitude, longitude, height, quality, sigma_or_nan(error_m))
    return fix, reference in _ELLIPSOIDAL


def _gps_tags(head: bytes) -> dict[int, Any]:
    from PIL.Image import Exif

    segment = _exif_segment(head)
    if segment is None:
        raise LeftOutError("no EXIF")
    exif = Exif()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's, of tags that it leaves out: absent ones are counted
            exif.load(segment)
            return dict(exif.get_ifd(_GPS_IFD))
    except (SyntaxError, ValueError, TypeError, KeyError, IndexError, EOFError, OSError, struct.error):
        # What Pillow lets through of a damaged TIFF structure.
        raise LeftOutError("EXIF unreadable") from None


def _exif_segment(head: bytes) -> bytes | None:
    """The APP1 segment of a JPEG that holds EXIF; None where there is none."""
    at = 2
    while looks_like_jpeg(head) and at + _SEGMENT.size <= len(head):
        marker, length = _SEGMENT.unpack_from(head, at)
        if marker[0] != 0xFF or length < 2:
            return None
        body = head[at + _SEGMENT.size : at + 2 + length]
        if marker == b"\xff\xe1" and body.startswith(b"Exif\0\0"):
            return body
        at += 2 + length
    return None


def _angle(gps: dict[int, Any], tag: int, reference_tag: int, signs: str) -> float:
    parts, reference = gps.get(tag), str(gps.get(reference_tag, "")).strip("\0 ").upper()
    if not isinstance(parts, tuple) or len(parts) != 3 or len(reference) != 1 or reference not in signs:
        raise LeftOutError("position unreadable")
    degrees, minutes, seconds = (_number(part) for part in parts)
    angle = degrees + minutes / 60 + seconds / 3600
    return -angle if reference == signs[1] else angle


def _number(value: Any) -> float:
    """A rational; those with denominator 0 are NaN."""
    try:
        return float(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return math.nan


def _epoch_ns(gps: dict[int, Any], head: bytes) -> int:
    if _DATE in gps and _TIME in gps:
        return _gps_epoch_ns(str(gps[_DATE]), gps[_TIME])
    epoch_ns = exif_epoch(head)
    if epoch_ns is None:
        raise LeftOutError("local time without a zone" if exif_needs_zone(head) else "no time")
    return epoch_ns


def _gps_epoch_ns(date: str, time: Any) -> int:
    try:
        day = datetime.strptime(date.strip("\0 ").replace("-", ":"), "%Y:%m:%d").replace(tzinfo=UTC)
    except ValueError:
        raise LeftOutError("time unreadable") from None
    parts = [_number(part) for part in time] if isinstance(time, tuple) else []
    if len(parts) != 3 or not all(0 <= part < limit for part, limit in zip(parts, (24, 60, 61), strict=True)):
        raise LeftOutError("time unreadable")
    second_ns = round(parts[2] * 1e9)
    return (int(day.timestamp()) + int(parts[0]) * 3600 + int(parts[1]) * 60) * 1_000_000_000 + second_ns
