"""AprilTags of the family 36h11 as PDF, one a page, the way up that its makers print them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoloc.arrays import BoolArray
from geoloc.calibration.extrinsics.tag_family import FAMILY, bits_of, dictionary_of
from twin.calibrate.prints.boards import cell_boxes
from twin.calibrate.prints.sheet import (
    RULER_STRIP_MM,
    Sheet,
    draw_ruler,
    new_sheet,
    page_for,
    pdf_pages,
    print_black,
    ruler_length_mm,
    write_text,
)
from twin.errors import ConfigError

LAST_TAG = 586
_CELLS = 8
"""Across the black square; the white margin is one more all around."""
_HEAD_MM = 14.0


def tags_pdf(ids: Sequence[int], size_m: float, page: str | None = None) -> bytes:
    """Print tags.

    Parameters
    ----------
    ids : sequence of int
    size_m : float
        Edge of the black square.
    page : str, optional
        A4 to A0. Default: the smallest that they fit on.

    Raises
    ------
    ConfigError
        If they do not fit.
    """
    return pdf_pages([_sheet(number, 1000.0 * size_m, page) for number in ids])


def ids_from_text(text: str) -> list[int]:
    """Read ``0-19`` or ``1,2,30-35``.

    Raises
    ------
    ConfigError
        If it is not that, or a tag is none of the family's.
    """
    ids: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        try:
            ids += range(int(first), int(last if dash else first) + 1)
        except ValueError:
            ids = []
            break
    if not ids or not set(ids) <= set(range(LAST_TAG + 1)):
        raise ConfigError(f"The tags are given as {text}: write ids of 0 to {LAST_TAG}, 0-19 or 1,2,30-35.")
    return list(dict.fromkeys(ids))


def official_tag(number: int) -> BoolArray:
    """Black cells (8, 8) of a tag with its border, top row first, as AprilTag's makers print it."""
    return np.pad(bits_of(dictionary_of(FAMILY), number) == 0, 1, constant_values=True)


def _sheet(number: int, size_mm: float, page: str | None) -> Sheet:
    cell = size_mm / _CELLS
    whole = size_mm + 2.0 * cell
    what = f"A tag of {size_mm:g} mm"
    sheet = new_sheet(*page_for(whole, whole + _HEAD_MM + RULER_STRIP_MM, page, what))
    left = 0.5 * (sheet.width_mm - size_mm)
    top = 0.5 * (sheet.height_mm - size_mm + _HEAD_MM - RULER_STRIP_MM)
    print_black(sheet, cell_boxes(official_tag(number), left, top, cell))
    write_text(sheet, left, top - cell - 0.5 * _HEAD_MM, f"▲ up    tag {number}", 6.0)
    foot = top + size_mm + cell
    draw_ruler(sheet, left, foot + 5.0, ruler_length_mm(size_mm))
    text = f"36h11, id {number}. Print at 100 %, then measure the black square: {size_mm:g} mm, both ways."
    write_text(sheet, left, foot + 13.0, text, min(2.8, size_mm / 45.0))
    return sheet
