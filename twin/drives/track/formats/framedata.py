"""JSON that DriveWorks' ingestion tools make of a recording: frames, and the fixes of a GPS among them.

``ingest_framedata`` and ``timesync_framedata`` write records with ``timestamp_us``, the host's clock, and
``payload``. NVIDIA's pages name these fields and not what holds the records: they are taken from wherever
they stand in it, or from one document a line. A GPS frame has ``latitude``, ``longitude``, ``altitude``
over the WGS-84 ellipsoid and, of later versions, ``utcTimeUs``.

NVIDIA DriveWorks 3.5, "Frame Parsing Ingestion Tool"; DriveWorks 5, ``dwGPSFrame``.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from twin.drives.track.fixes import Fix, FixesRead, LeftOutError, check_epoch, check_position, fixes_read
from twin.errors import DriveError

_STAMP = re.compile(rb'"timestamp_us"\s*:')
_LATITUDE = b'"latitude"'
_SINGLE = 1
_US_NS = 1_000
_LARGEST_US = 9_000_000_000_000_000


def is_framedata(head: bytes) -> bool:
    """Whether a file begins as JSON of the ingestion tools."""
    return head.lstrip()[:1] in (b"{", b"[") and _STAMP.search(head) is not None and b'"payload"' in head


def is_gps_framedata(head: bytes) -> bool:
    """Whether its frames are those of a GPS."""
    return is_framedata(head) and _LATITUDE in head


def frames(content: bytes, where: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield stamp (microseconds) and payload of every frame.

    Raises
    ------
    DriveError
        If it is not JSON, neither as a whole nor line by line.
    """
    for document in _documents(content, where):
        stack: list[Any] = [document]
        while stack:
            part = stack.pop()
            if isinstance(part, list):
                stack.extend(reversed(part))
            elif isinstance(part, dict):
                stamp, payload = part.get("timestamp_us"), part.get("payload")
                if type(stamp) is int and abs(stamp) < _LARGEST_US and isinstance(payload, dict):
                    yield stamp, payload
                else:
                    stack.extend(reversed([one for one in part.values() if isinstance(one, list | dict)]))


def read_gps(content: bytes, antenna: str, where: str) -> FixesRead:
    """Read the fixes of a GPS.

    Raises
    ------
    DriveError
        If no fix can be used.
    """
    faults: Counter[str] = Counter()
    rows, by_host = [], 0
    for stamp_us, payload in frames(content, where):
        try:
            fix, timed = _fix(stamp_us, payload)
        except LeftOutError as reason:
            faults[str(reason)] += 1
            continue
        rows.append(fix)
        by_host += not timed
    warnings = []
    if by_host:
        warnings.append(
            f"{where} has no UTC of its own: {by_host} fixes are timed by the host, which has them some 0.1 s"
            " late, 1.7 m at 60 km/h. Give the receiver's own recording (NMEA, SBP) if there is one."
        )
    cure = "export the GPS recording of this drive with ingest_framedata --format=json"
    return fixes_read(rows, antenna, where, faults=faults, cure=cure, warnings=warnings)


def _fix(stamp_us: int, payload: Mapping[str, Any]) -> tuple[Fix, bool]:
    """One fix, and whether it says itself when it was."""
    place = [payload.get(key) for key in ("latitude", "longitude", "altitude")]
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e9 for v in place):
        raise LeftOutError("frame without a position")
    latitude, longitude, height = (float(v) for v in place if v is not None)
    check_position(latitude, longitude, height)
    utc_us = payload.get("utcTimeUs")
    timed = type(utc_us) is int and 0 < utc_us < _LARGEST_US
    epoch_us = utc_us if timed and type(utc_us) is int else stamp_us
    check_epoch(epoch_us * _US_NS)
    return Fix(epoch_us * _US_NS, stamp_us * _US_NS, latitude, longitude, height, _SINGLE), timed


def _documents(content: bytes, where: str) -> Iterator[Any]:
    try:
        yield json.loads(content)
    except (ValueError, RecursionError) as whole:
        try:
            lines = [json.loads(line) for line in content.splitlines() if line.strip()]
        except (ValueError, RecursionError) as error:
            raise DriveError(
                f"{where} is not JSON ({whole}): export it again with --format=json (ION is not read)."
            ) from error
        yield from lines
