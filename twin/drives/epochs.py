"""Stamps of a recording: what is a credible one, and how to show it."""

from __future__ import annotations

from bisect import bisect_left
from datetime import UTC, datetime
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

HOST_DELAY_LIMIT_S = 0.5
"""A fix stamped further than this from its epoch tells of clocks that differ, not of a slow link."""

EARLIEST_NS = 946_684_800_000_000_000
"""2000-01-01 UTC: an earlier stamp is a clock that was never set."""

LATEST_NS = 4_102_444_800_000_000_000
"""2100-01-01 UTC: a later stamp is not in the unit that it should be."""


def credible(epoch_ns: int) -> bool:
    """Whether a stamp lies in the years 2000–2099."""
    return EARLIEST_NS <= epoch_ns < LATEST_NS


_LONGEST_STAMP = 40
_UNITS_NS = {"seconds": 1_000_000_000, "milliseconds": 1_000_000, "microseconds": 1_000, "nanoseconds": 1}


def unit_hint(text: str, wanted: str) -> str:
    """Say in which unit a stamp seems to be that is none of the years 2000–2099; "" if in none.

    Parameters
    ----------
    text : str
        The stamp as it stands in the file.
    wanted : str
        The unit it should be in, ``nanoseconds``.
    """
    try:
        stamp = Decimal(text[:_LONGEST_STAMP].strip(' "'))
        if not 0 < stamp < LATEST_NS:
            return ""
        unit = next((u for u, ns in _UNITS_NS.items() if u != wanted and credible(int(stamp * ns))), "")
    except ArithmeticError:  # no number
        return ""
    if not unit:
        return ""
    right = int(stamp * _UNITS_NS[unit]) // _UNITS_NS[wanted]
    return f"{text.strip()} looks like {unit}: write it in {wanted} since 1970, UTC, as {right}"


def clock_hint(frames_ns: tuple[int, int], track_ns: tuple[int, int]) -> str:
    """Say which usual mistake of clocks would explain frames outside the track; "" if none would.

    Parameters
    ----------
    frames_ns, track_ns : (int, int)
        First and last epoch of each.
    """
    shift_s, said = usual_shift(frames_ns, track_ns)
    cure = f"then give camera_offset_ms = {1000 * shift_s}"
    return f"They would fit if one clock is off by {said}: {cure}." if said else ""


def stamps_hint(frames_ns: tuple[int, int], track_ns: tuple[int, int], where: str) -> str:
    """Say the same of one camera among others, whose file of times is `where`."""
    shift_s, said = usual_shift(frames_ns, track_ns)
    cure = f"then add {shift_s:+d} s to the times in {where}"
    return f"They would fit if their clock is off by {said}: {cure}." if said else ""


def usual_shift(frames_ns: tuple[int, int], track_ns: tuple[int, int]) -> tuple[int, str]:
    """Seconds to add so that the frames fit the track, and why; "" if none of the usual ones does."""
    usual = [(sign * 18, "18 s, as GPS time is from UTC") for sign in (-1, 1)]
    hours = [sign * hour for hour in range(1, 15) for sign in (-1, 1)]
    usual += [(3600 * hour, f"{abs(hour)} h, as local time can be from UTC") for hour in hours]
    for shift_s, said in usual:
        first, last = (epoch + shift_s * 1_000_000_000 for epoch in frames_ns)
        if track_ns[0] <= first and last <= track_ns[1]:
            return shift_s, said
    return 0, ""


def utc_text(epoch_ns: int) -> str:
    """``2023-05-22 07:18:40.900 UTC`` for an epoch in nanoseconds since 1970."""
    moment = datetime.fromtimestamp(epoch_ns // 1_000_000_000, tz=UTC)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{epoch_ns // 1_000_000 % 1000:03d} UTC"


def longest_increasing(values: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mark the longest strictly increasing subsequence.

    Keeping "every row that is later than the row before" lets one stamp from the future throw away the rest
    of a recording; the longest increasing subsequence loses only the odd stamp itself.

    Parameters
    ----------
    values : int64 (n,)

    Returns
    -------
    bool (n,)
        True on the rows to keep. Of equal values in a row the first is kept.

    Notes
    -----
    Patience sorting, O(n log n): Fredman, *On computing the length of longest increasing subsequences*,
    Discrete Mathematics 11 (1975), doi:10.1016/0012-365X(75)90103-X.
    """
    n = len(values)
    if n < 2 or bool(np.all(np.diff(values) > 0)):
        return np.ones(n, dtype=np.bool_)
    ends: list[int] = []  # smallest last value of an increasing run of each length, and its row
    rows: list[int] = []
    before = np.full(n, -1, dtype=np.int64)
    for row, value in enumerate(values.tolist()):
        length = bisect_left(ends, value)
        if length < len(ends) and ends[length] == value:
            continue
        before[row] = rows[length - 1] if length else -1
        ends[length : length + 1] = [value]
        rows[length : length + 1] = [row]
    keep = np.zeros(n, dtype=np.bool_)
    row = rows[-1]
    while row >= 0:
        keep[row] = True
        row = int(before[row])
    return keep


WEEK_NS = 604_800_000_000_000


GPS_EPOCH_NS = 315_964_800_000_000_000
"""1980-01-06 UTC, where week 0 begins, since 1970."""


ROLLOVER_NS = 1024 * WEEK_NS
"""Receivers that count weeks with ten bits fall back by this, 19.6 years."""


_FIRST_DRIVE_NS = int(datetime(2010, 1, 1, tzinfo=UTC).timestamp()) * 1_000_000_000


# IERS Bulletin C: from when on GPS time runs ahead of UTC by so many seconds.
_LEAP_SECONDS = tuple(
    (int(datetime(year, month, 1, tzinfo=UTC).timestamp()) * 1_000_000_000, ahead)
    for year, month, ahead in (
        (2017, 1, 18),
        (2015, 7, 17),
        (2012, 7, 16),
        (2009, 1, 15),
        (2006, 1, 14),
        (1999, 1, 13),
    )
)


def leap_seconds(epoch_ns: int) -> int:
    """How many seconds GPS time runs ahead of UTC, for an epoch in either of them.

    By the table of IERS Bulletin C, from 1999 on; its last entry, 18 s since 2017, holds for later epochs.
    """
    return next((ahead for since_ns, ahead in _LEAP_SECONDS if epoch_ns >= since_ns), 13)


def utc_from_gps(gps_ns: int, ahead_s: int | None = None) -> int:
    """UTC since 1970 of nanoseconds since the GPS epoch; by `leap_seconds` where `ahead_s` is None."""
    epoch_ns = gps_ns + GPS_EPOCH_NS
    return epoch_ns - (leap_seconds(epoch_ns) if ahead_s is None else ahead_s) * 1_000_000_000


def after_rollovers(epoch_ns: int) -> int:
    """The epoch that a receiver meant which counts GPS weeks with ten bits.

    Such a receiver writes 2007 in 2026. Nothing that twin reads was recorded before 2010, so earlier epochs
    are moved on by 1024 weeks, as often as it takes.
    """
    if not GPS_EPOCH_NS <= epoch_ns < _FIRST_DRIVE_NS:
        return epoch_ns
    weeks = -(-(_FIRST_DRIVE_NS - epoch_ns) // ROLLOVER_NS)
    return epoch_ns + weeks * ROLLOVER_NS


def nearest_week(time_of_week_ns: int, near_ns: int) -> int:
    """The epoch with this time of week that is nearest to `near_ns`, both in GPS time."""
    weeks = (near_ns - time_of_week_ns + WEEK_NS // 2) // WEEK_NS
    return time_of_week_ns + weeks * WEEK_NS


def rollover_warning(where: str, count: int) -> str:
    """Tell that dates were moved on."""
    return (
        f"{count} dates of {where} lie before 2010, as a receiver writes them whose GPS weeks have run over:"
        " 1024 weeks were added to them, as often as it takes; update the receiver's firmware."
    )
