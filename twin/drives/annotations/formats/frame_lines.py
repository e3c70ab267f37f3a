"""Detections as a detector writes them while it runs: JSON lines, one frame a line.

::

    {"camera": "C3", "frame": 1043, "time_ns": 1781078434767000000, "detections":
     [{"foot": [1063.2, 619.4], "object": "P15", "skiltnummer": "362.50"},
      {"box": [310.0, 80.5, 352.0, 121.0], "label": "stop", "track": 7, "score": 0.93}]}

(on one line). Pixels count from the corner of the first pixel, as annotation tools count: reading subtracts
0.5. A frame without detections says that nothing was there. Keys that twin does not know are passed by.
`twin.live` reads these lines from sockets, and this module reads the files of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import msgspec

from twin.drives.annotations.formats.shapes import (
    NO_HINTS,
    AnnotationFile,
    Hints,
    Shape,
    UnusableShapeError,
    box_at,
    foot_at,
    numbers,
)
from twin.drives.epochs import credible

TOOL = "frame lines"
SUFFIX = ".jsonl"
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_FIRST_LINES = 20


class Found(msgspec.Struct, frozen=True):
    """One detection: a foot, a box, or both.

    Attributes
    ----------
    foot : (x, y) or None
        Where the pole meets the ground.
    box : (left, top, right, bottom) or None
        The sign's face.
    label : str
        The class, as the detector calls it.
    skiltnummer : str
        Sign codes on this pole, top down, joined by ``;``.
    text : str
        What is written on these plates.
    object : str or int
        The same for one pole in all frames and cameras.
    track : str or int
        The same for one pole in the frames of this camera.
    score : float or None
        How sure the detector is.
    """

    foot: tuple[float, float] | None = None
    box: tuple[float, float, float, float] | None = None
    label: str = ""
    skiltnummer: str = ""
    text: str = ""
    object: str | int = ""
    track: str | int = ""
    score: float | None = None


class FrameLine(msgspec.Struct, frozen=True, omit_defaults=True):
    """One frame; one of `time_ns`, `time` and `stamp_ns` says when it was exposed.

    Attributes
    ----------
    camera : str
        As the rig calls it.
    frame : int
        Its number in the recording of this camera.
    time_ns : int or None
        UTC of the exposure of the middle row, nanoseconds since 1970.
    time : datetime or None
        The same as text with its zone: ``2026-06-10T08:00:34.767Z``.
    stamp_ns : int or None
        What the camera was stamped with instead: ``camera_offset_ms`` of ``drive.toml`` is added to it.
    detections : tuple of Found
    """

    camera: str
    frame: int
    time_ns: int | None = None
    time: datetime | None = None
    stamp_ns: int | None = None
    detections: tuple[Found, ...] = ()

    def stamp(self, offset_ns: int) -> int | None:
        """Frame stamp, as a file of stamps has it: `offset_ns` before the exposure; None without a time."""
        exposed_ns = self.time_ns
        if exposed_ns is None and self.time is not None and self.time.tzinfo is not None:
            exposed_ns = (self.time - _EPOCH) // timedelta(microseconds=1) * 1000
        stamp_ns = self.stamp_ns if exposed_ns is None else exposed_ns - offset_ns
        return stamp_ns if stamp_ns is not None and credible(stamp_ns) else None


_DECODER = msgspec.json.Decoder(FrameLine)
_ENCODER = msgspec.json.Encoder()


def frame_of_line(line: bytes) -> FrameLine | None:
    """Read one line; None for what is no frame."""
    try:
        return _DECODER.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def line_of_frame(frame: FrameLine) -> bytes:
    """Write one line, with its end."""
    return _ENCODER.encode(frame) + b"\n"


def shapes_of(frame: FrameLine) -> Iterator[Shape | UnusableShapeError]:
    """Yield feet and faces of a frame, or why one is none."""
    for found in frame.detections:
        said = {"object": str(found.object), "skiltnummer": found.skiltnummer, "text": found.text}
        attributes = {name: value for name, value in said.items() if value}
        shapes: list[Shape] = []
        if found.foot is None and found.box is None:
            yield UnusableShapeError("neither foot nor box")
        try:
            if found.foot is not None:
                shapes.append(foot_at(*numbers(*found.foot)))
            if found.box is not None:
                shapes.append(box_at(*numbers(*found.box)))
        except UnusableShapeError as error:
            yield error
        for shape in shapes:
            yield replace(
                shape,
                label=found.label,
                attributes=attributes,
                track=str(found.track),
                frame=frame.frame,
                task=frame.camera,
            )


def looks_like_frame_lines(head: bytes) -> bool:
    """Whether one of the first lines of a file is a frame."""
    return any(frame_of_line(line) is not None for line in head.splitlines()[:_FIRST_LINES])


def read_frame_lines(content: bytes, where: str, _hints: Hints = NO_HINTS) -> AnnotationFile:
    """Read a file of frames; a line that is none, such as a last one that was cut, is counted."""
    file = AnnotationFile(where, TOOL)
    for line in content.splitlines():
        if not line.strip():
            continue
        frame = frame_of_line(line)
        if frame is None:
            file.leave_out(UnusableShapeError("line that is no frame"))
            continue
        file.tasks[frame.camera] = (frame.camera,)
        for shape in shapes_of(frame):
            if isinstance(shape, Shape):
                file.shapes.append(shape)
            else:
                file.leave_out(shape)
    return file
