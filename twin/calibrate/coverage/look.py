"""Pictures of a board as they come: which views there are, and what to take next."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geoloc.calibration.intrinsics import sharp
from geoloc.calibration.intrinsics.missing_views import Reach, ShownViews, Tilt, shown_views
from geoloc.errors import CalibrationError
from twin.calibrate.boards.boards import Board, board_from_text
from twin.calibrate.boards.detect import DetectedBoard, detect
from twin.calibrate.boards.pictures import (
    IMAGE_SUFFIXES,
    Picture,
    Progress,
    count,
    files_of,
    pictures,
)
from twin.calibrate.coverage.words import hints

N_HINTS = 3


@dataclass(frozen=True, slots=True)
class CoverageReport:
    """Which views of a board there are, and which are missing.

    Attributes
    ----------
    pictures, boards : int
        Looked at; and those that show the board, sharp.
    without_board, blurred : tuple of str
        Names of the others.
    alike : int
        Boards that are shown just as in another picture: they count once.
    part_of_the_image : float
        Inside the outline of at least one board.
    zone_views : tuple of tuple of float
        Boards over a place of each ninth of the picture, on average: three rows from the top.
    tilts : mapping of str to int
        Views by the edge that is nearer the camera.
    reaches : mapping of str to int
        Views by how much of the picture's width the board takes: near (about half), middling (a third), far.
    turned : int
        Views of the board turned by a quarter.
    missing : int
        About so many pictures more; 0 where there are enough.
    next : tuple of str
        What to do next.
    """

    pictures: int
    boards: int
    without_board: tuple[str, ...]
    blurred: tuple[str, ...]
    alike: int
    part_of_the_image: float
    zone_views: tuple[tuple[float, ...], ...]
    tilts: dict[str, int]
    reaches: dict[str, int]
    turned: int
    missing: int
    next: tuple[str, ...]


@dataclass(slots=True)
class BoardLog:
    """Boards found so far.

    Attributes
    ----------
    board : Board
    found : list of DetectedBoard
    without_board : list of str
    size_px : (int, int) or None
        Of the pictures.
    """

    board: Board
    found: list[DetectedBoard] = field(default_factory=list)
    without_board: list[str] = field(default_factory=list)
    size_px: tuple[int, int] | None = None

    def add(self, picture: Picture) -> bool:
        """Look for the board in a picture.

        Raises
        ------
        CalibrationError
            If the picture has another size than those before.
        """
        height, width = picture.grey.shape
        self.size_px = self.size_px or (width, height)
        if self.size_px != (width, height):
            raise CalibrationError(
                f"{picture.name} has {width} x {height} pixels and those before it "
                f"{self.size_px[0]} x {self.size_px[1]}: calibrate from pictures of one camera in its full "
                "size."
            )
        seen = detect(picture.grey, self.board, picture.name)
        if seen is None:
            self.without_board.append(picture.name)
        else:
            self.found.append(seen)
        return seen is not None

    def shown(self) -> ShownViews:
        """What the sharp ones show.

        Raises
        ------
        CalibrationError
            If no picture was looked at, or they are mirrored.
        """
        width, height = self.size_px or (0, 0)
        if not width:
            raise CalibrationError("There is no picture yet.")
        return shown_views(
            [b.view for b, good in zip(self.found, self._sharp(), strict=True) if good], width, height
        )

    def report(self, shown: ShownViews) -> CoverageReport:
        """Put what is there and what is missing into a record."""
        blurred = [b.view.name for b, good in zip(self.found, self._sharp(), strict=True) if not good]
        views = shown.views
        return CoverageReport(
            pictures=len(self.found) + len(self.without_board),
            boards=len(self.found) - len(blurred),
            without_board=tuple(self.without_board),
            blurred=tuple(blurred),
            alike=shown.n_alike,
            part_of_the_image=float((shown.covered > 0).mean()),
            zone_views=tuple(tuple(row) for row in np.round(shown.zone_views, 1).tolist()),
            tilts={tilt.value: sum(v.tilt is tilt for v in views) for tilt in Tilt},
            reaches={reach.value: sum(v.reach is reach for v in views) for reach in Reach},
            turned=sum(v.turned for v in views),
            missing=shown.n_missing,
            next=hints(shown.next_views(N_HINTS), self.board),
        )

    def _sharp(self) -> list[bool]:
        return list(map(bool, sharp(np.array([b.edge_px for b in self.found]))))


def look_at(
    sources: Sequence[Path],
    board: str,
    every: int | None = None,
    progress: Progress = lambda _what, _done, _total: None,
) -> tuple[BoardLog, ShownViews]:
    """Look at pictures and films of a board.

    Raises
    ------
    CalibrationError, ConfigError
        If they cannot be read, or there is no such board.
    """
    log, files = BoardLog(board_from_text(board)), files_of(sources)
    total = count(files, every)
    for number, picture in enumerate(pictures(files, every)):
        log.add(picture)
        progress("looking for the board", number + 1, total)
    return log, log.shown()


def watch(folder: Path, board: str, wait: Callable[[], None]) -> Iterator[tuple[str, BoardLog, ShownViews]]:
    """Look at each picture that arrives in a folder, until there are enough.

    Parameters
    ----------
    folder : Path
    board : str
    wait : callable
        Called between two looks into the folder.

    Yields
    ------
    name, log, shown
        After each picture: its name, and all that is known by then.

    Raises
    ------
    CalibrationError, ConfigError
        If there is no such folder or board, or a picture has another size.
    """
    if not folder.is_dir():
        raise CalibrationError(f"{folder} is no folder: give the one in which pictures arrive.")
    log, done, sizes = BoardLog(board_from_text(board)), set[Path](), dict[Path, int]()
    while True:
        for file in sorted(
            p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and p not in done
        ):
            size = file.stat().st_size
            # What is still being written grows from look to look.
            if sizes.get(file) != size or size == 0:
                sizes[file] = size
                continue
            done.add(file)
            log.add(next(iter(pictures([file]))))
            shown = log.shown()
            yield file.name, log, shown
            if not shown.n_missing:
                return
        wait()
