"""What live sources receive → a drive folder."""

from __future__ import annotations

import logging
import os
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from io import FileIO
from pathlib import Path
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Any, Self

from msgspec.structs import replace

from twin.drives.annotations.formats.frame_lines import SUFFIX, FrameLine, line_of_frame
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.errors import CURES, FileError, RefusedError, TwinError
from twin.live.car import Car
from twin.live.toml_text import toml_text
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder

_log = logging.getLogger("twin.live")
_TO_DISK_EVERY_S = 1.0
_OF_RECORDINGS = (
    *("name", "poses", "motion", "timestamps", "frames", "annotations", "annotations_complete"),
    *("detections_complete", "first_frame", "frames_by_number"),
)
"""Keys of ``drive.toml`` that are of a drive, and not of its car."""
_STAMPS_HEADER = b"frame,time_ns\n"
_WRITTEN_BY = "# Written by twin live: the car's own, and what was recorded.\n"


class Form(StrEnum):
    """How what a receiver sends is written, by the suffix of its file."""

    NMEA = "nmea"
    SBP = "sbp"
    GPSD = "gpsd"


class Recorder:
    """Writes what sources receive, as received, into a folder that ``twin ingest-drive`` reads as any drive.

    The folder is readable at any moment: every line is handed to the system as it comes, and to the disk
    every second, so that a kill loses nothing that has come and a power cut a second at most. Any number of
    threads may write. It is empty until ``with`` begins: a run that cannot begin leaves it to the next one.

    Parameters
    ----------
    folder : Path
        Made; refused where it holds anything.
    car : Car
        Its files are copied, but for recordings.

    Attributes
    ----------
    folder : Path
    failure : str
        Why nothing more is written, one sentence (a full disk), which is logged once; "" while it works.
        Sources go on without it.

    Raises
    ------
    RefusedError
        If the folder is not empty, or cannot be made.
    FileError
        If a file of the car cannot be copied.
    """

    def __init__(self, folder: Path, car: Car) -> None:
        self.folder, self.failure = make_folder(folder), ""
        if any(self.folder.iterdir()):
            raise RefusedError(f"{folder} is not empty: name a new folder to record into.")
        self._document = _of_car(car)
        self._rig_antennas = frozenset(car.rig.antennas)
        self._lock, self._ended = Lock(), Event()
        self._files: dict[str, FileIO] = {}
        self._gnss: dict[str, str] = {}
        self._cameras: dict[str, _Camera] = {}
        self._car = car
        self._syncing = Thread(target=self._sync, name="recorder", daemon=True)

    def fixes(self, antenna: str, form: Form) -> Callable[[bytes], None]:
        """Return what writes the bytes of a receiver: whole lines, or what has come of messages."""
        return partial(self._write_fixes, antenna, f"{_file_name(antenna)}.{form}")

    def frame(self, frame: FrameLine, line: bytes, stamp_ns: int) -> None:
        """Write a frame with its detections, and its stamp.

        Parameters
        ----------
        frame : FrameLine
        line : bytes
            As received, without its end. Frames of a camera that counts anew get numbers that go on.
        stamp_ns : int
            As a drive's file of stamps has it.
        """
        with self._writing() as works:
            if not works:
                return
            if frame.camera not in self._cameras:
                name = _file_name(frame.camera)
                self._cameras[frame.camera] = _Camera(name + SUFFIX, f"{name}.timestamps")
                self._write(f"{name}.timestamps", _STAMPS_HEADER)
                self._write(name + SUFFIX, b"")
                replace_file(self.folder / SETTINGS_FILE, self._settings())
            camera = self._cameras[frame.camera]
            added = camera.added(frame.frame, stamp_ns)
            whole = line_of_frame(replace(frame, frame=frame.frame + added)) if added else line + b"\n"
            # Detections without a stamp are left out; a stamp without them would say that nothing was there.
            self._write(camera.detections, whole)
            self._write(camera.stamps, b"%d,%d\n" % (frame.frame + added, stamp_ns))

    def close(self) -> None:
        """Write everything to the disk and end; what sources still hand over is dropped."""
        self._ended.set()
        self._syncing.join()
        with self._lock:
            for file in self._files.values():
                file.close()
            self._files.clear()

    def __enter__(self) -> Self:
        _copy(self._car, self.folder)
        replace_file(self.folder / SETTINGS_FILE, self._settings())
        self._syncing.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write_fixes(self, antenna: str, file: str, data: bytes) -> None:
        with self._writing() as works:
            if not works:
                return
            if antenna not in self._gnss:
                self._write(file, b"")
                self._gnss[antenna] = file
                replace_file(self.folder / SETTINGS_FILE, self._settings())
            self._write(file, data)

    @contextmanager
    def _writing(self) -> Iterator[bool]:
        """Hold the files, and note why nothing can be written any more; yield whether anything can be."""
        with self._lock:
            try:
                yield not self.failure and not self._ended.is_set()
            except (OSError, TwinError) as error:
                why = error.strerror if isinstance(error, OSError) else str(error)
                cure = (
                    CURES.get(error.errno or 0, "name another folder") if isinstance(error, OSError) else ""
                )
                self.failure = f"{self.folder} takes no more of the drive ({why}){cure and ': ' + cure}."
                _log.error("%s", self.failure)

    def _write(self, name: str, data: bytes) -> None:
        file = self._files.get(name)
        if file is None:
            file = self._files[name] = FileIO(self.folder / name, "a")
        while data:
            data = data[file.write(data) :]

    def _sync(self) -> None:
        """Bring to the disk what the system holds, once a second and at the end; nobody waits for it."""
        goes_on = True
        while goes_on:
            goes_on = not self._ended.wait(_TO_DISK_EVERY_S)
            with self._lock:
                files = list(self._files.values())
            for file in files:
                with suppress(OSError):  # the next write says so
                    os.fsync(file.fileno())

    def _settings(self) -> bytes:
        """``drive.toml`` of what has been recorded so far."""
        document = dict(self._document)
        gnss = dict(document.get("gnss", {}))
        arms = gnss.pop("lever_arms", {})
        arms = {name: arm for name, arm in arms.items() if name in self._rig_antennas | self._gnss.keys()}
        gnss |= ({"lever_arms": arms} if arms else {}) | ({"files": self._gnss} if self._gnss else {})
        document |= {"gnss": gnss} if gnss else {}
        if self._cameras:
            document["timestamps"] = {name: one.stamps for name, one in self._cameras.items()}
            document["annotations"] = {name: one.detections for name, one in self._cameras.items()}
        return (_WRITTEN_BY + toml_text(document)).encode()


@dataclass(slots=True)
class _Camera:
    """Files of a camera, and its last frame as it was written."""

    detections: str
    stamps: str
    number: int = -1
    stamp_ns: int = 0
    before: int = 0

    def added(self, number: int, stamp_ns: int) -> int:
        """What is added to a frame's number: a camera that was started again counts from 0 again."""
        is_later = stamp_ns > self.stamp_ns
        if is_later and number + self.before <= self.number:
            self.before = self.number + 1 - number
        if is_later:
            self.number, self.stamp_ns = number + self.before, stamp_ns
        return self.before


def _of_car(car: Car) -> dict[str, Any]:
    """``drive.toml`` of the car, but for what is of recordings."""
    path = car.path / SETTINGS_FILE
    document = tomllib.loads(path.read_text("utf-8-sig")) if SETTINGS_FILE in car.files else {}
    kept = {key: value for key, value in document.items() if key not in _OF_RECORDINGS}
    if "gnss" in kept:
        kept["gnss"] = {key: value for key, value in kept["gnss"].items() if key not in ("files", "topics")}
    # What is recorded was found by a detector: whether it finds every sign is said there.
    return kept | {"annotations_complete": car.settings.detections_complete}


def _copy(car: Car, folder: Path) -> None:
    for name in car.files:
        if name == SETTINGS_FILE:
            continue
        try:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(car.path / name, folder / name)
        except OSError as error:
            raise FileError(
                f"{car.path / name} cannot be copied to {folder} ({error.strerror}):"
                f" {CURES.get(error.errno or 0, 'name another folder')}."
            ) from error


def _file_name(sensor: str) -> str:
    """Name of a sensor's file: what no system's names can have becomes a line."""
    return re.sub(r"[^\w.+-]+", "_", sensor).strip(".")[:100] or "_"
