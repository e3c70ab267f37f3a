"""COCO JSON: boxes, keypoints and polygons.

The format: https://cocodataset.org/#format-data. Boxes are ``[x, y, width, height]`` from the corner of the
first pixel. Tracks, which COCO does not know, stand in ``track_id`` of an annotation or of its
``attributes`` (so CVAT writes them). ``iscrowd`` marks a heap of objects, which is none.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from twin.drives.annotations.formats.json_values import key, mapping, sequence, size_px, text, texts, whole
from twin.drives.annotations.formats.shapes import (
    AnnotationFile,
    Drawn,
    Gathering,
    Place,
    UnusableShapeError,
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
    found = mapping(document)
    return isinstance(found.get("images"), list) and isinstance(found.get("annotations"), list)


def read_coco(document: object, where: str, feet: Collection[str] = ()) -> AnnotationFile:
    """Read one COCO document.

    Parameters
    ----------
    document : object
        Parsed JSON.
    where : str
        File name, for messages.
    feet : collection of str
        Further names of keypoints that are the foot.
    """
    found = mapping(document)
    images = {
        key(mapping(image).get("id")): _place(mapping(image)) for image in sequence(found.get("images"))
    }
    categories = {key(mapping(c).get("id")): mapping(c) for c in sequence(found.get("categories"))}
    gathering = Gathering(where, TOOL)
    for annotation in map(mapping, sequence(found.get("annotations"))):
        place = images.get(key(annotation.get("image_id")))
        category = categories.get(key(annotation.get("category_id")), {})
        if place is None:
            gathering.leave_out(UnusableShapeError("image that is not listed"))
            continue
        try:
            drawn = _drawn(annotation, category, feet)
        except UnusableShapeError as error:
            gathering.leave_out(error)
            continue
        attributes = texts(annotation.get("attributes"))
        track = key(annotation.get("track_id")) or attributes.get("track_id", "")
        gathering.add(place._replace(track=track), text(category.get("name")), drawn, attributes)
    return gathering.file()


def _place(image: Mapping[str, Any]) -> Place:
    number = whole(image.get("id"))
    return Place(
        image=text(image.get("file_name")),
        image_id=-1 if number is None else number,
        size_px=size_px(image.get("width"), image.get("height")),
    )


def _drawn(annotation: Mapping[str, Any], category: Mapping[str, Any], feet: Collection[str]) -> Drawn:
    if annotation.get("iscrowd") == 1:
        raise UnusableShapeError("a crowd, not one object")
    keypoints = sequence(annotation.get("keypoints"))
    if keypoints:
        return _foot(keypoints, [text(name) for name in sequence(category.get("keypoints"))], feet)
    corner = sequence(annotation.get("bbox"))
    if len(corner) == 4:
        x, y, width, height = numbers(*corner)
        return box_at(x, y, x + width, y + height)
    segments = annotation.get("segmentation")
    if isinstance(segments, list) and segments:
        flat = [value for segment in segments for value in sequence(segment)]
        return box_around(pairs(numbers(*flat)))
    raise UnusableShapeError("neither box nor keypoints")


def _foot(keypoints: Any, names: list[str], feet: Collection[str]) -> Drawn:
    """Return the foot among ``x, y, visibility`` triples; visibility 0 is a point that was not marked."""
    triples = [keypoints[k : k + 3] for k in range(0, len(keypoints) - 2, 3)]
    which = foot_of(names or [""] * len(triples), feet)
    if which is None or which >= len(triples):
        raise UnusableShapeError("keypoints, none of them named foot")
    x, y, visibility = numbers(*triples[which])
    if visibility == 0:
        raise UnusableShapeError("foot not marked")
    return foot_at(x, y)
