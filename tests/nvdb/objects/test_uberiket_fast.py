"""The quick reading of Uberiket's usual objects says exactly what the careful one says."""

from __future__ import annotations

import copy
import json
from functools import cache
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nvdb_country import GeneratedWorld

from nvdb.datakatalog import snapshot
from nvdb.errors import SchemaError
from nvdb.objects import skilt_from_uberiket
from nvdb.objects.uberiket import careful_skilt
from nvdb.objects.uberiket_fast import usual_skilt

Raw = dict[str, Any]

anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([0, -1, 95, 96, 2**63, 10**400, "", "5530", "POINT(0 0)", "2020-W01-1", "EnumEgenskap"])
    | st.floats()
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


def generated(type_id: int, n: int = 50) -> list[Raw]:
    """Signs in Uberiket's form."""
    found: list[Raw] = json.loads(page_of(type_id))["vegobjekter"]
    return found[:n]


@cache
def page_of(type_id: int) -> bytes:
    """A page of generated signs."""
    query = {"antall": "50", "inkluder": "alle"}
    body = GeneratedWorld(50, 50).uberiket_body(type_id, query, "http://localhost/vegobjekter")
    assert body is not None
    return body


def said(read: Any, raw: Raw, type_id: int) -> str:
    """Result or message."""
    try:
        return repr(read(raw, type_id, snapshot()))
    except SchemaError as error:
        return f"SchemaError: {error}"


def places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every path into a JSON value."""
    steps = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [found for key, value in steps for found in ((*path, key), *places(value, (*path, key)))]


def holder(raw: Raw, path: tuple[Any, ...]) -> Any:
    """What holds the last step of a path."""
    inner: Any = raw
    for step in path[:-1]:
        inner = inner[step]
    return inner


@pytest.mark.parametrize("type_id", [95, 96])
def test_usual_reading_takes_every_generated_object(type_id: int) -> None:
    """Whole countries go the quick way, with the careful reading's result."""
    for raw in generated(type_id):
        usual = usual_skilt(raw, type_id, snapshot())
        if usual is None:  # the snapshot does not know every enum
            assert careful_skilt(raw, type_id, snapshot()).problems
        else:
            assert usual == careful_skilt(raw, type_id, snapshot())
    assert sum(usual_skilt(raw, type_id, snapshot()) is not None for raw in generated(type_id)) > 40


@pytest.mark.parametrize("type_id", [95, 96])
@pytest.mark.parametrize("value", [None, True, 0, -1, 1.5, "", "x", [], {}, [None], {"id": "x"}, 2**63])
def test_usual_reading_agrees_whatever_one_field_becomes(type_id: int, value: Any) -> None:
    """Each field in turn is replaced, or taken away: result or message are those of the careful reading."""
    for raw in generated(type_id, 2):
        for path in places(raw):
            changed = copy.deepcopy(raw)
            holder(changed, path)[path[-1]] = value
            assert said(skilt_from_uberiket, changed, type_id) == said(careful_skilt, changed, type_id), path
            del holder(changed, path)[path[-1]]
            assert said(skilt_from_uberiket, changed, type_id) == said(careful_skilt, changed, type_id), path


@pytest.mark.parametrize("key", ["05530", "5530 ", "²", "x", "-1", "9999999"])
def test_usual_reading_agrees_on_odd_keys(key: str) -> None:
    """A property or relation under an odd key is read, or refused, as the careful reading does."""
    for type_id in (95, 96):
        for name, value in (("egenskaper", {"type": "EnumEgenskap", "verdi": 7633}), ("barn", [1, 1])):
            raw = generated(type_id, 1)[0]
            raw[name][key] = value
            assert said(skilt_from_uberiket, raw, type_id) == said(careful_skilt, raw, type_id)


@settings(deadline=None, max_examples=100)
@given(data=st.data())
def test_usual_reading_agrees_on_any_two_changes(data: st.DataObject) -> None:
    """Two arbitrary changes anywhere lead both readings to the same object or the same message."""
    type_id = data.draw(st.sampled_from([95, 96]))
    raw = generated(type_id, 1)[0]
    for _ in range(2):
        path = data.draw(st.sampled_from(places(raw)))
        holder(raw, path)[path[-1]] = data.draw(anything)
    assert said(skilt_from_uberiket, raw, type_id) == said(careful_skilt, raw, type_id)
