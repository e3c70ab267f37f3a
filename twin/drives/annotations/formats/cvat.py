"""CVAT XML 1.1: exports of image tasks, video tasks and projects.

The format: https://docs.cvat.ai/docs/dataset_management/formats/format-cvat/. What is taken:

- ``<points>`` with exactly one point, the foot of a pole;
- ``<skeleton>``, if one of its points is called foot (or it has only one): that point;
- ``<box>``, and ``<polygon>`` by the box around it, the face of a sign;
- ``<polygon>`` by its corners and ``<polyline>``, if ``labels.toml`` says that its label lies on the ground.

Other polylines, other skeletons, tags and the rest are counted by kind. Rows with ``outside="1"`` say that
the object is *not* in view: they are no annotations, and are not counted either. Rows with ``keyframe="0"``
were put there by CVAT, between two that somebody set.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree.ElementTree import ParseError  # only the exception: parsing goes through defusedxml

from twin.drives.annotations.formats.shapes import (
    KEY_FRAME,
    NO_HINTS,
    AnnotationFile,
    Hints,
    Shape,
    UnusableShapeError,
    area_at,
    box_at,
    foot_at,
    foot_of,
    is_key_frame,
    line_at,
    numbers,
    of_kind,
)
from twin.errors import DriveError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

TOOL = "CVAT"
_NOT_SHAPES = ("attribute", "track")


def read_cvat(content: bytes, where: str, hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read one CVAT XML 1.1 export.

    Parameters
    ----------
    content : bytes
    where : str
        File name, for messages.
    hints : Hints

    Raises
    ------
    DriveError
        If it is not well-formed XML, carries a DTD or entities (which are refused, since they can blow up or
        read other files), or is not CVAT 1.1.
    """
    file, sizes = AnnotationFile(where, TOOL), dict[str, tuple[int, int]]()
    for element in _children_of_root(content, where):
        if element.tag == "version" and (element.text or "").strip() != "1.1":
            version = (element.text or "").strip()
            raise DriveError(
                f"{where} is CVAT XML {version!r}: export it as 'CVAT for images 1.1' or 'video 1.1'."
            )
        if element.tag == "meta":
            sizes |= _read_meta(element, file)
        elif element.tag == "image":
            _read_image(element, file, hints)
        elif element.tag == "track":
            _read_track(element, file, sizes, hints)
    return file


def is_cvat(head: bytes) -> bool:
    """Whether the beginning of a file is that of a CVAT export: its root element is ``<annotations>``."""
    return root_tag(head) == "annotations"


def root_tag(head: bytes) -> str:
    """Return the root element's name of an XML file that begins so; "" if it is none."""
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import iterparse

    try:
        for _, element in iterparse(io.BytesIO(head), events=("start",)):
            return str(element.tag)
    except (DefusedXmlException, ParseError, ValueError, LookupError):
        # Taken for what it says it is, so that the reader refuses it by name; also in UTF-16.
        found = re.search(rb"<(annotations?)\b", head.replace(b"\0", b""))
        return found.group(1).decode() if found else ""
    return ""


def _children_of_root(content: bytes, where: str) -> Iterator[Element]:
    """Yield each finished child of the root, and let it go: memory stays that of the largest track."""
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import iterparse

    depth = 0
    root: Element | None = None
    try:
        for event, element in iterparse(io.BytesIO(content), events=("start", "end"), forbid_dtd=True):
            if event == "start":
                depth += 1
                if root is None:
                    root = element
                    _check_root(element, where)
                continue
            depth -= 1
            if depth == 1 and root is not None:
                yield element
                root.clear()
    except DefusedXmlException as error:
        raise DriveError(
            f"{where} declares a document type or entities, which are refused: export the annotations from"
            " CVAT again, it writes none."
        ) from error
    except (ParseError, ValueError, LookupError) as error:
        raise DriveError(f"{where} is not well-formed XML ({error}): export it from CVAT again.") from error


def _check_root(root: Element, where: str) -> None:
    if root.tag != "annotations":
        raise DriveError(f"{where} is no CVAT export: its root is <{root.tag}>, not <annotations>.")


def _read_meta(meta: Element, file: AnnotationFile) -> dict[str, tuple[int, int]]:
    """Note the names of tasks and videos; return the size of the pictures of each task that says it."""
    names, sizes = [meta.findtext("source")], {}
    for task in meta.iter("task"):
        own = _texts(task.findtext("name"), task.findtext("source"))
        names += own
        identifier = (task.findtext("id") or "").strip()
        size = task.find("original_size")
        file.tasks[identifier] = own
        if size is not None:
            pair = _size(size.findtext("width"), size.findtext("height"))
            if pair:
                sizes[identifier] = pair
    file.source = _texts(*names)
    return sizes


def _texts(*texts: str | None) -> tuple[str, ...]:
    return tuple(text.strip() for text in texts if text and text.strip())


def _size(width: str | None, height: str | None) -> tuple[int, int] | None:
    """Size of an image in pixels; None where it is not stated."""
    try:
        pair = int(width or ""), int(height or "")
    except ValueError:
        return None
    return pair if min(pair) > 0 else None


def _read_image(image: Element, file: AnnotationFile, hints: Hints) -> None:
    number = _whole(image.get("id"))
    for element in image:
        if element.tag in _NOT_SHAPES:
            continue
        with file.counting():
            file.shapes.append(
                replace(
                    _shape(element, hints, element.get("label", "")),
                    label=element.get("label", ""),
                    attributes=_attributes(element),
                    image=image.get("name", ""),
                    image_id=-1 if number is None else number,
                    size_px=_size(image.get("width"), image.get("height")),
                    task=image.get("task_id", ""),
                )
            )


def _read_track(
    track: Element, file: AnnotationFile, sizes: Mapping[str, tuple[int, int]], hints: Hints
) -> None:
    task = track.get("task_id", "")
    only_size = next(iter(sizes.values())) if len(sizes) == 1 else None
    rows, said = _rows_of_foot(track, hints.feet)
    for element in rows:
        if element.tag in _NOT_SHAPES or element.get("outside") == "1":
            continue
        with file.counting():
            frame = _whole(element.get("frame"))
            if frame is None:
                raise UnusableShapeError("frame number unreadable")
            file.shapes.append(
                replace(
                    _shape(element, hints, track.get("label", "")),
                    label=track.get("label", ""),
                    attributes={**said.get(frame, {}), **_attributes(element)},
                    track=track.get("id", ""),
                    frame=frame,
                    size_px=sizes.get(task, only_size),
                    task=task,
                    is_measured=is_key_frame(element.get(KEY_FRAME)),
                )
            )


def _rows_of_foot(track: Element, feet: Collection[str]) -> tuple[Element, dict[int | None, dict[str, str]]]:
    """Return the rows of a track, and what is said of each frame besides.

    A skeleton's points are tracks inside its track: if one of them is the foot, its rows count, and the
    skeleton's own say only the attributes. Otherwise those are the rows, and the points are not looked at.
    """
    parts = track.findall("track")
    which = foot_of([part.get("label", "") for part in parts], feet)
    if which is None:
        return track, {}
    return parts[which], {_whole(row.get("frame")): _attributes(row) for row in track.iter("skeleton")}


def _whole(text: str | None) -> int | None:
    """A whole number from 0 that fits 63 bits; None otherwise."""
    try:
        number = int(text or "")
    except ValueError:
        return None
    return number if 0 <= number < 2**63 else None


def _attributes(element: Element) -> dict[str, str]:
    return {a.get("name", ""): (a.text or "").strip() for a in element.iter("attribute")}


def _shape(element: Element, hints: Hints, label: str) -> Shape:
    if element.tag == "points":
        return foot_at(*_points(element)[0])
    if element.tag == "polygon":
        return area_at(_points(element))
    if element.tag == "polyline" and hints.on_ground(label):
        return line_at(_points(element))
    if element.tag == "box":
        return _box(element)
    if element.tag == "skeleton":
        points = element.findall("points")
        which = foot_of([point.get("label", "") for point in points], hints.feet)
        if which is not None:
            return _marked(points[which])
    raise of_kind(element.tag)


def _marked(point: Element) -> Shape:
    """Return a skeleton's point; in image tasks one that is not to be seen is ``outside``."""
    if point.get("outside") == "1":
        raise UnusableShapeError("foot not marked")
    return foot_at(*_points(point)[0])


def _points(element: Element) -> list[tuple[float, float]]:
    parts = [pair.split(",") for pair in element.get("points", "").split(";")]
    if len(parts) > 1 and element.tag == "points":
        raise UnusableShapeError(f"points with {len(parts)} points")
    if not all(len(part) == 2 for part in parts):
        raise UnusableShapeError("coordinates unreadable")
    values = numbers(*(text for part in parts for text in part))
    return list(zip(values[::2], values[1::2], strict=True))


def _box(element: Element) -> Shape:
    """Return a box; of one that is turned about its centre, the upright box around it."""
    left, top, right, bottom = numbers(*(element.get(edge) for edge in ("xtl", "ytl", "xbr", "ybr")))
    upright = box_at(left, top, right, bottom)
    (degrees,) = numbers(element.get("rotation", "0"))
    cos, sin = abs(math.cos(math.radians(degrees))), abs(math.sin(math.radians(degrees)))
    width, height = right - left, bottom - top
    x, y = upright.pixel_px
    half_width, half_height = (width * cos + height * sin) / 2, (width * sin + height * cos) / 2
    return Shape("box", (x, y), (x - half_width, y - half_height, x + half_width, y + half_height))
