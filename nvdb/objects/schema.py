"""An object of the API by its schema: read by a compiled checker, its first fault named.

The schema (a msgspec ``Struct``) is the one place that says what a field must be. Fields that it does not
name are not looked at. A missing field and null are the same, unless the schema has no default for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, TypeVar

import msgspec
from msgspec import inspect

from nvdb.errors import SchemaError

T = TypeVar("T")

Whole = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""A whole number that a database can keep; msgspec takes neither true nor 1.0 for one."""
Number = Whole | Annotated[float, msgspec.Meta(ge=-1.7976931348623157e308, le=1.7976931348623157e308)]
"""A number that is neither NaN nor infinite."""

_WORDS: Final[Mapping[type[inspect.Type], str]] = {
    inspect.FloatType: "a number",
    inspect.IntType: "a whole number",
    inspect.StrType: "text",
    inspect.BoolType: "true or false",
    inspect.ListType: "a list",
    inspect.StructType: "an object",
    inspect.DictType: "an object",
}


def read(value: Any, kind: type[T], where: str, place: str = "") -> T:
    """Read a JSON value by its schema.

    Parameters
    ----------
    value : Any
    kind : type
        A msgspec ``Struct``, or any type that msgspec knows.
    where : str
        What it is a part of, for messages: ``vegobjekt 84130065``.
    place : str
        Path of the value inside that; empty for the whole.

    Raises
    ------
    SchemaError
        A field that is missing or of another type; the message names it, and `where` it is.
    """
    try:
        return msgspec.convert(value, kind)
    except (msgspec.ValidationError, RecursionError) as error:
        fault = _fault(value, inspect.type_info(kind), place) or (place, f"cannot be read ({error})")
        raise field_error(where, *fault) from None


def as_float(value: float | None) -> float | None:
    """A `Number` as a float: JSON may write it as a whole number."""
    return None if value is None else float(value)


def field_error(where: str, name: str, clause: str) -> SchemaError:
    """Make (not raise) the error for a field: *what* is wrong is a clause such as ``is not text``."""
    return SchemaError(f"In {where} the field {name} {clause}.")


def _fault(value: Any, kind: inspect.Type, place: str) -> tuple[str, str] | None:
    """Path and clause of the first thing, in the schema's order, that is not what the schema says."""
    kinds = kind.types if isinstance(kind, inspect.UnionType) else (kind,)
    wanted = [one for one in kinds if not isinstance(one, inspect.NoneType)][-1]
    if isinstance(wanted, inspect.StructType) and isinstance(value, Mapping):
        return _fault_of_fields(value, wanted.cls, f"{place}." if place else "")
    if isinstance(wanted, inspect.ListType) and isinstance(value, list):
        member = wanted.item_type
        if isinstance(member, inspect.UnionType):
            return place, "holds something that is not an id"
        if not isinstance(member, inspect.StructType):
            return place, f"holds something that is not {_WORDS[type(member)]}"
        bad = next((i for i, item in enumerate(value) if not _fits(item, member.cls)), 0)
        return _fault(value[bad], member, f"{place}[{bad}]")
    return place, f"is {value!r:.40} instead of {_WORDS[type(wanted)]}"


def _fault_of_fields(
    raw: Mapping[str, Any], schema: type[msgspec.Struct], prefix: str
) -> tuple[str, str] | None:
    for field in msgspec.structs.fields(schema):
        value, place = raw.get(field.encode_name), prefix + field.encode_name
        kind = inspect.type_info(field.type)
        if value is None and field.required:
            if not isinstance(kind, inspect.StructType):
                return place, "is missing"
            value = {}
        if value is not None and not _fits(value, field.type):
            return _fault(value, kind, place)
    return None


def _fits(value: Any, kind: Any) -> bool:
    try:
        msgspec.convert(value, kind)
    except (msgspec.ValidationError, RecursionError):
        return False
    return True
