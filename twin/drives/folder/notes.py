"""What is told while a drive folder is read, and what stays with the drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

from geoloc.doubts import Doubt

Progress = Callable[[str], None]


class DriveDoubt(StrEnum):
    """What a warning of a drive is about."""

    RIG = "rig"
    TRACK = "track"
    CLOCK = "clock"
    PICTURES = "pictures"
    ANNOTATIONS = "annotations"
    NO_ANNOTATION_FILES = "no annotation files"
    LABELS = "labels"
    IDS = "ids"
    CAMERAS_DISAGREE = "cameras disagree"


class SkipKind(StrEnum):
    """Why something was left out, as far as anything is decided by it."""

    OTHER = "other"
    DAMAGED_FILE = "damaged file"
    EMPTY_FILE = "empty file"
    UNUSABLE = "unusable annotation"
    REPEATED = "repeated annotation"
    SLIP = "slip of the hand"
    OTHER_VERSION = "version of another annotator"
    OTHER_SHAPE = "shape that stands for no sign"
    NO_TIME = "annotation without a time"
    INTERPOLATED = "interpolated annotation"

    def reason(self, detail: str = "") -> str:
        """Return the clause that people read; `detail` is what the file says, or the whole clause."""
        return _REASONS.get(self, "{}").replace("{}", detail)


_REASONS = {
    SkipKind.DAMAGED_FILE: "damaged",
    SkipKind.EMPTY_FILE: "empty",
    SkipKind.REPEATED: "the same annotation again",
    SkipKind.SLIP: "no object stands there, and one near it lacks this picture: a slip of the hand",
    SkipKind.OTHER_VERSION: "another annotator's version of the task",
    SkipKind.OTHER_SHAPE: "kind {}",
    SkipKind.NO_TIME: "frame of {} without a time stamp",
    SkipKind.INTERPOLATED: "interpolated between key frames: the object was seen there, but not measured",
}
_FILES = (SkipKind.DAMAGED_FILE, SkipKind.EMPTY_FILE)


@dataclass(frozen=True, slots=True)
class Skipped:
    """Lines, fixes or frames that a reader left out: never silently."""

    what: str
    """e.g. ``GNSS sentences``, ``annotations``."""
    where: str
    """File name inside the drive folder."""
    count: int
    reason: str
    """One clause, only for people: ``fix quality 0``, ``checksum``, ``outside the image``."""
    kind: SkipKind = SkipKind.OTHER

    @property
    def is_annotation(self) -> bool:
        """Whether these are annotations that somebody made: no interpolated ones, files or anything else."""
        return self.kind not in (SkipKind.OTHER, SkipKind.INTERPOLATED, *_FILES)

    def as_row(self) -> dict[str, str | int]:
        """Return what is kept and shown of it."""
        return {"what": self.what, "where": self.where, "count": self.count, "reason": self.reason}


def skipped_annotations(kind: SkipKind, where: str, count: int, detail: str = "") -> Skipped:
    """Return annotations, or files of them, that were left out, with the reason that their kind gives."""
    what = "annotation files" if kind in _FILES else "annotations"
    return Skipped(what, where, count, kind.reason(detail), kind)


@dataclass(slots=True)
class ReadingNotes:
    """What is told while reading, and what stays with the drive."""

    progress: Progress | None = None
    warnings: list[Doubt] = field(default_factory=list)
    skipped: list[Skipped] = field(default_factory=list)

    def say(self, text: str) -> None:
        """Tell whoever watches what was just read."""
        if self.progress is not None:
            self.progress(text)

    def warn(self, kind: DriveDoubt, *sentences: str) -> None:
        """Remember what a user should know, one sentence each."""
        self.warnings += doubts(kind, *sentences)


def doubts(kind: DriveDoubt, *sentences: str) -> tuple[Doubt, ...]:
    """Return sentences of one kind as warnings."""
    return tuple(Doubt(kind, sentence) for sentence in sentences)
