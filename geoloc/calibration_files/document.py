"""The text of a calibration file: YAML and JSON of strangers, and the numbers in them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.cameras import CameraModel
from geoloc.errors import CalibrationError

MAX_BYTES = 4_000_000
"""Longest calibration file: a rig with a car mask for each of its cameras stays below it."""
MAX_YAML_BYTES = 1_000_000
"""Longest in YAML, which takes seconds a megabyte: one with the corners of a hundred views stays below it."""
_HEAD_BYTES = 4096
_MOST_NUMBERS = 64
_DEEPEST = 3
_LONGEST_SIDE_PX = 1_000_000
# A rotation in a file has its digits cut; more than this is no rotation.
_ROTATION_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class CalibratedCamera:
    """One camera of a calibration file.

    Attributes
    ----------
    model : CameraModel
    camera_T_body : float64 (4, 4) or None
        Turns points of `body` into the camera's frame (RDF), metres; None where the file does not say.
    body : str
        What the pose is against: ``imu``, mrcal's ``ref``, or the name of the file's first camera. "" without
        a pose.
    warning : str
        One sentence where the file leaves open how it is meant; else "".
    """

    model: CameraModel
    camera_T_body: NDArray[np.float64] | None = None
    body: str = ""
    warning: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """Keys and values of one camera, and what an error message needs to name it."""

    values: Mapping[str, Any]
    where: str

    def error(self, what: str) -> CalibrationError:
        """Build the error that says what is wrong with this camera."""
        return CalibrationError(f"{self.where} {what}")

    def text(self, key: str) -> str:
        """One value as a text; "" where there is none."""
        value = self.values.get(key)
        return str(value).strip()[:200] if isinstance(value, str | int | float) else ""

    def numbers(self, key: str, *counts: int) -> tuple[float, ...]:
        """All numbers of a value, of nested lists row by row; as many as one of `counts`, if given."""
        if key not in self.values:
            raise self.error(f"has no {key}: export the calibration with it.")
        try:
            numbers = tuple(_flat(self.values[key]))
        except (TypeError, ValueError, OverflowError) as error:
            raise self.error(
                f"gives {key} as {_shown(self.values[key])}: expected finite numbers."
            ) from error
        if counts and len(numbers) not in counts:
            wanted = " or ".join(str(count) for count in counts)
            raise self.error(f"gives {key} as {len(numbers)} numbers: expected {wanted}.")
        return numbers

    def number(self, key: str, default: float | None = None) -> float:
        """One number."""
        if default is not None and key not in self.values:
            return default
        return self.numbers(key, 1)[0]

    def size(self, *keys: str) -> tuple[int, int]:
        """Width and height: one value of two numbers, or two of one."""
        size = self.numbers(keys[0], 2) if len(keys) == 1 else tuple(self.number(key) for key in keys)
        return self.pixels(size[0]), self.pixels(size[1])

    def pixels(self, number: float) -> int:
        """Return a number of pixels as an integer."""
        if number != int(number) or abs(number) > _LONGEST_SIDE_PX:
            raise self.error(f"gives an image side of {number:g} pixels: expected a whole number.")
        return int(number)

    def transform(self, key: str) -> NDArray[np.float64]:
        """Rigid transform, 16 or (without its last row) 12 numbers."""
        numbers = self.numbers(key, 12, 16)
        matrix = np.eye(4)
        matrix[:3] = np.reshape(numbers[:12], (3, 4))
        with np.errstate(all="ignore"):
            off = np.abs(matrix[:3, :3] @ matrix[:3, :3].T - np.eye(3)).max()
            turned = np.linalg.det(matrix[:3, :3]) > 0.0
        if numbers[12:] not in {(), (0.0, 0.0, 0.0, 1.0)} or not off <= _ROTATION_TOLERANCE or not turned:
            raise self.error(f"gives a {key} that is no rotation and translation: check the matrix.")
        return matrix


def yaml_document(content: bytes, where: str) -> Mapping[str, Any]:
    """Read YAML, OpenCV's included, into dicts, lists and texts.

    Tags are left aside and nothing is made of them: every scalar stays a text, so that no content can build
    an object, and a document that multiplies itself by aliases stays as small as it is written.

    Raises
    ------
    CalibrationError
        If the file is too long, no text, or no YAML with keys at its top.
    """
    import yaml

    text = _text(content, where, MAX_YAML_BYTES)
    if text.startswith("%YAML"):
        # OpenCV writes "%YAML:1.0", which is no YAML.
        text = text.partition("\n")[2]
    try:
        # Not the loader in C: brackets nested a million deep overflow its stack and end the process.
        document = yaml.load(text, Loader=yaml.BaseLoader)  # noqa: S506  # makes nothing but texts
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise CalibrationError(f"{where} is not valid YAML ({reason}): correct that line.") from error
    return _mapping(document, where)


def json_document(content: bytes, where: str) -> Mapping[str, Any]:
    """Read JSON with keys at its top.

    Raises
    ------
    CalibrationError
        If it is not that.
    """
    try:
        document = json.loads(_text(content, where))
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"{where} is not valid JSON ({error}): export it again.") from error
    return _mapping(document, where)


def sections(document: Mapping[str, Any], where: str) -> Iterator[tuple[str, Section]]:
    """Those values of a document that have keys of their own."""
    for name, values in document.items():
        if isinstance(values, Mapping):
            yield str(name), Section(values, f"{name} in {where}"[:300])


def built(where: str, model: type[CameraModel], **arguments: Any) -> CameraModel:
    """Build a camera model; a fault in its numbers names the file."""
    try:
        return model(**arguments)
    except CalibrationError as error:
        raise CalibrationError(f"{where} makes no camera: {error}.") from error


def _text(content: bytes, where: str, most: int = MAX_BYTES) -> str:
    if len(content) > most:
        raise CalibrationError(
            f"{where} is {len(content) / 1e6:.0f} MB, and a calibration file of its kind has at most"
            f" {most / 1e6:.0f}: check that it is the right file."
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{where} is not UTF-8 text: save it as UTF-8.") from error


def text_lines(content: bytes, where: str) -> list[str]:
    """Lines of a text file that are neither blank nor comments (#)."""
    lines = (line.strip() for line in _text(content, where).splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def first_lines(head: bytes, count: int) -> list[str]:
    """First lines that are neither blank nor a comment (#) of a file's beginning; "" for those it lacks."""
    text = head[:_HEAD_BYTES].decode("utf-8", errors="replace").lstrip("\ufeff")
    lines = (line.strip() for line in text.splitlines())
    found = [line for line in lines if line and not line.startswith("#")][:count]
    return found + [""] * (count - len(found))


def _mapping(document: object, where: str) -> Mapping[str, Any]:
    if not isinstance(document, dict):
        raise CalibrationError(f"{where} has no keys at its top: it is no calibration file.")
    return document


def _flat(value: object, depth: int = 0) -> Iterable[float]:
    """Finite numbers of nested lists; an error where there are others, or too many."""
    found: list[float] = []
    if isinstance(value, list) and depth < _DEEPEST and len(value) <= _MOST_NUMBERS:
        for item in value:
            found += _flat(item, depth + 1)
            if len(found) > _MOST_NUMBERS:
                raise ValueError("too many numbers")
        return found
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise TypeError("not a number")
    number = float(value)
    if not math.isfinite(number):
        raise ValueError("not finite")
    return [number]


def _shown(value: object) -> str:
    """Beginning of a value, for a message."""
    if isinstance(value, list | dict):
        return f"a {'list' if isinstance(value, list) else 'table'} of {len(value)}"
    return repr(value)[:60]
