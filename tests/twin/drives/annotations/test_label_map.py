"""Labels and what they mean."""

from __future__ import annotations

import tomllib
from importlib.resources import files

import pytest

from nvdb.datakatalog import snapshot
from twin.drives.annotations.labels import (
    LABELS_FILE,
    Meaning,
    default_label_map,
    plain_label,
    read_label_map,
)
from twin.errors import DriveError

OWN = b"""
foot_keypoints = ["fundament"]
[labels]
"Speed 50" = "362.50"
"speed_and-hump" = ["362.50", "808.105"]
"guard rail end" = { type = 14 }
"object--*" = "ignore"
"object--support--*" = { type = 14 }
"object--support--pole" = "202"
"*--left--*" = "906V"
"""


@pytest.mark.parametrize(
    ("label", "meaning"),
    [
        ("Speed 50", Meaning("362.50")),
        (" speed-50 ", Meaning("362.50")),
        ("SPEED_50", Meaning("362.50")),
        ("speed and hump", Meaning("362.50;808.105")),
        ("Guard rail end", Meaning(nvdb_type=14)),
        ("object--vehicle--car", Meaning(is_ignored=True)),
        ("object--support--wall", Meaning(nvdb_type=14)),
        ("object--support--pole", Meaning("202")),
        ("warning--left--g1", Meaning("906V")),
        ("left", None),
        ("speed 500", None),
        ("", None),
    ],
)
def test_label_is_looked_up_whole_then_by_the_longest_pattern(label: str, meaning: Meaning | None) -> None:
    """Case, blanks, hyphens and underscores do not matter."""
    assert read_label_map(OWN).of(label) == meaning


def test_label_map_adds_names_of_the_foot() -> None:
    """They are beside the labels."""
    assert read_label_map(OWN).foot_keypoints == ("fundament",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[labels", "not valid TOML"),
        ("\xff", "not UTF-8"),
        ('"Speed 50" = "362.50"', "unknown key Speed 50: labels belong under"),
        ("labels = 3", "must be a table"),
        ("foot_keypoints = 3", "must be a list of names"),
        ('[labels]\na = "fifty"', "maps 'a' to 'fifty': write a sign code"),
        ('[labels]\na = ["362.50", "x"]', "write a sign code"),
        ("[labels]\na = []", "write a sign code"),
        ("[labels]\na = 362.50", "write a sign code"),
        ("[labels]\na = { typ = 14 }", "write a sign code"),
        ("[labels]\na = { type = 96 }", "that is a sign"),
        ("[labels]\na = { type = true }", "must be an NVDB type"),
        ("[labels]\na = { type = 123456 }", "must be an NVDB type"),
    ],
)
def test_label_map_that_is_wrong_is_refused_with_its_cure(text: str, message: str) -> None:
    """The sentence names the file and the label."""
    with pytest.raises(DriveError, match=message) as caught:
        read_label_map(text.encode("latin-1"))
    assert LABELS_FILE in str(caught.value)


@pytest.mark.parametrize(
    ("label", "codes"),
    [
        ("regulatory--maximum-speed-limit-50--g1", "362.50"),
        ("regulatory--maximum-speed-limit-110--g3", "362.110"),
        ("regulatory--end-of-maximum-speed-limit-30--g2", "364.30"),
        ("Speed limit (80km/h)", "362.80"),
        ("regulatory--stop--g1", "204"),
        ("regulatory--yield--g1", "202"),
        ("Give_way", "202"),
        ("regulatory--no-entry--g1", "302"),
        ("regulatory--priority-road--g4", "206"),
        ("regulatory--keep-right--g1", "404.1"),
        ("information--pedestrians-crossing--g1", "516"),
    ],
)
def test_default_labels_are_norwegian_signs(label: str, codes: str) -> None:
    """Names of Mapillary, of GTSRB, and plain English."""
    meaning = default_label_map().of(label)
    assert meaning is not None
    assert meaning.codes == codes


@pytest.mark.parametrize(
    "label", ["regulatory--stop-here-on-red-or-flashing-light--g1", "sign", "pole", "stopp"]
)
def test_default_labels_do_not_guess(label: str) -> None:
    """A name that only looks like a known one means nothing."""
    assert default_label_map().of(label) is None


def test_default_sign_codes_are_known_to_nvdb() -> None:
    """Every code above the second comment stands in the datakatalog's snapshot of Skiltnummer."""
    text = files("twin.drives.annotations").joinpath("labels_default.toml").read_text(encoding="utf-8")
    confirmed, _, regulation = text.partition("# Not in the part of the datakatalog")
    known = {str(value).split(" ")[0] for value in snapshot().egenskapstyper[5530].verdier.values()}
    codes = set(tomllib.loads(confirmed)["labels"].values())
    assert len(codes) > 30
    assert codes <= known
    others = set(tomllib.loads("[labels]\n" + regulation.partition("\n")[2])["labels"].values()) - {"ignore"}
    assert not others & known


def test_labels_are_spelt_plainly() -> None:
    """Runs of blanks, hyphens and underscores are one blank."""
    assert plain_label("  Regulatory--Stop__g1 ") == "regulatory stop g1"
