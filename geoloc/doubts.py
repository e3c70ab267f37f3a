"""What a drive or an adjustment is warned of: a kind that code decides by, a sentence that people read."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


@dataclass(frozen=True, slots=True)
class Doubt:
    """One warning.

    Attributes
    ----------
    kind : StrEnum
        What it is about: a member of the enumeration of the room that found it. Code decides by this alone.
    sentence : str
        What, where, and the cure; made once, from the kind and the figures. Only for people.
    """

    kind: StrEnum
    sentence: str

    def __str__(self) -> str:
        """Return the sentence."""
        return self.sentence
