"""Checkerboards and ChArUco boards as PDF: exactly those that the detectors read."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import BoolArray
from twin.calibrate.boards.boards import Board, board_from_text
from twin.calibrate.prints.sheet import (
    EDGE_MM,
    RULER_STRIP_MM,
    Box,
    Sheet,
    draw_ruler,
    new_sheet,
    page_for,
    pdf_pages,
    print_black,
    ruler_length_mm,
    write_text,
)

_CHECK = "Print at 100 % (not “fit to page”), then measure both rulers with a steel rule."
_QUIET_SQUARES = 0.25
"""White around the squares."""


def board_pdf(text: str, page: str | None = None) -> bytes:
    """Print a board.

    Parameters
    ----------
    text : str
        As ``--board`` takes it.
    page : str, optional
        A4 to A0. Default: the smallest that it fits on.

    Raises
    ------
    ConfigError
        If there is no such board, or it does not fit.
    """
    return pdf_pages([_sheet(board_from_text(text), page)])


def _sheet(board: Board, page: str | None) -> Sheet:
    square = 1000.0 * board.square_m
    width, height = square * (board.columns + 1), square * (board.rows + 1)
    white = max(EDGE_MM, _QUIET_SQUARES * square)
    beside, below = max(white, RULER_STRIP_MM), max(white, RULER_STRIP_MM)
    sheet = new_sheet(
        *page_for(beside + width + white, white + height + below, page, f"The board {board.text}")
    )
    left = 0.5 * (sheet.width_mm - width + beside - white)
    top = 0.5 * (sheet.height_mm - height + white - below)
    boxes = [(left + x, top + y, w, h) for x, y, w, h in _boxes(board)]
    print_black(sheet, boxes)
    draw_ruler(sheet, left - 0.5 * beside, top, ruler_length_mm(height), upright=True)
    foot = top + height + min(below, 30.0)
    draw_ruler(sheet, left, foot - 13.0, ruler_length_mm(width))
    write_text(sheet, left, foot - 6.0, f"--board {board.text}   square {square:g} mm   {_CHECK}", 2.8)
    write_text(sheet, left - 0.5 * beside - 5.0, max(top - 4.0, 4.0), "top ▲", 2.8)
    return sheet


def _boxes(board: Board) -> list[Box]:
    """Black parts in millimetres from the top left corner of the squares."""
    square = 1000.0 * board.square_m
    columns, rows = board.columns + 1, board.rows + 1
    if board.kind == "checkerboard":
        black = [(c, r) for r in range(rows) for c in range(columns) if (r + c) % 2 == 0]
        return [(c * square, r * square, square, square) for c, r in black]
    import cv2

    printed = board.aruco()
    dictionary, cells = printed.getDictionary(), board.marker_cells
    places = {
        int(n): np.asarray(p)[:, :2] for n, p in zip(printed.getIds(), printed.getObjPoints(), strict=True)
    }
    with_marker = {tuple((p.mean(axis=0) / board.square_m).astype(int).tolist()) for p in places.values()}
    boxes: list[Box] = [
        (c * square, r * square, square, square)
        for r in range(rows)
        for c in range(columns)
        if (c, r) not in with_marker
    ]
    for number, corners in places.items():
        ink = cv2.aruco.generateImageMarker(dictionary, number, cells, borderBits=1) < 128
        left, top = 1000.0 * corners.min(axis=0)
        boxes += cell_boxes(ink, float(left), float(top), 1000.0 * board.marker_m / cells)
    return boxes


def cell_boxes(ink: BoolArray, left_mm: float, top_mm: float, cell_mm: float) -> list[Box]:
    """Boxes of black cells (rows, columns)."""
    return [
        (left_mm + c * cell_mm, top_mm + r * cell_mm, cell_mm, cell_mm) for r, c in np.argwhere(ink).tolist()
    ]
