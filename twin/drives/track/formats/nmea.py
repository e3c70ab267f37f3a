"""NMEA 0183 text, with or without the host's stamps → fixes of an antenna.

The recorder of the NTNU car writes one sentence a line, a space, and the host's clock in µs::

    $GPGGA,071840.90,6324.8972646,N,01023.9477304,E,4,14,1.1,65.70,M,0.0,M,0.9,0246*75 1684739920978036

The epoch of a fix is the UTC *in the sentence*: the host stamps a sentence when it arrives, 78 ms later on
that car, which is a metre at 50 km/h. GGA gives the fixes, GST of the same epoch their sigmas, RMC and ZDA
the date, RMC or VTG the velocity, HDT or THS the heading.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import NamedTuple

from twin.drives.epochs import after_rollovers, credible, rollover_warning
from twin.drives.track.fixes import (
    HIGHEST_M,
    Fix,
    FixesRead,
    LeftOutError,
    check_position,
    fixes_read,
    sigma_or_nan,
)
from twin.drives.track.formats.nmea_motion import HEADINGS, MAGNETIC_COMPASS, Motion

_LINE = re.compile(r"\$(?P<body>[^*]*)(?:\*(?P<sum>[0-9A-Fa-f]{2})(?P<rest>.*))?", re.DOTALL)
_USED = ("GGA", "RMC", "ZDA", "GST", "VTG", *HEADINGS)
_HEADING_FIELDS = ("heading", "mode")
"""Of HDT and THS: pynmea2 does not know the latter."""
_TIME = re.compile(r"(\d\d)(\d\d)(\d\d)(?:\.(\d{0,9})\d*)?")
_ANGLE = re.compile(r"(\d{1,3}?)(\d\d(?:\.\d*)?)")
_DAY_NS = 86_400_000_000_000
MOST_WAITING = 100
"""Sentences or messages that a receiver sends of one epoch; what sends more repeats itself."""
_NO_DATE = "no date: neither a host stamp nor an RMC or ZDA sentence"


class Sentence(NamedTuple):
    """One sound sentence: its type (``GGA``), its fields by name (used types only), and the host's stamp."""

    kind: str
    field: Mapping[str, str]
    host_ns: int | None


def read_nmea(content: bytes, antenna: str, where: str) -> FixesRead:
    """Read the GGA sentences of any talker.

    The date is that of the host stamp, moved to the day on which the sentence's UTC comes nearest to it: a
    sentence from before midnight that arrives after midnight keeps its own day. Where lines carry no host
    stamp, the date is that of the last RMC or ZDA sentence; one before 2010 is that of a receiver whose GPS
    weeks have run over, and is moved on. Height is the altitude plus the geoid separation, which is
    ellipsoidal both for receivers that state the separation and for those that write the ellipsoidal height
    with a separation of 0. Sigmas are those of the GST sentence of the same time of day, velocities those of
    RMC, and headings see `twin.drives.track.formats.nmea_motion`.

    Parameters
    ----------
    content : bytes
    antenna : str
        Name of the antenna in the rig.
    where : str
        File name, for messages.

    Returns
    -------
    FixesRead
        Fixes in order of time. Sentences of other types are not counted as left out.

    Raises
    ------
    DriveError
        If no fix can be used; the message says why the lines were left out.
    """
    faults: Counter[str] = Counter()
    log = _Log()
    for sentence in iter_sentences(content, faults):
        log.take(sentence, faults)
    rows = log.fixes(faults)
    cure, warnings = log.cure(faults), log.warnings(where)
    return fixes_read(
        rows, antenna, where, faults=faults, cure=cure, what="GNSS sentences", warnings=warnings
    )


def looks_like_nmea(head: bytes) -> bool:
    """Whether the beginning of a file holds a sound GGA, RMC or ZDA sentence."""
    if b"\0" in head or b"$" not in head:
        return False
    return any(sentence.kind in ("GGA", "RMC", "ZDA") for sentence in iter_sentences(head))


def iter_sentences(content: bytes, faults: Counter[str] | None = None) -> Iterator[Sentence]:
    """Yield every sound sentence; count the lines that are none in `faults`."""
    for line in content.splitlines():
        text = line.decode("latin-1").strip()
        if not text:
            continue
        try:
            yield _sentence(text)
        except LeftOutError as reason:
            if faults is not None:
                faults[str(reason)] += 1


def _sentence(text: str) -> Sentence:
    from pynmea2 import NMEASentence, ParseError

    # A line that was cut, or another protocol, may stand before a whole sentence.
    match = _LINE.fullmatch(text[max(text.rfind("$"), 0) :])
    if not match:
        raise LeftOutError("not an NMEA sentence")
    body, stated, rest = match.group("body", "sum", "rest")
    if stated is None:
        raise LeftOutError("no checksum")
    if NMEASentence.checksum(body) != int(stated, 16):
        raise LeftOutError("checksum")
    kind = body.partition(",")[0][2:]
    if kind not in _USED:
        return Sentence(kind, {}, None)
    if kind in HEADINGS:
        if body.startswith(MAGNETIC_COMPASS):
            raise LeftOutError("heading of a magnetic compass")
        values = body.split(",")[1:]
        return Sentence(kind, dict(zip(_HEADING_FIELDS, values, strict=False)), host_stamp_ns(rest))
    try:
        message = NMEASentence.parse(f"${body}")
    except ParseError:
        raise LeftOutError("not an NMEA sentence") from None
    # The library's own conversions are passed by: they cut the time to whole microseconds, downwards, and
    # turn an absent latitude into 0.
    names = (field[1] for field in message.fields)
    return Sentence(kind, dict(zip(names, message.data, strict=False)), host_stamp_ns(rest))


def host_stamp_ns(rest: str) -> int | None:
    """Host stamp behind a sentence, in ns; None where there is none.

    Raises
    ------
    LeftOutError
        If something else stands there.
    """
    if not rest.strip():
        return None
    try:
        host_ns = int(rest) * 1000
    except ValueError:
        raise LeftOutError("host stamp is not a number") from None
    if not credible(host_ns):
        raise LeftOutError("host stamp outside the years 2000–2099")
    return host_ns


class _Measured(NamedTuple):
    """A GGA sentence with a fix, before its day is known."""

    time_ns: int
    host_ns: int | None
    latitude_deg: float
    longitude_deg: float
    height_m: float
    quality: int


@dataclass(slots=True)
class _Log:
    """What is kept of a file's sentences."""

    rows: list[_Measured | int] = field(default_factory=list)
    """Fixes, and between them the epochs of sentences with a date, in file order."""
    sigmas_m: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Horizontal (one axis) and vertical sigma by time of day."""
    motion: Motion = field(default_factory=Motion)
    seen: Counter[str] = field(default_factory=Counter)
    """Sentences by type."""
    stamped: bool = False
    """Whether there is any host stamp."""
    moved: int = 0
    """Dates that were moved on by whole rollovers of the GPS week."""
    without_separation: int = 0

    def take(self, sentence: Sentence, faults: Counter[str]) -> None:
        """Keep what a sentence says."""
        self.seen[sentence.kind] += 1
        self.stamped |= sentence.host_ns is not None
        try:
            self._take_motion(sentence)
            if sentence.kind == "GGA":
                self.rows.append(_measured(sentence))
                self.without_separation += not sentence.field["geo_sep"]
            elif sentence.kind == "GST":
                time_ns, sigmas_m = _sigmas(sentence)
                self.sigmas_m[time_ns] = sigmas_m
            elif (stated_ns := _stated_epoch_ns(sentence)) is not None:
                epoch_ns = after_rollovers(stated_ns)
                self.moved += epoch_ns != stated_ns
                self.rows += [epoch_ns] if credible(epoch_ns) else []
        except LeftOutError as reason:
            faults[str(reason)] += 1

    def _take_motion(self, sentence: Sentence) -> None:
        kind, fields, host_ns = sentence
        if kind == "VTG" or kind in HEADINGS:
            self.motion.take_untimed(kind, fields, host_ns)
        elif (time_ns := _time_if_any_ns(fields)) is not None:
            self.motion.pass_time(time_ns, host_ns)
            if kind == "RMC" and fields.get("status") == "A":
                self.motion.take_rmc(time_ns, fields)

    def fixes(self, faults: Counter[str]) -> list[Fix]:
        """Fixes with their days, in file order."""
        # Sentences before the first date belong to the same day.
        reference_ns = next((row for row in self.rows if isinstance(row, int)), None)
        self.motion.finish()
        fixes = []
        for row in self.rows:
            if isinstance(row, int):
                reference_ns = row
                continue
            near_ns = reference_ns if row.host_ns is None else row.host_ns
            if near_ns is None:
                faults[_NO_DATE] += 1
                continue
            fix = self.fix(row, near_ns)
            reference_ns = fix.epoch_ns
            fixes.append(fix)
        return fixes

    def fix(self, row: _Measured, near_ns: int) -> Fix:
        """Return a fix on the day that brings its time nearest to an epoch, with all that is said of it."""
        epoch_ns = _nearest_day(row.time_ns, near_ns)
        host_ns = epoch_ns if row.host_ns is None else row.host_ns
        sigmas_m = self.sigmas_m.get(row.time_ns, (math.nan, math.nan))
        return Fix(epoch_ns, host_ns, *row[2:], *sigmas_m, **self.motion.at(row.time_ns))

    def warnings(self, where: str) -> list[str]:
        """Tell what a user should know; host stamps overrule dates without a word."""
        warnings = [rollover_warning(where, self.moved)] if self.moved and not self.stamped else []
        if self.without_separation:
            warnings.append(
                f"{self.without_separation} fixes of {where} state no geoid separation: their altitude was"
                " taken as the ellipsoidal height."
            )
        return warnings

    def cure(self, faults: Counter[str]) -> str:
        """What to do where no fix can be used."""
        if faults[_NO_DATE]:
            return "record it with host stamps, or with RMC or ZDA sentences"
        if self.seen and not self.seen["GGA"]:
            return "switch GGA sentences on in the receiver"
        return "check that it is the NMEA recording of this drive"


class NmeaStream:
    """Lines as a receiver sends them → fixes, each as soon as all that is said of its epoch has come.

    A fix is complete when a sentence of another time comes, or `pause` tells that nothing does. Its date is
    that of RMC and ZDA where the receiver sends them, else that of the host; by a host whose clock was never
    set there is no fix.

    Attributes
    ----------
    readable, unreadable : int
        Lines so far that are sound sentences, and that are none.
    """

    def __init__(self) -> None:
        self.readable = self.unreadable = 0
        self._log, self._faults = _Log(), Counter[str]()
        self._stated_ns: int | None = None
        self._waiting = 0

    def feed(self, line: bytes, at_ns: int) -> list[Fix]:
        """Take a line that came when the host's clock showed `at_ns`, unless it carries a host stamp."""
        faults = Counter[str]()
        sentence = next(iter_sentences(line, faults), None)
        self.unreadable += faults.total()
        if sentence is None:
            return []
        self.readable += 1
        before = self._log.motion.time_ns
        stamp_ns = at_ns if sentence.host_ns is None else sentence.host_ns
        self._log.take(sentence._replace(host_ns=stamp_ns), self._faults)
        now = self._log.motion.time_ns
        self._waiting += 1
        if self._waiting > MOST_WAITING:
            return self.pause()
        return [] if now is None or now == before else self._complete(now)

    def pause(self) -> list[Fix]:
        """Return what waits: nothing more has come for a moment."""
        self._log.motion.finish()
        return self._complete(None)

    def _complete(self, but_ns: int | None) -> list[Fix]:
        """Hand on all fixes but those of a time of day, and forget what belongs to them."""
        log, fixes, waiting = self._log, [], list[_Measured | int]()
        self._waiting = 0
        for row in log.rows:
            if isinstance(row, int):
                self._stated_ns = row
            elif row.time_ns == but_ns:
                waiting.append(row)
            else:
                fix = log.fix(row, self._stated_ns or row.host_ns or 0)
                self._stated_ns = self._stated_ns and fix.epoch_ns
                fixes += [fix] if credible(fix.epoch_ns) else []
        log.rows = waiting
        log.sigmas_m = {at: sigmas for at, sigmas in log.sigmas_m.items() if at == but_ns}
        log.motion.forget(but_ns)
        self._faults.clear()
        return fixes


def _sigmas(sentence: Sentence) -> tuple[int, tuple[float, float]]:
    """Time of day of a GST sentence, and its sigmas."""
    fields = sentence.field
    try:
        time_ns = _time_of_day_ns(fields.get("timestamp", ""))
        north, east, up = (
            _metres(fields.get(f"std_dev_{axis}", "")) or math.nan
            for axis in ("latitude", "longitude", "altitude")
        )
    except LeftOutError:
        raise LeftOutError("GST sentence unreadable") from None
    return time_ns, (sigma_or_nan(math.sqrt((north**2 + east**2) / 2)), sigma_or_nan(up))


def _measured(sentence: Sentence) -> _Measured:
    fields = sentence.field
    if "geo_sep" not in fields:
        raise LeftOutError("sentence too short")
    if fields["gps_qual"] not in set("0123456789"):
        raise LeftOutError("fix quality is not a digit")
    quality = int(fields["gps_qual"])
    if quality == 0:
        raise LeftOutError("fix quality 0")
    latitude = _degrees(fields["lat"], fields["lat_dir"], "NS")
    longitude = _degrees(fields["lon"], fields["lon_dir"], "EW")
    altitude, separation = _metres(fields["altitude"]), _metres(fields["geo_sep"])
    if altitude is None:
        raise LeftOutError("no altitude")
    height = altitude + (separation or 0.0)
    check_position(latitude, longitude, height)
    time_ns = _time_of_day_ns(fields["timestamp"])
    return _Measured(time_ns, sentence.host_ns, latitude, longitude, height, quality)


def _degrees(text: str, hemisphere: str, signs: str) -> float:
    """Degrees of ``ddmm.mmmm`` or ``dddmm.mmmm``; the second of `signs` is negative."""
    if not text:
        raise LeftOutError("no position")
    match = _ANGLE.fullmatch(text)
    if not match or len(hemisphere) != 1 or hemisphere not in signs or float(match.group(2)) >= 60:
        raise LeftOutError("position unreadable")
    degrees = int(match.group(1)) + float(match.group(2)) / 60
    return -degrees if hemisphere == signs[1] else degrees


def _metres(text: str) -> float | None:
    """A height; None for an empty field."""
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        raise LeftOutError("height unreadable") from None
    if not math.isfinite(value) or abs(value) > HIGHEST_M:
        raise LeftOutError("height absurd")
    return value


def _time_of_day_ns(text: str) -> int:
    """``hhmmss.sss`` in whole nanoseconds: a float would lose the last digit. A leap second is second 60."""
    match = _TIME.fullmatch(text)
    if not match:
        raise LeftOutError("no UTC time")
    hours, minutes, seconds = (int(part) for part in match.group(1, 2, 3))
    if hours > 23 or minutes > 59 or seconds > 60:
        raise LeftOutError("no UTC time")
    fraction = int((match.group(4) or "0").ljust(9, "0"))
    return (hours * 3600 + minutes * 60 + seconds) * 1_000_000_000 + fraction


def _time_if_any_ns(fields: Mapping[str, str]) -> int | None:
    try:
        return _time_of_day_ns(fields.get("timestamp", ""))
    except LeftOutError:
        return None


def _nearest_day(time_ns: int, near_ns: int) -> int:
    """The epoch with this time of day that is nearest to `near_ns`."""
    days = (near_ns - time_ns + _DAY_NS // 2) // _DAY_NS
    return time_ns + days * _DAY_NS


def _stated_epoch_ns(sentence: Sentence) -> int | None:
    """Epoch as written in an RMC sentence with a valid position, or in a ZDA sentence."""
    fields = sentence.field
    date = fields.get("datestamp", "")
    if sentence.kind == "RMC" and fields.get("status") == "A" and len(date) == 6:
        # GPS began in 1980: two digits from 80 on are of that century.
        day, month, year = date[:2], date[2:4], ("19" if date[4:] >= "80" else "20") + date[4:]
    elif sentence.kind == "ZDA" and "year" in fields:
        day, month, year = fields["day"], fields["month"], fields["year"]
    else:
        return None
    try:
        midnight = datetime(int(year), int(month), int(day), tzinfo=UTC)
        return int(midnight.timestamp()) * 1_000_000_000 + _time_of_day_ns(fields["timestamp"])
    except (ValueError, OverflowError, LeftOutError):
        return None
