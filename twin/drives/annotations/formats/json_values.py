"""JSON of unknown make: parsed without surprises, read without trusting that it is what it should be."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from twin.errors import DriveError


def parse_json(content: bytes, where: str) -> Any:
    """Parse JSON in UTF-8, -16 or -32.

    Raises
    ------
    DriveError
        If it is cut, no JSON, or nested deeper than any export is.
    """
    try:
        return json.loads(content)
    except RecursionError as error:
        raise DriveError(f"{where} is nested too deeply to be read: export it again.") from error
    except ValueError as error:
        raise DriveError(f"{where} is not JSON ({error}): export it again.") from error


def mapping(value: object) -> Mapping[str, Any]:
    """Return a JSON object, an empty one if it is something else."""
    return value if isinstance(value, dict) else {}


def sequence(value: object) -> Sequence[Any]:
    """Return a JSON array, an empty one if it is something else."""
    return value if isinstance(value, list) else []


def text(value: object) -> str:
    """Return a scalar as text; "" for null, arrays and objects."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return str(value)
    if isinstance(value, str):
        # JSON can spell half a surrogate pair, which no file or database takes.
        return value.encode("utf-8", "replace").decode().strip()
    return ""


def texts(value: object) -> dict[str, str]:
    """Return the attributes of an object as texts; arrays of scalars are joined by ``;``."""
    return {
        text(name): ";".join(text(part) for part in inner) if isinstance(inner, list) else text(inner)
        for name, inner in mapping(value).items()
    }


def key(value: object) -> str:
    """Return an id, which tools write as a number or as text, as text."""
    return "" if isinstance(value, bool) else text(value)


def whole(value: object) -> int | None:
    """Return a whole number from 0 that fits 63 bits; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**63:
        return None
    return value


def size_px(width: object, height: object) -> tuple[int, int] | None:
    """Return the size of an image; None where it is not stated."""
    pair = whole(width), whole(height)
    return (pair[0], pair[1]) if pair[0] and pair[1] else None
