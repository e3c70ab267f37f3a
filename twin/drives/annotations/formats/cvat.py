"""CVAT XML 1.1: exports of image tasks, video tasks and projects.

The format: https://docs.cvat.ai/docs/dataset_management/formats/format-cvat/. What is taken:

- ``<points>`` with exactly one point, the foot of a pole;
- ``<skeleton>``, if one of its points is called foot (or it has only one): that point;
- ``<box>``, and ``<polygon>`` by the box around it, the face of a sign.

Polylines, other skeletons, tags and the rest are counted by kind. Rows with ``outside="1"`` say that the
object is *not* in view: they are no annotations, and are not counted either.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.etree.ElementTree import ParseError  # only the exception: parsing goes through defusedxml

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
    of_kind,
)
from twin.errors import DriveError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

TOOL = "CVAT"
_NOT_SHAPES = ("attribute", "track")


@dataclass(slots=True)
class _Reading:
    """What has been gathered so far of one file."""

    gathering: Gathering
    feet: Collection[str] = ()
    source: tuple[str, ...] = ()
    tasks: dict[str, tuple[str, ...]] = field(default_factory=dict)
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)


def read_cvat(content: bytes, where: str, feet: Collection[str] = ()) -> AnnotationFile:
    """Read one CVAT XML 1.1 export.

    Parameters
    ----------
    content : bytes
    where : str
        File name, for messages.
    feet : collection of str
        Further names of a skeleton's points that are the foot.

    Raises
    ------
    DriveError
        If it is not well-formed XML, carries a DTD or entities (which are refused, since they can blow up or
        read other files), or is not CVAT 1.1.
    """
    reading = _Reading(Gathering(where, TOOL), feet)
    for element in _children_of_root(content, where):
        if element.tag == "version" and (element.text or "").strip() != "1.1":
            version = (element.text or "").strip()
            raise DriveError(
                f"{where} is CVAT XML {version!r}: export it as 'CVAT for images 1.1' or 'video 1.1'."
            )
        if element.tag == "meta":
            _read_meta(element, reading)
        elif element.tag == "image":
            _read_image(element, reading)
        elif element.tag == "track":
            _read_track(element, reading)
    return reading.gathering.file(reading.source, reading.tasks)


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


def _read_meta(meta: Element, reading: _Reading) -> None:
    names = [meta.findtext("source")]
    for task in meta.iter("task"):
        own = _texts(task.findtext("name"), task.findtext("source"))
        names += own
        identifier = (task.findtext("id") or "").strip()
        size = task.find("original_size")
        reading.tasks[identifier] = own
        if size is not None:
            pair = _size(size.findtext("width"), size.findtext("height"))
            if pair:
                reading.sizes[identifier] = pair
    reading.source = _texts(*names)


def _texts(*texts: str | None) -> tuple[str, ...]:
    return tuple(text.strip() for text in texts if text and text.strip())


def _size(width: str | None, height: str | None) -> tuple[int, int] | None:
    """Size of an image in pixels; None where it is not stated."""
    try:
        pair = int(width or ""), int(height or "")
    except ValueError:
        return None
    return pair if min(pair) > 0 else None


def _read_image(image: Element, reading: _Reading) -> None:
    identifier = _whole(image.get("id"))
    place = Place(
        frame=None,
        image=image.get("name", ""),
        image_id=-1 if identifier is None else identifier,
        task=image.get("task_id", ""),
        track="",
        size_px=_size(image.get("width"), image.get("height")),
    )
    for shape in image:
        if shape.tag not in _NOT_SHAPES:
            _read_shape(shape, shape.get("label", ""), place, reading)


def _read_track(track: Element, reading: _Reading) -> None:
    task = track.get("task_id", "")
    only_size = next(iter(reading.sizes.values()), None) if len(reading.sizes) == 1 else None
    size = reading.sizes.get(task, only_size)
    rows, said = _rows_of_foot(track, reading.feet)
    for shape in rows:
        if shape.tag in _NOT_SHAPES or shape.get("outside") == "1":
            continue
        frame = _whole(shape.get("frame"))
        if frame is None:
            reading.gathering.leave_out(UnusableShapeError("frame number unreadable"))
            continue
        place = Place(frame, "", -1, task, track.get("id", ""), size)
        _read_shape(shape, track.get("label", ""), place, reading, said.get(frame))


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


def _read_shape(
    shape: Element, label: str, place: Place, reading: _Reading, said: Mapping[str, str] | None = None
) -> None:
    try:
        drawn = _drawn(shape, reading.feet)
    except UnusableShapeError as error:
        reading.gathering.leave_out(error)
        return
    reading.gathering.add(place, label, drawn, {**(said or {}), **_attributes(shape)})


def _attributes(shape: Element) -> dict[str, str]:
    return {a.get("name", ""): (a.text or "").strip() for a in shape.iter("attribute")}


def _drawn(shape: Element, feet: Collection[str]) -> Drawn:
    if shape.tag == "points":
        return foot_at(*_points(shape)[0])
    if shape.tag == "polygon":
        return box_around(_points(shape))
    if shape.tag == "box":
        return _box(shape)
    if shape.tag == "skeleton":
        points = shape.findall("points")
        which = foot_of([point.get("label", "") for point in points], feet)
        if which is not None:
            return _marked(points[which])
    raise of_kind(shape.tag)


def _marked(point: Element) -> Drawn:
    """Return a skeleton's point; in image tasks one that is not to be seen is ``outside``."""
    if point.get("outside") == "1":
        raise UnusableShapeError("foot not marked")
    return foot_at(*_points(point)[0])


def _points(shape: Element) -> list[tuple[float, float]]:
    parts = [pair.split(",") for pair in shape.get("points", "").split(";")]
    if len(parts) > 1 and shape.tag == "points":
        raise UnusableShapeError(f"points with {len(parts)} points")
    if not all(len(part) == 2 for part in parts):
        raise UnusableShapeError("coordinates unreadable")
    values = numbers(*(text for part in parts for text in part))
    return list(zip(values[::2], values[1::2], strict=True))


def _box(shape: Element) -> Drawn:
    """Return a box; of one that is turned about its centre, the upright box around it."""
    left, top, right, bottom = numbers(*(shape.get(edge) for edge in ("xtl", "ytl", "xbr", "ybr")))
    upright = box_at(left, top, right, bottom)
    (degrees,) = numbers(shape.get("rotation", "0"))
    cos, sin = abs(math.cos(math.radians(degrees))), abs(math.sin(math.radians(degrees)))
    width, height = right - left, bottom - top
    x, y = upright.pixel_px
    half_width, half_height = (width * cos + height * sin) / 2, (width * sin + height * cos) / 2
    return Drawn("box", (x, y), (x - half_width, y - half_height, x + half_width, y + half_height))
