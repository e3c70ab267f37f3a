"""Pictures to calibrate from: files, folders, films."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import ByteArray
from geoloc.errors import CalibrationError
from twin.errors import DriveError, MissingExtraError

if TYPE_CHECKING:
    from twin.drives.frames.video import VideoIndex

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"})
VIDEO_SUFFIXES = frozenset(
    {".mp4", ".avi", ".mkv", ".mov", ".h264", ".h265", ".hevc", ".264", ".265", ".webm"}
)
Progress = Callable[[str, int, int | None], None]
"""Called with what is being done, how much of it is done, and how much there is."""
_FRAMES_LOOKED_AT = 240
"""Of a film, evenly spread."""


@dataclass(frozen=True, slots=True)
class Picture:
    """One grey picture and what to call it."""

    name: str
    grey: ByteArray


def files_of(sources: Sequence[Path]) -> list[Path]:
    """Pictures and films that are named, or lie in folders that are named.

    Raises
    ------
    CalibrationError
        If something named is not there, is neither, or a folder holds none.
    """
    files: list[Path] = []
    for source in sources:
        if source.is_dir():
            inside = sorted(
                p for p in source.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES | VIDEO_SUFFIXES
            )
            if not inside:
                raise CalibrationError(
                    f"There are no pictures or films in {source}: name the folder they are in."
                )
            files += inside
        elif not source.exists():
            raise CalibrationError(f"There is no file {source}: check its name.")
        elif source.suffix.lower() not in IMAGE_SUFFIXES | VIDEO_SUFFIXES:
            raise CalibrationError(
                f"{source} is neither a picture nor a film that twin reads: give PNG, JPEG, TIFF, MP4, H.264."
            )
        else:
            files.append(source)
    return files


def count(files: Sequence[Path], every: int | None) -> int:
    """How many pictures `pictures` will look at.

    Raises
    ------
    CalibrationError
        If a film cannot be read.
    """
    total = 0
    for file in files:
        if file.suffix.lower() in IMAGE_SUFFIXES:
            total += 1
        else:
            frames = _index(file).n_frames
            total += -(-frames // _step(frames, every))
    return total


def pictures(files: Sequence[Path], every: int | None = None) -> Iterator[Picture]:
    """Read the pictures, and every so manieth frame of the films.

    Raises
    ------
    CalibrationError
        If a file cannot be read, or its size is not that of the first.
    """
    first: Picture | None = None
    alone = len({file.name for file in files}) == len(files)
    for file in files:
        name = file.name if alone else str(file)
        film = file.suffix.lower() in VIDEO_SUFFIXES
        read = _film(file, name, every) if film else iter([_picture(file, name)])
        for picture in read:
            first = first or picture
            if picture.grey.shape != first.grey.shape:
                here, there = ("{1} x {0}".format(*p.grey.shape) for p in (picture, first))
                raise CalibrationError(
                    f"{picture.name} has {here} pixels and {first.name} {there}: calibrate from pictures of "
                    "one camera in its full size."
                )
            yield picture


def _picture(file: Path, name: str) -> Picture:
    import cv2

    # Not imread: on Windows it cannot read names outside of ASCII.
    data = np.frombuffer(file.read_bytes(), dtype=np.uint8)
    grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if grey is None:
        raise CalibrationError(f"{file} cannot be read as a picture: save it again, or leave it out.")
    return Picture(name, np.asarray(grey, dtype=np.uint8))


def _film(file: Path, name: str, every: int | None) -> Iterator[Picture]:
    """Frames of a film, by PyAV: OpenCV decodes damaged ones without a word."""
    import cv2

    from twin.drives.frames.video import decoded

    index = _index(file)
    wanted = np.zeros(index.n_frames, dtype=np.bool_)
    wanted[:: _step(index.n_frames, every)] = True
    with file.open("rb") as stream:
        for number, image in decoded(stream, index, wanted, Counter()):
            grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
            yield Picture(f"{name}#{number}", np.asarray(grey, dtype=np.uint8))


def _index(file: Path) -> VideoIndex:
    from twin.drives.frames.video import index_video

    try:
        with file.open("rb") as stream:
            return index_video(stream, file.name)
    except MissingExtraError:
        raise
    except DriveError as error:
        raise CalibrationError(str(error)) from error


def _step(frames: int, every: int | None) -> int:
    return max(1, frames // _FRAMES_LOOKED_AT) if every is None else every
