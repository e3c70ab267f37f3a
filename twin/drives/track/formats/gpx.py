"""GPX tracks → fixes of an antenna.

A track point says where and when, but neither how well nor above what: fixes have GGA quality 1, and heights
are taken as above sea level, as GPX 1.1 means them (https://www.topografix.com/GPX/1/1/).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from io import BytesIO

from twin.drives.track.fixes import (
    Fix,
    FixesRead,
    LeftOutError,
    check_epoch,
    check_position,
    epoch_of,
    fixes_read,
)
from twin.drives.track.sea_level import above_ellipsoid
from twin.errors import DriveError

_SINGLE = 1
_QUALITY = {"dgps": 2, "pps": 3}
_POINT = "trkpt"


def looks_like_gpx(head: bytes) -> bool:
    """Whether the beginning of a file opens a GPX document."""
    return b"<gpx" in head[:4096]


def read_gpx(content: bytes, antenna: str, where: str) -> FixesRead:
    """Read the points of all tracks, in the order of the file.

    Points without a time, or with a time that names no zone, cannot be used: times are UTC.

    Raises
    ------
    DriveError
        If it is not XML, or no point can be used.
    """
    faults: Counter[str] = Counter()
    rows = []
    for point in _points(content, where):
        try:
            rows.append(_fix(point))
        except LeftOutError as reason:
            faults[str(reason)] += 1
    heights, warnings = above_ellipsoid(rows, where)
    cure = "export the recorded track (trkpt) with time and elevation"
    return fixes_read(
        heights, antenna, where, faults=faults, cure=cure, what="track points", warnings=warnings
    )


def _points(content: bytes, where: str) -> Iterator[dict[str, str]]:
    """Attributes and texts of each track point, by name without namespace."""
    from xml.etree.ElementTree import ParseError

    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import iterparse

    point: dict[str, str] = {}
    depth = 0  # inside a point; 0 outside
    try:
        for event, element in iterparse(BytesIO(content), events=("start", "end"), forbid_dtd=True):
            name = element.tag.rpartition("}")[2]
            if event == "start":
                point = dict(element.attrib) if name == _POINT and not depth else point
                depth += bool(depth or name == _POINT)
                continue
            depth -= bool(depth)
            if depth == 1:
                point[name] = (element.text or "").strip()
            elif not depth and name == _POINT:
                yield point
            element.clear()
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise DriveError(f"{where} is not sound XML ({error}): export the track again.") from error


def _fix(point: dict[str, str]) -> Fix:
    try:
        latitude, longitude = float(point["lat"]), float(point["lon"])
    except (KeyError, ValueError):
        raise LeftOutError("no position") from None
    if point.get("fix") == "none":
        raise LeftOutError("fix none")
    if not point.get("ele"):
        raise LeftOutError("no elevation")
    try:
        height = float(point["ele"])
    except ValueError:
        raise LeftOutError("elevation is no number") from None
    check_position(latitude, longitude, height)
    epoch_ns = epoch_of(point.get("time", ""))
    check_epoch(epoch_ns)
    quality = _QUALITY.get(point.get("fix", ""), _SINGLE)
    return Fix(epoch_ns, epoch_ns, latitude, longitude, height, quality)
