"""labelme: one JSON for each image.

The format: https://github.com/wkentaro/labelme. A ``point`` is a foot; a ``rectangle``, ``polygon``,
``circle`` or ``mask`` (by its corners) is a face; lines are neither, unless ``labels.toml`` says that their
label lies on the ground, where a polygon counts by its corners. ``group_id`` ties shapes together, in
one image and, where the annotator kept the numbers, across images: it is the track. ``description`` is what
is written on the sign: labelme has no other place for it. The picture that may be embedded is not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from twin.drives.annotations.formats.json_values import key, mapping, sequence, size_px, text, texts
from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    Pixel,
    Shape,
    UnusableShapeError,
    area_at,
    box_around,
    foot_at,
    line_at,
    numbers,
    of_kind,
)

TOOL = "labelme"


def looks_like_labelme(document: object) -> bool:
    """Whether a JSON document is a labelme file: shapes, and the name of their image."""
    top = mapping(document)
    return isinstance(top.get("shapes"), list) and "imagePath" in top


def read_labelme(document: object, where: str, hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read the annotations of one image; its name is the file's where that is not given."""
    file, top = AnnotationFile(where, TOOL), mapping(document)
    image, size = text(top.get("imagePath")) or where, size_px(top.get("imageWidth"), top.get("imageHeight"))
    for drawn in map(mapping, sequence(top.get("shapes"))):
        with file.counting():
            file.shapes.append(
                replace(
                    _shape(drawn, hints),
                    label=text(drawn.get("label")),
                    attributes={"text": text(drawn.get("description")), **texts(drawn.get("flags"))},
                    track=key(drawn.get("group_id")),
                    image=image,
                    size_px=size,
                )
            )
    return file


def _shape(drawn: Mapping[str, Any], hints: Hints) -> Shape:
    kind = text(drawn.get("shape_type")) or "polygon"  # files older than version 4 knew nothing else
    points = _points(drawn)
    if kind == "point" and len(points) == 1:
        return foot_at(*points[0])
    if kind == "polygon" and len(points) >= 2:
        return area_at(points)
    if kind in {"line", "linestrip"} and hints.on_ground(text(drawn.get("label"))):
        return line_at(points)
    if kind in {"rectangle", "mask"} and len(points) >= 2:
        return box_around(points)
    if kind == "circle" and len(points) == 2:
        (x, y), edge = points[0], points[1]
        radius = math.dist(points[0], edge)
        return box_around([(x - radius, y - radius), (x + radius, y + radius)])
    raise of_kind(kind)


def _points(drawn: Mapping[str, Any]) -> list[Pixel]:
    points = [numbers(*sequence(point)) for point in sequence(drawn.get("points"))]
    if not all(len(point) == 2 for point in points):
        raise UnusableShapeError("coordinates unreadable")
    return [(x, y) for x, y in points]
