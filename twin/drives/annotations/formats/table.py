"""Every annotation format: what it is called, how it is recognised and how it is read.

A new format is a module beside this one and a line in `FORMATS`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from twin.drives.annotations.formats import (
    coco,
    cvat,
    datumaro,
    frame_lines,
    labelme,
    labelme_xml,
    labelstudio,
    plain_csv,
    vistas,
    yolo,
)
from twin.drives.annotations.formats.json_values import parse_json
from twin.drives.annotations.formats.shapes import NO_HINTS, AnnotationFile, Hints
from twin.errors import DriveError

JSON, XML = ".json", ".xml"
LARGEST_JSON_BYTES = 200_000_000
"""JSON takes some ten times its size in memory: a million boxes stay below this."""
_XML_BEGINS = re.compile(rb"(?:\xef\xbb\xbf|\xff\xfe|\xfe\xff)?[\s\0]*<")


class AnnotationFormat(NamedTuple):
    """One format.

    Attributes
    ----------
    tool : str
        What :attr:`.shapes.AnnotationFile.tool` says of its files.
    name : str
        In messages.
    suffix : str
        What `suffix_of` gives for its files.
    is_it : callable
        Whether a file is of this format, by its first bytes; in JSON, by the parsed document.
    read : callable
        Takes the bytes, in JSON the parsed document, the file's name (for messages, and as the image's where
        a file is of one image and does not name it), and `Hints`.
    is_one_image : bool
        Whether the tool writes one such file for each image.
    keys : tuple of str
        Of JSON: keys of which the beginning of a file shows one. Others are not parsed: they may be large.
    """

    tool: str
    name: str
    suffix: str
    is_it: Callable[[Any], bool]
    read: Callable[[Any, str, Hints], AnnotationFile]
    is_one_image: bool = False
    keys: tuple[str, ...] = ()


FORMATS = (
    AnnotationFormat(cvat.TOOL, "CVAT XML 1.1", XML, cvat.is_cvat, cvat.read_cvat),
    AnnotationFormat(
        coco.TOOL,
        "COCO",
        JSON,
        coco.looks_like_coco,
        coco.read_coco,
        keys=("images", "annotations", "categories"),
    ),
    AnnotationFormat(
        labelstudio.TOOL,
        "Label Studio",
        JSON,
        labelstudio.looks_like_labelstudio,
        labelstudio.read_labelstudio,
        keys=("annotations", "completions", "result", "annotation_id"),
    ),
    AnnotationFormat(
        labelme.TOOL,
        "labelme",
        JSON,
        labelme.looks_like_labelme,
        labelme.read_labelme,
        is_one_image=True,
        keys=("shapes", "imageData", "imagePath"),
    ),
    AnnotationFormat(yolo.TOOL, "YOLO", ".txt", yolo.looks_like_yolo, yolo.read_yolo, is_one_image=True),
    AnnotationFormat(
        datumaro.TOOL,
        "Datumaro",
        JSON,
        datumaro.looks_like_datumaro,
        datumaro.read_datumaro,
        keys=("items", "categories"),
    ),
    AnnotationFormat(
        vistas.TOOL,
        "Mapillary Vistas",
        JSON,
        vistas.looks_like_vistas,
        vistas.read_vistas,
        is_one_image=True,
        keys=("objects",),
    ),
    AnnotationFormat(
        labelme_xml.TOOL,
        "LabelMe XML",
        XML,
        labelme_xml.looks_like_labelme_xml,
        labelme_xml.read_labelme_xml,
        True,
    ),
    AnnotationFormat(
        frame_lines.TOOL,
        "JSON lines",
        frame_lines.SUFFIX,
        frame_lines.looks_like_frame_lines,
        frame_lines.read_frame_lines,
    ),
    AnnotationFormat(
        plain_csv.TOOL, "CSV", ".csv", plain_csv.looks_like_annotations_csv, plain_csv.read_annotations_csv
    ),
)
NAMES = f"{', '.join(one.name for one in FORMATS[:-1])} or {FORMATS[-1].name}"
"""For people."""
SUFFIXES = tuple({one.suffix: None for one in FORMATS})
MAY_ANNOTATE = re.compile(rb'"(?:%s)"\s*:' % b"|".join(key.encode() for one in FORMATS for key in one.keys))
"""Finds a key of any format in the beginning of a JSON file."""
ONE_IMAGE = frozenset(one.tool for one in FORMATS if one.is_one_image)
"""Tools that write one file for each image."""


def suffix_of(name: str, head: bytes) -> str:
    """Suffix of a file's name, in lower case; ``.xml`` for whatever begins as XML, in any Unicode encoding.

    XML is called ``.txt`` by browsers that save what they show.
    """
    return XML if _XML_BEGINS.match(head) else PurePosixPath(name).suffix.lower()


def format_of(suffix: str, beginning: Any) -> AnnotationFormat | None:
    """Return the format of a file; None if it is none of the table.

    Parameters
    ----------
    suffix : str
        As `suffix_of` gives it.
    beginning : bytes or object
        Its first bytes; of JSON, the parsed document.
    """
    return next((one for one in FORMATS if one.suffix == suffix and one.is_it(beginning)), None)


def read_annotation_json(content: bytes, where: str, hints: Hints = NO_HINTS) -> AnnotationFile | None:
    """Read a JSON export of whichever tool wrote it; None if it is none of the table.

    Raises
    ------
    DriveError
        If it is larger than an export may be, or is not JSON.
    """
    if len(content) > LARGEST_JSON_BYTES:
        raise DriveError(
            f"{where} is {len(content) / 1e6:.0f} MB, more than the {LARGEST_JSON_BYTES / 1e6:.0f} MB that a"
            " JSON of annotations may have: export it in parts."
        )
    document = parse_json(content, where)
    its = format_of(JSON, document)
    return None if its is None else its.read(document, where, hints)
