"""YOLO labels: one text file for each image, and the names of the classes beside them.

The format: https://docs.ultralytics.com/datasets/detect/ and https://docs.ultralytics.com/datasets/pose/. A
row is ``class x y width height`` in fractions of the image, the middle of the box first; then, if
``kpt_shape`` in ``data.yaml`` says so, the key points; or ``class`` and the corners of a polygon. A sixth
number up to 1 is a confidence; a whole one above 1 is the track, as trackers write it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

from twin.drives.annotations.formats.json_values import mapping, sequence, text
from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    Shape,
    UnusableShapeError,
    YoloClasses,
    area_at,
    as_fraction,
    box_at,
    foot_at,
    foot_of,
    numbers,
    pairs,
)
from twin.errors import DriveError

TOOL = "YOLO"
NAME_FILES = (".names", ".yaml", ".yml", "classes.txt")
"""How the files end that name the classes."""
_MOST_BYTES = 1_000_000
_MOST_POINTS = 1000


def looks_like_yolo(head: bytes) -> bool:
    """Whether the beginning of a file is empty, or a class number and four fractions or more."""
    first = next((line for line in head.splitlines() if line.strip()), None)
    if first is None:
        return True
    cells = first.split()
    if len(cells) < 5 or not cells[0].isdigit():
        return False
    try:
        return all(-0.5 <= float(cell) <= 1.5 for cell in cells[1:5])
    except ValueError:
        return False


def read_yolo_classes(content: bytes, where: str) -> YoloClasses:
    """Read the names of the classes: YAML with ``names``, or one name a line.

    Raises
    ------
    DriveError
        If it is larger than a list of names, no UTF-8, or its YAML is none or has no names.
    """
    if len(content) > _MOST_BYTES:
        raise DriveError(f"{where} is {len(content) / 1e6:.0f} MB: that is no list of class names.")
    try:
        written = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DriveError(f"{where} is not UTF-8 text: save it as UTF-8.") from error
    if not where.lower().endswith((".yaml", ".yml")):
        names = [line.strip() for line in written.splitlines()]
        return YoloClasses({number: name for number, name in enumerate(names) if name})
    document = mapping(_yaml(written, where))
    labels = _numbered(document.get("names"))
    if not labels:
        raise DriveError(f"{where} has no names: a YOLO data set names its classes there.")
    shape = [_number(value) for value in sequence(document.get("kpt_shape"))]
    n_keypoints, n_values = shape if len(shape) == 2 else (0, 3)
    if not 0 <= n_keypoints <= _MOST_POINTS or n_values not in {2, 3}:
        raise DriveError(f"{where} gives kpt_shape: {shape}: it must be the number of points, and 2 or 3.")
    per_class = document.get("kpt_names")
    points = next(iter(mapping(per_class).values()), per_class)
    return YoloClasses(labels, n_keypoints, n_values, tuple(text(name) for name in sequence(points)))


def read_yolo(content: bytes, where: str, hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read the labels of one image.

    Parameters
    ----------
    content : bytes
    where : str
        File name: that of the image, too.
    hints : Hints
        Without names of the classes the label of class 3 is ``class 3``.
    """
    file, classes = AnnotationFile(where, TOOL), hints.classes or YoloClasses({})
    for line in content.decode("utf-8-sig", errors="replace").splitlines():
        cells = line.split()
        if not cells:
            continue
        with file.counting():
            number, values = _row(cells)
            label = classes.labels.get(number, f"class {number}")
            file.shapes.append(replace(_shape(values, classes, hints.feet), label=label, image=where))
    return file


def _row(cells: Sequence[str]) -> tuple[int, list[float]]:
    number, *values = numbers(*cells)
    if number < 0 or number != int(number) or number > 1e6:
        raise UnusableShapeError("class number unreadable")
    if values and max(map(abs, values[:4])) > 1.5:
        raise UnusableShapeError("coordinates are no fractions of the image")
    return int(number), values


def _shape(values: list[float], classes: YoloClasses, feet: Collection[str]) -> Shape:
    """Return the shape, with its track where there is one."""
    n = len(values)
    n_pose = 4 + classes.n_keypoints * classes.n_values
    if classes.n_keypoints and n in {n_pose, n_pose + 1}:
        return _foot(values[4:n_pose], classes, feet)
    if n in {4, 5}:
        x, y, width, height = values[:4]
        box = box_at(x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        track = str(int(values[4])) if n == 5 and values[4] > 1 and values[4] == int(values[4]) else ""
        return replace(as_fraction(box), track=track)
    if not classes.n_keypoints and n >= 6 and n % 2 == 0:
        return as_fraction(area_at(pairs(values)))
    if classes.n_keypoints:
        said = f"kpt_shape in data.yaml makes it {n_pose + 1}"
    else:
        said = "key points need kpt_shape = [points, 2 or 3] in data.yaml"
    raise UnusableShapeError(f"row of {n + 1} numbers" + (f": {said}" if n > 5 else ""))


def _foot(values: list[float], classes: YoloClasses, feet: Collection[str]) -> Shape:
    which = foot_of(classes.keypoint_names or [""] * classes.n_keypoints, feet)
    if which is None or which >= classes.n_keypoints:
        raise UnusableShapeError("keypoints, none of them named foot")
    point = values[which * classes.n_values : (which + 1) * classes.n_values]
    if len(point) == 3 and point[2] == 0:
        raise UnusableShapeError("foot not marked")
    return as_fraction(foot_at(point[0], point[1]))


def _numbered(names: object) -> dict[int, str]:
    """Class number → name of a YAML list, or of a mapping from numbers."""
    if isinstance(names, list):
        return {number: text(name) for number, name in enumerate(names)}
    return {_number(number): text(name) for number, name in mapping(names).items()}


def _number(value: object) -> int:
    """A whole number as it is written; -1 for anything else."""
    written = text(value)
    return int(written) if re.fullmatch(r"[0-9]{1,6}", written) else -1


def _yaml(written: str, where: str) -> Any:
    import yaml

    class Plain(yaml.BaseLoader):
        """Texts as they are written, since 362.50 is no number; no references, which can grow without end."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.events.AliasEvent):
                raise yaml.YAMLError("it has references")
            return super().compose_node(parent, index)

    try:
        return yaml.load(written, Loader=Plain)  # noqa: S506  # makes texts, lists and mappings alone
    except (yaml.YAMLError, ValueError, RecursionError, OverflowError, TypeError) as error:
        reason = " ".join(str(error).split())
        raise DriveError(f"{where} is not YAML that can be read ({reason:.120}): correct it.") from error
