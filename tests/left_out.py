"""What a reader left out, to compare."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def counts(skipped: Iterable[Any]) -> dict[str, int]:
    """Reasons and counts."""
    return {one.reason: one.count for one in skipped}
