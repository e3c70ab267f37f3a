"""COCO JSON: boxes, keypoints and polygons.

The format: https://cocodataset.org/#format-data. Boxes are ``[x, y, width, height]`` from the corner of the
first pixel. Tracks, which COCO does not know, stand in ``track_id`` of an annotation or of its
``attributes`` (so CVAT writes them, with the attribute ``keyframe``). ``iscrowd`` marks a heap of objects,
which is none. Of what lies on the ground by ``labels.toml`` the polygon counts, not the box.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from twin.drives.annotations.formats.json_values import key, mapping, sequence, size_px, text, texts, whole
from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    Shape,
    UnusableShapeError,
    area_at,
    box_around,
    box_at,
    foot_at,
    foot_of,
    numbers,
    pairs,
)

TOOL = "COCO"


def looks_like_coco(document: object) -> bool:
    """Whether a JSON document is a COCO export: images and annotations side by side."""
    top = mapping(document)
    return isinstance(top.get("images"), list) and isinstance(top.get("annotations"), list)


def read_coco(document: object, where: str, hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read one COCO document."""
    file, top = AnnotationFile(where, TOOL), mapping(document)
    images = {key(image.get("id")): image for image in map(mapping, sequence(top.get("images")))}
    categories = {key(one.get("id")): one for one in map(mapping, sequence(top.get("categories")))}
    for annotation in map(mapping, sequence(top.get("annotations"))):
        with file.counting():
            image = images.get(key(annotation.get("image_id")))
            category = categories.get(key(annotation.get("category_id")), {})
            if image is None:
                raise UnusableShapeError("image that is not listed")
            shape = _shape(annotation, category, hints)
            attributes = texts(annotation.get("attributes"))
            number = whole(image.get("id"))
            file.shapes.append(
                replace(
                    shape,
                    label=text(category.get("name")),
                    attributes=attributes,
                    track=key(annotation.get("track_id")) or attributes.get("track_id", ""),
                    image=text(image.get("file_name")),
                    image_id=-1 if number is None else number,
                    size_px=size_px(image.get("width"), image.get("height")),
                )
            )
    return file


def _shape(annotation: Mapping[str, Any], category: Mapping[str, Any], hints: Hints) -> Shape:
    if annotation.get("iscrowd") == 1:
        raise UnusableShapeError("a crowd, not one object")
    keypoints = sequence(annotation.get("keypoints"))
    if keypoints:
        return _foot(keypoints, [text(name) for name in sequence(category.get("keypoints"))], hints.feet)
    if hints.on_ground(text(category.get("name"))):
        return _area(sequence(annotation.get("segmentation")))
    corner = sequence(annotation.get("bbox"))
    if len(corner) == 4:
        x, y, width, height = numbers(*corner)
        return box_at(x, y, x + width, y + height)
    segments = annotation.get("segmentation")
    if isinstance(segments, list) and segments:
        flat = [value for segment in segments for value in sequence(segment)]
        return box_around(pairs(numbers(*flat)))
    raise UnusableShapeError("neither box nor keypoints")


def _area(parts: Sequence[Any]) -> Shape:
    """Return the polygon of what lies on the ground; a mask (run lengths) has no corners."""
    if len(parts) != 1:
        raise UnusableShapeError(
            "what lies on the ground without one polygon: annotate it as one, and several parts as several"
            " objects"
        )
    return area_at(pairs(numbers(*sequence(parts[0]))))


def _foot(keypoints: Any, names: list[str], feet: Collection[str]) -> Shape:
    """Return the foot among ``x, y, visibility`` triples; visibility 0 is a point that was not marked."""
    triples = [keypoints[k : k + 3] for k in range(0, len(keypoints) - 2, 3)]
    which = foot_of(names or [""] * len(triples), feet)
    if which is None or which >= len(triples):
        raise UnusableShapeError("keypoints, none of them named foot")
    x, y, visibility = numbers(*triples[which])
    if visibility == 0:
        raise UnusableShapeError("foot not marked")
    return foot_at(x, y)
