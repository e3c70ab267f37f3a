"""Terms of the error budget that a drive or a command states, by name."""

from __future__ import annotations

import math
from dataclasses import fields

from geoloc.locate.single_frame import ErrorBudget

TERMS = tuple(field.name for field in fields(ErrorBudget))
"""Names of the terms, each with its unit: ``boresight_deg``, ``time_ms``, …"""

_LEAST = 1e-4
_MOST = {"px": 1000.0, "deg": 30.0, "m": 10.0, "ms": 60_000.0}
_MOST_SHARE = 1.0


def most_of(term: str) -> float:
    """Largest value that a term can have: what is beyond it is in another unit."""
    return _MOST.get(term.rpartition("_")[2], _MOST_SHARE)


def can_be(term: str, value: float) -> bool:
    """Whether a term can have this value."""
    return math.isfinite(value) and _LEAST <= value <= most_of(term)


def wanted(term: str) -> str:
    """Say what values a term can have."""
    return f"one sigma, a number from {_LEAST:g} to {most_of(term):g} (`twin help error-budget`)"
