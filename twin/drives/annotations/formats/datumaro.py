"""Datumaro JSON: boxes, points, skeletons and polygons.

The format: https://open-edge-platform.github.io/datumaro/latest/docs/data-formats/formats/datumaro.html.
Boxes are ``[x, y, width, height]`` from the corner of the first pixel; tracks stand in the attribute
``track_id`` (CVAT adds ``keyframe``), the frame of a video in the item's ``attr.frame`` where its name has no
number.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from twin.drives.annotations.formats.json_values import key, mapping, sequence, text, texts, whole
from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    Shape,
    UnusableShapeError,
    area_at,
    box_at,
    foot_at,
    foot_of,
    numbers,
    of_kind,
    pairs,
)

TOOL = "Datumaro"
_NO_SHAPES = ("label", "caption")
"""What is said of the whole image."""


def looks_like_datumaro(document: object) -> bool:
    """Whether a JSON document is a Datumaro export: items beside categories."""
    top = mapping(document)
    return isinstance(top.get("items"), list) and isinstance(top.get("categories"), dict)


@dataclass(frozen=True, slots=True)
class _Categories:
    """Names of the labels, and of the points of each label."""

    labels: list[str]
    points: Mapping[int, list[str]]
    feet: Collection[str]


def read_datumaro(document: object, where: str, hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read one Datumaro document."""
    file, top = AnnotationFile(where, TOOL), mapping(document)
    categories = _categories(mapping(top.get("categories")), hints.feet)
    for item in map(mapping, sequence(top.get("items"))):
        image, number = mapping(item.get("image")), whole(mapping(item.get("attr")).get("frame"))
        for annotation in map(mapping, sequence(item.get("annotations"))):
            kind = text(annotation.get("type"))
            if kind in _NO_SHAPES:
                continue
            with file.counting():
                attributes = texts(annotation.get("attributes"))
                file.shapes.append(
                    replace(
                        _shape(annotation, kind, categories),
                        label=_label(annotation, categories),
                        attributes=attributes,
                        track=attributes.get("track_id", ""),
                        image=text(image.get("path")) or key(item.get("id")),
                        image_id=-1 if number is None else number,
                        size_px=_size_px(image),
                    )
                )
    return file


def _categories(categories: Mapping[str, Any], feet: Collection[str]) -> _Categories:
    labels = [
        text(mapping(one).get("name")) for one in sequence(mapping(categories.get("label")).get("labels"))
    ]
    points = {}
    for one in map(mapping, sequence(mapping(categories.get("points")).get("items"))):
        number = whole(one.get("label_id"))
        if number is not None:
            points[number] = [text(name) for name in sequence(one.get("labels"))]
    return _Categories(labels, points, feet)


def _size_px(image: Mapping[str, Any]) -> tuple[int, int] | None:
    sides = [whole(side) for side in sequence(image.get("size"))]
    height, width = sides if len(sides) == 2 else (None, None)
    return (width, height) if width and height else None


def _label(annotation: Mapping[str, Any], categories: _Categories) -> str:
    number = whole(annotation.get("label_id"))
    return categories.labels[number] if number is not None and number < len(categories.labels) else ""


def _shape(annotation: Mapping[str, Any], kind: str, categories: _Categories) -> Shape:
    points = sequence(annotation.get("points"))
    if kind == "bbox":
        corner = sequence(annotation.get("bbox"))
        if len(corner) != 4:
            raise UnusableShapeError("coordinates unreadable")
        x, y, width, height = numbers(*corner)
        return box_at(x, y, x + width, y + height)
    if kind == "polygon":
        return area_at(pairs(numbers(*points)))
    if kind == "points":
        return _foot([points[k : k + 2] for k in range(0, len(points), 2)], annotation, categories)
    if kind == "skeleton":
        return _foot([points[k : k + 3] for k in range(0, len(points), 3)], annotation, categories)
    raise of_kind(kind)


def _foot(points: Sequence[Any], annotation: Mapping[str, Any], categories: _Categories) -> Shape:
    """Return the foot among points of two or, with their visibility (0: absent), three numbers."""
    number = whole(annotation.get("label_id"))
    names = categories.points.get(-1 if number is None else number, [])
    # A single point is the foot, whatever the points of its label are called.
    which = foot_of(names, categories.feet) if len(points) > 1 else 0
    if which is None or which >= len(points):
        raise UnusableShapeError(
            f"{text(annotation.get('type'))} with {len(points)} points, none of them named foot"
        )
    point = numbers(*points[which])
    if len(point) < 2:
        raise UnusableShapeError("coordinates unreadable")
    if len(point) == 3 and point[2] == 0:
        raise UnusableShapeError("foot not marked")
    return foot_at(point[0], point[1])
