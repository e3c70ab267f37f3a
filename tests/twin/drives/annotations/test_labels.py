"""Sign codes in labels and attributes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.drives.annotations.labels import codes_from_attribute, codes_from_label


@pytest.mark.parametrize(
    ("label", "codes"),
    [
        ("362.50", "362.50"),
        ("362.50 Fartsgrense", "362.50"),
        ("906H", "906H"),
        ("727.3K", "727.3K"),
        ("skilt_362.50", "362.50"),
        ("Skilt 202", "202"),
        ("362.50;808.1", "362.50;808.1"),
        ("U324", "U324"),
        ("723.21 - Avstandsskilt", "723.21"),
        ("skilt", ""),
        ("fartsgrense 362.50", ""),
        ("3625", ""),
        ("2024-05-01", ""),
        ("362.50Fartsgrense", ""),
        ("100m", ""),
        ("", ""),
    ],
)
def test_label_gives_the_codes_that_it_begins_with(label: str, codes: str) -> None:
    """A label counts only where it begins with a whole sign code."""
    assert codes_from_label(label) == codes


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("362.50", "362.50"),
        ("362.50;808.1", "362.50;808.1"),
        ("362.50, 808.1", "362.50;808.1"),
        ("202,362", "202;362"),
        ("362,50", "362.50"),
        ("362,50 Fartsgrense", "362.50"),
        ("906h", "906H"),
        ("202 + 808", "202;808"),
        ("ukjent", ""),
        ("", ""),
    ],
)
def test_attribute_gives_every_code_in_its_order(text: str, codes: str) -> None:
    """The attribute lists codes top down; a decimal comma and small letters are understood."""
    assert codes_from_attribute(text) == codes


@given(st.lists(st.from_regex(r"\A[1-9][0-9]{2}[A-ZÆØÅ]?(\.[0-9]{1,2})?\Z"), min_size=1, max_size=4))
def test_codes_survive_being_joined_and_read_again(codes: list[str]) -> None:
    """Whatever the codes, attribute and label read the joined list back."""
    joined = ";".join(codes)
    assert codes_from_attribute(joined) == joined
    assert codes_from_label(joined) == joined
