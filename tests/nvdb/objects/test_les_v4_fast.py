"""The quick reading of usual objects says exactly what the careful one says."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest
from checkout import REAL
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nvdb_country import GeneratedWorld

from nvdb.errors import SchemaError
from nvdb.objects import (
    Skiltplate,
    Skiltpunkt,
    skilt_from_les_v4,
    skiltplate_from_vegobjekt,
    skiltpunkt_from_vegobjekt,
    vegobjekt_from_les_v4,
)
from nvdb.objects.les_v4_fast import usual_parts

Raw = dict[str, Any]

steady = settings(
    deadline=None, max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture]
)

anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([0, -1, 95, 96, 2**63, -(2**63) - 1, 10**400, "", "5530", "POINT(0 0)", "2020-W01-1"])
    | st.floats()
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


def _careful(raw: Raw, type_id: int) -> Skiltpunkt | Skiltplate:
    vegobjekt = vegobjekt_from_les_v4(raw, type_id=type_id)
    if type_id == 95:
        return skiltpunkt_from_vegobjekt(vegobjekt)
    return skiltplate_from_vegobjekt(vegobjekt)


def _said(read: Any, raw: Raw, type_id: int) -> str:
    try:
        return repr(read(raw, type_id))
    except SchemaError as error:
        return f"SchemaError: {error}"


def _generated(type_id: int) -> list[Raw]:
    query = {"antall": "50", "inkluder": "alle"}
    body = GeneratedWorld(50, 50).page_body(type_id, query, "http://localhost/vegobjekter")
    found: list[Raw] = json.loads(body)["objekter"]
    return found


def _places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every path into a JSON value."""
    steps = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [found for key, value in steps for found in ((*path, key), *_places(value, (*path, key)))]


def _change(raw: Raw, path: tuple[Any, ...], value: Any) -> Raw:
    changed = copy.deepcopy(raw)
    inner: Any = changed
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    return changed


@pytest.mark.parametrize("type_id", [95, 96])
def test_usual_reading_takes_every_generated_object(type_id: int) -> None:
    """Whole countries go the quick way, with the careful reading's result."""
    for raw in _generated(type_id):
        assert usual_parts(raw, type_id) is not None
        assert skilt_from_les_v4(raw, type_id) == _careful(raw, type_id)


@pytest.mark.parametrize("value", [None, True, 0, -1, 1.5, "", "x", [], {}, [None], {"id": "x"}, 2**63])
def test_usual_reading_agrees_whatever_one_field_becomes(plate: Any, point: Any, value: Any) -> None:
    """Each field in turn is replaced: result or message are those of the careful reading."""
    for type_id, raw in (
        (95, point(200)),
        (96, plate(700)),
        (95, _generated(95)[0]),
        (96, _generated(96)[0]),
    ):
        for path in _places(raw):
            changed = _change(raw, path, value)
            assert _said(skilt_from_les_v4, changed, type_id) == _said(_careful, changed, type_id), path


@steady
@given(data=st.data())
def test_usual_reading_agrees_on_any_two_changes(plate: Any, point: Any, data: st.DataObject) -> None:
    """Two arbitrary changes anywhere lead both readings to the same object or the same message."""
    type_id = data.draw(st.sampled_from([95, 96]))
    raw = plate(700) if type_id == 96 else point(200)
    for _ in range(2):
        raw = _change(raw, data.draw(st.sampled_from(_places(raw))), data.draw(anything))
    assert _said(skilt_from_les_v4, raw, type_id) == _said(_careful, raw, type_id)


def test_usual_reading_agrees_on_lists_units_and_missing_fields(plate: Any) -> None:
    """Members of a Liste, units, and the absence of any field are read alike."""
    raw = plate(700)
    inner = {"id": 1, "navn": "a", "egenskapstype": "Heltall", "verdi": 5, "enhet": {"kortnavn": "mm"}}
    raw["egenskaper"].append({"id": 2, "navn": "b", "egenskapstype": "Liste", "innhold": [inner]})
    assert usual_parts(raw, 96) is not None
    for path in _places(raw):
        changed = copy.deepcopy(raw)
        holder: Any = changed
        for step in path[:-1]:
            holder = holder[step]
        del holder[path[-1]]
        assert _said(skilt_from_les_v4, changed, 96) == _said(_careful, changed, 96), path


def test_usual_reading_agrees_on_recorded_pages() -> None:
    """Every recorded object of the two types is read alike by both."""
    folder = REAL / "nvdb"
    if not folder.is_dir():
        pytest.skip("the recorded pages of NVDB are not beside this repository")
    n = 0
    for file in sorted(folder.rglob("*.json")):
        document = json.loads(file.read_text(encoding="utf-8"))
        objects = document.get("objekter") if isinstance(document, dict) else None
        for raw in objects if isinstance(objects, list) else ():
            for type_id in (95, 96):
                n += 1
                assert _said(skilt_from_les_v4, raw, type_id) == _said(_careful, raw, type_id)
    assert n
