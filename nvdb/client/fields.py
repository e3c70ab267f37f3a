"""Typed access to the fields of a JSON object, with errors that name the object and the field."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from nvdb.errors import SchemaError

INT64: Final = range(-(2**63), 2**63)
"""Whole numbers that a database can keep."""


class Fields:
    """The fields of one JSON object.

    A missing field and null are the same: None, or empty. A field of the wrong type raises.

    Parameters
    ----------
    raw : mapping
        The JSON object.
    where : str
        What it is, for messages: ``vegobjekt 84130065``.
    prefix : str
        Path of this object inside it, ending in a dot.
    """

    __slots__ = ("_prefix", "_where", "raw")

    def __init__(self, raw: Mapping[str, Any], where: str, prefix: str = "") -> None:
        self.raw = raw
        self._where = where
        self._prefix = prefix

    def error(self, name: str, clause: str) -> SchemaError:
        """Make (not raise) the error for a field: *what* is wrong is a clause such as ``is not text``."""
        return SchemaError(f"In {self._where} the field {self._prefix}{name} {clause}.")

    def text(self, name: str) -> str | None:
        """Text, or None."""
        value = self.raw.get(name)
        if value is None or isinstance(value, str):
            return value
        raise self.error(name, f"is {value!r:.40} instead of text")

    def integer(self, name: str) -> int | None:
        """Whole number, or None."""
        value = self.raw.get(name)
        if value is None:
            return None
        if isinstance(value, int) and not isinstance(value, bool) and value in INT64:
            return value
        raise self.error(name, f"is {value!r:.40} instead of a whole number")

    def required_integer(self, name: str) -> int:
        """Whole number; missing is an error."""
        value = self.integer(name)
        if value is None:
            raise self.error(name, "is missing")
        return value

    def number(self, name: str) -> float | None:
        """Finite number, or None."""
        value = self.raw.get(name)
        if value is None:
            return None
        if isinstance(value, float) and math.isfinite(value):
            return value
        if isinstance(value, int) and not isinstance(value, bool) and value in INT64:
            return float(value)
        raise self.error(name, f"is {value!r:.40} instead of a number")

    def boolean(self, name: str) -> bool:
        """Boolean; missing is False."""
        value = self.raw.get(name)
        if value is None:
            return False
        if isinstance(value, bool):
            return value
        raise self.error(name, f"is {value!r:.40} instead of true or false")

    def items(self, name: str) -> list[Any]:
        """List as it came; missing is empty."""
        value = self.raw.get(name)
        if value is None:
            return []
        if isinstance(value, list):
            return value
        raise self.error(name, f"is {value!r:.40} instead of a list")

    def texts(self, name: str) -> tuple[str, ...]:
        """List of texts."""
        values = self.items(name)
        if all(isinstance(value, str) for value in values):
            return tuple(values)
        raise self.error(name, "holds something that is not text")

    def child(self, name: str) -> Fields:
        """Inner object; missing is an empty one."""
        value = self.raw.get(name)
        if value is None:
            value = {}
        if isinstance(value, Mapping):
            return Fields(value, self._where, f"{self._prefix}{name}.")
        raise self.error(name, f"is {value!r:.40} instead of an object")

    def children(self, name: str) -> Iterator[Fields]:
        """Inner objects of a list."""
        for number, value in enumerate(self.items(name)):
            if not isinstance(value, Mapping):
                raise self.error(f"{name}[{number}]", f"is {value!r:.40} instead of an object")
            yield Fields(value, self._where, f"{self._prefix}{name}[{number}].")
