"""``layout.toml``: the AprilTags and boards around the car, and what was measured of them.

::

    size_m = 0.60             # edge of the black square, of every tag that says nothing else
    sigma_m = 0.003           # of measured places
    floor_sigma_m = 0.003     # how flat the floor is
    floor = [20, 21, 22]      # ids of tags that lie on the floor, and of which no more is known
    free = [30, 31]           # ids of tags that stand somewhere: they tie cameras together
    [[tag]]
    id = 1
    centre = [6.02, 1.48, 0.91]   # in the rig frame: x forward, y left, z up from the ground below the axle
    [[tag]]
    id = 2
    z = 0.85                  # only its height was measured
    size_m = 0.30
    sigma_m = 0.010
    [[board]]                 # a ChArUco board, described as `--board` of `calibrate intrinsics` does
    board = "charuco:12x9:0.10:0.075"
    floor = true
    top_left = [5.45, 0.60, 0.0]      # corners of the squares, seen as printed; of tags: of the black square
    top_right = [5.45, -0.60, 0.0]
    bottom_right = [4.55, -0.60, 0.0]
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics import Sigmas, Tag
from twin.calibrate.boards.boards import Board, board_from_text
from twin.errors import ConfigError, LayoutError

FIRST_BOARD = 1_000_000
"""Boards are targets with ids from here on: 36h11 has 587 tags."""
_LAST_TAG = 586
_KEYS = ("size_m", "sigma_m", "floor_sigma_m", "floor", "free", "tag", "board")
_CORNERS = ("top_left", "top_right", "bottom_right", "bottom_left")
_PLACE_KEYS = ("centre", "x", "y", "z", *_CORNERS, "sigma_m", "floor")
_TAG_KEYS = ("id", "size_m", *_PLACE_KEYS)
_BOARD_KEYS = ("board", *_PLACE_KEYS)
_SIGMA_M = 0.005
_FLOOR_SIGMA_M = 0.003
_FURTHEST_M = 200.0
_LARGEST_M = 5.0


@dataclass(frozen=True, slots=True)
class YardLayout:
    """What stands around the car.

    Attributes
    ----------
    tags : mapping of id to Tag
        Boards too, under their ids.
    boards : mapping of id to Board
    sigmas : Sigmas
    """

    tags: Mapping[int, Tag]
    boards: Mapping[int, Board]
    sigmas: Sigmas


def read_layout(content: bytes, where: str) -> YardLayout:
    """Read ``layout.toml``.

    Raises
    ------
    LayoutError
        If it is not TOML, has an unknown key, a value that cannot be, or a tag twice.
    """
    try:
        document = tomllib.loads(content.decode("utf-8-sig"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise LayoutError(f"{where} is not valid TOML ({error}): correct that line.") from error
    _refuse_unknown(document, _KEYS, where, "")
    size_m = _number(document, "size_m", where, _LARGEST_M, default=math.nan)
    sigma_m = _number(document, "sigma_m", where, 1.0, default=_SIGMA_M)
    tags: dict[int, Tag] = {}
    for key in ("floor", "free"):
        for number in _list(document, key, where):
            _add(tags, Tag(_id(number, where), size_m, on_floor=key == "floor"), where)
    for table in _tables(document, "tag", where):
        _refuse_unknown(table, _TAG_KEYS, where, "tag: ")
        _add(tags, _tag(table, size_m, sigma_m, where), where)
    boards = {}
    for number, table in enumerate(_tables(document, "board", where), FIRST_BOARD):
        _refuse_unknown(table, _BOARD_KEYS, where, "board: ")
        boards[number] = _board(table, where)
        _refuse_same_markers(boards, number, where)
        _add(tags, _board_tag(number, boards[number], table, sigma_m, where), where)
    if not tags:
        raise LayoutError(f"{where} names no tag: list them under [[tag]], floor or free.")
    floor_m = _number(document, "floor_sigma_m", where, 1.0, default=_FLOOR_SIGMA_M)
    return YardLayout(tags, boards, Sigmas(floor_m=floor_m))


def _add(tags: dict[int, Tag], tag: Tag, where: str) -> None:
    if not math.isfinite(tag.size_m):
        raise LayoutError(f"{where} gives tag {tag.id} no size: write size_m, the edge of the black square.")
    if tag.id in tags:
        raise LayoutError(f"{where} names tag {tag.id} twice: keep one of the two.")
    tags[tag.id] = tag


def _tag(table: Mapping[str, Any], size_m: float, sigma_m: float, where: str) -> Tag:
    own_m = _number(table, "size_m", where, _LARGEST_M, default=size_m)
    tag = Tag(id=_id(table.get("id"), where), size_m=own_m)
    return _placed(tag, (own_m, own_m), table, sigma_m, where)


def _placed(
    tag: Tag, size_m: tuple[float, float], table: Mapping[str, Any], sigma_m: float, where: str
) -> Tag:
    """The tag with what was measured of its middle and of its corners."""
    marks, places = [], []
    for name, corner in zip(_CORNERS, outline_m(*size_m), strict=True):
        if name in table:
            marks.append(corner)
            places.append(_three(table[name], name, where))
    return replace(
        tag,
        centre_m=_centre(table, where),
        centre_sigma_m=_number(table, "sigma_m", where, 1.0, default=sigma_m),
        on_floor=_flag(table, where),
        marks_m=np.array(marks).reshape(-1, 3),
        mark_places_m=np.array(places).reshape(-1, 3),
    )


def outline_m(width_m: float, height_m: float) -> FloatArray:
    """Corners (4, 3) of a flat target in its own frame: top left, top right, bottom right, bottom left."""
    half = np.array([width_m / 2.0, height_m / 2.0, 0.0])
    signs = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    return np.asarray(half * np.array(signs))


def board_size_m(board: Board) -> tuple[float, float]:
    """Width and height of a board's squares, without the margin of the print."""
    return board.square_m * (board.columns + 1), board.square_m * (board.rows + 1)


def _refuse_same_markers(boards: Mapping[int, Board], number: int, where: str) -> None:
    mine = boards[number]
    if any(board.dictionary == mine.dictionary for other, board in boards.items() if other != number):
        raise LayoutError(
            f"{where} has two boards with markers of {mine.dictionary}, which pictures cannot tell apart:"
            " print one of them from another dictionary, as of charuco:12x9:0.10:0.075:DICT_6X6_250."
        )


def _board(table: Mapping[str, Any], where: str) -> Board:
    text = table.get("board")
    if not isinstance(text, str) or not text.startswith("charuco:"):
        raise LayoutError(
            f'{where} gives board = {text!r}: describe the ChArUco board as "charuco:12x9:0.10:0.075",'
            " which has 12 by 9 squares of 0.10 m with markers of 0.075 m."
        )
    try:
        return board_from_text(text)
    except ConfigError as error:  # one of a command line elsewhere
        raise LayoutError(f"{where}: {error}") from error


def _board_tag(number: int, board: Board, table: Mapping[str, Any], sigma_m: float, where: str) -> Tag:
    size_m = board_size_m(board)
    tag = Tag(id=number, size_m=min(size_m), label=f"the board {board.text}")
    return _placed(tag, size_m, table, sigma_m, where)


def _centre(table: Mapping[str, Any], where: str) -> FloatArray:
    axes = ("x", "y", "z")
    if "centre" not in table:
        return np.array([_place(table.get(axis, math.nan), axis, where) for axis in axes])
    if any(axis in table for axis in axes):
        raise LayoutError(f"{where} gives a tag both centre and x, y or z: keep one of the two.")
    return _three(table["centre"], "centre", where)


def _three(value: object, key: str, where: str) -> FloatArray:
    if not isinstance(value, list) or len(value) != 3:
        raise LayoutError(
            f"{where} gives {key} = {value!r}: it must be [x, y, z] in metres; x, y, z alone stand for a"
            " middle of which only some were measured."
        )
    return np.array([_place(part, key, where) for part in value])


def _place(value: object, key: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > _FURTHEST_M:
        raise LayoutError(f"{where} gives {key} = {value!r}: it must be metres in the rig frame.")
    return float(value)


def _id(value: object, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _LAST_TAG:
        raise LayoutError(
            f"{where} gives the tag id {value!r}: ids of the family 36h11 are 0 to {_LAST_TAG}."
        )
    return value


def _number(
    table: Mapping[str, Any], key: str, where: str, most: float, *, default: float | None = None
) -> float:
    if key not in table and default is not None:
        return default
    value = table.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= most:
        raise LayoutError(f"{where} gives {key} = {value!r}: it must be metres, above 0 and up to {most:g}.")
    return float(value)


def _flag(table: Mapping[str, Any], where: str) -> bool:
    value = table.get("floor", False)
    if not isinstance(value, bool):
        raise LayoutError(f"{where} gives floor = {value!r}: it must be true or false.")
    return value


def _list(document: Mapping[str, Any], key: str, where: str) -> list[Any]:
    value = document.get(key, [])
    if not isinstance(value, list):
        raise LayoutError(f"{where} gives {key} = {value!r}: it must be a list of tag ids.")
    return value


def _tables(document: Mapping[str, Any], key: str, where: str) -> list[Mapping[str, Any]]:
    value = document.get(key, [])
    if not isinstance(value, list) or not all(isinstance(table, dict) for table in value):
        raise LayoutError(f"{where} gives {key} as {type(value).__name__}: write each one under [[{key}]].")
    return value


def _refuse_unknown(table: Mapping[str, Any], known: tuple[str, ...], where: str, what: str) -> None:
    for key in table:
        if key not in known:
            nearest = difflib.get_close_matches(key, known, n=1, cutoff=0.0)[0]
            raise LayoutError(f"{where} has the unknown key {what}{key}: the nearest known one is {nearest}.")
