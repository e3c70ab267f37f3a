"""The page's own files in a drive folder: ``CAMERA.annotate.xml``, CVAT XML 1.1.

Files of other tools are never written. Of its own, what stood there when the page was opened, and whatever
another program put there since, is copied to ``CAMERA.annotate.xml.20260610T080000Z.before`` first.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from geoloc.locate.records import Kind
from twin.annotate.marks import Mark, Page, Sign, Where
from twin.drives.annotations.formats.cvat import read_cvat
from twin.drives.annotations.write_cvat import CvatRow, CvatTask, CvatTrack, cvat_document
from twin.errors import RefusedError
from twin.store.atomic_files import replace_file

_ENDING = ".annotate.xml"
_BY = "by"


def file_name(camera: str) -> str:
    """Return the name of a camera's file; file systems refuse the colons of ``camera:front:120``."""
    return re.sub(r"[^\w.-]+", "_", camera) + _ENDING


def is_own_file(name: str) -> bool:
    """Whether a file of the folder is one of these."""
    return name.endswith(_ENDING)


@dataclass(slots=True)
class OwnFiles:
    """The page's files of one drive.

    Attributes
    ----------
    root : Path
        The drive folder.
    tasks : mapping of camera to CvatTask
        What each file says of its recording; times are set when it is written.
    """

    root: Path
    tasks: Mapping[str, CvatTask]
    _written: dict[str, bytes] = field(default_factory=dict)
    _kept: dict[str, Sequence[CvatTrack]] = field(default_factory=dict)

    def read(self) -> Page:
        """Read what earlier runs of the page have kept.

        Raises
        ------
        DriveError
            A file is damaged.
        """
        signs: dict[str, Sign] = {}
        marks: dict[Where, Mark] = {}
        for camera in self.tasks:
            content = self._content(camera)
            for shape in read_cvat(content, file_name(camera)).shapes if content else ():
                said, kind = shape.attributes, Kind(shape.kind)
                name = said.get("object") or f"{camera}:{shape.track}"
                place = shape.pixel_px if kind is Kind.FOOT else shape.box_px
                marks[Where(name, camera, shape.frame or 0, kind)] = Mark(tuple(place), shape.is_measured)
                signs[name] = Sign(said.get("skiltnummer", ""), said.get(_BY, ""))
        return Page(signs, marks)

    def save(self, before: Page, after: Page, now: dt.datetime) -> list[str]:
        """Write the files of the cameras in which something changed.

        Returns
        -------
        list of str
            Copies that were made of what stood there.

        Raises
        ------
        RefusedError
            A file cannot be written: it is as it was.
        """
        copies = []
        for camera in self.tasks:
            tracks = _tracks(after, camera)
            # What was written before another file failed is not what the page holds: it is written again.
            if tracks == self._kept.get(camera, _tracks(before, camera)):
                continue
            copies += self._copy(camera, now)
            content = cvat_document(_dated(self.tasks[camera], now), tracks).encode() if tracks else b""
            self._replace(camera, content)
            self._written[camera], self._kept[camera] = content, tracks
        return copies

    def _replace(self, camera: str, content: bytes) -> None:
        """Put a camera's file there; one without a mark is none."""
        path = self.root / file_name(camera)
        if content:
            replace_file(path, content)
            return
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise RefusedError(
                f"{path} cannot be deleted ({error.strerror}): check who may write there."
            ) from error

    def _copy(self, camera: str, now: dt.datetime) -> list[str]:
        """Keep what stands in the place of a file, unless this run has written it."""
        content = self._content(camera)
        if not content or content == self._written.get(camera):
            return []
        name = f"{file_name(camera)}.{now:%Y%m%dT%H%M%S%fZ}.before"
        replace_file(self.root / name, content)
        return [name]

    def _content(self, camera: str) -> bytes:
        path = self.root / file_name(camera)
        try:
            return path.read_bytes() if path.exists() else b""
        except OSError as error:
            raise RefusedError(f"{path} cannot be read ({error.strerror}): check who may read it.") from error


def _dated(task: CvatTask, now: dt.datetime) -> CvatTask:
    return replace(task, made=now.replace(microsecond=0))


def _tracks(page: Page, camera: str) -> Sequence[CvatTrack]:
    """One track an object and kind."""
    rows: dict[tuple[str, Kind], list[CvatRow]] = {}
    for where, mark in page.marks.items():
        if where.camera == camera:
            row = CvatRow(where.frame, mark.place_px, mark.is_measured)
            rows.setdefault((where.object, where.kind), []).append(row)
    return [CvatTrack(sorted(rows[name, kind]), _said(name, page.signs[name])) for name, kind in sorted(rows)]


def _said(name: str, sign: Sign) -> dict[str, str]:
    said = {"skiltnummer": sign.codes, "object": name, _BY: sign.by}
    return {key: value for key, value in said.items() if value}
