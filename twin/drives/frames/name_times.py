"""When an image was taken, by its name.

Two ways to write it are read. A run of digits that is a Unix time in seconds (10 digits, with an optional
fraction), milliseconds (13), microseconds (16) or nanoseconds (19): that is UTC. Or a date and a time of day,
year first, with any separators (``2026-06-10T07_59_59.123``, ``20260610_075959_123``): UTC where ``Z``
follows, of the zone that follows as ``+0200``, and else of a zone that only the user knows.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import PurePosixPath

from twin.drives.epochs import credible

_NS = 1_000_000_000
_LONGEST_NAME = 255
"""No file system has longer names: what is longer is not looked at."""

_UNIX = re.compile(
    r"(?<![0-9.])(\d{19}|\d{16}|\d{13}|\d{10}(?:\.\d{1,9}|_(?:\d{9}|\d{6}|\d{3}))?)(?![0-9])", re.ASCII
)
_CALENDAR = re.compile(
    r"(?<![0-9])(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)[-_. T]{0,3}"
    r"([0-2]\d)[-_.:h]?([0-5]\d)[-_.:m]?([0-6]\d)(?:[-_.,s]?(\d{1,9})(?![0-9]))?(?![0-9])"
    r"(?:(Z)(?![A-Za-z])|([+-])([01]\d)[:_.]?([0-5]\d)(?![0-9]))?",
    re.ASCII,
)


def epoch_from_name(name: str, utc_offset_hours: float | None = None) -> int | None:
    """Epoch that stands in the name of an image.

    Parameters
    ----------
    name : str
        File name; folders before it and the suffix are not looked at.
    utc_offset_hours : float or None
        Zone of a date and time of day that says none itself; 2 in a Norwegian summer.

    Returns
    -------
    int or None
        Nanoseconds UTC; None where the name holds no time in the years 2000–2099, more than one, or a local
        time whose zone is unknown (see `needs_zone`).
    """
    moments = _moments(name)
    if len(moments) != 1:
        return None
    epoch_ns, has_zone = moments[0]
    if has_zone:
        return epoch_ns
    return None if utc_offset_hours is None else epoch_ns - round(utc_offset_hours * 3600 * _NS)


def needs_zone(name: str) -> bool:
    """Whether a name holds one time, but not in which zone."""
    moments = _moments(name)
    return len(moments) == 1 and not moments[0][1]


def _moments(name: str) -> list[tuple[int, bool]]:
    """Epochs in a name, each with whether it is UTC; those without a zone as if they were."""
    stem = PurePosixPath(name).name[-_LONGEST_NAME:]
    stem = re.sub(r"\.[A-Za-z][A-Za-z0-9]{1,4}$", "", stem)
    moments = {moment for match in _CALENDAR.finditer(stem) if (moment := _calendar(match)) is not None}
    if not moments:
        moments = {(epoch, True) for match in _UNIX.finditer(stem) if (epoch := _unix(match[1])) is not None}
    return sorted(moments)


def _unix(digits: str) -> int | None:
    whole, _, fraction = digits.replace("_", ".").partition(".")
    epoch_ns = int(whole) * 10 ** (19 - len(whole))
    epoch_ns += int(fraction.ljust(9, "0")) if fraction else 0
    return epoch_ns if credible(epoch_ns) else None


def _calendar(match: re.Match[str]) -> tuple[int, bool] | None:
    year, month, day, hour, minute, second = (int(match[i]) for i in range(1, 7))
    try:
        # A leap second is the first of the next minute, as Unix time has it.
        start = datetime(year, month, day, hour, minute, tzinfo=UTC)
    except ValueError:
        return None
    epoch_ns = (int(start.timestamp()) + second) * _NS + int((match[7] or "0").ljust(9, "0"))
    if match[9]:
        offset_s = (int(match[10]) * 60 + int(match[11])) * 60
        epoch_ns -= (offset_s if match[9] == "+" else -offset_s) * _NS
    return (epoch_ns, bool(match[8] or match[9])) if credible(epoch_ns) else None
