"""Label Studio's JSON: rectangles, key points, polygons and ellipses of images, rectangles of videos.

The format: https://labelstud.io/guide/export and https://labelstud.io/tags/rectanglelabels. Coordinates are
percent of the image, from its corner. A rectangle is turned clockwise about its first corner, which turns
with it. What an annotator says of one region besides its label (``<TextArea name="skiltnummer"
perRegion="true"/>``, choices, numbers) are attributes: they stand in results with the region's id. Of
several annotators' versions of one task the one that is marked as ground truth counts, else the first.
Frames of videos count from 1. An export "with interpolated key frames" marks what it adds as ``auto``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any
from urllib.parse import unquote

from twin.drives.annotations.formats.json_values import key, mapping, sequence, size_px, text, whole
from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    Pixel,
    Shape,
    UnusableShapeError,
    area_at,
    as_fraction,
    box_around,
    foot_at,
    numbers,
    of_kind,
)
from twin.drives.folder.notes import SkipKind
from twin.errors import DriveError

TOOL = "Label Studio"

_SHAPES = ("rectangle", "keypoint", "polygon", "ellipse")
_VIDEO = "videorectangle"
_ATTRIBUTES = ("text", "choices", "number", "rating", "taxonomy", "datetime")
"""Where a result about a region, that is no shape, holds its value."""


def looks_like_labelstudio(document: object) -> bool:
    """Whether a JSON document is a Label Studio export: a list of tasks with annotations and data."""
    tasks = sequence(document)
    first = mapping(tasks[0]) if tasks else {}
    versions = first.get("annotations", first.get("completions"))
    return _is_short(first) or (isinstance(versions, list) and isinstance(first.get("data"), dict))


def _is_short(task: Mapping[str, Any]) -> bool:
    """Whether a task is of an export as "JSON-MIN", which says of no attribute which region it is of."""
    return "annotation_id" in task and "annotations" not in task


def read_labelstudio(document: object, where: str, _hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read one export in the form "JSON".

    Raises
    ------
    DriveError
        If it is of the form "JSON-MIN".
    """
    if any(_is_short(mapping(task)) for task in sequence(document)):
        raise DriveError(
            f"{where} is Label Studio's JSON-MIN, which does not say what belongs to which region: export it"
            " as JSON."
        )
    file = AnnotationFile(where, TOOL)
    for task in map(mapping, sequence(document)):
        number = whole(task.get("id"))
        image_id = -1 if number is None else number
        results = [mapping(result) for result in sequence(_version(task, file).get("result"))]
        file.shapes += [
            replace(shape, image_id=image_id) for shape in _shapes(results, mapping(task.get("data")), file)
        ]
    return file


def _version(task: Mapping[str, Any], file: AnnotationFile) -> Mapping[str, Any]:
    """Return the one version of a task that counts."""
    every = [mapping(version) for version in sequence(task.get("annotations", task.get("completions")))]
    versions = [version for version in every if version.get("was_cancelled") is not True]
    if not versions:
        return {}
    chosen = next((version for version in versions if version.get("ground_truth") is True), versions[0])
    others = sum(len(sequence(version.get("result"))) for version in versions if version is not chosen)
    other = SkipKind.OTHER_VERSION
    file.leave_out(UnusableShapeError(other.reason(), kind=other), others)
    return chosen


def _image(data: Mapping[str, Any], result: Mapping[str, Any], *, is_one_of_several: bool) -> str:
    """Return the name of the image; local files are served as ``/data/local-files/?d=front/12.jpg``.

    It is an address: a blank in a name is ``%20`` there. Of a task with several images the one counts whose
    column is called as its tag is, or whose place in a list of images the result gives.

    Raises
    ------
    UnusableShapeError
        If it may be any of several.
    """
    of_tag = data.get(text(result.get("to_name")))
    pages = next((sequence(value) for value in (of_tag, *data.values()) if sequence(value)), ())
    page = whole(result.get("item_index"))
    usual = [text(data[name]) for name in ("image", "img", "video") if isinstance(data.get(name), str)]
    others = [text(value) for value in data.values() if isinstance(value, str) and "." in value]
    if page is not None and page < len(pages):
        name = text(pages[page])
    elif isinstance(of_tag, str):
        name = text(of_tag)
    elif is_one_of_several and len(others) > 1:
        raise UnusableShapeError(
            "one of a task's several images, the export does not say which: call the tag as its column,"
            ' <Image name="left" value="$left"/>'
        )
    else:
        name = next(iter(usual + others), "")
    return unquote(name.partition("?d=")[2] or name.partition("?")[0])


def _shapes(
    results: Sequence[Mapping[str, Any]], data: Mapping[str, Any], file: AnnotationFile
) -> Iterator[Shape]:
    """Yield the shapes of one task; those that cannot be used are counted."""
    attributes, labels = _attributes(results), _labels(results)
    several = len({text(result.get("to_name")) for result in results if _kind(result) in _SHAPES}) > 1
    for result in results:
        value, region = mapping(result.get("value")), key(result.get("id"))
        kind = _kind(result)
        shapes: list[Shape] = []
        if kind == _VIDEO:
            image = _image(data, result, is_one_of_several=False)
            shapes = [replace(shape, track=region, image=image) for shape in _of_video(value, file)]
        elif kind in _SHAPES:
            with file.counting():
                image = _image(data, result, is_one_of_several=several)
                shapes = [replace(_of_image(result, value, kind), image=image)]
        elif kind and not any(name in value for name in _ATTRIBUTES):
            file.leave_out(of_kind(kind))
        for shape in shapes:
            yield replace(shape, label=labels.get(region, ""), attributes=attributes.get(region, {}))


def _kind(result: Mapping[str, Any]) -> str:
    return text(result.get("type")).removesuffix("labels")


def _labels(results: Any) -> dict[str, str]:
    """Return the label of each region, which may stand in a result of its own (``<Labels/>``)."""
    labels_of: dict[str, str] = {}
    for result in map(mapping, results):
        for name, labels in mapping(result.get("value")).items():
            if name.endswith("labels") and sequence(labels):
                labels_of[key(result.get("id"))] = text(labels[0])
    return labels_of


def _attributes(results: Any) -> dict[str, dict[str, str]]:
    """Return what was said of each region besides its label."""
    attributes: dict[str, dict[str, str]] = {}
    for result in map(mapping, results):
        value = mapping(result.get("value"))
        said = next((value[name] for name in _ATTRIBUTES if name in value), None)
        parts = said if isinstance(said, list) else [said]
        words = ";".join(word for word in map(text, parts) if word)
        if words:
            about = attributes.setdefault(key(result.get("id")), {})
            about[text(result.get("from_name"))] = words
    return attributes


def _of_image(result: Mapping[str, Any], value: Mapping[str, Any], kind: str) -> Shape:
    """Return a shape in pixels where the size of the image is known, else in fractions of it."""
    (turn,) = numbers(result.get("image_rotation") or 0)
    if turn % 360:
        raise UnusableShapeError("the image was turned in Label Studio: annotate it as the camera took it")
    size = size_px(result.get("original_width"), result.get("original_height"))
    width, height = size or (1, 1)
    shape = _shape(value, kind, width / 100.0, height / 100.0)
    return replace(shape, size_px=size) if size else as_fraction(shape)


def _shape(value: Mapping[str, Any], kind: str, per_x: float, per_y: float) -> Shape:
    """Return a shape whose percents are `per_x` and `per_y` long."""
    if kind == "polygon":
        corners = [numbers(*sequence(point)) for point in sequence(value.get("points"))]
        if not all(len(corner) == 2 for corner in corners):
            raise UnusableShapeError("coordinates unreadable")
        return area_at([(x * per_x, y * per_y) for x, y in corners])
    x, y = numbers(value.get("x"), value.get("y"))
    if kind == "keypoint":
        return foot_at(x * per_x, y * per_y)
    (degrees,) = numbers(value.get("rotation") or 0)
    if kind == "ellipse":
        radius_x, radius_y = numbers(value.get("radiusX"), value.get("radiusY"))
        return _ellipse(x * per_x, y * per_y, radius_x * per_x, radius_y * per_y, degrees)
    width, height = numbers(value.get("width"), value.get("height"))
    return box_around(_turned(x * per_x, y * per_y, width * per_x, height * per_y, degrees))


def _turned(x: float, y: float, width: float, height: float, degrees: float) -> list[Pixel]:
    """Corners of a rectangle that is turned clockwise about its first one."""
    if width <= 0 or height <= 0:
        raise UnusableShapeError("box without area")
    if not degrees:
        return [(x, y), (x + width, y + height)]
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return [
        (x + right * cos - down * sin, y + right * sin + down * cos)
        for right in (0.0, width)
        for down in (0.0, height)
    ]


def _ellipse(x: float, y: float, radius_x: float, radius_y: float, degrees: float) -> Shape:
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    half_width, half_height = (
        math.hypot(radius_x * cos, radius_y * sin),
        math.hypot(radius_x * sin, radius_y * cos),
    )
    return box_around([(x - half_width, y - half_height), (x + half_width, y + half_height)])


def _of_video(value: Mapping[str, Any], file: AnnotationFile) -> Iterator[Shape]:
    """Yield the frames of one track that are in the export: the key frames, and others where it was asked so.

    ``enabled`` is false on the last frame of a stretch in which the object is seen: it is in view there.
    """
    for row in map(mapping, sequence(value.get("sequence"))):
        with file.counting():
            number = whole(row.get("frame"))
            if not number:
                raise UnusableShapeError("frame number unreadable")
            shape = as_fraction(_shape(row, "rectangle", 0.01, 0.01))
            yield replace(shape, frame=number - 1, is_measured=row.get("auto") is not True)
