"""Frames as detectors write them → frames as the engine takes them: read as a drive's annotations are."""

from __future__ import annotations

import math
from collections import Counter

from geoloc.errors import CalibrationError
from geoloc.locate.records import Kind
from geoloc.rig.rig import RigCamera
from twin.drives.annotations.formats.frame_lines import TOOL, FrameLine, shapes_of
from twin.drives.annotations.formats.shapes import AnnotationFile, Shape
from twin.drives.annotations.gather import annotations_of
from twin.drives.annotations.labels import Meanings
from twin.drives.annotations.left_out import FileReading
from twin.drives.drive import Annotation
from twin.drives.frames.stamp_files import MAX_FRAME
from twin.live.car import Car
from twin.live.events import Detection, Frame

_REMEMBERED = 2000
_POSITIONS = {kind.value for kind in (Kind.FOOT, Kind.BOX)}


class UnusableFrameError(Exception):
    """A frame that is left out; its text says why, for people."""


class UnknownCameraError(UnusableFrameError):
    """A frame of a camera that the car does not have."""


class FrameReader:
    """What a car makes of a detector's frames."""

    def __init__(self, car: Car) -> None:
        self._car = car
        self._reading = self._fresh()
        self._frames = 0

    def stamp_ns(self, line: FrameLine) -> int:
        """Return the stamp of a frame, as a drive's file of stamps has it.

        Raises
        ------
        UnusableFrameError
            For a frame without a number or a time.
        UnknownCameraError
            For a camera that the car does not have.
        """
        stamp_ns = line.stamp(self._car.settings.camera_offset_ns)
        if stamp_ns is None:
            raise UnusableFrameError("a frame without a time_ns, time or stamp_ns of this century")
        if not 0 <= line.frame <= MAX_FRAME:
            raise UnusableFrameError(f"a frame number outside 0–{MAX_FRAME}")
        self._camera(line.camera)
        return stamp_ns

    def frame(self, line: FrameLine, stamp_ns: int) -> tuple[Frame, Counter[str]]:
        """Return a frame with what can be used of its detections; how many cannot, by reason, for people."""
        camera = self._camera(line.camera)
        left_out = Counter[str]()
        shapes: list[Shape] = []
        for shape in shapes_of(line):
            if isinstance(shape, Shape):
                shapes.append(shape)
            else:
                left_out[str(shape)] += 1
        rows = annotations_of(AnnotationFile(TOOL, TOOL, shapes), lambda _shape: camera, self._reading)
        alone = len(self._car.rig.cameras) == 1
        found = tuple(_detection(row, track, alone=alone) for row, track in rows if row.kind in _POSITIONS)
        for reasons in self._reading.faults.values():
            left_out += reasons
        self._reading.faults.clear()
        self._frames += 1
        if self._frames % _REMEMBERED == 0:
            # It remembers every label that it was asked for: garbage may have many.
            self._reading = self._fresh()
        epoch_ns = stamp_ns + self._car.settings.camera_offset_ns
        return Frame(line.camera, line.frame, epoch_ns, found), left_out

    def _camera(self, name: str) -> RigCamera:
        try:
            return self._car.rig.camera(name)
        except CalibrationError as error:
            known = ", ".join(sorted(self._car.rig.cameras)) or "none"
            raise UnknownCameraError(f"camera {name:.60} is not in the rig: it has {known}") from error

    def _fresh(self) -> FileReading:
        return FileReading(self._car.rig.source, Meanings(self._car.labels), {}, 0, {})


def _detection(row: Annotation, track: str, *, alone: bool) -> Detection:
    # A track's number says nothing of what other cameras see.
    named = row.object or (track if alone and row.has_id else None)
    _, top, _, bottom = row.box_px
    size_px = bottom - top if row.kind == Kind.BOX.value else math.nan
    return Detection(row.pixel_px, row.kind, named, row.label, row.skiltnummer, row.text, size_px)
