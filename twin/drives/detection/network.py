"""An ONNX network, run by ONNX's own runtime on this machine."""

from __future__ import annotations

import ast
import hashlib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.drives.detection.yolo_output import (
    Detections,
    Letterbox,
    candidates,
    kept,
    letterboxed,
    strong,
)
from twin.errors import DriveError, MissingExtraError

DEFAULT_SIZE_PX = 640
"""Input of a network that leaves its size open: the family's own default."""
LARGEST_SIDE_PX = 4096
MAX_MODEL_BYTES = 2_000_000_000
"""Protocol Buffers end at 2 GiB."""
_LONGEST_TEXT = 1_000_000
_ONLY_FATAL = 4
"""Of the runtime's own messages on stderr; what goes wrong is raised as well."""


class Detector:
    """A network that finds signs in a picture.

    Parameters
    ----------
    path : Path
        The ONNX file. Beside it, ``<name>.names`` may name the classes, one a line, where the file does not.

    Attributes
    ----------
    input_px : (width, height)
        What pictures are fitted into.
    names : tuple of str
        Classes by index; empty where nobody names them.
    sha256 : str
        Over the file.

    Raises
    ------
    MissingExtraError
        If the extra `detect` is not installed.
    DriveError
        If the file cannot be read, or is no network of the contract.
    """

    def __init__(self, path: Path) -> None:
        content = _content(path)
        self.where = path.name
        self._session = _session(content, self.where)
        said = _said(self._session)
        network_input = self._session.get_inputs()[0] if self._session.get_inputs() else None
        self._input = network_input.name if network_input else ""
        self.input_px = _input_size(network_input, said, self.where)
        self.names = _class_names(said.get("names", "")) or _names_beside(path)
        self.sha256 = hashlib.sha256(content).hexdigest()

    def name_of(self, class_index: int) -> str:
        """Name of a class; ``class 7`` where it has none."""
        is_named = 0 <= class_index < len(self.names)
        return (
            self.names[class_index].strip() or f"class {class_index}" if is_named else f"class {class_index}"
        )

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
        boxes, letterbox = self._run(image)
        rows, columns = image.shape[:2]
        return kept(boxes, letterbox, (columns, rows), threshold, faults)

    def find_all(self, image: NDArray[np.uint8], threshold: float) -> Detections:
        """As `find`, with boxes that are small, overlap others or are cut by the edge of the picture.

        Where something must not be overlooked, no box is one too many.
        """
        boxes, letterbox = self._run(image)
        return strong(boxes, letterbox, threshold)

    def _run(self, image: NDArray[np.uint8]) -> tuple[Detections, Letterbox]:
        blob, letterbox = letterboxed(image, *self.input_px)
        try:
            output = self._session.run(None, {self._input: blob})[0]
        except Exception as error:  # the runtime's own, which have no common base
            raise DriveError(
                f"{self.where} cannot be run on pictures of {self.input_px[0]} x {self.input_px[1]} pixels"
                f" ({_first_line(error)}): export it with a fixed input size."
            ) from error
        return candidates(_floats(output, self.where), len(self.names) or None, self.where), letterbox


def _content(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_MODEL_BYTES:
            raise DriveError(f"{path} is larger than 2 GB: no ONNX file is; check that it is the right one.")
        return path.read_bytes()
    except OSError as error:
        raise DriveError(
            f"The detector {path} cannot be read ({error.strerror}): name an ONNX file."
        ) from error


def _session(content: bytes, where: str) -> Any:
    """Load a network; the file's bytes are all that is read of it."""
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingExtraError(f"The detector {where}", "ONNX's runtime", "detect") from error
    options = onnxruntime.SessionOptions()
    options.log_severity_level = _ONLY_FATAL
    try:
        return onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"], enable_fallback=0
        )
    except Exception as error:  # the runtime's own, which have no common base
        raise DriveError(
            f"{where} is not an ONNX model that can be run ({_first_line(error)}): export the network again,"
            " as ONNX."
        ) from error


def _said(session: Any) -> Mapping[str, str]:
    """What the file says of the network, as Ultralytics writes it; nothing where that is no text."""
    try:
        metadata: Mapping[str, str] = session.get_modelmeta().custom_metadata_map
    except UnicodeDecodeError:
        return {}
    return metadata


def _input_size(network_input: Any, said: Mapping[str, str], where: str) -> tuple[int, int]:
    """Width and height of the input: what is open is what the network was trained on, ``imgsz``."""
    shape = tuple(size if isinstance(size, int) else 0 for size in getattr(network_input, "shape", ()))
    is_float32 = getattr(network_input, "type", "") == "tensor(float)"
    fits = len(shape) == 4 and shape[0] in (0, 1) and shape[1] in (0, 3) and is_float32
    height, width = shape[2:] if len(shape) == 4 else (0, 0)
    trained = _numbers(said.get("imgsz", ""))
    if len(trained) == 2:
        height, width = height or trained[0], width or trained[1]
    if not fits or max(width, height) > LARGEST_SIDE_PX:
        raise DriveError(
            f"The input of {where} has the shape {shape}: it must be (1, 3, rows, columns) of 32-bit"
            " floats with rows and columns up to 4096, as `twin help detector` says. Export it again for one"
            " picture at a time."
        )
    return width or DEFAULT_SIZE_PX, height or DEFAULT_SIZE_PX


def _floats(output: object, where: str) -> NDArray[np.float32]:
    try:
        return np.asarray(output, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise DriveError(f"{where} gives no numbers: export it as detector.") from error


def _class_names(text: str) -> tuple[str, ...]:
    """``{0: 'stop', 1: 'yield'}`` or ``['stop', 'yield']`` → names by index."""
    value = _literal(text)
    if isinstance(value, dict):
        keys = [key for key in value if isinstance(key, int)]
        if sorted(keys) != list(range(len(value))):
            return ()
        value = [value[key] for key in range(len(value))]
    return tuple(str(name) for name in value) if isinstance(value, list | tuple) else ()


def _numbers(text: str) -> tuple[int, ...]:
    """``[320, 640]`` → rows and columns; empty for what is no list of whole numbers above 0."""
    value = _literal(text)
    numbers = tuple(value) if isinstance(value, list | tuple) else ()
    return numbers if all(type(number) is int and number > 0 for number in numbers) else ()


def _literal(text: str) -> Any:
    """A Python literal, as Ultralytics writes its metadata; None for what is none."""
    try:
        return ast.literal_eval(text[:_LONGEST_TEXT])
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return None


def _names_beside(path: Path) -> tuple[str, ...]:
    try:
        text = path.with_suffix(".names").read_bytes()[:1_000_000].decode("utf-8-sig", errors="replace")
    except OSError:
        return ()
    return tuple(line.strip() for line in text.splitlines() if line.strip())


def _first_line(error: Exception) -> str:
    """What the runtime says, without its own codes and the place in its source."""
    text = (str(error).strip().splitlines() or ["no reason given"])[0]
    return text.rpartition(" : ")[2][:160]
