"""What live sources receive → a drive folder."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from twin.live.car import Car


class Recorder:
    """Writes what sources receive, as received, into a folder that ``twin ingest-drive`` reads as any drive.

    The folder is readable at any moment: every line is handed to the system as it comes, and to the disk every
    second, so that a kill loses nothing that was written and a power cut a second at most.

    Parameters
    ----------
    folder : Path
        Made; refused where it holds anything.
    car : Car
        Its files are copied, but for recordings.

    Attributes
    ----------
    folder : Path
    failure : str
        Why nothing more is written, one sentence (a full disk); "" while it works. Sources go on without it.

    Raises
    ------
    RefusedError
        If the folder is not empty.
    FileError
        If it cannot be made.
    """

    def __init__(self, folder: Path, car: Car) -> None:
        self.folder = folder
        self.failure = ""
        raise NotImplementedError

    def close(self) -> None:
        """Write everything to the disk and end; what sources still hand over is dropped."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
