"""Stamps of a recording: what is a credible one, and how to show it."""

from __future__ import annotations

from datetime import UTC, datetime
from decimal import Decimal

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
        found = next((u for u, ns in _UNITS_NS.items() if u != wanted and credible(int(stamp * ns))), "")
    except ArithmeticError:  # no number
        return ""
    if not found:
        return ""
    right = int(stamp * _UNITS_NS[found]) // _UNITS_NS[wanted]
    return f"{text.strip()} looks like {found}: write it in {wanted} since 1970, UTC, as {right}"


def clock_hint(frames_ns: tuple[int, int], track_ns: tuple[int, int]) -> str:
    """Say which usual mistake of clocks would explain frames outside the track; "" if none would.

    Parameters
    ----------
    frames_ns, track_ns : (int, int)
        First and last epoch of each.
    """
    shift_s, said = _usual_shift(frames_ns, track_ns)
    cure = f"then give camera_offset_ms = {1000 * shift_s}"
    return f"They would fit if one clock is off by {said}: {cure}." if said else ""


def stamps_hint(frames_ns: tuple[int, int], track_ns: tuple[int, int], where: str) -> str:
    """Say the same of one camera among others, whose file of times is `where`."""
    shift_s, said = _usual_shift(frames_ns, track_ns)
    cure = f"then add {shift_s:+d} s to the times in {where}"
    return f"They would fit if their clock is off by {said}: {cure}." if said else ""


def _usual_shift(frames_ns: tuple[int, int], track_ns: tuple[int, int]) -> tuple[int, str]:
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
