"""Objects of both APIs are read by a schema: whatever a field becomes is read or named as a fault."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nvdb_country import GeneratedWorld

from nvdb.datakatalog import snapshot
from nvdb.errors import SchemaError
from nvdb.objects import skilt_from_les_v4, skilt_from_uberiket
from nvdb.objects.schema import Number, Whole, read

Raw = dict[str, Any]
READERS: dict[str, Callable[[Raw, int], Any]] = {
    "les-v4": skilt_from_les_v4,
    "uberiket": lambda raw, type_id: skilt_from_uberiket(raw, type_id, snapshot()),
}

anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([0, -1, 95, 96, 2**63, -(2**63) - 1, 10**400, "", "5530", "POINT(0 0)", "EnumEgenskap"])
    | st.floats()
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


@cache
def _page(api: str, type_id: int) -> bytes:
    world, query = GeneratedWorld(50, 50), {"antall": "50", "inkluder": "alle"}
    body = (world.page_body if api == "les-v4" else world.uberiket_body)(type_id, query, "http://localhost/x")
    assert body is not None
    return body


def _generated(api: str, type_id: int) -> list[Raw]:
    objects: list[Raw] = json.loads(_page(api, type_id))["objekter" if api == "les-v4" else "vegobjekter"]
    return objects


def _places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every path into a JSON value."""
    steps = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [inner for key, value in steps for inner in ((*path, key), *_places(value, (*path, key)))]


def _change(raw: Raw, path: tuple[Any, ...], value: Any) -> None:
    inner: Any = raw
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value


def _said(api: str, raw: Raw, type_id: int) -> str:
    """The message of a refusal; empty for an object that is read."""
    try:
        READERS[api](raw, type_id)
    except SchemaError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("api", READERS)
@pytest.mark.parametrize("type_id", [95, 96])
@pytest.mark.parametrize("value", [None, True, 0, 1.5, "x", [], {}, [None], {"id": "x"}, 2**63])
def test_wrong_field_is_read_or_named(api: str, type_id: int, value: Any) -> None:
    """Each field in turn is replaced: the object is read, or the message names a field on the way to it."""
    raw = _generated(api, type_id)[0]
    for path in _places(raw):
        changed = copy.deepcopy(raw)
        _change(changed, path, value)
        said = _said(api, changed, type_id)
        assert said == "" or f"the field {path[0]}" in said or path == ("typeId",), path


@given(data=st.data(), api=st.sampled_from(sorted(READERS)), type_id=st.sampled_from([95, 96]))
def test_any_two_changes_are_read_or_refused(data: st.DataObject, api: str, type_id: int) -> None:
    """Two arbitrary changes anywhere lead to an object or to a SchemaError; the input stays as it was."""
    raw = _generated(api, type_id)[0]
    for _ in range(2):
        _change(raw, data.draw(st.sampled_from(_places(raw))), data.draw(anything))
    before = repr(raw)
    assert _said(api, raw, type_id) == "" or "egobjekt" in _said(api, raw, type_id)
    assert repr(raw) == before


@pytest.mark.parametrize("key", ["5530 ", "²", "x", "-1"])
@pytest.mark.parametrize("name", ["egenskaper", "barn"])
def test_key_that_is_no_id_is_refused(name: str, key: str) -> None:
    """A property or relation of Uberiket stands under its id."""
    raw = _generated("uberiket", 96)[0]
    raw[name][key] = {}
    with pytest.raises(SchemaError, match=f"{name}.{key} is not the id of a"):
        skilt_from_uberiket(raw, 96, snapshot())


class Inner(msgspec.Struct):
    """An inner object."""

    id: Whole


class Outer(msgspec.Struct):
    """One field of each kind."""

    inner: Inner
    number: Number | None = None
    flag: bool | None = None
    texts: list[str] | None = None
    ids: list[Whole | Inner] | None = None
    members: list[Inner] | None = None


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"inner": None}, "inner.id is missing"),
        ({"inner": {"id": 2**63}}, "inner.id is 9223372036854775808 instead of a whole number"),
        ({"number": float("nan")}, "number is nan instead of a number"),
        ({"number": -(2**63) - 1}, "number is -9223372036854775809 instead of a number"),
        ({"flag": 1}, "flag is 1 instead of true or false"),
        ({"texts": "a"}, "texts is 'a' instead of a list"),
        ({"texts": [1]}, "texts holds something that is not text"),
        ({"ids": [1, "2"]}, "ids holds something that is not an id"),
        ({"members": [{"id": 1}, None]}, r"members\[1\] is None instead of an object"),
        ({"members": [{"id": 1}, {}]}, r"members\[1\].id is missing"),
    ],
)
def test_read_names_the_field_and_what_it_should_be(change: Raw, sentence: str) -> None:
    """A fault is told by its path and in words, whatever the checker calls it."""
    with pytest.raises(SchemaError, match=f"^In vegobjekt 7 the field {sentence}.$"):
        read({"inner": {"id": 1}, **change}, Outer, "vegobjekt 7")
