"""GPS time and its traps: weeks that begin anew, and leap seconds."""

from __future__ import annotations

from datetime import UTC, datetime

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
