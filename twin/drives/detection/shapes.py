"""Boxes of consecutive pictures → tracks → shapes, as if a person had drawn them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from twin.drives.annotations.formats.shapes import AnnotationFile, Shape
from twin.drives.detection.tracker import tracks
from twin.drives.detection.yolo_output import Detections

TOOL = "detector"


class Looked(NamedTuple):
    """What was found in one picture.

    Attributes
    ----------
    frame : int
    epoch_ns : int
    found : Detections
    """

    frame: int
    epoch_ns: int
    found: Detections


def annotation_file(
    pictures: Sequence[Looked], name_of: Callable[[int], str], where: str
) -> tuple[AnnotationFile, int]:
    """Link the boxes of one camera, and write them down as an annotation tool would.

    Parameters
    ----------
    pictures : sequence of Looked
        In order of time.
    name_of : callable
        Name of a class by its index.
    where : str
        What the file is called in messages.

    Returns
    -------
    AnnotationFile
        Tracks ``d1``, ``d2``, …; all boxes of a track have the class that most of its score says.
    n_left_out : int
        Boxes that belong to no track.
    """
    track = tracks([p.epoch_ns for p in pictures], [p.found for p in pictures])
    frame = np.repeat([p.frame for p in pictures], [len(p.found.score) for p in pictures])
    every = [p.found for p in pictures] or [Detections(np.empty((0, 4)), np.empty(0), np.empty(0, np.int64))]
    boxes = Detections(*(np.concatenate(parts) for parts in zip(*every, strict=True)))
    shapes: list[Shape] = []
    for number in range(int(track.max(initial=-1)) + 1):
        rows = np.flatnonzero(track == number)
        classes, which = np.unique(boxes.class_index[rows], return_inverse=True)
        best = int(classes[np.argmax(np.bincount(which, weights=boxes.score[rows]))])
        shapes += _shapes(frame[rows].tolist(), boxes.box_px[rows].tolist(), f"d{number + 1}", name_of(best))
    return AnnotationFile(where, TOOL, shapes), int(np.count_nonzero(track < 0))


def _shapes(frames: list[int], boxes: list[list[float]], track: str, label: str) -> Iterator[Shape]:
    for frame, (left, top, right, bottom) in zip(frames, boxes, strict=True):
        middle = ((left + right) / 2.0, (top + bottom) / 2.0)
        yield Shape("box", middle, (left, top, right, bottom), label=label, track=track, frame=frame)
