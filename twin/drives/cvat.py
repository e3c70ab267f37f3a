"""CVAT XML 1.1: exports of image tasks, video tasks and projects.

The format: https://docs.cvat.ai/docs/dataset_management/formats/format-cvat/. What is taken:

- ``<points>`` with exactly one point, the foot of a pole;
- ``<box>``, the face of a sign.

Polygons, polylines, skeletons, tags and the rest are counted by kind. Rows with ``outside="1"`` say that the
object is *not* in view: they are no annotations, and are not counted either.
"""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple
from xml.etree.ElementTree import ParseError  # only the exception: parsing goes through defusedxml

from twin.drives.drive import Skipped
from twin.errors import DriveError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_CORNER_TO_CENTRE_PX = 0.5
"""CVAT counts from the corner of the first pixel, the twin from its centre."""

_NOT_SHAPES = ("attribute", "track")


@dataclass(frozen=True, slots=True)
class CvatShape:
    """One point or box.

    Attributes
    ----------
    frame : int or None
        Absolute frame number in the source (video tasks); None in image tasks.
    image : str
        Name of the image; "" in video tasks.
    image_id : int
        Running number of the image; -1 in video tasks.
    task : str
        Id of the task in a project export, else "".
    track : str
        Track id, else "".
    label : str
    attributes : mapping of str to str
    kind : str
        ``foot`` or ``box``.
    pixel_px : (x, y)
        The foot, or the centre of the box; (0, 0) is the centre of the first pixel.
    box_px : (left, top, right, bottom)
        NaN for points.
    size_px : (width, height) or None
        Of the image that was annotated.
    """

    frame: int | None
    image: str
    image_id: int
    task: str
    track: str
    label: str
    attributes: Mapping[str, str]
    kind: str
    pixel_px: tuple[float, float]
    box_px: tuple[float, float, float, float]
    size_px: tuple[int, int] | None


@dataclass(frozen=True, slots=True)
class CvatFile:
    """One export.

    Attributes
    ----------
    where : str
        File name.
    source : tuple of str
        Names of the video and of the task, in which a camera may be named.
    tasks : mapping of task id to names
        The same for each task of a project export.
    shapes : tuple of CvatShape
    skipped : tuple of Skipped
    """

    where: str
    source: tuple[str, ...]
    tasks: Mapping[str, tuple[str, ...]]
    shapes: tuple[CvatShape, ...]
    skipped: tuple[Skipped, ...]


class _LeftOutError(Exception):
    """A shape that is left out; its text is the reason."""


class _Place(NamedTuple):
    """Where a shape was drawn: the fields of `CvatShape` that it shares with its neighbours."""

    frame: int | None
    image: str
    image_id: int
    task: str
    track: str
    size_px: tuple[int, int] | None


@dataclass(slots=True)
class _Reading:
    """What has been gathered so far of one file."""

    where: str
    source: tuple[str, ...] = ()
    tasks: dict[str, tuple[str, ...]] = field(default_factory=dict)
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    shapes: list[CvatShape] = field(default_factory=list)
    faults: Counter[str] = field(default_factory=Counter)


def read_cvat(content: bytes, where: str) -> CvatFile:
    """Read one CVAT XML 1.1 export.

    Parameters
    ----------
    content : bytes
    where : str
        File name, for messages.

    Raises
    ------
    DriveError
        If it is not well-formed XML, carries a DTD or entities (which are refused, since they can blow up or
        read other files), or is not CVAT 1.1.
    """
    reading = _Reading(where)
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
    skipped = (Skipped("annotations", where, n, reason) for reason, n in sorted(reading.faults.items()))
    return CvatFile(where, reading.source, reading.tasks, tuple(reading.shapes), tuple(skipped))


def is_cvat(head: bytes) -> bool:
    """Whether the beginning of a file is that of a CVAT export: its root element is ``<annotations>``."""
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import iterparse

    try:
        for _, element in iterparse(io.BytesIO(head), events=("start",)):
            return bool(element.tag == "annotations")
    except DefusedXmlException:
        return b"<annotations" in head  # so that the reader refuses it by name
    except (ParseError, ValueError, LookupError):
        return False
    return False


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
    place = _Place(
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
    for shape in track:
        # A skeleton's parts are tracks inside its track: the skeleton rows are counted, not their parts.
        if shape.tag in _NOT_SHAPES or shape.get("outside") == "1":
            continue
        frame = _whole(shape.get("frame"))
        if frame is None:
            reading.faults["frame number unreadable"] += 1
            continue
        place = _Place(frame, "", -1, task, track.get("id", ""), size)
        _read_shape(shape, track.get("label", ""), place, reading)


def _whole(text: str | None) -> int | None:
    """A whole number from 0 that fits 63 bits; None otherwise."""
    try:
        number = int(text or "")
    except ValueError:
        return None
    return number if 0 <= number < 2**63 else None


def _read_shape(shape: Element, label: str, place: _Place, reading: _Reading) -> None:
    try:
        pixel, box = _pixel_and_box(shape)
    except _LeftOutError as reason:
        reading.faults[str(reason)] += 1
        return
    reading.shapes.append(
        CvatShape(
            frame=place.frame,
            image=place.image,
            image_id=place.image_id,
            task=place.task,
            track=place.track,
            label=label,
            attributes={a.get("name", ""): (a.text or "").strip() for a in shape.iter("attribute")},
            kind="box" if shape.tag == "box" else "foot",
            pixel_px=pixel,
            box_px=box,
            size_px=place.size_px,
        )
    )


def _pixel_and_box(shape: Element) -> tuple[tuple[float, float], tuple[float, float, float, float]]:
    if shape.tag == "points":
        return _single_point(shape.get("points", "")), (math.nan, math.nan, math.nan, math.nan)
    if shape.tag == "box":
        return _box(shape)
    raise _LeftOutError(f"kind {shape.tag}")


def _numbers(*texts: str | None) -> list[float]:
    try:
        values = [float(text or "") for text in texts]
    except ValueError:
        raise _LeftOutError("coordinates unreadable") from None
    if not all(math.isfinite(value) for value in values):
        raise _LeftOutError("coordinates not finite")
    return values


def _single_point(text: str) -> tuple[float, float]:
    pairs = [pair.split(",") for pair in text.split(";")]
    if len(pairs) > 1:
        raise _LeftOutError(f"points with {len(pairs)} points")
    if len(pairs[0]) != 2:
        raise _LeftOutError("coordinates unreadable")
    x, y = _numbers(*pairs[0])
    return x - _CORNER_TO_CENTRE_PX, y - _CORNER_TO_CENTRE_PX


def _box(shape: Element) -> tuple[tuple[float, float], tuple[float, float, float, float]]:
    """Centre and edges; of a rotated box the edges of the upright box around it."""
    left, top, right, bottom = _numbers(*(shape.get(edge) for edge in ("xtl", "ytl", "xbr", "ybr")))
    if right <= left or bottom <= top:
        raise _LeftOutError("box without area")
    (degrees,) = _numbers(shape.get("rotation", "0"))
    cos, sin = abs(math.cos(math.radians(degrees))), abs(math.sin(math.radians(degrees)))
    width, height = right - left, bottom - top
    x = (left + right) / 2 - _CORNER_TO_CENTRE_PX
    y = (top + bottom) / 2 - _CORNER_TO_CENTRE_PX
    half_width, half_height = (width * cos + height * sin) / 2, (width * sin + height * cos) / 2
    return (x, y), (x - half_width, y - half_height, x + half_width, y + half_height)
