"""The time that rows carry."""

from __future__ import annotations

import datetime as dt


def utc_now() -> str:
    """Return the present instant as ISO 8601 UTC to the second: ``2026-06-10T08:00:00Z``."""
    return dt.datetime.now(dt.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
