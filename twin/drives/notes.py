"""What is told while a drive folder is read, and what stays with the drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from twin.drives.drive import Skipped

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
