"""Mapillary Vistas: one JSON of polygons for each image.

The format, version 2.0: https://www.mapillary.com/dataset/vistas. A polygon counts as the box around it. The
image has the file's own name; ``heigth`` is spelt so in the published files.
"""

from __future__ import annotations

from dataclasses import replace

from twin.drives.annotations.formats.json_values import mapping, sequence, size_px, text
from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    box_around,
    numbers,
    pairs,
)

TOOL = "Mapillary Vistas"


def looks_like_vistas(document: object) -> bool:
    """Whether a JSON document is a Vistas file: objects, the first of which has a polygon."""
    things = sequence(mapping(document).get("objects"))
    return bool(things) and "polygon" in mapping(things[0])


def read_vistas(document: object, where: str, _hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read the polygons of one image: rings of points, or of flat numbers."""
    file, top = AnnotationFile(where, TOOL), mapping(document)
    size = size_px(top.get("width"), top.get("height", top.get("heigth")))
    for thing in map(mapping, sequence(top.get("objects"))):
        with file.counting():
            rings = sequence(thing.get("polygon"))
            shape = box_around(pairs(numbers(*(value for ring in rings for value in sequence(ring)))))
            file.shapes.append(replace(shape, label=text(thing.get("label")), image=where, size_px=size))
    return file
