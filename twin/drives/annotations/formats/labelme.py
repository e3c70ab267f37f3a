"""labelme: one JSON for each image.

The format: https://github.com/wkentaro/labelme. A ``point`` is a foot; a ``rectangle``, ``polygon``,
``circle`` or ``mask`` (by its corners) is a face; lines are neither. ``group_id`` ties shapes together, in
one image and, where the annotator kept the numbers, across images: it is the track. ``description`` is what
is written on the sign: labelme has no other place for it. The picture that may be embedded is not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from twin.drives.annotations.formats.json_values import key, mapping, sequence, size_px, text, texts
from twin.drives.annotations.formats.shapes import (
    AnnotationFile,
    Drawn,
    Gathering,
    Pixel,
    Place,
    UnusableShapeError,
    box_around,
    foot_at,
    numbers,
    of_kind,
)

TOOL = "labelme"


def looks_like_labelme(document: object) -> bool:
    """Whether a JSON document is a labelme file: shapes, and the name of their image."""
    found = mapping(document)
    return isinstance(found.get("shapes"), list) and "imagePath" in found


def read_labelme(document: object, where: str) -> AnnotationFile:
    """Read the annotations of one image.

    Parameters
    ----------
    document : object
        Parsed JSON.
    where : str
        File name, for messages, and for the image's where that is not given.
    """
    found = mapping(document)
    gathering = Gathering(where, TOOL)
    place = Place(
        image=text(found.get("imagePath")) or where,
        size_px=size_px(found.get("imageWidth"), found.get("imageHeight")),
    )
    for shape in map(mapping, sequence(found.get("shapes"))):
        try:
            drawn = _drawn(shape)
        except UnusableShapeError as error:
            gathering.leave_out(error)
            continue
        place_of_shape = place._replace(track=key(shape.get("group_id")))
        about = {"text": text(shape.get("description")), **texts(shape.get("flags"))}
        gathering.add(place_of_shape, text(shape.get("label")), drawn, about)
    return gathering.file(is_one_image=True)


def _drawn(shape: Mapping[str, Any]) -> Drawn:
    kind = text(shape.get("shape_type")) or "polygon"  # files older than version 4 knew nothing else
    points = _points(shape)
    if kind == "point" and len(points) == 1:
        return foot_at(*points[0])
    if kind in {"rectangle", "polygon", "mask"} and len(points) >= 2:
        return box_around(points)
    if kind == "circle" and len(points) == 2:
        (x, y), edge = points[0], points[1]
        radius = math.dist(points[0], edge)
        return box_around([(x - radius, y - radius), (x + radius, y + radius)])
    raise of_kind(kind)


def _points(shape: Mapping[str, Any]) -> list[Pixel]:
    points = [numbers(*sequence(point)) for point in sequence(shape.get("points"))]
    if not all(len(point) == 2 for point in points):
        raise UnusableShapeError("coordinates unreadable")
    return [(x, y) for x, y in points]
