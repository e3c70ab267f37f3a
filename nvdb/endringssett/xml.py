"""Change sets as XML, the form that API Skriv V3 documents throughout.

Elements that the schema lists in ``xs:all`` may stand in any order. What a reader of XML sees is what counts:
a ``kontekst`` is escaped instead of framed as CDATA, which is the same text.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final
from xml.etree import ElementTree as ET

from nvdb.endringssett.document import Endringssett
from nvdb.endringssett.read_tree import endringssett_from_tree
from nvdb.endringssett.write_tree import decimal_text, tree_from_endringssett
from nvdb.errors import RequestError, SchemaError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

NAMESPACE: Final = "http://nvdb.vegvesen.no/apiskriv/domain/changeset/v3"

_ATTRIBUTES: Final[Mapping[str, frozenset[str]]] = {
    "vegobjekt": frozenset({"typeId", "nvdbId", "tempId", "versjon", "overskriv"}),
    "egenskap": frozenset({"typeId", "operasjon"}),
    "assosiasjon": frozenset({"typeId", "operasjon"}),
    "stedfesting": frozenset({"operasjon"}),
    "punkt": frozenset({"veglenkesekvensNvdbId", "posisjon", "operasjon"}),
    "nvdbId": frozenset({"operasjon"}),
    "tempId": frozenset({"operasjon"}),
}
"""Element → what of it is written as attributes."""
_MEMBER: Final = {
    "vegobjekter": "vegobjekt",
    "egenskaper": "egenskap",
    "assosiasjoner": "assosiasjon",
    "kjørefelt": "felt",
}
"""Element that wraps a list → its members."""
_REPEATED: Final[Mapping[str, frozenset[str]]] = {
    "egenskap": frozenset({"verdi", "enum", "geometri"}),
    "assosiasjon": frozenset({"nvdbId", "tempId"}),
    "stedfesting": frozenset({"punkt"}),
}
"""Element → members that may come several times without a wrapper."""

_NOT_XML = re.compile("[^\t\n\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold even escaped (section 2.2), and the carriage return, which its readers
turn into a new line (2.11)."""


def to_xml(sett: Endringssett) -> bytes:
    """Write a set as an XML document in UTF-8.

    Raises
    ------
    RequestError
        A text holds a character that XML cannot hold.
    """
    root = _element("endringssett", tree_from_endringssett(sett))
    root.set("xmlns", NAMESPACE)
    ET.indent(root)
    body = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n{body}\n'.encode()


def _element(tag: str, value: Any) -> Element:
    made = ET.Element(tag)
    if isinstance(value, Mapping):
        for word, part in value.items():
            if word in _ATTRIBUTES.get(tag, ()):
                made.set(word, _text(part))
            elif word == "verdi" and tag in {"nvdbId", "tempId"}:
                made.text = _text(part)
            elif isinstance(part, list) and word not in _MEMBER:
                made.extend(_element(word, member) for member in part)
            else:
                made.append(_element(word, part))
    elif isinstance(value, list):
        made.extend(_element(_MEMBER[tag], member) for member in value)
    else:
        made.text = _text(value)
    return made


def _text(value: str | int | float) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    text = decimal_text(value) if isinstance(value, float) else str(value)
    if _NOT_XML.search(text):
        msg = f"The text {text[:40]!r} holds a character that XML cannot hold: take it out."
        raise RequestError(msg)
    return text


def from_xml(document: bytes) -> Endringssett:
    """Read a set from XML, its own or another's.

    Raises
    ------
    SchemaError
        Not XML, another document, or one with a part that is not written here (a stretch, a structure).
    """
    root = parse_xml(document, "The change set")
    if local_name(root) != "endringssett":
        msg = f"The document is a {local_name(root)[:40]!r}, not a change set: give an endringssett of V3."
        raise SchemaError(msg)
    return endringssett_from_tree(_tree(root))


def parse_xml(document: bytes, what: str) -> Element:
    """Parse XML that came from outside; no entities, no external references.

    Raises
    ------
    SchemaError
        It is not XML, or holds what is refused.
    """
    import defusedxml.ElementTree
    from defusedxml.common import DefusedXmlException

    try:
        root: Element = defusedxml.ElementTree.fromstring(document)
    except (ET.ParseError, DefusedXmlException, ValueError, LookupError) as error:
        msg = f"{what} is not readable XML ({error}): check where it comes from."
        raise SchemaError(msg) from error
    return root


def local_name(element: Element) -> str:
    """Name of an element without its namespace."""
    return element.tag.rpartition("}")[2]


def _tree(element: Element) -> Any:
    tag = local_name(element)
    if tag in _MEMBER:
        return [_tree(child) for child in element]
    text = element.text or ""
    if tag in {"verdi", "kontekst"}:
        return text
    if tag in {"nvdbId", "tempId"}:
        return {"verdi": text, **element.attrib}
    if not len(element) and not element.attrib:
        return text.strip() or None
    tree: dict[str, Any] = dict(element.attrib)
    for child in element:
        word, part = local_name(child), _tree(child)
        if word in _REPEATED.get(tag, ()):
            tree.setdefault(word, []).append(part)
        elif word in tree:
            msg = f"The change set has {word} twice in one {tag}: it belongs there once."
            raise SchemaError(msg)
        else:
            tree[word] = part
    return tree
