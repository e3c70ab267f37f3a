"""What is told while a drive folder is read, and what stays with the drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass

Progress = Callable[[str], None]


@dataclass(slots=True)
class ReadingNotes:
    """What is told while reading, and what stays with the drive."""

    progress: Progress | None
    warnings: list[str]
    skipped: list[Skipped]

    def say(self, text: str) -> None:
        """Tell whoever watches what was just read."""
        if self.progress is not None:
            self.progress(text)


@dataclass(frozen=True, slots=True)
class Skipped:
    """Lines, fixes or frames that a reader left out: never silently."""

    what: str
    """e.g. ``GNSS sentences``, ``annotations``."""
    where: str
    """File name inside the drive folder."""
    count: int
    reason: str
    """One clause: ``fix quality 0``, ``checksum``, ``outside the image``."""
