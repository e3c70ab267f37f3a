"""Sensor names in the names of files, tasks and images."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

from geoloc.errors import CalibrationError
from geoloc.rig.rig import Rig, RigCamera
from twin.drives.annotations.formats.frame_lines import TOOL as FRAME_LINES
from twin.drives.annotations.formats.plain_csv import TOOL as CSV
from twin.drives.annotations.formats.shapes import AnnotationFile, Shape
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.sensor_names import named_in, which_camera
from twin.errors import DriveError

_AFTER_HASH = re.compile(r"#([^\W\d_][^/#.]*)")
"""A camera as ``[cameras]`` names it in a calibration file, ``boxes#cam0.csv``; ``run #3`` is none."""

_NAMING = (CSV, FRAME_LINES)
"""Tools whose files name the camera of each row outright."""


class CameraChooser:
    """Says which camera each shape of one annotation file belongs to.

    Parameters
    ----------
    file : AnnotationFile
    declared : str or None
        The camera that ``drive.toml`` gives the file, which settles it.
    rig : Rig

    Attributes
    ----------
    chosen : set of str
        Cameras that were named so far.
    """

    def __init__(self, file: AnnotationFile, declared: str | None, rig: Rig) -> None:
        self.chosen: set[str] = set()
        self._file = file
        self._declared = declared
        self._rig = rig
        self._aliases = {name: name for name in (*rig.cameras, *rig.unsupported)}
        for camera in rig.cameras.values():
            if camera.video:
                self._aliases.setdefault(PurePosixPath(camera.video).stem, camera.name)
        self._known: dict[tuple[str, str], RigCamera] = {}

    def of(self, shape: Shape) -> RigCamera:
        """Return the camera of a shape.

        Raises
        ------
        DriveError
            If that is unclear, or the rig does not have the camera or cannot compute with it.
        """
        key = (shape.task, shape.image)
        if key not in self._known:
            self._known[key] = self._camera(*key)
        return self._known[key]

    def of_empty_file(self) -> set[str]:
        """Name the camera of a file without usable shapes: annotated, with nothing seen; empty if unclear."""
        candidates = self._candidates("", "")
        return candidates & set(self._rig.cameras) if len(candidates) == 1 else set()

    def _camera(self, task: str, image: str) -> RigCamera:
        if self._declared is None:
            self._refuse_absent(task)
        candidates = self._candidates(task, image)
        if len(candidates) != 1:
            raise DriveError(self._unclear(candidates))
        (name,) = candidates
        try:
            camera = self._rig.camera(name)
        except CalibrationError as error:
            raise DriveError(f"{self._file.where} annotates {name}: {error}") from error
        self.chosen.add(name)
        return camera

    def _candidates(self, task: str, image: str) -> set[str]:
        """Cameras that every source of a name agrees on; all that were named where they disagree."""
        if self._declared is not None:
            return {self._declared}
        place = PurePosixPath(self._file.where)
        of_task = self._cameras_in(*self._file.tasks.get(task, ()))
        clues = (
            self._cameras_in(place.stem) or self._cameras_in(*place.parent.parts),
            of_task or self._cameras_in(*self._file.source),
            self._cameras_in(image),
        )
        named = [clue for clue in clues if clue]
        if not named:
            return set(self._rig.cameras) if len(self._rig.cameras) == 1 else set()
        return set.intersection(*named) or set.union(*named)

    def _refuse_absent(self, task: str) -> None:
        """Refuse a camera that a CSV's column, a detector's line or ``#`` names, and that is absent."""
        named = _AFTER_HASH.findall(self._file.where)
        named += self._file.tasks.get(task, ()) if self._file.tool in _NAMING else ()
        for name in named:
            if not self._cameras_in(name):
                raise DriveError(
                    f"{self._file.where} names the camera {name:.80}, which {self._rig.source} does not have"
                    f" ({which_camera(name, self._aliases.values())}): correct the name, or give the rig that"
                    " the camera belongs to."
                )

    def _cameras_in(self, *texts: str) -> set[str]:
        return {self._aliases[alias] for text in texts for alias in named_in(text, self._aliases)}

    def _unclear(self, candidates: set[str]) -> str:
        cameras = ", ".join(sorted({*self._rig.cameras, *self._rig.unsupported}))
        which = (
            f"could be of {' or of '.join(sorted(candidates))}"
            if candidates
            else "names no camera of the rig"
        )
        return (
            f'{self._file.where} {which}: write [annotations] <camera> = "{self._file.where}" in'
            f" {SETTINGS_FILE}, or put the camera into the file's name (the cameras of {self._rig.source} are"
            f" {cameras})."
        )
