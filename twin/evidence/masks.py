"""What of a crop is shown, and how coarsely: everything is decided here before anything is written.

Nothing inside the protected faces is changed. What a network called a person or a vehicle is hidden. Of the
rest, nothing is shown finer than a person could be recognised by: a network misses people, and without one
nobody has looked. The limits are pixels a metre, after EN 62676-4: 125 show who somebody is to those who know
him, 62.5 how he is dressed, 25 that somebody is there.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray

Image = NDArray[np.uint8]

HIDDEN_PX_PER_M, HIDDEN_FROM_M = 20.0, 3.0
"""What is hidden keeps less than shows that somebody is there, from 3 m before the camera on."""


@dataclass(frozen=True, slots=True)
class Limits:
    """How finely things may be shown where no person or vehicle was found.

    Attributes
    ----------
    rest_px_per_m, rest_from_m : float
        Of the surroundings: so many pixels a metre on somebody this far from the camera, fewer further off.
    window_px_per_m : float
        Where a face would be, on somebody as far off as the sign. Whoever stands nearer is shown finer, but
        would have to stand at less than a fifth, or half, of the distance to be recognised.
    is_grey : bool
        Whether the surroundings lose their colours.
    """

    rest_px_per_m: float
    rest_from_m: float
    window_px_per_m: float
    is_grey: bool


BY_GEOMETRY = Limits(HIDDEN_PX_PER_M, HIDDEN_FROM_M, 25.0, is_grey=True)
"""Nobody has looked for people."""
BY_NETWORK = Limits(62.5, 4.0, 62.5, is_grey=False)
"""A network has; it misses small ones, of which little is to be seen."""
_VEIL, _TINT = 0.8, (0, 4, 22)
_SMALLEST_CELL_PX = 2.0

RULES = hashlib.sha256(
    repr((HIDDEN_PX_PER_M, HIDDEN_FROM_M, asdict(BY_GEOMETRY), asdict(BY_NETWORK), _VEIL, _TINT)).encode()
).hexdigest()
"""Hash of the rules of this module, the version of the masker ``geometry``."""


@dataclass(frozen=True, slots=True)
class Regions:
    """Parts of a crop, each bool (rows, columns).

    Attributes
    ----------
    faces : protected
    window : where a face would be
    found : people and vehicles that a network found
    """

    faces: BoolArray
    window: BoolArray
    found: BoolArray


@dataclass(frozen=True, slots=True)
class Masked:
    """A masked crop, which part of it is what, and how large the squares are that were averaged over [px]."""

    image: Image
    hidden: BoolArray
    softened: BoolArray
    hidden_px: float
    softened_px: float
    window_px: float


def masked(image: Image, regions: Regions, limits: Limits, focal_px: float, px_per_m: float) -> Masked:
    """Mask a crop.

    Parameters
    ----------
    image : uint8 (rows, columns, 3)
        RGB, of the crop alone.
    regions : Regions
    limits : Limits
    focal_px : float
        Pixels a radian.
    px_per_m : float
        At the sign.

    Returns
    -------
    Masked
    """
    hidden_cell = _cell(focal_px, HIDDEN_PX_PER_M * HIDDEN_FROM_M)
    rest_cell = _cell(focal_px, limits.rest_px_per_m * limits.rest_from_m)
    window_cell = _cell(px_per_m, limits.window_px_per_m)
    rest = _averaged(image, rest_cell)
    shown = _greyed(rest) if limits.is_grey else _veiled(rest)
    hidden = regions.found & ~regions.faces
    window = regions.window & ~hidden & ~regions.faces
    if window.any():
        shown[window] = _veiled(_averaged(image, window_cell))[window]
    if hidden.any():
        shown[hidden] = _greyed(_averaged(image, hidden_cell))[hidden]
    shown[regions.faces] = image[regions.faces]
    softened = ~hidden & ~regions.faces
    if limits.is_grey:
        hidden, softened = ~regions.faces & ~window, window
    return Masked(shown, hidden, softened, hidden_cell, rest_cell, window_cell)


def filled(shape: tuple[int, int], polygons: Sequence[NDArray[np.float64]]) -> BoolArray:
    """Fill polygons, each (k, 2) in pixels of an image of that shape (rows, columns)."""
    import cv2

    mask = np.zeros(shape, np.uint8)
    for polygon in polygons:
        cv2.fillPoly(mask, [np.round(polygon * 16).astype(np.int32)], 1, lineType=cv2.LINE_8, shift=4)
    return np.asarray(mask.astype(bool))


def _cell(px_per_unit: float, most: float) -> float:
    """Side of a square that is averaged over so that no more than `most` of them go on a unit."""
    return max(px_per_unit / most, _SMALLEST_CELL_PX)


def _averaged(image: Image, cell_px: float) -> Image:
    """Average over squares, and join these smoothly: what was finer than they is gone."""
    import cv2

    rows, columns = image.shape[:2]
    small = (max(math.floor(columns / cell_px), 1), max(math.floor(rows / cell_px), 1))
    coarse = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _greyed(image: Image) -> Image:
    """Without colours, by which a car or a jacket is known; bluish, which tells what is masked."""
    grey = image.astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
    return np.asarray(np.round(0.6 * grey[..., None] + 60.0 + np.array(_TINT, np.float32)), dtype=np.uint8)


def _veiled(image: Image) -> Image:
    """A little paler, so that everybody sees what is not as it was."""
    return np.asarray(np.round(_VEIL * image.astype(np.float32) + 255 * (1 - _VEIL)), dtype=np.uint8)
