"""The default QGIS style of each exported layer: the files in ``saved_styles/``, as QGIS 3.22 saves them.

They hold what QGIS writes with *Save Style*, less what equals its defaults; QGIS 3.16 and later read them.
Options stand twice, as ``Option`` (QGIS ≥ 3.22) and as ``prop`` (older), as QGIS 3.22 does. To change one,
edit the file, or load it in QGIS and save it there. A test holds colours, shapes, sizes and labels against
:mod:`twin.export.appearance` and :data:`twin.export.layers.COLUMNS`.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from nvdb.datakatalog import SKILTPLATE, SKILTPUNKT
from twin.export.layers import COLUMNS
from twin.store.kinds import Decision, Verdict
from twin.words import Lang, messages, nvdb_type_title, say, verdict_title

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

DOCTYPE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>"


def style(layer: str, *, verdicts: Collection[str], lang: Lang = Lang.EN) -> str:
    """QML document of a layer.

    Parameters
    ----------
    layer : str
        A key of :data:`twin.export.layers.COLUMNS`.
    verdicts : collection of str
        The verdicts that occur in the layer: the legends of ``changes`` and ``moves`` show these, or all
        where there is none.
    lang : Lang, optional
        Of what people read: names of columns, legends and choices.
    """
    return _style(layer, frozenset(verdicts), lang)


@cache
def _style(layer: str, verdicts: frozenset[str], lang: Lang) -> str:
    """Make it once: an export writes it into two files."""
    from defusedxml.ElementTree import fromstring

    root = fromstring(files("twin.export.qgis").joinpath("saved_styles", f"{layer}.qml").read_text("utf-8"))
    for element in root.iter():
        # The lines and indents of the file are for its readers.
        element.tail = None
        if not (element.text or "").strip():
            element.text = None
    renderer = root.find("renderer-v2")
    if renderer is not None and renderer.get("attr") == "verdict":
        _keep_categories(renderer, verdicts)
    if lang is not Lang.EN:
        _translate(root, layer, lang)
    return f"{DOCTYPE}\n{ET.tostring(root, encoding='unicode')}\n"


def _translate(root: Element, layer: str, lang: Lang) -> None:
    """Put another language in the place of the file's English; its values stay what they are."""
    labels = {column.name: column.label_in(lang) for column in COLUMNS[layer]}
    for alias in root.iter("alias"):
        alias.set("name", labels.get(alias.get("field", ""), alias.get("name", "")))
    for category in root.iter("category"):
        value = category.get("value")
        category.set("label", _legend(layer, value or "other", lang))
    choices = {
        "verdict": {verdict.value: _begun(verdict_title(verdict, lang)) for verdict in Verdict},
        "decision": {decision.value: say(lang, f"decide.{decision.value}") for decision in Decision},
    }
    for box in root.iter("attributeEditorContainer"):
        box.set("name", say(lang, f"qgis.box.{box.get('name', '').lower()}"))
    _translate_map_tip(root, f"qgis.tip.{layer}.", lang)
    for field in root.iter("field"):
        for option in field.iter("Option"):
            shown = choices.get(field.get("name", ""), {}).get(option.get("value", ""))
            if shown is not None:
                option.set("name", shown)


def _translate_map_tip(root: Element, phrases: str, lang: Lang) -> None:
    """Put phrases in the place of those of the file, which stand once each between names of columns."""
    tip, texts = root.find("mapTip"), messages(lang, phrases)
    if tip is not None and tip.text:
        for key, english in messages(Lang.EN, phrases).items():
            tip.text = tip.text.replace(english, texts[key])


def _legend(layer: str, value: str, lang: Lang) -> str:
    if value in set(Verdict):
        return _begun(verdict_title(value, lang))
    # Skiltpunkt and Skiltplate are the database's own nouns.
    is_type = value in {str(SKILTPUNKT), str(SKILTPLATE)}
    return nvdb_type_title(int(value)) if is_type else say(lang, f"qgis.legend.{layer}.{value}")


def _begun(text: str) -> str:
    """With a capital, as a label of its own."""
    return text[:1].upper() + text[1:]


def _keep_categories(renderer: Element, verdicts: Collection[str]) -> None:
    """Leave the given categories in the legend, and one for any other value; all where none is given."""
    categories, symbols = renderer.find("categories"), renderer.find("symbols")
    if categories is None or symbols is None:
        return
    shown = {category.get("value") for category in categories} & set(verdicts)
    for category, symbol in zip(list(categories), list(symbols), strict=True):
        if shown and category.get("value") not in {"", *shown}:
            categories.remove(category)
            symbols.remove(symbol)
    # A category names its symbol by number.
    for number, (category, symbol) in enumerate(zip(categories, symbols, strict=True)):
        category.set("symbol", str(number))
        symbol.set("name", str(number))
