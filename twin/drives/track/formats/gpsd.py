"""What gpsd reports, one JSON object a line (``gpspipe -w``, or its socket) → fixes of an antenna.

TPV gives the fix and GST of the same time its sigmas; both carry UTC. Receivers of many protocols are
reported alike (https://gpsd.io/gpsd_json.html). The host's clock in µs may stand behind a line.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import msgspec

from twin.drives.epochs import after_rollovers
from twin.drives.track.fixes import (
    Fix,
    FixesRead,
    LeftOutError,
    check_epoch,
    check_position,
    epoch_of,
    fixes_read,
    sigma_or_nan,
)
from twin.drives.track.formats.nmea import MOST_WAITING, host_stamp_ns
from twin.drives.track.formats.nmea_motion import velocity_of

_NAN = math.nan
_REPORT = re.compile(rb'^\{\s*"class"\s*:\s*"(?:VERSION|DEVICES|DEVICE|WATCH|TPV|SKY|GST|ATT)"', re.MULTILINE)
_QUALITY = {0: 1, 1: 1, 2: 2, 3: 4, 4: 5, 5: 6, 6: 6, 9: 1}
"""gpsd's status as GGA writes it; surveyed-in and simulated ones are none of a car."""
_IN_SPACE = 3
"""Mode of a fix with a height."""


class Report(msgspec.Struct, frozen=True):
    """One report, with what is read of TPV and GST: metres, m/s, degrees; NaN for what it does not say."""

    kind: str = msgspec.field(name="class")
    mode: int = 0
    status: int = 0
    time: str = ""
    lat: float = _NAN
    lon: float = _NAN
    alt: float = _NAN
    height_m: float = msgspec.field(name="altHAE", default=_NAN)
    epx: float = _NAN
    epy: float = _NAN
    epv: float = _NAN
    speed: float = _NAN
    track: float = _NAN


class _Line(NamedTuple):
    report: Report
    host_ns: int | None


_DECODER = msgspec.json.Decoder(Report)


def looks_like_gpsd(head: bytes) -> bool:
    """Whether a line in the beginning of a file is a report of gpsd."""
    return _REPORT.search(head) is not None


def read_gpsd(content: bytes, antenna: str, where: str) -> FixesRead:
    """Read the fixes (TPV) of a recording.

    Raises
    ------
    DriveError
        If no fix can be used.
    """
    faults: Counter[str] = Counter()
    log = _Log()
    for line in content.splitlines():
        try:
            log.take(_line(line))
        except LeftOutError as reason:
            faults[str(reason)] += 1
    rows = log.fixes(faults)
    return fixes_read(
        rows, antenna, where, faults=faults, cure="see that gpsd has a receiver (cgps, gpspipe -w)"
    )


class GpsdStream:
    """Lines as gpsd sends them → fixes, each as soon as its sigmas have come or a next time is reported.

    Attributes
    ----------
    readable, unreadable : int
        Lines so far that are reports, and that are none.
    """

    def __init__(self) -> None:
        self.readable = self.unreadable = 0
        self._log, self._waiting = _Log(), 0

    def feed(self, line: bytes, at_ns: int) -> list[Fix]:
        """Take a line that came when the host's clock showed `at_ns`, unless it carries a host stamp."""
        try:
            report, host_ns = _line(line)
        except LeftOutError:
            self.unreadable += bool(line.strip())
            return []
        self.readable += 1
        self._waiting += 1
        fixes = self.pause() if report.kind == "TPV" or self._waiting > MOST_WAITING else []
        self._log.take(_Line(report, at_ns if host_ns is None else host_ns))
        return fixes

    def pause(self) -> list[Fix]:
        """Return what waits: nothing more has come for a moment."""
        fixes = self._log.fixes(Counter())
        self._log, self._waiting = _Log(), 0
        return fixes


def report_of(fix: Fix) -> bytes:
    """Write a fix that came in no bytes of its own as gpsd reports one: TPV and GST, a line each."""
    since = timedelta(microseconds=fix.epoch_ns // 1000)
    time = (
        (datetime(1970, 1, 1, tzinfo=UTC) + since).isoformat(timespec="microseconds").replace("+00:00", "Z")
    )
    status = next(status for status, quality in _QUALITY.items() if quality == fix.quality)
    place = {"lat": fix.latitude_deg, "lon": fix.longitude_deg, "altHAE": fix.height_m}
    reports: list[dict[str, object]] = [
        {"class": "TPV", "mode": _IN_SPACE, "status": status, "time": time, **place}
    ]
    sigmas = {"lat": fix.sigma_horizontal_m, "lon": fix.sigma_horizontal_m, "alt": fix.sigma_vertical_m}
    if math.isfinite(fix.sigma_horizontal_m):
        known = {name: sigma for name, sigma in sigmas.items() if math.isfinite(sigma)}
        reports.append({"class": "GST", "time": time, **known})
    return b"".join(msgspec.json.encode(report) + b"\n" for report in reports)


class _Log:
    """Fixes, and sigmas by time as reported."""

    def __init__(self) -> None:
        self._rows: list[_Line] = []
        self._sigmas_m: dict[str, tuple[float, float]] = {}

    def take(self, line: _Line) -> None:
        """Keep what a report says."""
        report = line.report
        if report.kind == "TPV":
            self._rows.append(line)
        elif report.kind == "GST":
            sigma_m = math.hypot(report.lat, report.lon) / math.sqrt(2.0)
            self._sigmas_m[report.time] = sigma_or_nan(sigma_m), sigma_or_nan(report.alt)

    def fixes(self, faults: Counter[str]) -> list[Fix]:
        """All fixes, in their order."""
        fixes = []
        for line in self._rows:
            try:
                fixes.append(_fix(line, self._sigmas_m.get(line.report.time)))
            except LeftOutError as reason:
                faults[str(reason)] += 1
        return fixes


def _line(line: bytes) -> _Line:
    text, brace, stamp = line.strip().rpartition(b"}")
    try:
        report = _DECODER.decode(text + brace)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise LeftOutError("not a report of gpsd") from None
    return _Line(report, host_stamp_ns(stamp.decode("latin-1")))


def _fix(line: _Line, sigmas_m: tuple[float, float] | None) -> Fix:
    report, host_ns = line
    quality = _QUALITY.get(report.status)
    if report.mode < _IN_SPACE or quality is None:
        raise LeftOutError("no fix with a height by its mode and status")
    if not math.isfinite(report.height_m):
        raise LeftOutError("no height above the ellipsoid (altHAE): gpsd before 3.20")
    check_position(report.lat, report.lon, report.height_m)
    epoch_ns = after_rollovers(epoch_of(report.time))
    check_epoch(epoch_ns)
    if sigmas_m is None:
        # How probably these hold nobody knows: they count as one sigma, which is at worst too large.
        horizontal_m = math.hypot(report.epx, report.epy) / math.sqrt(2.0)
        sigmas_m = sigma_or_nan(horizontal_m), sigma_or_nan(report.epv)
    course_deg = report.track if math.isfinite(report.track) else None
    velocity = velocity_of(report.speed, course_deg) if report.speed >= 0.0 else None
    fix = Fix(
        epoch_ns,
        epoch_ns if host_ns is None else host_ns,
        report.lat,
        report.lon,
        report.height_m,
        quality,
        *sigmas_m,
    )
    if velocity is None:
        return fix
    east, north, sigma = velocity
    return fix._replace(velocity_mps=(east, north, _NAN), velocity_sigma_mps=(sigma, _NAN))
