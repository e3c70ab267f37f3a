"""Pictures to calibrate from: files, folders, films."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geoloc.errors import CalibrationError
from twin.calibrate.boards import ByteArray

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"})
VIDEO_SUFFIXES = frozenset(
    {".mp4", ".avi", ".mkv", ".mov", ".h264", ".h265", ".hevc", ".264", ".265", ".webm"}
)
_FRAMES_LOOKED_AT = 240
"""Of a film whose length is known; of others every tenth frame."""
_EVERY = 10


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


def count(files: Sequence[Path], every: int | None) -> int | None:
    """How many pictures `pictures` will give; None where a film does not say how long it is."""
    total = 0
    for file in files:
        if file.suffix.lower() in IMAGE_SUFFIXES:
            total += 1
            continue
        frames = _n_frames(file)
        if frames is None:
            return None
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
    import cv2

    step = _step(_n_frames(file), every)
    film = cv2.VideoCapture(str(file))
    try:
        number = 0
        while film.grab():
            if number % step == 0:
                read, image = film.retrieve()
                if read:
                    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
                    yield Picture(f"{name}#{number}", np.asarray(grey, dtype=np.uint8))
            number += 1
    finally:
        film.release()
    if number == 0:
        raise CalibrationError(f"{file} has no frame that can be read: convert it to MP4.")


def _n_frames(file: Path) -> int | None:
    """Frames of a film; None for raw streams, which do not say."""
    import cv2

    film = cv2.VideoCapture(str(file))
    frames = int(film.get(cv2.CAP_PROP_FRAME_COUNT)) if film.isOpened() else 0
    film.release()
    return frames if frames > 0 else None


def _step(frames: int | None, every: int | None) -> int:
    if every is not None:
        return every
    return _EVERY if frames is None else max(1, frames // _FRAMES_LOOKED_AT)
