"""What an ONNX file says about itself: the size of its input and the names of its classes.

OpenCV runs a network but does not tell these. They stand in the file's Protocol Buffers, of which four
messages are walked through here (https://github.com/onnx/onnx/blob/main/onnx/onnx.proto): no more is needed,
and the package ``onnx`` would bring 60 MB for it.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from twin.errors import DriveError

_VARINT, _EIGHT_BYTES, _LENGTH, _FOUR_BYTES = 0, 1, 2, 5
_GRAPH, _METADATA = 7, 14
_INITIALIZER, _INPUT, _TENSOR_NAME = 5, 11, 8
_FLOAT32 = 1
_LONGEST_TEXT = 1_000_000
_LARGEST_VARINT_BYTES = 10


@dataclass(frozen=True, slots=True)
class OnnxHeader:
    """Input and classes of a network.

    Attributes
    ----------
    shape : tuple of int
        Of the first input; 0 where the file leaves a dimension open. Rows and columns that it leaves open are
        those of the metadata entry ``imgsz``, with which Ultralytics says what the network was trained on.
    is_float32 : bool
        Whether the input takes 32-bit floats.
    names : tuple of str
        Classes by index, from the metadata entry ``names`` as Ultralytics writes it; empty without one.
    """

    shape: tuple[int, ...]
    is_float32: bool
    names: tuple[str, ...]


class _DamagedError(Exception):
    """Not a Protocol Buffers message."""


def read_onnx_header(content: bytes, where: str) -> OnnxHeader:
    """Read input size and class names.

    Parameters
    ----------
    content : bytes
        The whole file; it is walked through, not copied.
    where : str
        File name, for messages.

    Raises
    ------
    DriveError
        If it is not an ONNX model with an input.
    """
    try:
        return _header(memoryview(content))
    except _DamagedError as error:
        raise DriveError(
            f"{where} is not an ONNX model that can be read ({error}): export the network again, as ONNX."
        ) from error


def _header(model: memoryview) -> OnnxHeader:
    metadata: dict[str, str] = {}
    constants: set[str] = set()
    inputs: list[tuple[str, int, tuple[int, ...]]] = []
    for field, value in _fields(model):
        if field == _METADATA:
            entry = {key: _text(text) for key, text in _fields(_message(value))}
            metadata[entry.get(1, "")] = entry.get(2, "")
        elif field == _GRAPH:
            for part, inner in _fields(_message(value)):
                if part == _INITIALIZER:
                    constants |= {_text(v) for f, v in _fields(_message(inner)) if f == _TENSOR_NAME}
                elif part == _INPUT:
                    inputs.append(_input(_message(inner)))
    # Old files list the weights among the inputs.
    found = next((one for one in inputs if one[0] not in constants), None)
    if found is None:
        raise _DamagedError("it has no input")
    _, kind, shape = found
    return OnnxHeader(
        _filled(shape, _numbers(metadata.get("imgsz", ""))),
        kind == _FLOAT32,
        _class_names(metadata.get("names", "")),
    )


def _filled(shape: tuple[int, ...], trained: tuple[int, ...]) -> tuple[int, ...]:
    """The shape with rows and columns that are open set to those the network was trained on."""
    if len(shape) != 4 or len(trained) != 2:
        return shape
    return (*shape[:2], shape[2] or trained[0], shape[3] or trained[1])


def _input(info: memoryview) -> tuple[str, int, tuple[int, ...]]:
    """Name, element type and shape of a ValueInfoProto."""
    name, kind, shape = "", 0, []
    for field, value in _fields(info):
        if field == 1:
            name = _text(value)
        elif field == 2:
            for _, tensor in _fields(_message(value)):
                for part, inner in _fields(_message(tensor)):
                    if part == 1 and isinstance(inner, int):
                        kind = inner
                    elif part == 2:
                        shape += [_dimension(_message(d)) for f, d in _fields(_message(inner)) if f == 1]
    return name, kind, tuple(shape)


def _dimension(dimension: memoryview) -> int:
    return next((v for f, v in _fields(dimension) if f == 1 and isinstance(v, int)), 0)


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


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Field numbers and values of a message; numbers of fixed width are skipped."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        field, wire = key >> 3, key & 7
        if wire == _VARINT:
            number, at = _varint(message, at)
            yield field, number
        elif wire == _LENGTH:
            size, at = _varint(message, at)
            if size > len(message) - at:
                raise _DamagedError("it was cut")
            yield field, message[at : at + size]
            at += size
        elif wire in (_EIGHT_BYTES, _FOUR_BYTES):
            at += 8 if wire == _EIGHT_BYTES else 4
        else:
            raise _DamagedError("it is of another format")


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    number = 0
    for shift, byte in enumerate(message[at : at + _LARGEST_VARINT_BYTES]):
        number |= (byte & 0x7F) << 7 * shift
        if not byte & 0x80:
            return number, at + shift + 1
    raise _DamagedError("it was cut, or is of another format")


def _message(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise _DamagedError("it is of another format")
    return value


def _text(value: int | memoryview) -> str:
    return str(value) if isinstance(value, int) else bytes(value[:_LONGEST_TEXT]).decode("utf-8", "replace")
