"""What to do next with the board, in plain words."""

from __future__ import annotations

from collections.abc import Sequence

from geoloc.calibration.intrinsics.missing_views import NextView, Reach, Tilt
from twin.calibrate.boards.boards import Board

_PLACES = (
    "in the upper left corner",
    "at the upper edge",
    "in the upper right corner",
    "at the left edge",
    "in the middle",
    "at the right edge",
    "in the lower left corner",
    "at the lower edge",
    "in the lower right corner",
)
_TILTS = {
    Tilt.LEFT: "its left side tilted towards the camera",
    Tilt.RIGHT: "its right side tilted towards the camera",
    Tilt.TOP: "its upper side tilted towards the camera",
    Tilt.BOTTOM: "its lower side tilted towards the camera",
}
_REACHES = {
    Reach.NEAR: "so near that it takes half of the picture's width or more",
    Reach.MIDDLING: "so far away that it takes a third of the picture's width",
}


def hints(views: Sequence[NextView], board: Board) -> tuple[str, ...]:
    """Say what to do, a sentence a view."""
    return tuple(_sentence(view, board) for view in views)


def _sentence(view: NextView, board: Board) -> str:
    parts = [f"Hold the board {_PLACES[view.zone]} of the picture"]
    if view.zone != len(_PLACES) // 2:
        cut = board.kind == "charuco"
        parts.append("part of it may be outside" if cut else "all of its squares still in the picture")
    if view.tilt is not None:
        parts.append(_TILTS[view.tilt])
    if view.reach in _REACHES:
        parts.append(_REACHES[view.reach])
    if view.turned:
        parts.append("turned by a quarter")
    return f"{', '.join(parts)}."
