"""From pictures of a board to a camera: the work of ``twin calibrate intrinsics``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geoloc.calibration.intrinsics import (
    ENOUGH_VIEWS,
    MIN_VIEWS,
    MODELS,
    Intrinsics,
    alike,
    sharp,
    some,
    spread,
)
from geoloc.calibration.intrinsics import calibrate_intrinsics as calibrate_views
from geoloc.doubts import Doubt
from geoloc.errors import CalibrationError
from twin.calibrate.boards.boards import Board, board_from_text
from twin.calibrate.boards.detect import BLURRED_PX, DetectedBoard, detect
from twin.calibrate.boards.pictures import Progress, count, files_of, pictures
from twin.calibrate.intrinsics.no_board import PictureFault, PicturesWithoutBoard
from twin.errors import ConfigError

MAX_VIEWS = 60
_MARKER_TOLERANCE, _BLUR_TOLERANCE = 0.01, 0.08
"""Of the ratio of markers to squares: sharp, and times the square of blur over a marker's cell."""


@dataclass(frozen=True, slots=True)
class Calibrated:
    """One camera calibrated from pictures.

    Attributes
    ----------
    intrinsics : Intrinsics
        `Intrinsics.left_out` also has the blurred and the superfluous views.
    board : Board
    n_pictures, n_found : int
        Pictures looked at, and those that showed the board.
    edge_px : mapping of view name to float
        Width of the print's edges in every view found.
    faults : tuple of Doubt
        Of the views (`ViewFault`) and of the pictures (`PictureFault`).
    """

    intrinsics: Intrinsics
    board: Board
    n_pictures: int
    n_found: int
    edge_px: Mapping[str, float]
    faults: tuple[Doubt, ...]


def models_from_text(text: str) -> tuple[str, ...]:
    """Models of ``--model``: ``auto`` for all, else one or several with commas between.

    Raises
    ------
    ConfigError
        If one is not known.
    """
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if names == ("auto",):
        return MODELS
    unknown = [name for name in names if name not in MODELS]
    if unknown or not names:
        raise ConfigError(f"There is no camera model {', '.join(unknown)}: give auto or {', '.join(MODELS)}.")
    return names


def calibrate_intrinsics(
    sources: Sequence[Path],
    board: str,
    *,
    model: str = "auto",
    linear: bool = False,
    max_views: int = MAX_VIEWS,
    every: int | None = None,
    distances_m: Mapping[str, float] | None = None,
    progress: Progress = lambda _what, _done, _total: None,
) -> Calibrated:
    """Calibrate one camera from pictures or films of a board.

    Parameters
    ----------
    sources : sequence of Path
        Pictures, films, folders of them.
    board : str
        ``checkerboard:9x6:0.08`` or ``charuco:12x9:0.06:0.045``.
    model : str
        ``auto``, or models to choose from, with commas between.
    linear : bool
        Only with c and d of f-theta and ocam free; otherwise where held-out views say so.
    max_views : int
        At most so many views are used, spread over the image, over distances and tilts.
    every : int, optional
        Look at every so manieth frame of a film. Default: at some 240 frames.
    distances_m : mapping of picture name to float, optional
        Measured distances of the camera from the middle of the board.

    Raises
    ------
    CalibrationError
        If nothing can be calibrated; says why.
    ConfigError
        If the board or the model is not known.
    """
    printed, models = board_from_text(board), models_from_text(model)
    boards, without_board, size = _looked_at(files_of(sources), printed, every, progress)
    edge_px = {b.view.name: b.edge_px for b in boards}
    kept, left_out, same = _chosen(boards, size, max_views)
    steps = iter(range(1, 1000))
    intrinsics = calibrate_views(
        [s.view for s in kept],
        *size,
        models=models,
        linear=linear,
        distances_m=_measured(distances_m or {}, edge_px),
        progress=lambda text: progress(text, next(steps), None),
    )
    n_pictures = len(boards) + len(without_board.reasons)
    faults = (*without_board.faults(n_pictures), *_picture_faults(kept, same, printed), *intrinsics.faults)
    intrinsics = replace(intrinsics, left_out={**without_board.reasons, **left_out, **intrinsics.left_out})
    return Calibrated(intrinsics, printed, n_pictures, len(boards), edge_px, faults)


def _looked_at(
    files: Sequence[Path], board: Board, every: int | None, progress: Progress
) -> tuple[list[DetectedBoard], PicturesWithoutBoard, tuple[int, int]]:
    """Boards found, pictures without one, and the pictures' width and height."""
    total, boards, without_board = count(files, every), list[DetectedBoard](), PicturesWithoutBoard(board)
    size = (0, 0)
    for number, picture in enumerate(pictures(files, every)):
        detected = detect(picture.grey, board, picture.name)
        if detected is not None:
            boards.append(detected)
        else:
            without_board.add(picture)
        height, width = picture.grey.shape
        size = (width, height)
        progress("looking for the board", number + 1, total)
    if len(boards) < MIN_VIEWS:
        raise CalibrationError(without_board.why_so_few(len(boards)))
    return boards, without_board, size


def _chosen(
    boards: Sequence[DetectedBoard], size: tuple[int, int], max_views: int
) -> tuple[list[DetectedBoard], dict[str, str], list[str]]:
    """Sharp, different and well spread views, why not the others, and those that show what another shows.

    Raises
    ------
    CalibrationError
        If there are too few that differ.
    """
    widths = np.array([b.edge_px for b in boards])
    good = sharp(widths)
    usual = float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan
    left_out = {
        b.view.name: f"blurred: its edges are {b.edge_px:.1f} px wide, usual are {usual:.1f} px"
        for b, keep in zip(boards, good, strict=True)
        if not keep
    }
    kept = [b for b, keep in zip(boards, good, strict=True) if keep]
    copies = alike([b.view for b in kept], size[0], np.array([b.edge_px for b in kept]))
    same = [kept[number].view.name for number in copies]
    left_out |= dict.fromkeys(same, "shows the board just as another view does")
    kept = [b for number, b in enumerate(kept) if number not in copies]
    if same and len(kept) < MIN_VIEWS:
        raise CalibrationError(
            f"The views are too similar: {len(same)} of {len(boards)} show the board just as another one "
            f"does, which leaves {len(kept)} that differ, and {MIN_VIEWS} are the least: move and tilt the "
            "board between pictures."
        )
    taken = spread([b.view for b in kept], *size, max_views).tolist()
    others = (b.view.name for number, b in enumerate(kept) if number not in taken)
    left_out |= dict.fromkeys(others, "not needed: other views are like it")
    return [kept[number] for number in taken], left_out, same


def _measured(distances_m: Mapping[str, float], edge_px: Mapping[str, float]) -> Mapping[str, float]:
    for name, metres in distances_m.items():
        if name not in edge_px:
            raise ConfigError(f"A distance is given for {name}, a picture in which the board was not found.")
        if not 0.0 < metres < 1000.0:
            raise ConfigError(f"The distance of {name} is {metres:g} m: give metres, more than 0.")
    return distances_m


def _picture_faults(kept: Sequence[DetectedBoard], same: Sequence[str], board: Board) -> list[Doubt]:
    """Pictures alike, blur that all have, and markers that are not as large as the board's text says."""
    faults, widths = [], np.array([b.edge_px for b in kept])
    if same and len(kept) < ENOUGH_VIEWS:
        faults.append(
            Doubt(
                PictureFault.SIMILAR_VIEWS,
                f"{len(same)} views ({some(same)}) show the board just as others do and were left out: move "
                "and tilt it between pictures.",
            )
        )
    usual = float(np.nanmedian(widths)) if np.isfinite(widths).any() else 0.0
    if usual > BLURRED_PX:
        faults.append(
            Doubt(
                PictureFault.BLURRED_CAMERA,
                f"All pictures are blurred: the board's edges are {usual:.1f} px wide, where a sharp lens "
                "gives 2 to 3: focus the camera, and hold it and the board still.",
            )
        )
    parts = np.array([b.marker_part for b in kept])
    if board.kind == "charuco" and np.isfinite(parts).any():
        part, stated = float(np.nanmedian(parts)), board.marker_m / board.square_m
        cell_px = np.nanmedian([b.marker_px for b in kept]) / board.marker_cells
        if abs(part / stated - 1.0) > _MARKER_TOLERANCE + _BLUR_TOLERANCE * (usual / cell_px) ** 2:
            faults.append(
                Doubt(
                    PictureFault.WRONG_SQUARE_SIZE,
                    f"In the pictures a marker's side is {part:.3f} of a square's, by --board "
                    f"({board.marker_m:g} m of {board.square_m:g} m) it is {stated:.3f}: measure both again.",
                )
            )
    return faults
