"""People and vehicles in a picture, by a network of the contract of ``docs/detector.md``."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from twin.drives.detection.network import Detector
from twin.errors import ConfigError
from twin.evidence.crops import Box

PEOPLE_AND_VEHICLES = frozenset(
    {
        *("person", "pedestrian", "rider", "cyclist", "face", "licence plate", "license plate"),
        *("bicycle", "motorcycle", "motorbike", "car", "truck", "lorry", "bus", "van", "train", "trailer"),
        *("vehicle", "caravan", "tractor"),
    }
)
"""Classes that are masked: people, and vehicles as a whole, as Statens vegvesen masks them."""
THRESHOLD = 0.1
"""Lowest score: a box too many costs nothing, one too few shows somebody."""
_MARGIN, _LEAST_MARGIN_PX = 0.1, 4.0


class Found(NamedTuple):
    """Boxes with their margin, in pixels of the frame, and what each was called."""

    boxes_px: tuple[Box, ...]
    labels: tuple[str, ...]


class Masker(Protocol):
    """What finds people and vehicles."""

    @property
    def name(self) -> str:
        """For the proof."""

    @property
    def version(self) -> str:
        """SHA-256 of what it is made of."""

    def find(self, image: NDArray[np.uint8], region: tuple[int, int, int, int]) -> Found:
        """Find them in a frame, and once more in that region of it (left, top, right, bottom)."""


class NetworkMasker:
    """A network that finds people and vehicles.

    Parameters
    ----------
    path : Path
        ONNX file; the names of its classes must be among those of COCO.

    Raises
    ------
    MissingExtraError
        The extra `detect` is not installed.
    ConfigError
        No class of the network is a person or a vehicle.
    DriveError
        The file cannot be read, or is no network of the contract.
    """

    def __init__(self, path: Path) -> None:
        self._detector = Detector(path)
        self.name, self.version = path.name, self._detector.sha256
        named = {name.strip().lower() for name in self._detector.names}
        if not named & PEOPLE_AND_VEHICLES:
            raise ConfigError(
                f"No class of {path.name} is a person or a vehicle (its classes:"
                f" {', '.join(sorted(named)[:8]) or 'none are named'}): give a network with the classes of"
                " COCO, or put their names beside it as `twin help detector` says."
            )
        # What does not fit is found before hours of video are decoded.
        self._detector.find_all(np.zeros((64, 96, 3), dtype=np.uint8), THRESHOLD)

    def find(self, image: NDArray[np.uint8], region: tuple[int, int, int, int]) -> Found:
        """Find them in the whole frame, which has large ones whole, and in the region, for small ones."""
        rows, columns = image.shape[:2]
        boxes: list[Box] = []
        labels: list[str] = []
        for left, top, right, low in {(0, 0, columns, rows), region}:
            found = self._detector.find_all(image[top:low, left:right], THRESHOLD)
            for box, index in zip(found.box_px.tolist(), found.class_index.tolist(), strict=True):
                label = self._detector.name_of(index).lower()
                if label in PEOPLE_AND_VEHICLES:
                    boxes.append(_wider(box, left, top))
                    labels.append(label)
        order = sorted(range(len(boxes)), key=lambda k: (boxes[k], labels[k]))
        return Found(tuple(boxes[k] for k in order), tuple(labels[k] for k in order))


def _wider(box: list[float], left: int, top: int) -> Box:
    """With a margin: boxes cut off hands, mirrors and shadows of number plates."""
    x0, y0, x1, y1 = box
    dx, dy = (max(_MARGIN * size, _LEAST_MARGIN_PX) for size in (x1 - x0, y1 - y0))
    return (
        round(x0 - dx + left, 1),
        round(y0 - dy + top, 1),
        round(x1 + dx + left, 1),
        round(y1 + dy + top, 1),
    )
