"""What every annotation tool's export becomes: points and boxes on pictures.

A **foot** is a point: where the pole meets the ground. A **box** is the face of a sign; a polygon, an ellipse
or a turned rectangle counts as the upright box around it. An object with a keypoint that is named as its foot
(:data:`FOOT_WORDS`) is that foot: its box is then of the whole object, pole and all, and no face.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from twin.drives.folder.notes import SkipKind, Skipped

_CORNER_TO_CENTRE_PX = 0.5
"""Annotation tools count from the corner of the first pixel, the twin from its centre."""

_LARGEST = 1e9
"""No coordinate is larger: sums and products of such numbers stay finite."""

NO_BOX = (math.nan, math.nan, math.nan, math.nan)

FOOT_WORDS = frozenset({"foot", "base", "bottom", "ground", "fot", "fotpunkt", "bunn"})
"""A keypoint whose name has one of these words is the foot."""

Pixel = tuple[float, float]
Edges = tuple[float, float, float, float]
_UNIT_PX = (1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Shape:
    """One point or box.

    Attributes
    ----------
    frame : int or None
        Absolute frame number in the source (video tasks); None in image tasks.
    image : str
        Name of the image; "" in video tasks.
    image_id : int
        Running number of the image; -1 where there is none.
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
    is_fraction : bool
        Whether `pixel_px` and `box_px` are fractions of the image, from its corner, since the tool does not
        say how large it is: :meth:`in_pixels` turns them into pixels.
    """

    frame: int | None
    image: str
    image_id: int
    task: str
    track: str
    label: str
    attributes: Mapping[str, str]
    kind: str
    pixel_px: Pixel
    box_px: Edges
    size_px: tuple[int, int] | None
    is_fraction: bool = False

    def in_pixels(self, width_px: int, height_px: int) -> Shape:
        """Return the shape in pixels of an image of this size."""
        if not self.is_fraction:
            return self
        x, y = self.pixel_px
        left, top, right, bottom = self.box_px
        half = _CORNER_TO_CENTRE_PX
        return replace(
            self,
            pixel_px=(x * width_px - half, y * height_px - half),
            box_px=(
                left * width_px - half,
                top * height_px - half,
                right * width_px - half,
                bottom * height_px - half,
            ),
            is_fraction=False,
        )


@dataclass(frozen=True, slots=True)
class AnnotationFile:
    """One export, or a folder of files that hold one image each.

    Attributes
    ----------
    where : str
        File or folder name.
    source : tuple of str
        Names of the video and of the task, in which a camera may be named.
    tasks : mapping of task id to names
        The same for each task of a project export.
    shapes : tuple of Shape
    skipped : tuple of Skipped
    tool : str
        The format, as people call it: ``CVAT``, ``COCO``.
    is_one_image : bool
        Whether the tool writes one such file for each image.
    n_files : int
        Files that were brought together in it.
    """

    where: str
    source: tuple[str, ...]
    tasks: Mapping[str, tuple[str, ...]]
    shapes: tuple[Shape, ...]
    skipped: tuple[Skipped, ...]
    tool: str = "CVAT"
    is_one_image: bool = False
    n_files: int = 1


class UnusableShapeError(Exception):
    """A shape that is left out: the reason in words, what stands in the file if it likes, and the kind."""

    def __init__(self, reason: str, example: str = "", kind: SkipKind = SkipKind.UNUSABLE) -> None:
        super().__init__(reason)
        self.example = example
        self.kind = kind


def of_kind(kind: str) -> UnusableShapeError:
    """Return the reason to leave out a shape of a kind that stands for no foot and no face."""
    return UnusableShapeError(SkipKind.OTHER_SHAPE.reason(f"{kind:.40}"), kind=SkipKind.OTHER_SHAPE)


class Place(NamedTuple):
    """Where a shape was drawn: the fields of `Shape` that it shares with its neighbours."""

    frame: int | None = None
    image: str = ""
    image_id: int = -1
    task: str = ""
    track: str = ""
    size_px: tuple[int, int] | None = None


class Drawn(NamedTuple):
    """The geometry of one shape."""

    kind: str
    pixel_px: Pixel
    box_px: Edges
    is_fraction: bool = False


@dataclass(slots=True)
class Gathering:
    """What has been gathered so far of one export."""

    where: str
    tool: str
    shapes: list[Shape] = field(default_factory=list)
    faults: Counter[tuple[str, SkipKind]] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)
    """What the first shape that was left out for a reason looks like, where that is told."""

    def add(self, place: Place, label: str, drawn: Drawn, attributes: Mapping[str, str]) -> None:
        """Take one shape."""
        self.shapes.append(
            Shape(
                **place._asdict(),
                label=label,
                attributes=attributes,
                kind=drawn.kind,
                pixel_px=drawn.pixel_px,
                box_px=drawn.box_px,
                is_fraction=drawn.is_fraction,
            )
        )

    def leave_out(self, error: UnusableShapeError, count: int = 1) -> None:
        """Count shapes that are not taken."""
        reason = str(error)
        self.faults[reason, error.kind] += count
        if error.example:
            self.examples.setdefault(reason, f"{reason}, such as {error.example!r:.60}")

    def file(
        self,
        source: tuple[str, ...] = (),
        tasks: Mapping[str, tuple[str, ...]] | None = None,
        *,
        is_one_image: bool = False,
    ) -> AnnotationFile:
        """Return all of it."""
        skipped = (
            Skipped("annotations", self.where, n, self.examples.get(reason, reason), kind)
            for (reason, kind), n in sorted(self.faults.items())
            if n
        )
        return AnnotationFile(
            self.where, source, tasks or {}, tuple(self.shapes), tuple(skipped), self.tool, is_one_image
        )


def foot_at(x: float, y: float) -> Drawn:
    """Return the foot at a point that is counted from the corner of the first pixel."""
    return Drawn("foot", (x - _CORNER_TO_CENTRE_PX, y - _CORNER_TO_CENTRE_PX), NO_BOX)


def box_at(left: float, top: float, right: float, bottom: float) -> Drawn:
    """Return the box with these edges, counted from the corner of the first pixel.

    Raises
    ------
    UnusableShapeError
        If it has no area.
    """
    if right <= left or bottom <= top:
        raise UnusableShapeError("box without area")
    half = _CORNER_TO_CENTRE_PX
    centre = ((left + right) / 2 - half, (top + bottom) / 2 - half)
    return Drawn("box", centre, (left - half, top - half, right - half, bottom - half))


def box_around(points: Sequence[Pixel]) -> Drawn:
    """Return the upright box around a polygon, from the corner of the first pixel.

    Raises
    ------
    UnusableShapeError
        If there are no points, or the box has no area.
    """
    if not points:
        raise UnusableShapeError("coordinates unreadable")
    x, y = zip(*points, strict=True)
    return box_at(min(x), min(y), max(x), max(y))


def as_fraction(drawn: Drawn) -> Drawn:
    """Return the same for coordinates that are fractions of the image: no pixel's half is taken off yet."""
    half = _CORNER_TO_CENTRE_PX
    x, y = drawn.pixel_px
    left, top, right, bottom = drawn.box_px
    return Drawn(
        drawn.kind, (x + half, y + half), (left + half, top + half, right + half, bottom + half), True
    )


def pairs(values: Sequence[float]) -> list[Pixel]:
    """Return x and y of a flat list.

    Raises
    ------
    UnusableShapeError
        If a number is left over.
    """
    if len(values) % 2:
        raise UnusableShapeError("coordinates unreadable")
    return list(zip(values[::2], values[1::2], strict=True))


def numbers(*values: object) -> list[float]:
    """Return numbers, or texts of numbers, as floats.

    Raises
    ------
    UnusableShapeError
        If one is neither, not finite, or so large that no image has it.
    """
    found = []
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise UnusableShapeError("coordinates unreadable")
        try:
            found.append(float(value))
        except ValueError:
            raise UnusableShapeError("coordinates unreadable") from None
        except OverflowError:
            raise UnusableShapeError("coordinates not finite") from None
    if not all(math.isfinite(value) for value in found):
        raise UnusableShapeError("coordinates not finite")
    if any(abs(value) > _LARGEST for value in found):
        raise UnusableShapeError("coordinates beyond any image")
    return found


def foot_of(names: Sequence[str], feet: Collection[str] = ()) -> int | None:
    """Return which of an object's keypoints is the foot: the one so named, or the only one; None if unclear.

    Parameters
    ----------
    names : sequence of str
        One a keypoint.
    feet : collection of str
        Names that ``labels.toml`` adds.
    """
    known = {name.casefold() for name in feet}
    found = [
        k
        for k, name in enumerate(names)
        if name.casefold() in known or FOOT_WORDS & set(re.findall(r"[^\W\d_]+", name.casefold()))
    ]
    if len(found) == 1:
        return found[0]
    return 0 if len(names) == 1 else None


def merged(files: Iterable[AnnotationFile], where: str) -> AnnotationFile:
    """Return files of one image each as one: their tracks are the same tracks.

    Parameters
    ----------
    files : iterable of AnnotationFile
        At least one, of one tool.
    where : str
        The folder.
    """
    every = list(files)
    counts: Counter[tuple[str, SkipKind]] = Counter()
    for file in every:
        for skipped in file.skipped:
            counts[skipped.reason, skipped.kind] += skipped.count
    return AnnotationFile(
        where=where,
        source=(),
        tasks={},
        shapes=tuple(shape for file in every for shape in file.shapes),
        skipped=tuple(
            Skipped("annotations", where, n, reason, kind) for (reason, kind), n in sorted(counts.items())
        ),
        tool=every[0].tool,
        n_files=len(every),
    )
