"""The few words that rows of the store choose from, as enumerations: code never spells them out."""

from __future__ import annotations

from enum import StrEnum


class Method(StrEnum):
    """Geolocation methods, the best first."""

    ADJUSTED = "adjusted"
    SINGLE_FRAME = "single-frame"
    PAPER = "paper"


class Verdict(StrEnum):
    """What a match says of a sign, as :mod:`twin.matching` decides it."""

    UNCHANGED = "unchanged"
    MOVED = "moved"
    WRONG_TYPE = "wrong_type"
    NEW = "new"
    MISSING = "missing"
    NOT_OBSERVABLE = "not_observable"
    REVIEW = "review"


class Decision(StrEnum):
    """What people say of a finding."""

    OPEN = "open"
    ACCEPT = "accept"
    DISMISS = "dismiss"
    DEFER = "defer"
