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


QUIET = frozenset({Verdict.UNCHANGED, Verdict.NOT_OBSERVABLE})
"""Verdicts that ask nobody to decide."""


class Sending(StrEnum):
    """How far a finding is on its way to NVDB, as :mod:`twin.changesets.sent` keeps it."""

    REGISTERING = "registering"
    """It is to be registered; whether API Skriv has heard of it is not known."""
    UNDER_WAY = "under_way"
    """API Skriv has the set."""
    CARRIED_OUT = "carried_out"
    WITHOUT_EFFECT = "without_effect"
    """Refused, cancelled, or never arrived: it may be sent again."""
    UNDONE = "undone"
    """What it registered was removed again: it may be sent again."""


class JobKind(StrEnum):
    """What a fleet does."""

    INGEST = "ingest"
    PART = "part"
    """Of a match of everything: some drives, or a tile."""
    MATCH = "match"


class JobState(StrEnum):
    """How far a job of a fleet is."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    PARKED = "parked"
    """It failed three times: it waits for a person."""


class Fault(StrEnum):
    """Why a run of a job failed."""

    DRIVE = "drive"
    """The drive, or how it is to be read: bad data, a wrong option."""
    LACKING = "lacking"
    """The drive is not there, or not whole."""
    STORAGE = "storage"
    """Its storage does not answer."""
    REFUSED = "refused"
    """It would take away what the store has."""
    STORE = "store"
    """The store cannot be used, or has no signs to match."""
    MEMORY = "memory"
    """The machine has too little memory."""
    LOST = "lost"
    """The process that ran it was killed."""
    BUG = "bug"
    """An error in twin."""


class Decision(StrEnum):
    """What people say of a finding; ``open``: nobody has decided, or not since the evidence changed."""

    OPEN = "open"
    ACCEPT = "accept"
    DISMISS = "dismiss"
    DEFER = "defer"
