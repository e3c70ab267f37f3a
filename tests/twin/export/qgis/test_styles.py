"""The QGIS styles as documents; tests/twin/export/qgis/test_layers_in_qgis.py lets QGIS itself read them."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from twin.export.appearance import DRIVE_COLOUR, ESTIMATE_COLOUR, MARKS, NVDB_COLOUR
from twin.export.layers import COLUMNS
from twin.export.qgis.qml import style
from twin.store.kinds import Decision, Verdict
from twin.words import Lang, messages

ALL = list(Verdict)

# Machado, Oliveira & Fernandes (2009), doi 10.1109/TVCG.2009.113, severity 1.0, for linear RGB.
SIGHT = {
    "full": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.01182, 0.04294, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.3039],
    ],
}


def _cielab(colour: str, sight: str) -> np.ndarray:
    """CIELAB (D65) of an sRGB colour as an eye sees it."""
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.asarray(SIGHT[sight]) @ linear, 0, 1)
    to_xyz = [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.072175],
        [0.0193339, 0.119192, 0.9503041],
    ]
    xyz = np.asarray(to_xyz) @ seen / [0.95047, 1.0, 1.08883]
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SIGHT)
def test_verdict_colours_stay_apart_for_every_eye(sight: str) -> None:
    """No two verdicts come closer than 15 in CIELAB (2.3 is just noticeable), whatever the colour vision."""
    lab = {mark.verdict: _cielab(mark.colour, sight) for mark in MARKS}
    closest = min(float(np.linalg.norm(lab[a] - lab[b])) for a, b in itertools.combinations(lab, 2))
    assert closest > 15


SHAPES = {
    "o": ("circle", "0"),
    "s": ("square", "0"),
    "^": ("triangle", "0"),
    "D": ("diamond", "0"),
    "P": ("cross_fill", "0"),
    "X": ("cross_fill", "45"),
}
"""Matplotlib's name of a shape → QGIS's, and its rotation in degrees."""


def drawn(layer: str) -> dict[tuple[str, str], dict[str, str]]:
    """Value and label of a style's categories → what their symbols are drawn with."""
    renderer = fromstring(style(layer, verdicts=ALL)).find("renderer-v2")
    symbols = {symbol.get("name"): symbol for symbol in renderer.find("symbols")}
    return {
        (category.get("value"), category.get("label")): {
            prop.get("k"): prop.get("v") for prop in symbols[category.get("symbol")].iter("prop")
        }
        for category in renderer.find("categories")
    }


def rgba(colour: str, alpha: int = 255) -> str:
    """``#rrggbb`` as QGIS writes it."""
    return ",".join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5)) + f",{alpha}"


def test_styles_draw_verdicts_as_the_picture_does() -> None:
    """Colour, shape and size of a mark, colour and width of a move; what matters most comes first."""
    changes, moves = drawn("changes"), drawn("moves")
    assert list(changes) == [*((m.verdict, m.label) for m in reversed(MARKS)), ("", "Other")]
    assert list(moves) == [(m.verdict, m.label) for m in reversed(MARKS)]
    for mark in MARKS:
        one, line = changes[mark.verdict, mark.label], moves[mark.verdict, mark.label]
        assert (one["color"], float(one["size"])) == (rgba(mark.colour), mark.size_mm)
        assert (one["name"], one["angle"]) == SHAPES[mark.mpl_marker]
        width = pytest.approx(0.2 * mark.size_mm)
        assert (line["line_color"], float(line["line_width"])) == (rgba(mark.colour), width)
    assert changes["", "Other"]["outline_color"] == rgba("#000000")


@pytest.mark.parametrize("layer", ["changes", "moves"])
def test_styles_draw_what_matters_most_last(layer: str) -> None:
    """In the order of the marks; labels of the verdicts are those of the legend."""
    root = fromstring(style(layer, verdicts=ALL))
    order = " ".join(f"WHEN '{mark.verdict}' THEN {number}" for number, mark in enumerate(MARKS))
    assert (
        root.findtext("renderer-v2/orderby/orderByClause") == f'CASE "verdict" {order} ELSE {len(MARKS)} END'
    )
    widget = root.find("fieldConfiguration/field[@name='verdict']/editWidget")
    options = [(o.get("value"), o.get("name")) for o in widget.iter("Option") if o.get("value")]
    assert options == [(mark.verdict, mark.label) for mark in MARKS]


@pytest.mark.parametrize(
    ("layer", "name", "colour"),
    [
        ("estimates", "outline_color", ESTIMATE_COLOUR),
        ("ellipses", "outline_color", ESTIMATE_COLOUR),
        ("nvdb_signs", "outline_color", NVDB_COLOUR),
        ("drives", "line_color", DRIVE_COLOUR),
    ],
)
def test_styles_have_the_colours_of_the_picture(layer: str, name: str, colour: str) -> None:
    """Of the layers beside the findings."""
    symbols = list(drawn(layer).values())
    if layer == "estimates":
        dot = symbols.pop(0)  # filled, with a white rim
        assert (dot["color"], dot["outline_color"]) == (rgba(colour), rgba("#ffffff"))
    assert {symbol[name] for symbol in symbols} == {rgba(colour)}


def test_unchanged_is_the_smallest_mark() -> None:
    """What needs no decision steps back on the map."""
    assert min(MARKS, key=lambda mark: mark.size_mm).verdict == Verdict.UNCHANGED


@pytest.mark.parametrize("layer", COLUMNS)
def test_style_is_well_formed_and_names_every_field(layer: str) -> None:
    """The QML parses, and every column has its label at its place after the fid."""
    root = fromstring(style(layer, verdicts=ALL))
    aliases = [(alias.get("field"), alias.get("index"), alias.get("name")) for alias in root.iter("alias")]
    assert aliases == [
        (column.name, str(i), column.label) for i, column in enumerate(COLUMNS[layer], start=1)
    ]
    assert root.findtext("mapTip")


@pytest.mark.parametrize(("layer", "fallback"), [("changes", [""]), ("moves", [])])
def test_style_draws_the_verdicts_that_occur(layer: str, fallback: list[str]) -> None:
    """The legend shows the verdicts in the data, of changes also a fallback; all where there is no data."""
    some = fromstring(style(layer, verdicts=["moved", "unchanged"]))
    assert [c.get("value") for c in some.iter("category")] == ["moved", "unchanged", *fallback]
    none = fromstring(style(layer, verdicts=[]))
    assert {c.get("value") for c in none.iter("category")} == {*ALL, *fallback}


def test_form_of_changes_has_every_field_where_it_comes_from_last() -> None:
    """A person decides at the top, beside the pictures; where it comes from stands below."""
    fields = [f.get("name") for f in fromstring(style("changes", verdicts=ALL)).iter("attributeEditorField")]
    assert sorted(fields) == sorted(column.name for column in COLUMNS["changes"])
    assert fields[:5] == ["decision", "comment", "author", "crop_face", "crop_wide"]
    assert fields[-4:] == ["cameras", "synced_at", "software", "config_sha256"]


def test_style_of_changes_lets_only_the_answer_be_edited() -> None:
    """Findings are read-only; the decision is chosen from its four values, comment and author are free."""
    root = fromstring(style("changes", verdicts=ALL))
    assert [f.get("name") for f in root.find("editable") if f.get("editable") == "1"] == [
        "decision",
        "comment",
        "author",
    ]
    widget = root.find("fieldConfiguration/field[@name='decision']/editWidget")
    assert widget.get("type") == "ValueMap"
    assert [o.get("value") for o in widget.iter("Option") if o.get("value")] == list(Decision)


@pytest.mark.parametrize("layer", COLUMNS)
def test_map_tip_uses_fields_of_its_layer(layer: str) -> None:
    """Every quoted name in a map tip is a column, and no notation is left over."""
    tip = fromstring(style(layer, verdicts=ALL)).findtext("mapTip")
    quoted = {
        part for expression in tip.split("[%")[1:] for part in expression.split("%]")[0].split('"')[1::2]
    }
    assert quoted <= {column.name for column in COLUMNS[layer]}
    assert "{" not in tip


@pytest.mark.parametrize("layer", sorted(COLUMNS))
def test_map_tip_has_no_english_left_in_norwegian(layer: str) -> None:
    """Each word outside the names of columns is said in Norwegian; columns and functions are the same."""
    english, norsk = (fromstring(style(layer, verdicts=ALL, lang=lang)).findtext("mapTip") for lang in Lang)
    phrases = messages(Lang.EN, f"qgis.tip.{layer}.").values()
    assert [english.count(phrase) for phrase in phrases] == [1] * len(phrases)
    assert re.findall(r'"\w+"|\w+[(]', norsk) == re.findall(r'"\w+"|\w+[(]', english)
    shown = (re.sub(r"\[%.*?%\]|<.*?>", "", tip) for tip in (english, norsk))
    told = (set(re.findall("[A-Za-zæøå]{3,}", text)) for text in shown)
    in_both = set.intersection(*told) - {
        "NVDB",
        "UTC",
        "CEP",
        "nbsp",
        "ellipse",
    }
    assert in_both == set()


@pytest.mark.parametrize("layer", sorted(COLUMNS))
def test_norwegian_style_says_everything_in_norwegian_and_decides_the_same(layer: str) -> None:
    """Names of columns, legends and choices are others; fields and values are those of the English file."""
    english, norsk = (fromstring(style(layer, verdicts=ALL, lang=lang)) for lang in Lang)
    shown = {"alias": "name", "category": "label", "attributeEditorContainer": "name"}
    for one, other in zip(english.iter(), norsk.iter(), strict=True):
        spoken = shown.get(one.tag, "name" if one.tag == "Option" else "")
        assert {k: v for k, v in one.items() if k != spoken} == {
            k: v for k, v in other.items() if k != spoken
        }
    aliases = {alias.get("field"): alias.get("name") for alias in norsk.iter("alias")}
    assert aliases == {c.name: c.label_in(Lang.NB) for c in COLUMNS[layer]}
    if layer == "changes":
        choices = {one.get("value"): one.get("name") for one in norsk.iter("Option")}
        assert (choices["accept"], choices["wrong_type"]) == ("Godta", "Feil skilttype")
        assert {one.get("label") for one in norsk.iter("category")} >= {"Mangler", "Er flyttet", "Annet"}
