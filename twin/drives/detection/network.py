"""An ONNX network, run by OpenCV on this machine."""

from __future__ import annotations

import hashlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.drives.detection.onnx_header import OnnxHeader, read_onnx_header
from twin.drives.detection.yolo_output import Detections, candidates, kept, letterboxed
from twin.errors import DriveError

DEFAULT_SIZE_PX = 640
"""Input of a network that leaves its size open: the family's own default."""
LARGEST_SIDE_PX = 4096
MAX_MODEL_BYTES = 2_000_000_000
"""Protocol Buffers end at 2 GiB."""


class Detector:
    """A network that finds signs in a picture.

    Parameters
    ----------
    path : Path
        The ONNX file. Beside it, ``<name>.names`` may name the classes, one a line, where the file does not.

    Attributes
    ----------
    names : tuple of str
        Classes by index; empty where nobody names them.
    sha256 : str
        Over the file.

    Raises
    ------
    DriveError
        If the file cannot be read, or is no network of the contract.
    """

    def __init__(self, path: Path) -> None:
        content = _content(path)
        self.where = path.name
        header = read_onnx_header(content, self.where)
        self._width_px, self._height_px = _input_size(header, self.where)
        self.names = header.names or _names_beside(path)
        self.sha256 = hashlib.sha256(content).hexdigest()
        self._network = _network(content, self.where)

    def name_of(self, class_index: int) -> str:
        """Name of a class; ``class 7`` where it has none."""
        known = 0 <= class_index < len(self.names)
        return self.names[class_index].strip() or f"class {class_index}" if known else f"class {class_index}"

    def find(self, image: NDArray[np.uint8], threshold: float, faults: Counter[str]) -> Detections:
        """Find signs in one picture.

        Parameters
        ----------
        image : uint8 (rows, columns, 3)
            RGB.
        threshold : float
            Lowest score that counts.
        faults : Counter
            Gets the reasons why boxes were left out.

        Raises
        ------
        DriveError
            If the network cannot be run, or its output is not of the contract.
        """
        import cv2

        blob, letterbox = letterboxed(image, self._width_px, self._height_px)
        try:
            self._network.setInput(blob)
            output = self._network.forward()
        except cv2.error as error:
            raise DriveError(
                f"{self.where} cannot be run on pictures of {self._width_px} x {self._height_px} pixels"
                f" ({_first_line(error)}): export it with a fixed input size, opset 17 or older."
            ) from error
        found = candidates(np.asarray(output, dtype=np.float32), len(self.names) or None, self.where)
        rows, columns = image.shape[:2]
        return kept(found, letterbox, (columns, rows), threshold, faults)


def _content(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_MODEL_BYTES:
            raise DriveError(f"{path} is larger than 2 GB: no ONNX file is; check that it is the right one.")
        return path.read_bytes()
    except OSError as error:
        raise DriveError(
            f"The detector {path} cannot be read ({error.strerror}): name an ONNX file."
        ) from error


def _input_size(header: OnnxHeader, where: str) -> tuple[int, int]:
    """Width and height of the input."""
    shape = header.shape
    fits = len(shape) == 4 and shape[0] in (0, 1) and shape[1] in (0, 3) and header.is_float32
    height, width = shape[2:] if len(shape) == 4 else (0, 0)
    if not fits or max(width, height) > LARGEST_SIDE_PX:
        raise DriveError(
            f"The input of {where} has the shape {shape}: it must be (1, 3, rows, columns) of 32-bit"
            " floats with rows and columns up to 4096, as docs/detector.md says. Export it again for one"
            " picture at a time."
        )
    return width or DEFAULT_SIZE_PX, height or DEFAULT_SIZE_PX


def _names_beside(path: Path) -> tuple[str, ...]:
    try:
        text = path.with_suffix(".names").read_bytes()[:1_000_000].decode("utf-8-sig", errors="replace")
    except OSError:
        return ()
    return tuple(line.strip() for line in text.splitlines() if line.strip())


def _network(content: bytes, where: str) -> Any:
    import cv2

    try:
        return cv2.dnn.readNetFromONNX(np.frombuffer(content, dtype=np.uint8))
    except cv2.error as error:
        raise DriveError(
            f"{where} holds a network that OpenCV cannot run ({_first_line(error)}): export it again with"
            " opset 17 or older."
        ) from error


def _first_line(error: Exception) -> str:
    """What OpenCV says, without the place in its source."""
    text = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
    return text.rpartition("error: ")[2][:160]
