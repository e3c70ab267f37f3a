"""From pictures of a board to a camera: the work of ``twin calibrate intrinsics``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geoloc.calibration.faults import Fault
from geoloc.calibration.fit import MODELS
from geoloc.calibration.intrinsics import MIN_VIEWS, Intrinsics
from geoloc.calibration.intrinsics import calibrate_intrinsics as calibrate_views
from geoloc.calibration.selection import sharp, spread
from geoloc.errors import CalibrationError
from twin.calibrate.boards import Board, board_from_text
from twin.calibrate.detect import Seen, detect
from twin.calibrate.pictures import Picture, count, files_of, pictures
from twin.errors import ConfigError

MAX_VIEWS = 60
_BLURRED_PX = 5.0
"""Width of edges at which corners lose their sub-pixels."""
_MARKER_TOLERANCE = 0.06
_MIRROR_TRIALS = 5

Progress = Callable[[str, int, int | None], None]
"""What is being done, how much of it is done, and how much there is."""


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
    faults : tuple of Fault
        Of the views and of the pictures.
    """

    intrinsics: Intrinsics
    board: Board
    n_pictures: int
    n_found: int
    edge_px: Mapping[str, float]
    faults: tuple[Fault, ...]


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
        Also free c and d of f-theta and ocam.
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
    seen, n_pictures, size = _looked_at(files_of(sources), printed, every, progress)
    edge_px = {s.view.name: s.edge_px for s in seen}
    kept, left_out = _chosen(seen, size, max_views)
    steps = iter(range(1, 1000))
    made = calibrate_views(
        [s.view for s in kept],
        *size,
        models=models,
        linear=linear,
        distances_m=_measured(distances_m or {}, edge_px),
        progress=lambda text: progress(text, next(steps), None),
    )
    faults = (*_picture_faults(kept, printed), *made.faults)
    made = replace(made, left_out={**left_out, **made.left_out})
    return Calibrated(made, printed, n_pictures, len(seen), edge_px, faults)


def _looked_at(
    files: Sequence[Path], board: Board, every: int | None, progress: Progress
) -> tuple[list[Seen], int, tuple[int, int]]:
    """Boards found, number of pictures, and their width and height."""
    total, seen, first = count(files, every), list[Seen](), list[Picture]()
    n_pictures = 0
    for picture in pictures(files, every):
        found = detect(picture.grey, board, picture.name)
        if found is not None:
            seen.append(found)
        n_pictures += 1
        first = [*first, picture][:_MIRROR_TRIALS]
        progress("looking for the board", n_pictures, total)
    if len(seen) < MIN_VIEWS:
        raise CalibrationError(_why_so_few(len(seen), n_pictures, first, board))
    height, width = first[0].grey.shape
    return seen, n_pictures, (width, height)


def _why_so_few(n_seen: int, n_pictures: int, first: Sequence[Picture], board: Board) -> str:
    """Sentence about pictures that do not show the board, with the likeliest cause."""
    what = f"The board {board.text} was found in {n_seen} of {n_pictures} pictures"
    if n_seen == 0 and board.kind == "charuco":
        mirrored = [p for p in first if detect(np.ascontiguousarray(p.grey[:, ::-1]), board, p.name)]
        if mirrored:
            return (
                f"The pictures are mirrored: {mirrored[0].name} shows the board only when it is flipped. "
                "Switch mirroring off in the camera, or flip the pictures back."
            )
    if n_pictures < MIN_VIEWS:
        return f"{what}, and {MIN_VIEWS} are the least that give a camera: take 30 or more."
    counted = "inner corners" if board.kind == "checkerboard" else "squares and the dictionary of the markers"
    whole = "whole and " if board.kind == "checkerboard" else ""
    return (
        f"{what}, and {MIN_VIEWS} are the least: count its {counted} again, and see that pictures show it "
        f"{whole}sharp, with a white margin."
    )


def _chosen(seen: Sequence[Seen], size: tuple[int, int], max_views: int) -> tuple[list[Seen], dict[str, str]]:
    """Sharp and well spread views, and why not the others."""
    widths = np.array([s.edge_px for s in seen])
    good = sharp(widths)
    usual = float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan
    left_out = {
        s.view.name: f"blurred: its edges are {s.edge_px:.1f} px wide, usual are {usual:.1f} px"
        for s, keep in zip(seen, good, strict=True)
        if not keep
    }
    kept = [s for s, keep in zip(seen, good, strict=True) if keep]
    taken = set(spread([s.view for s in kept], *size, max_views).tolist())
    for number, s in enumerate(kept):
        if number not in taken:
            left_out[s.view.name] = "not needed: other views are like it"
    return [s for number, s in enumerate(kept) if number in taken], left_out


def _measured(distances_m: Mapping[str, float], found: Mapping[str, float]) -> Mapping[str, float]:
    for name, metres in distances_m.items():
        if name not in found:
            raise ConfigError(f"A distance is given for {name}, a picture in which the board was not found.")
        if not 0.0 < metres < 1000.0:
            raise ConfigError(f"The distance of {name} is {metres:g} m: give metres, more than 0.")
    return distances_m


def _picture_faults(kept: Sequence[Seen], board: Board) -> list[Fault]:
    """Blur that all pictures have, and markers that are not as large as the board's text says."""
    faults, widths = [], np.array([s.edge_px for s in kept])
    usual = float(np.nanmedian(widths)) if np.isfinite(widths).any() else 0.0
    if usual > _BLURRED_PX:
        faults.append(
            Fault(
                "blurred_camera",
                f"All pictures are blurred: the board's edges are {usual:.1f} px wide, where a sharp lens "
                "gives 2 to 3: focus the camera, and hold it and the board still.",
            )
        )
    parts = np.array([s.marker_part for s in kept])
    if board.kind == "charuco" and np.isfinite(parts).any():
        part, stated = float(np.nanmedian(parts)), board.marker_m / board.square_m
        if abs(part - stated) > _MARKER_TOLERANCE * stated:
            faults.append(
                Fault(
                    "wrong_square_size",
                    f"In the pictures a marker's side is {part:.2f} of a square's, by --board "
                    f"({board.marker_m:g} m of {board.square_m:g} m) it is {stated:.2f}: measure both again.",
                )
            )
    return faults
