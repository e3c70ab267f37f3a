"""What a network takes and gives: letterboxed pictures in, boxes with classes and scores out.

The contract is that of the YOLO family as its tools export it (docs/detector.md): input 1 x 3 x rows x
columns, RGB, 0 to 1; output one of

- ``(1, 4 + classes, n)``: centre x, centre y, width, height, a score for each class (YOLOv8, YOLO11);
- ``(1, n, 5 + classes)``: the same with objectness before the scores of the classes (YOLOv5, YOLOv7);
- ``(1, n, 6)``: left, top, right, bottom, score, class, after non-maximum suppression (YOLOv10, YOLO26).

All in pixels of the input, counted from the corner of its first pixel.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from twin.errors import DriveError

GREY = 114
"""What the family's own letterboxing fills the rest of the input with."""
OVERLAP = 0.5
"""Two boxes that share more of their union are one sign: faces of signs do not hide one another by half."""
MOST_CANDIDATES = 3000
"""Boxes that suppression looks at, the best first: it compares all with all."""
SMALLEST_PX = 3.0
"""A smaller box says nothing about the sign, nor much about where its middle is."""
_EDGE_PX = 1.0
_CORNER_TO_CENTRE_PX = 0.5
_MOST_CLASSES = 1e6
_MANY_BOXES = 1000
"""Suppressed output has some hundred rows; a YOLOv5 head of one class, six columns too, has thousands."""


class Letterbox(NamedTuple):
    """How a picture was fitted into the input: ``input = picture * scale + pad``, from corner to corner."""

    scale: tuple[float, float]
    pad: tuple[int, int]


class Detections(NamedTuple):
    """Boxes in one picture.

    Attributes
    ----------
    box_px : float64 (n, 4)
        left, top, right, bottom; (0, 0) is the centre of the first pixel.
    score : float64 (n,)
        0 to 1.
    class_index : int64 (n,)
    """

    box_px: FloatArray
    score: FloatArray
    class_index: IntArray


def letterboxed(
    image: NDArray[np.uint8], width_px: int, height_px: int
) -> tuple[NDArray[np.float32], Letterbox]:
    """Fit a picture into the input, keeping its shape, with grey around it.

    Parameters
    ----------
    image : uint8 (rows, columns, 3)
        RGB.
    width_px, height_px : int
        Of the input.

    Returns
    -------
    float32 (1, 3, height_px, width_px)
        0 to 1.
    Letterbox
    """
    import cv2

    rows, columns = image.shape[:2]
    ratio = min(width_px / columns, height_px / rows)
    width, height = max(round(columns * ratio), 1), max(round(rows * ratio), 1)
    method = cv2.INTER_AREA if ratio < 1.0 else cv2.INTER_LINEAR
    left, top = (width_px - width) // 2, (height_px - height) // 2
    filled = np.full((height_px, width_px, 3), GREY, dtype=np.uint8)
    filled[top : top + height, left : left + width] = cv2.resize(image, (width, height), interpolation=method)
    blob = np.ascontiguousarray(filled.transpose(2, 0, 1)[None], dtype=np.float32) / np.float32(255.0)
    return blob, Letterbox((width / columns, height / rows), (left, top))


def candidates(output: NDArray[np.float32], n_classes: int | None, where: str) -> Detections:
    """Read a network's output: boxes in pixels of the input, from its corner, before suppression.

    Parameters
    ----------
    output : float32
        One of the forms of the module's text.
    n_classes : int or None
        As the class names say; None where there are none.
    where : str
        The network's file, for messages.

    Raises
    ------
    DriveError
        If the output has none of these forms, or another number of classes than names.
    """
    form = _form(output.shape, n_classes)
    if not form:
        classes = f", for {n_classes} classes" if n_classes is not None else ""
        raise DriveError(
            f"{where} gives an output of shape {tuple(output.shape)}{classes}: it must be (1, 4 + classes,"
            " n), (1, n, 5 + classes) or (1, n, 6), as `twin help detector` says. Export it as detector, with"
            " the names of its own classes."
        )
    # Infinities become NaN, whose sums and products are NaN again and no warning: no score, so no box.
    rows = np.where(np.isfinite(output[0]), output[0], np.nan).astype(np.float64)
    if form == "boxes":
        kind = np.where(np.abs(rows[:, 5]) < _MOST_CLASSES, rows[:, 5], -1.0)
        return Detections(rows[:, :4], rows[:, 4], kind.astype(np.int64))
    rows = rows.T if form == "columns" else rows
    scores = rows[:, 4:] if form == "columns" else rows[:, 5:] * rows[:, 4:5]
    best = np.argmax(scores, axis=1) if len(scores) else np.empty(0, np.int64)
    centre, half = rows[:, :2], rows[:, 2:4] / 2.0
    box = np.concatenate([centre - half, centre + half], axis=1)
    return Detections(box, scores[np.arange(len(scores)), best], best.astype(np.int64))


def _form(shape: tuple[int, ...], n_classes: int | None) -> str:
    """``columns`` (YOLOv8), ``rows`` (YOLOv5), ``boxes`` (suppressed), or "" for none of them."""
    if len(shape) != 3 or shape[0] != 1:
        return ""
    _, first, second = shape
    if n_classes is not None and first == 4 + n_classes and (second != 5 + n_classes or first < second):
        return "columns"
    if second == 6 and first <= _MANY_BOXES:
        return "boxes"
    if n_classes is None:
        if 5 <= first < second:
            return "columns"
        return "rows" if second >= 6 else ""
    return "rows" if second == 5 + n_classes else ""


def kept(
    found: Detections,
    letterbox: Letterbox,
    size_px: tuple[int, int],
    threshold: float,
    faults: Counter[str],
) -> Detections:
    """Suppress what is weak or found twice, and bring the rest into pixels of the picture.

    Classes do not matter for suppression: one face of a sign is one box, whatever it is called.

    Parameters
    ----------
    found : Detections
        Of `candidates`.
    letterbox : Letterbox
    size_px : (width, height)
        Of the picture.
    threshold : float
        Lowest score that counts.
    faults : Counter
        Gets the reasons why boxes with a sufficient score were left out.

    Returns
    -------
    Detections
        Best first.
    """
    import cv2

    with np.errstate(invalid="ignore"):
        strong = np.flatnonzero((found.score >= threshold) & (found.score <= 1.0 + 1e-3))
    finite = np.all(np.abs(np.nan_to_num(found.box_px[strong], nan=np.inf)) < 1e6, axis=1)
    faults["box that is no box"] += int(np.count_nonzero(~finite))
    strong = strong[finite]
    strong = strong[np.argsort(-found.score[strong], kind="stable")][:MOST_CANDIDATES]
    box, score = found.box_px[strong], found.score[strong]
    if strong.size:
        corner_size = np.concatenate([box[:, :2], box[:, 2:] - box[:, :2]], axis=1)
        chosen = cv2.dnn.NMSBoxes(corner_size.tolist(), score.tolist(), threshold, OVERLAP)
        strong = strong[np.sort(np.asarray(chosen, dtype=np.int64).reshape(-1))]
    image_box = _in_picture(found.box_px[strong], letterbox)
    usable = _usable(image_box, size_px, faults)
    chosen_rows = strong[usable]
    return Detections(image_box[usable], found.score[chosen_rows], found.class_index[chosen_rows])


def strong(found: Detections, letterbox: Letterbox, threshold: float) -> Detections:
    """Every box of `candidates` with a sufficient score, in pixels of the picture; nothing is suppressed."""
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero((found.score >= threshold) & np.isfinite(found.box_px).all(axis=1))
    return Detections(_in_picture(found.box_px[rows], letterbox), found.score[rows], found.class_index[rows])


def _in_picture(box: FloatArray, letterbox: Letterbox) -> FloatArray:
    """Pixels of the input, from its corner → pixels of the picture, from the centre of its first pixel."""
    pad = np.array(letterbox.pad * 2, dtype=np.float64)
    scale = np.array(letterbox.scale * 2, dtype=np.float64)
    return (box - pad) / scale - _CORNER_TO_CENTRE_PX


def _usable(box: FloatArray, size_px: tuple[int, int], faults: Counter[str]) -> NDArray[np.bool_]:
    """Leave out boxes that are too small, or cut by the picture's edge: their middle is not the sign's."""
    right, bottom = (size - _CORNER_TO_CENTRE_PX for size in size_px)
    small = np.any(box[:, 2:] - box[:, :2] < SMALLEST_PX, axis=1)
    inside = (box[:, :2] > -_CORNER_TO_CENTRE_PX + _EDGE_PX).all(axis=1)
    inside &= (box[:, 2] < right - _EDGE_PX) & (box[:, 3] < bottom - _EDGE_PX)
    faults[f"box smaller than {SMALLEST_PX:g} px"] += int(np.count_nonzero(small))
    faults["box cut by the edge of the picture"] += int(np.count_nonzero(~inside & ~small))
    usable: NDArray[np.bool_] = inside & ~small
    return usable
