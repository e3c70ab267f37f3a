"""Stamps of a recording: what is a credible one, and how to show it."""

from __future__ import annotations

from datetime import UTC, datetime

EARLIEST_NS = 946_684_800_000_000_000
"""2000-01-01 UTC: an earlier stamp is a clock that was never set."""

LATEST_NS = 4_102_444_800_000_000_000
"""2100-01-01 UTC: a later stamp is not in the unit that it should be."""


def credible(epoch_ns: int) -> bool:
    """Whether a stamp lies in the years 2000–2099."""
    return EARLIEST_NS <= epoch_ns < LATEST_NS


def utc_text(epoch_ns: int) -> str:
    """``2023-05-22 07:18:40.900 UTC`` for an epoch in nanoseconds since 1970."""
    moment = datetime.fromtimestamp(epoch_ns // 1_000_000_000, tz=UTC)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{epoch_ns // 1_000_000 % 1000:03d} UTC"
