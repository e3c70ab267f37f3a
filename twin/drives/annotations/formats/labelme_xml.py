"""LabelMe, the web tool: one XML for each image.

The format: http://labelme.csail.mit.edu/Release3.0/. A polygon or a segment's box is a face; the tool draws
no points. Deleted objects stay in the file, marked as such. CVAT and Datumaro write ``name=value, …`` where
the tool has one free text.
"""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree.ElementTree import ParseError  # only the exception: parsing goes through defusedxml

from twin.drives.annotations.formats.cvat import root_tag
from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    Shape,
    UnusableShapeError,
    area_at,
    box_at,
    numbers,
)
from twin.errors import DriveError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

TOOL = "LabelMe"


def looks_like_labelme_xml(head: bytes) -> bool:
    """Whether the beginning of a file is that of a LabelMe annotation with objects by polygon or segment."""
    plain = head.replace(b"\0", b"")  # also in UTF-16
    return root_tag(head) == "annotation" and (b"<polygon" in plain or b"<segm" in plain)


def read_labelme_xml(content: bytes, where: str, _hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read the annotations of one image.

    Raises
    ------
    DriveError
        If it is not well-formed XML, declares a DTD or entities, or is no LabelMe annotation.
    """
    root = _root(content, where)
    if root.tag != "annotation":
        raise DriveError(f"{where} is no LabelMe annotation: its root is <{root.tag:.40}>.")
    file = AnnotationFile(where, TOOL)
    image, size = _text(root, "filename") or where, _size(root.find("imagesize"))
    for thing in root.iter("object"):
        if _text(thing, "deleted") == "1":
            continue
        with file.counting():
            attributes = _attributes(thing)
            file.shapes.append(
                replace(
                    _shape(thing),
                    label=_text(thing, "name"),
                    attributes=attributes,
                    image=image,
                    size_px=size,
                )
            )
    return file


def _attributes(thing: Element) -> dict[str, str]:
    written = _text(thing, "attributes")
    named = (part.partition("=") for part in written.split(",") if "=" in part)
    return {"attributes": written} | {name.strip(): value.strip() for name, _, value in named}


def _root(content: bytes, where: str) -> Element:
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import parse

    try:
        root = parse(io.BytesIO(content), forbid_dtd=True).getroot()
    except DefusedXmlException as error:
        raise DriveError(
            f"{where} declares a document type or entities, which are refused: export it from LabelMe again."
        ) from error
    except (ParseError, ValueError, LookupError) as error:
        raise DriveError(
            f"{where} is not well-formed XML ({error}): export it from LabelMe again."
        ) from error
    if root is None:
        raise DriveError(f"{where} is an empty XML: export it from LabelMe again.")
    return root


def _text(element: Element, name: str) -> str:
    return (element.findtext(name) or "").strip()


def _size(size: Element | None) -> tuple[int, int] | None:
    try:
        pair = (int(_text(size, "ncols")), int(_text(size, "nrows"))) if size is not None else (0, 0)
    except ValueError:
        return None
    return pair if min(pair) > 0 else None


def _shape(thing: Element) -> Shape:
    polygon = thing.find("polygon")
    if polygon is not None:
        corners = [numbers(point.findtext("x"), point.findtext("y")) for point in polygon.iter("pt")]
        return area_at([(x, y) for x, y in corners])
    box = thing.find("segm/box")
    if box is not None:
        return box_at(*numbers(*(box.findtext(edge) for edge in ("xmin", "ymin", "xmax", "ymax"))))
    raise UnusableShapeError("neither polygon nor segment")
