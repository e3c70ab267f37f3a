"""Mapillary Vistas: one JSON of polygons for each image.

The format, version 2.0: https://www.mapillary.com/dataset/vistas. A polygon counts as the box around it. The
image has the file's own name; ``heigth`` is spelt so in the published files.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin.drives.annotations.formats.json_values import mapping, sequence, size_px, text
from twin.drives.annotations.formats.shapes import (
    AnnotationFile,
    Drawn,
    Gathering,
    Place,
    UnusableShapeError,
    box_around,
    numbers,
    pairs,
)

TOOL = "Mapillary Vistas"


def looks_like_vistas(document: object) -> bool:
    """Whether a JSON document is a Vistas file: objects, the first of which has a polygon."""
    things = sequence(mapping(document).get("objects"))
    return bool(things) and "polygon" in mapping(things[0])


def read_vistas(document: object, where: str) -> AnnotationFile:
    """Read the polygons of one image.

    Parameters
    ----------
    document : object
        Parsed JSON.
    where : str
        File name: that of the image, too.
    """
    found = mapping(document)
    gathering = Gathering(where, TOOL)
    height = found.get("height", found.get("heigth"))
    place = Place(image=where, size_px=size_px(found.get("width"), height))
    for thing in map(mapping, sequence(found.get("objects"))):
        try:
            drawn = _drawn(thing)
        except UnusableShapeError as error:
            gathering.leave_out(error)
            continue
        gathering.add(place, text(thing.get("label")), drawn, {})
    return gathering.file(is_one_image=True)


def _drawn(thing: Mapping[str, Any]) -> Drawn:
    """Return the box around a polygon: rings of points, or of flat numbers."""
    rings = sequence(thing.get("polygon"))
    return box_around(pairs(numbers(*(value for ring in rings for value in sequence(ring)))))
