"""In which order findings may be listed: apart from the list, so that a command's help is quick."""

from __future__ import annotations

from enum import StrEnum


class Order(StrEnum):
    """In which order findings are listed."""

    VERDICT = "verdict"
    """What is sure to be wrong in NVDB first, what is for review last; the surest of each first."""
    CONFIDENCE = "confidence"
    ROAD = "road"
    DISTANCE = "distance"
    """The farthest from NVDB's position first."""
