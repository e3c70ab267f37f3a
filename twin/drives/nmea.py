"""NMEA 0183 text, with or without the host's stamps → :class:`~geoloc.trajectory.GnssFixes`.

The recorder of the NTNU car writes one sentence a line, a space, and the host's clock in µs::

    $GPGGA,071840.90,6324.8972646,N,01023.9477304,E,4,14,1.1,65.70,M,0.0,M,0.9,0246*75 1684739920978036

The epoch of a fix is the UTC *in the sentence*: the host stamps a sentence when it arrives, 78 ms later on
that car, which is a metre at 50 km/h.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from geoloc.trajectory import GnssFixes
from twin.drives.clock import credible
from twin.drives.drive import Skipped
from twin.drives.ordering import longest_increasing
from twin.errors import DriveError

_LINE = re.compile(r"\$(?P<body>[^*]*)(?:\*(?P<sum>[0-9A-Fa-f]{2})(?P<rest>.*))?", re.DOTALL)
_USED = ("GGA", "RMC", "ZDA")
_TIME = re.compile(r"(\d\d)(\d\d)(\d\d)(?:\.(\d{0,9})\d*)?")
_ANGLE = re.compile(r"(\d{1,3}?)(\d\d(?:\.\d*)?)")
_DAY_NS = 86_400_000_000_000

HOST_DELAY_LIMIT_S = 2.0
"""A sentence stamped further than this from its epoch tells of clocks that differ, not of a slow link."""


class Sentence(NamedTuple):
    """One sound sentence: its type (``GGA``), its fields by name (used types only), and the host's stamp."""

    kind: str
    field: Mapping[str, str]
    host_ns: int | None


class Fix(NamedTuple):
    """One usable fix."""

    epoch_ns: int
    host_ns: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    quality: int


class _LeftOutError(Exception):
    """A line that is left out; its text is the reason."""


@dataclass(frozen=True, slots=True)
class NmeaRead:
    """Fixes of one file, with what was left out and what a user should know."""

    fixes: GnssFixes
    skipped: tuple[Skipped, ...]
    warnings: tuple[str, ...]


def read_nmea(content: bytes, antenna: str, where: str) -> NmeaRead:
    """Read the GGA sentences of any talker.

    The date is that of the host stamp, moved to the day on which the sentence's UTC comes nearest to it: a
    sentence from before midnight that arrives after midnight keeps its own day. Where lines carry no host
    stamp, the date is that of the last RMC or ZDA sentence. Height is the altitude plus the geoid
    separation, which is ellipsoidal both for receivers that state the separation and for those that write
    the ellipsoidal height with a separation of 0.

    Parameters
    ----------
    content : bytes
    antenna : str
        Name of the antenna in the rig.
    where : str
        File name, for messages.

    Returns
    -------
    NmeaRead
        Fixes in order of time. Sentences of other types are not counted as left out.

    Raises
    ------
    DriveError
        If no fix can be used; the message says why the lines were left out.
    """
    faults: Counter[str] = Counter()
    sentences = list(iter_sentences(content, faults))
    rows, without_separation = _fixes(sentences, faults)
    keep = longest_increasing(np.array([row.epoch_ns for row in rows], dtype=np.int64))
    faults["epoch not after the fix before"] += int(np.count_nonzero(~keep))
    skipped = tuple(Skipped("GNSS sentences", where, n, reason) for reason, n in sorted(faults.items()) if n)
    kept = [row for row, good in zip(rows, keep, strict=True) if good]
    if not kept:
        raise DriveError(_nothing_usable(where, sentences, skipped))
    fixes = _arrays(kept, antenna)
    warnings = _clock_warnings(fixes, where)
    if without_separation:
        warnings.append(
            f"{without_separation} fixes of {where} state no geoid separation: their altitude was taken as"
            " the ellipsoidal height."
        )
    return NmeaRead(fixes, skipped, tuple(warnings))


def fix_rate_hz(fixes: GnssFixes) -> float:
    """Rate of the fixes, from the median of their intervals; NaN for fewer than two."""
    if len(fixes.epoch_ns) < 2:
        return math.nan
    return float(1e9 / np.median(np.diff(fixes.epoch_ns)))


def iter_sentences(content: bytes, faults: Counter[str] | None = None) -> Iterator[Sentence]:
    """Yield every sound sentence; count the lines that are none in `faults`."""
    for line in content.splitlines():
        text = line.decode("latin-1").strip()
        if not text:
            continue
        try:
            yield _sentence(text)
        except _LeftOutError as reason:
            if faults is not None:
                faults[str(reason)] += 1


def _sentence(text: str) -> Sentence:
    from pynmea2 import NMEASentence, ParseError

    match = _LINE.fullmatch(text)
    if not match:
        raise _LeftOutError("not an NMEA sentence")
    body, stated, rest = match.group("body", "sum", "rest")
    if stated is None:
        raise _LeftOutError("no checksum")
    if NMEASentence.checksum(body) != int(stated, 16):
        raise _LeftOutError("checksum")
    kind = body.partition(",")[0][2:]
    if kind not in _USED:
        return Sentence(kind, {}, None)
    try:
        message = NMEASentence.parse(f"${body}")
    except ParseError:
        raise _LeftOutError("not an NMEA sentence") from None
    # The library's own conversions are passed by: they cut the time to whole microseconds, downwards, and
    # turn an absent latitude into 0.
    names = (field[1] for field in message.fields)
    return Sentence(kind, dict(zip(names, message.data, strict=False)), _host_ns(rest))


def _host_ns(rest: str) -> int | None:
    """Host stamp behind a sentence, in ns; None where there is none."""
    if not rest.strip():
        return None
    try:
        host_ns = int(rest) * 1000
    except ValueError:
        raise _LeftOutError("host stamp is not a number") from None
    if not credible(host_ns):
        raise _LeftOutError("host stamp outside the years 2000–2099")
    return host_ns


def _fixes(sentences: list[Sentence], faults: Counter[str]) -> tuple[list[Fix], int]:
    """Usable fixes in file order, and how many of them state no geoid separation."""
    dates = (date for sentence in sentences if (date := _dated_epoch_ns(sentence)) is not None)
    reference_ns = next(dates, None)  # sentences before the first date belong to the same day
    rows, without_separation = [], 0
    for sentence in sentences:
        dated = _dated_epoch_ns(sentence)
        reference_ns = reference_ns if dated is None else dated
        if sentence.kind != "GGA":
            continue
        try:
            row, has_separation = _fix(sentence, reference_ns)
        except _LeftOutError as reason:
            faults[str(reason)] += 1
            continue
        rows.append(row)
        reference_ns = row.epoch_ns
        without_separation += not has_separation
    return rows, without_separation


def _fix(sentence: Sentence, reference_ns: int | None) -> tuple[Fix, bool]:
    """One GGA sentence as a fix, and whether it states a geoid separation."""
    field = sentence.field
    if "geo_sep" not in field:
        raise _LeftOutError("sentence too short")
    if field["gps_qual"] not in set("0123456789"):
        raise _LeftOutError("fix quality is not a digit")
    quality = int(field["gps_qual"])
    if quality == 0:
        raise _LeftOutError("fix quality 0")
    latitude, longitude = _position(field)
    altitude, separation = _metres(field["altitude"]), _metres(field["geo_sep"])
    if altitude is None:
        raise _LeftOutError("no altitude")
    time_ns = _time_of_day_ns(field["timestamp"])
    near_ns = reference_ns if sentence.host_ns is None else sentence.host_ns
    if near_ns is None:
        raise _LeftOutError("no date: neither a host stamp nor an RMC or ZDA sentence")
    epoch_ns = _nearest_day(time_ns, near_ns)
    host_ns = epoch_ns if sentence.host_ns is None else sentence.host_ns
    fix = Fix(epoch_ns, host_ns, latitude, longitude, altitude + (separation or 0.0), quality)
    return fix, separation is not None


def _position(field: Mapping[str, str]) -> tuple[float, float]:
    latitude = _degrees(field["lat"], field["lat_dir"], "NS")
    longitude = _degrees(field["lon"], field["lon_dir"], "EW")
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise _LeftOutError("position outside the globe")
    if latitude == 0 and longitude == 0:
        raise _LeftOutError("position 0° N 0° E (null island)")
    return latitude, longitude


def _degrees(text: str, hemisphere: str, signs: str) -> float:
    """Degrees of ``ddmm.mmmm`` or ``dddmm.mmmm``; the second of `signs` is negative."""
    if not text:
        raise _LeftOutError("no position")
    match = _ANGLE.fullmatch(text)
    if not match or len(hemisphere) != 1 or hemisphere not in signs or float(match.group(2)) >= 60:
        raise _LeftOutError("position unreadable")
    degrees = int(match.group(1)) + float(match.group(2)) / 60
    return -degrees if hemisphere == signs[1] else degrees


def _metres(text: str) -> float | None:
    """A height; None for an empty field."""
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        raise _LeftOutError("height unreadable") from None
    if not math.isfinite(value) or abs(value) > 20_000:
        raise _LeftOutError("height absurd")
    return value


def _time_of_day_ns(text: str) -> int:
    """``hhmmss.sss`` in whole nanoseconds: a float would lose the last digit. A leap second is second 60."""
    match = _TIME.fullmatch(text)
    if not match:
        raise _LeftOutError("no UTC time")
    hours, minutes, seconds = (int(part) for part in match.group(1, 2, 3))
    if hours > 23 or minutes > 59 or seconds > 60:
        raise _LeftOutError("no UTC time")
    fraction = int((match.group(4) or "0").ljust(9, "0"))
    return (hours * 3600 + minutes * 60 + seconds) * 1_000_000_000 + fraction


def _nearest_day(time_ns: int, near_ns: int) -> int:
    """The epoch with this time of day that is nearest to `near_ns`."""
    days = (near_ns - time_ns + _DAY_NS // 2) // _DAY_NS
    return time_ns + days * _DAY_NS


def _dated_epoch_ns(sentence: Sentence) -> int | None:
    """Epoch of a sentence that carries a date: RMC with a valid position, or ZDA."""
    field = sentence.field
    date = field.get("datestamp", "")
    if sentence.kind == "RMC" and field.get("status") == "A" and len(date) == 6:
        day, month, year = date[:2], date[2:4], "20" + date[4:]
    elif sentence.kind == "ZDA" and "year" in field:
        day, month, year = field["day"], field["month"], field["year"]
    else:
        return None
    try:
        midnight = datetime(int(year), int(month), int(day), tzinfo=UTC)
        epoch_ns = int(midnight.timestamp()) * 1_000_000_000 + _time_of_day_ns(field["timestamp"])
    except (ValueError, _LeftOutError):
        return None
    return epoch_ns if credible(epoch_ns) else None


def _arrays(rows: list[Fix], antenna: str) -> GnssFixes:
    columns = list(zip(*rows, strict=True))
    epoch_ns, host_ns, quality = (np.array(columns[i], dtype=np.int64) for i in (0, 1, 5))
    latitude, longitude, height = (np.array(columns[i], dtype=np.float64) for i in (2, 3, 4))
    return GnssFixes(antenna, epoch_ns, host_ns, latitude, longitude, height, quality)


def _clock_warnings(fixes: GnssFixes, where: str) -> list[str]:
    """Tell of a host clock that does not run on UTC: the cameras are stamped by the same clock."""
    delay_s = float(np.median(fixes.host_ns - fixes.epoch_ns)) / 1e9
    if abs(delay_s) <= HOST_DELAY_LIMIT_S:
        return []
    warning = (
        f"The host clock of {where} is {delay_s:+.1f} s from the UTC in its sentences (18 s would be GPS"
        " time, whole hours local time): if the same clock stamped the frames, give"
        f" camera_offset_ms = {-1000 * delay_s:.0f} in drive.toml."
    )
    return [warning]


def _nothing_usable(where: str, sentences: list[Sentence], skipped: tuple[Skipped, ...]) -> str:
    if any("no date" in s.reason for s in skipped):
        cure = "record it with host stamps, or with RMC or ZDA sentences"
    elif sentences and not any(sentence.kind == "GGA" for sentence in sentences):
        cure = "switch GGA sentences on in the receiver"
    else:
        cure = "check that it is the NMEA recording of this drive"
    counts = "; ".join(f"{s.count} × {s.reason}" for s in skipped)
    return f"{where} holds no usable GNSS fix ({counts or 'no GGA sentence'}): {cure}."
