"""Printed calibration boards: what ``--board`` says, how one is drawn, where its corners are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import ByteArray, FloatArray, IntArray
from geoloc.calibration.extrinsics.tag_family import dictionary_of
from twin.errors import ConfigError

if TYPE_CHECKING:
    from cv2.aruco import CharucoBoard


_FORMS = (
    "checkerboard:COLUMNSxROWS:SQUARE (inner corners, metres) or "
    "charuco:COLUMNSxROWS:SQUARE:MARKER[:DICTIONARY] (squares, metres)"
)
_DICTIONARY = "DICT_5X5_250"
_TEXELS_A_SQUARE = 40
_WHITE, _BLACK = 235, 25
"""Paper and ink reflect neither all nor nothing."""


@dataclass(frozen=True, slots=True)
class Board:
    """One board.

    Attributes
    ----------
    kind : str
        ``checkerboard`` or ``charuco``.
    columns, rows : int
        Inner corners.
    square_m, marker_m : float
        Sides; no markers are 0.
    dictionary : str
        Name in ``cv2.aruco``; empty without markers.
    """

    kind: str
    columns: int
    rows: int
    square_m: float
    marker_m: float = 0.0
    dictionary: str = ""

    @property
    def text(self) -> str:
        """As ``--board`` takes it."""
        if self.kind == "checkerboard":
            return f"checkerboard:{self.columns}x{self.rows}:{self.square_m:g}"
        size = f"{self.columns + 1}x{self.rows + 1}"
        return f"charuco:{size}:{self.square_m:g}:{self.marker_m:g}:{self.dictionary}"

    @property
    def n_corners(self) -> int:
        """Inner corners of the whole board."""
        return self.columns * self.rows

    @property
    def marker_cells(self) -> int:
        """Cells across a marker, its black border included."""
        return int(self.aruco().getDictionary().markerSize) + 2

    @property
    def clear_part(self) -> float:
        """Part of a square along an edge, to either side, that is of one colour: room for sub-pixels."""
        if self.kind == "checkerboard":
            return 0.5
        return 0.5 * (1.0 - self.marker_m / self.square_m)

    def corners_m(self, ids: IntArray) -> FloatArray:
        """Places (n, 2) of inner corners by number, row by row from the top left: x right, y down."""
        return np.asarray(self.square_m * (np.column_stack([ids % self.columns, ids // self.columns]) + 1.0))

    def aruco(self, turns: int = 0) -> CharucoBoard:
        """The ``cv2.aruco.CharucoBoard``, its markers turned by so many quarter turns."""
        import cv2

        dictionary = dictionary_of(self.dictionary, turns)
        size = (self.columns + 1, self.rows + 1)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, dictionary)

    def texture(self) -> tuple[ByteArray, tuple[float, float]]:
        """Grey values of the print with its white margin of half a square, and width and height in metres.

        The corner that `corners_m` counts from lies half a square inside the print's edges: see
        `texture_offset_m`.
        """
        size = ((self.columns + 1) * _TEXELS_A_SQUARE, (self.rows + 1) * _TEXELS_A_SQUARE)
        if self.kind == "charuco":
            ink = self.aruco().generateImage(size, marginSize=0)
        else:
            row, column = np.mgrid[0 : size[1], 0 : size[0]] // _TEXELS_A_SQUARE
            ink = np.where((row + column) % 2, 255, 0)
        ink = np.pad(ink, _TEXELS_A_SQUARE // 2, constant_values=255)
        grey = np.where(ink > 127, _WHITE, _BLACK).astype(np.uint8)
        return grey, ((self.columns + 2) * self.square_m, (self.rows + 2) * self.square_m)

    @property
    def texture_offset_m(self) -> float:
        """From the print's edges to the board's, both ways."""
        return 0.5 * self.square_m


def board_from_text(text: str) -> Board:
    """Read ``checkerboard:9x6:0.08`` or ``charuco:12x9:0.06:0.045:DICT_5X5_250``.

    Raises
    ------
    ConfigError
        Naming the part that is wrong.
    """
    kind, *parts = text.strip().split(":")
    counts = {"checkerboard": (2,), "charuco": (3, 4)}
    if len(parts) not in counts.get(kind, ()):
        raise ConfigError(f"The board is given as {text}: write {_FORMS}.")
    try:
        columns, rows = (int(part) for part in parts[0].lower().split("x"))
        square_m, *more = (float(part) for part in parts[1:3])
    except ValueError:
        raise ConfigError(
            f"The board is given as {text}, with a part that is no number: write {_FORMS}."
        ) from None
    if square_m <= 0.0 or square_m > 5.0:
        raise ConfigError(f"A square of {square_m:g} m cannot be: give its side in metres, 0.08 for 8 cm.")
    inner = 0 if kind == "checkerboard" else 1
    if min(columns, rows) - inner < 3:
        raise ConfigError(f"A board of {parts[0]} is too small: it needs at least 3 x 3 inner corners.")
    if kind == "checkerboard":
        return Board(kind, columns, rows, square_m)
    marker_m, dictionary = more[0], parts[3] if len(parts) == 4 else _DICTIONARY
    if not 0.0 < marker_m < square_m:
        raise ConfigError(
            f"Markers of {marker_m:g} m do not fit into squares of {square_m:g} m: give the square first."
        )
    _check_dictionary(dictionary, columns * rows // 2)
    return Board(kind, columns - 1, rows - 1, square_m, marker_m, dictionary)


def _check_dictionary(name: str, n_markers: int) -> None:
    import cv2

    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise ConfigError(
            f"There is no marker dictionary {name}: name one of OpenCV's, {_DICTIONARY} for one."
        )
    known = len(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)).bytesList)
    if known < n_markers:
        raise ConfigError(
            f"The board has {n_markers} markers, {name} only {known}: name the dictionary it was made with."
        )
