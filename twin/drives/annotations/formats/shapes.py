"""What every annotation tool's export becomes: points and boxes on pictures.

A **foot** is a point: where the pole meets the ground. A **box** is the face of a sign; a polygon, an ellipse
or a turned rectangle counts as the upright box around it. What lies on the ground (a label that
``labels.toml`` calls so) keeps the corners of its polygon, and may be a **line**. An object with a keypoint
that is named as its foot (:data:`FOOT_WORDS`) is that foot: its box is then of the whole object, pole and
all, and no face.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from twin.drives.folder.notes import SkipKind, Skipped

_CORNER_TO_CENTRE_PX = 0.5
"""Annotation tools count from the corner of the first pixel, the twin from its centre."""

_LARGEST = 1e9
"""No coordinate is larger: sums and products of such numbers stay finite."""

KEY_FRAME = "keyframe"
"""CVAT's word for a row of a track that somebody set, in every format that it exports tracks to."""
_NO = ("0", "false", "no")

NO_BOX = (math.nan, math.nan, math.nan, math.nan)

FOOT_WORDS = frozenset({"foot", "base", "bottom", "ground", "fot", "fotpunkt", "bunn"})
"""A keypoint whose name has one of these words is the foot."""

Pixel = tuple[float, float]
Edges = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Shape:
    """One point, box or line.

    Attributes
    ----------
    kind : str
        ``foot``, ``box``, or ``line``: of what lies on the ground alone.
    pixel_px : (x, y)
        The foot, or the centre of the box, or of that around the line; (0, 0) is the centre of the first
        pixel.
    box_px : (left, top, right, bottom)
        NaN for points.
    outline_px : tuple of (x, y)
        Corners of a polygon or a line in their order, the first not again at the end; empty for others.
    is_fraction : bool
        Whether the coordinates are fractions of the image, from its corner, since the tool does not
        say how large it is: :meth:`in_pixels` turns them into pixels.
    label : str
    attributes : mapping of str to str
    track : str
        Track id, else "".
    frame : int or None
        Absolute frame number in the source (video tasks); None in image tasks.
    image : str
        Name of the image; "" in video tasks.
    image_id : int
        Running number of the image; -1 where there is none.
    size_px : (width, height) or None
        Of the image that was annotated.
    task : str
        Id of the task in a project export, else "".
    is_measured : bool
        Whether somebody put it there; False where the format itself says that the tool put it between two key
        frames. The attribute ``keyframe`` may say so besides.
    """

    kind: str
    pixel_px: Pixel
    box_px: Edges = NO_BOX
    outline_px: tuple[Pixel, ...] = ()
    is_fraction: bool = False
    label: str = ""
    attributes: Mapping[str, str] = field(default_factory=dict)
    track: str = ""
    frame: int | None = None
    image: str = ""
    image_id: int = -1
    size_px: tuple[int, int] | None = None
    task: str = ""
    is_measured: bool = True

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
            outline_px=tuple((x * width_px - half, y * height_px - half) for x, y in self.outline_px),
            is_fraction=False,
        )


class UnusableShapeError(Exception):
    """A shape that is left out: the reason in words, what stands in the file if it likes, and the kind."""

    def __init__(self, reason: str, example: str = "", kind: SkipKind = SkipKind.UNUSABLE) -> None:
        super().__init__(reason)
        self.example = example
        self.kind = kind


def of_kind(kind: str) -> UnusableShapeError:
    """Return the reason to leave out a shape of a kind that stands for no foot and no face."""
    return UnusableShapeError(SkipKind.OTHER_SHAPE.reason(f"{kind:.40}"), kind=SkipKind.OTHER_SHAPE)


@dataclass(frozen=True, slots=True)
class YoloClasses:
    """What ``data.yaml``, ``obj.names`` or ``classes.txt`` says.

    Attributes
    ----------
    labels : mapping of class number to name
    n_keypoints : int
        Key points of an object; 0 for boxes and polygons.
    n_values : int
        2: x and y; 3: and visibility.
    keypoint_names : tuple of str
        Empty where not said.
    """

    labels: dict[int, str]
    n_keypoints: int = 0
    n_values: int = 3
    keypoint_names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Hints:
    """What the drive says of its annotation files besides.

    Attributes
    ----------
    feet : collection of str
        Names of keypoints that are the foot, which ``labels.toml`` adds.
    classes : YoloClasses or None
        Names of the classes of YOLO files; None where the folder has none.
    on_ground : callable
        Whether ``labels.toml`` says of a label that it is of what lies on the ground.
    """

    feet: Collection[str] = ()
    classes: YoloClasses | None = None
    on_ground: Callable[[str], bool] = lambda _label: False


NO_HINTS = Hints()


@dataclass(slots=True)
class AnnotationFile:
    """One export, or a folder of files that hold one image each, filled by its reader.

    Attributes
    ----------
    where : str
        File or folder name.
    tool : str
        The format, as people call it: ``CVAT``, ``COCO``.
    shapes : list of Shape
    left_out : Counter of (reason, kind)
    source : tuple of str
        Names of the video and of the task, in which a camera may be named.
    tasks : dict of task id to names
        The same for each task of a project export.
    n_files : int
        Files that were brought together in it.
    """

    where: str
    tool: str
    shapes: list[Shape] = field(default_factory=list)
    left_out: Counter[tuple[str, SkipKind]] = field(default_factory=Counter)
    source: tuple[str, ...] = ()
    tasks: dict[str, tuple[str, ...]] = field(default_factory=dict)
    n_files: int = 1
    _examples: dict[str, str] = field(default_factory=dict)

    @contextmanager
    def counting(self) -> Iterator[None]:
        """Count a shape that turns out unusable instead of raising."""
        try:
            yield
        except UnusableShapeError as error:
            self.leave_out(error)

    def leave_out(self, error: UnusableShapeError, count: int = 1) -> None:
        """Count shapes that are not taken; the first example of a reason is told."""
        reason = str(error)
        self.left_out[reason, error.kind] += count
        if error.example:
            self._examples.setdefault(reason, f"{reason}, such as {error.example!r:.60}")

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """What was left out, by reason."""
        return tuple(
            Skipped("annotations", self.where, n, self._examples.get(reason, reason), kind)
            for (reason, kind), n in sorted(self.left_out.items())
            if n
        )


def is_key_frame(said: str | None) -> bool:
    """Whether a row of a track is a key frame by what its file says; one of which it says nothing is one."""
    return (said or "").strip().casefold() not in _NO


def foot_at(x: float, y: float) -> Shape:
    """Return the foot at a point that is counted from the corner of the first pixel."""
    return Shape("foot", (x - _CORNER_TO_CENTRE_PX, y - _CORNER_TO_CENTRE_PX))


def box_at(left: float, top: float, right: float, bottom: float) -> Shape:
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
    return Shape("box", centre, (left - half, top - half, right - half, bottom - half))


def box_around(points: Sequence[Pixel]) -> Shape:
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


def area_at(points: Sequence[Pixel]) -> Shape:
    """Return a polygon, from the corner of the first pixel: a face by the box around it, with its corners.

    Raises
    ------
    UnusableShapeError
        As `box_around`.
    """
    return replace(box_around(points), outline_px=_outline(points))


def line_at(points: Sequence[Pixel]) -> Shape:
    """Return a line on the ground through points that are counted from the corner of the first pixel.

    Raises
    ------
    UnusableShapeError
        If it has no length.
    """
    outline = _outline(points)
    if len(set(outline)) < 2:
        raise UnusableShapeError("line without length")
    x, y = zip(*outline, strict=True)
    edges = (min(x), min(y), max(x), max(y))
    return Shape("line", ((edges[0] + edges[2]) / 2, (edges[1] + edges[3]) / 2), edges, outline)


def _outline(points: Sequence[Pixel]) -> tuple[Pixel, ...]:
    """Corners from the centre of the first pixel; one that is set twice, as tools close polygons, once."""
    half = _CORNER_TO_CENTRE_PX
    moved = [(x - half, y - half) for x, y in points]
    kept = [point for k, point in enumerate(moved) if not k or point != moved[k - 1]]
    return tuple(kept[:-1] if len(kept) > 2 and kept[0] == kept[-1] else kept)


def as_fraction(shape: Shape) -> Shape:
    """Return the same for coordinates that are fractions of the image: no pixel's half is taken off yet."""
    half = _CORNER_TO_CENTRE_PX
    x, y = shape.pixel_px
    left, top, right, bottom = shape.box_px
    box = (left + half, top + half, right + half, bottom + half)
    outline = tuple((u + half, v + half) for u, v in shape.outline_px)
    return replace(shape, pixel_px=(x + half, y + half), box_px=box, outline_px=outline, is_fraction=True)


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
    floats = []
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise UnusableShapeError("coordinates unreadable")
        try:
            floats.append(float(value))
        except ValueError:
            raise UnusableShapeError("coordinates unreadable") from None
        except OverflowError:
            raise UnusableShapeError("coordinates not finite") from None
    if not all(math.isfinite(value) for value in floats):
        raise UnusableShapeError("coordinates not finite")
    if any(abs(value) > _LARGEST for value in floats):
        raise UnusableShapeError("coordinates beyond any image")
    return floats


def foot_of(names: Sequence[str], feet: Collection[str] = ()) -> int | None:
    """Return which of an object's keypoints is the foot: the one so named, or the only one; None if unclear.

    Parameters
    ----------
    names : sequence of str
        One a keypoint.
    feet : collection of str
        Names that ``labels.toml`` adds.
    """
    given = {name.casefold() for name in feet}
    which = [
        k
        for k, name in enumerate(names)
        if name.casefold() in given or FOOT_WORDS & set(re.findall(r"[^\W\d_]+", name.casefold()))
    ]
    if len(which) == 1:
        return which[0]
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
    return AnnotationFile(
        where,
        every[0].tool,
        shapes=[shape for file in every for shape in file.shapes],
        left_out=sum((file.left_out for file in every), Counter()),
        n_files=len(every),
    )
