"""Objects in the store: to the last character, small, and compared by what they say."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nvdb_country import GeneratedWorld

from nvdb.client import JsonObject, json_from_body
from nvdb.objects import VegobjektStedfesting
from twin.mirror.raw import packed, raw_object, raw_text, same_object
from twin.mirror.rows import _to_json

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)
objects = st.dictionaries(st.text(), values, max_size=5)


@settings(deadline=None)
@given(objects, st.booleans(), st.sampled_from([None, 1]))
def test_packed_object_comes_back_as_it_was_sent(raw: dict[str, Any], ascii_only: bool, indent: Any) -> None:
    """Text from a page survives to the character; an object without text survives as an object."""
    text = json.dumps(raw, ensure_ascii=ascii_only, indent=indent)
    sent = JsonObject(raw)
    sent.text = text.encode()
    assert raw_text(packed(sent)) == text
    assert raw_object({"raw": packed(raw)}) == raw
    assert same_object(packed(sent), packed(raw))


def test_packed_objects_are_small() -> None:
    """The dictionary brings an object of 2 kB below a fifth of that."""
    body = GeneratedWorld(20, 50).page_body(96, {"antall": "50", "inkluder": "alle"}, "http://localhost")
    page = json_from_body(body, "localhost", "application/json")
    assert isinstance(page, dict)
    sizes = [len(packed(raw)) / len(raw.text) for raw in page["objekter"]]
    assert max(sizes) < 0.2


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ('{"a": 1, "b": [2]}', '{"b":[2],"a":1}', True),
        ('{"a": "\\u00e5"}', '{"a": "å"}', True),
        ('{"a": 1}', '{"a": true}', False),
        ('{"a": 1}', '{"a": 2}', False),
        ('{"a": [1, 2]}', '{"a": [2, 1]}', False),
        ('{"a": null}', "{}", False),
    ],
)
def test_same_object_looks_at_what_is_said(one: str, other: str, same: bool) -> None:
    """Spaces, escapes and the order of fields do not count; values, their kinds and order in lists do."""
    stored = []
    for text in (one, other):
        raw = JsonObject(json.loads(text))
        raw.text = text.encode()
        stored.append(packed(raw))
    assert same_object(*stored) is same


@pytest.mark.parametrize(
    "text",
    [
        '{"objekter":[{"a":1},{"b":[]}],"metadata":{"returnert":2}}',
        ' { "objekter" : [ {"a": 1e5} , {} ] , "metadata" : {} } ',
        '{"vegobjekter":[{"a":"]},{"}],"metadata":{}}',
        '{"objekter":[{"a":1},7,null],"metadata":{}}',
        '{"objekter":[{"a":1}],"objekter":[{"a":2}]}',
        '{"objekter":[{"a":1}]}',
        '{"objekter":[]}',
        '{"metadata":{},"objekter":[{"a":1}]}',
    ],
)
def test_page_is_read_as_json_reads_it(text: str) -> None:
    """However a page is laid out, its objects are those of the JSON parser, and know their own text."""
    page = json_from_body(text.encode(), "localhost", "application/json")
    assert page == json.loads(text)
    assert isinstance(page, dict)
    for raw in next(iter(page.values())):
        if isinstance(raw, JsonObject):
            assert json.loads(raw.text) == raw
            assert raw.text in text.encode()


@settings(deadline=None)
@given(
    st.builds(
        VegobjektStedfesting,
        type=st.text(),
        veglenkesekvensid=st.none() | st.integers(),
        nodeid=st.none() | st.integers(),
        relativ_posisjon=st.none() | st.floats(0, 1),
        startposisjon=st.none() | st.floats(0, 1),
        sluttposisjon=st.none() | st.floats(allow_nan=False, allow_infinity=False),
        retning=st.none() | st.text(),
        kjorefelt=st.lists(st.text(), max_size=3).map(tuple),
        sideposisjon=st.none() | st.text(),
        kortform=st.none() | st.text(),
    )
)
def test_stedfesting_in_the_store_is_its_json(place: VegobjektStedfesting) -> None:
    """The JSON of a column has the fields of a stedfesting by name."""
    fields = {**msgspec.structs.asdict(place), "kjorefelt": [*place.kjorefelt]}
    assert json.loads(_to_json([place])) == [fields]
