"""Areas: what is asked for, and what is refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nvdb.area import Area
from nvdb.errors import AreaError

steady = settings(
    deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)


@steady
@given(st.lists(st.integers(301, 5999), min_size=1, max_size=8))
def test_area_of_kommuner_is_read_back_from_its_own_question(numbers: list[int]) -> None:
    """The query parameter names every kommune once, in order, and reads back as the same area."""
    area = Area(kommuner=tuple(numbers))
    assert area.kommuner == tuple(sorted(set(numbers)))
    assert Area.from_kommuner_text(area.params()["kommune"]) == area


def test_area_writes_its_question_and_its_name() -> None:
    """Kommuner, a box and the whole country each have their parameters and words."""
    oslo = Area.from_kommuner_text("5001, 0301")
    assert oslo.params() == {"kommune": "301,5001"}
    assert oslo.text() == "kommune 0301, 5001"
    box = Area.from_bbox_text("269000,7039000,271000,7041000.5")
    assert box.params() == {"kartutsnitt": "269000.000,7039000.000,271000.000,7041000.500"}
    assert box.text().startswith("box 269000, 7039000")
    assert Area.from_fylker_text("50, 03").params() == {"fylke": "3,50"}
    assert Area.from_fylker_text("50,03").text() == "fylke 03, 50"
    contract = Area.from_kontraktsomrader_text(" 9503 Midtre Hålogaland 2021-2026 ")
    assert contract.params() == {"kontraktsomrade": "9503 Midtre Hålogaland 2021-2026"}
    assert contract.text() == "kontraktsområde 9503 Midtre Hålogaland 2021-2026"
    assert Area().params() == {}
    assert Area().text() == "the whole country"


@pytest.mark.parametrize("text", ["", "Oslo", "5001;0301", "5001,", "50011", "12", "-301", "5001.0"])
def test_area_refuses_what_is_no_kommune(text: str) -> None:
    """Names, odd separators and impossible numbers are refused with an example of what is wanted."""
    with pytest.raises(AreaError, match="5001"):
        Area.from_kommuner_text(text)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is not a box"),
        ("1,2,3", "is not a box"),
        ("a,b,c,d", "is not a box"),
        ("10.3,63.4,10.5,63.5", "looks like degrees"),
        ("271000,7039000,269000,7041000", "is empty"),
        ("269000,7039000,269000,7041000", "is empty"),
        ("7039000,269000,7041000,271000", "outside Norway"),
        ("nan,7039000,271000,7041000", "finite"),
        ("269000,7039000,inf,7041000", "finite"),
    ],
)
def test_area_refuses_a_box_that_cannot_be(text: str, why: str) -> None:
    """Degrees, swapped corners, swapped axes and NaN each get a sentence that says so."""
    with pytest.raises(AreaError, match=why):
        Area.from_bbox_text(text)


@pytest.mark.parametrize("text", ["", "Trøndelag", "500", "0", "50;15", "-5"])
def test_area_refuses_what_is_no_fylke(text: str) -> None:
    """Names, odd separators and impossible numbers are refused with an example of what is wanted."""
    with pytest.raises(AreaError, match="50"):
        Area.from_fylker_text(text)


@pytest.mark.parametrize("text", ["", " ", "9503,", ",,"])
def test_area_refuses_a_kontraktsomrade_without_a_name(text: str) -> None:
    """An empty name would ask for everything."""
    with pytest.raises(AreaError, match="no kontraktsområder"):
        Area.from_kontraktsomrader_text(text)


BOXES = st.tuples(
    st.floats(-75_000, 500_000), st.floats(6_450_000, 7_000_000), st.floats(1, 9e5), st.floats(1, 9e5)
).map(lambda box: (box[0], box[1], box[0] + box[2], box[1] + box[3]))
NAMES = st.text(st.characters(exclude_characters=",", exclude_categories=["C", "Z"]), min_size=1)
AREAS = st.one_of(
    st.just(Area()),
    st.lists(st.integers(101, 9999), min_size=1, max_size=4).map(lambda n: Area(kommuner=tuple(n))),
    st.lists(st.integers(1, 99), min_size=1, max_size=4).map(lambda n: Area(fylker=tuple(n))),
    st.lists(NAMES, min_size=1, max_size=4).map(lambda n: Area(kontraktsomrader=tuple(n))),
    BOXES.map(lambda box: Area(bbox=box)),
)


@steady
@given(AREAS)
def test_area_is_read_back_from_its_words(area: Area) -> None:
    """The words that a store remembers say exactly which area it was, so that no two are taken for one."""
    assert Area.from_text(area.text()) == area


@pytest.mark.parametrize("text", ["", "Norway", "kommune", "fylke x", "box 1, 2"])
def test_area_does_not_guess_from_other_words(text: str) -> None:
    """Words that are no area's are refused."""
    with pytest.raises(AreaError):
        Area.from_text(text)


def test_area_excludes_by_what_an_object_says_of_itself() -> None:
    """Numbers and names that do not meet exclude; a box, no ``lokasjon`` and no list of numbers do not."""
    contract = {"id": 17, "nummer": 9503, "navn": "9503 Midtre Hålogaland 2021-2026"}
    here = {"kommuner": [5001, 301], "fylker": [50], "kontraktsområder": [contract]}
    for area in (
        Area(kommuner=(301,)),
        Area(fylker=(3, 50)),
        *(Area(kontraktsomrader=(name,)) for name in ("17", "9503", "9503 midtre hålogaland 2021-2026")),
        Area(bbox=(0.0, 6_500_000.0, 1000.0, 6_600_000.0)),
        Area(),
    ):
        assert not area.excludes(here)
        assert not area.excludes(None)
    for area in (Area(kommuner=(1103,)), Area(fylker=(3,)), Area(kontraktsomrader=("9504",))):
        assert area.excludes(here)
    assert not Area(fylker=(3,)).excludes({"kommuner": [5001]})
    assert Area(kontraktsomrader=("17",)).excludes({"kommuner": [5001], "fylker": [50]})


def test_area_is_one_thing_at_a_time() -> None:
    """Kommuner and a box together are refused, and so is a kommune that is no number."""
    with pytest.raises(AreaError, match="either"):
        Area(kommuner=(301,), bbox=(0.0, 6_500_000.0, 1000.0, 6_600_000.0))
    with pytest.raises(AreaError, match="either"):
        Area(kommuner=(301,), fylker=(3,))
    with pytest.raises(AreaError):
        Area(kommuner=(True,))
    with pytest.raises(AreaError):
        Area(bbox=(math.nan, 0.0, 1.0, 1.0))
