"""Annotations as a plain CSV, for tools that twin does not know.

One point or box a row, with a header: ``frame`` or ``image``; ``x_px,y_px`` for a foot,
``left_px,top_px,right_px, bottom_px`` for a face, or both; ``label``; and, as one likes, ``camera``,
``track`` and attributes of any name (``skiltnummer``, ``object``). Pixels count from the corner of the
first pixel, as annotation tools count. Any CSV that a spreadsheet saves is read (:mod:`twin.tables`).
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    Shape,
    UnusableShapeError,
    box_at,
    foot_at,
    numbers,
)
from twin.errors import DriveError
from twin.tables import NotTextError, Table, header_of

TOOL = "CSV"
FOOT = ("x_px", "y_px")
BOX = ("left_px", "top_px", "right_px", "bottom_px")
_KNOWN = ("frame", "image", "camera", "track", "label", *FOOT, *BOX)
_NUMBERS = (*FOOT, *BOX)
_NO_ANNOTATIONS = {"latitude_deg", "latitude", "time_ns"}
_LARGEST_FRAME = 2**62
_SHIFTED = "more cells than the header"
_SHIFTED_CURE = "put texts that hold a comma or semicolon in quotation marks"
_SEMICOLONS = "separated by semicolons, but the header by commas"
_SEMICOLONS_CURE = "write semicolons in the header too, and points in its numbers (1107.61)"


def looks_like_annotations_csv(head: bytes) -> bool:
    """Whether the beginning of a file is the header of an annotation table."""
    names = set(header_of(head))
    return bool(names & {"frame", "image"}) and (names.issuperset(FOOT) or names.issuperset(BOX))


def lacking(head: bytes) -> str:
    """Which columns a table lacks that is nearly one of annotations; "" where it is far from one."""
    names = header_of(head)
    if len(names) < 3 or looks_like_annotations_csv(head) or _NO_ANNOTATIONS & set(names):
        return ""
    begun = {re.split(r"[^a-z]", name.casefold())[0] for name in names}
    is_placed = any(
        initials <= begun for initials in ({"x", "y"}, {"u", "v"}, {"left", "top"}, {"xmin", "ymin"})
    )
    if not is_placed:
        return ""
    wanted = [] if {"frame", "image"} & set(names) else ["frame or image"]
    columns = BOX if {"left", "xmin"} & begun else FOOT
    wanted += [column for column in columns if column not in names]
    return f"has the columns {', '.join(names)[:120]}, and lacks {', '.join(wanted)}"


def read_annotations_csv(content: bytes, where: str, _hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read a table of annotations.

    Raises
    ------
    DriveError
        If it is no table, or its header lacks a column.
    """
    file = AnnotationFile(where, TOOL)
    try:
        for row in _rows(content, where, file):
            camera = row.pop("camera", "")
            if camera:
                file.tasks[camera] = (camera,)
            with file.counting():
                file.shapes += _shapes(row, camera)
    except csv.Error as error:
        raise DriveError(f"{where} is not CSV ({error}): export it again.") from error
    return file


def _rows(content: bytes, where: str, file: AnnotationFile) -> Iterator[dict[str, str]]:
    """Yield each row by the names of its columns; rows that do not fit them are left out.

    Raises
    ------
    DriveError
        If those are more than half.
    """
    table = _table(content, where)
    header, delimiter = table.header, table.delimiter
    n_rows, faulty = 0, ""
    misplaced: Counter[str] = Counter()
    for cells in table:
        row = {name: cell.strip() for name, cell in zip(header, cells, strict=False) if name}
        if not any(row.values()):
            continue
        n_rows += 1
        fault = _fault(cells, len(header), delimiter)
        if not fault:
            yield row | {name: table.plain(row[name]) for name in _NUMBERS if row.get(name)}
            continue
        line = delimiter.join(cells)
        faulty = faulty or f"line {table.line} ({line!r:.100}) has {len(cells)} cells, the header"
        misplaced[fault] += 1
        file.leave_out(UnusableShapeError(fault, line))
    if 2 * misplaced.total() > n_rows:
        cure = _SHIFTED_CURE if misplaced[_SHIFTED] else _SEMICOLONS_CURE
        raise DriveError(f"{where}: {faulty} {len(header)}, and so with more than half of its rows: {cure}.")


def _table(content: bytes, where: str) -> Table:
    try:
        table = Table(content)
    except NotTextError as error:
        raise DriveError(f"{where} is not text ({error}): export it again as CSV.") from error
    if not looks_like_annotations_csv(content[:65_536]):
        columns = table.delimiter.join(table.header)
        raise DriveError(
            f"{where} has the columns {columns!r:.200}: it needs frame or image,"
            f" and {','.join(FOOT)} or {','.join(BOX)}."
        )
    return table


def _fault(cells: Sequence[str], n_columns: int, delimiter: str) -> str:
    """Why the cells of a row do not stand below their columns; "" if they do."""
    if any(cell.strip() for cell in cells[n_columns:]):
        return _SHIFTED
    is_other = delimiter == "," and len(cells) < n_columns and ";" in "".join(cells)
    return _SEMICOLONS if is_other else ""


def _shapes(row: Mapping[str, str], camera: str) -> list[Shape]:
    """Return the foot, the face, or both of a row."""
    frame = _frame(row)
    shapes = []
    for columns, shape_at in ((FOOT, foot_at), (BOX, box_at)):
        cells = [row.get(name, "") for name in columns]
        if "," in "".join(cells):
            raise UnusableShapeError("decimal comma: write a point", " ".join(cells))
        if any(cells):
            shapes.append(shape_at(*numbers(*cells)))
    if not shapes:
        raise UnusableShapeError("neither point nor box")
    attributes = {name: cell for name, cell in row.items() if name not in _KNOWN}
    label, track, image = (row.get(name, "") for name in ("label", "track", "image"))
    return [
        replace(shape, label=label, attributes=attributes, track=track, frame=frame, image=image, task=camera)
        for shape in shapes
    ]


def _frame(row: Mapping[str, str]) -> int | None:
    frame = row.get("frame", "")
    if not frame and not row.get("image", ""):
        raise UnusableShapeError("neither frame nor image")
    if not frame:
        return None
    if not (frame.isascii() and frame.isdigit() and len(frame) <= 19 and int(frame) < _LARGEST_FRAME):
        raise UnusableShapeError("frame number unreadable", frame)
    return int(frame)
