"""A network over the pictures of a drive → annotations, as a person would have drawn them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from geoloc.rig.rig import Rig, RigCamera
from twin.drives.annotations.formats.shapes import AnnotationFile
from twin.drives.detection.network import Detector
from twin.drives.detection.shapes import Looked, annotation_file
from twin.drives.folder.notes import Skipped
from twin.drives.frames.find import Pictures
from twin.drives.frames.read import Frame, frames
from twin.drives.frames.stamp_files import NO_STAMP
from twin.errors import ConfigError, DriveError

DEFAULT_THRESHOLD = 0.25
"""Lowest score of a box: the family's own default. What is seen only once or twice is left out anyhow."""
_TOLD_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class DetectorOptions:
    """How a detector is run.

    Attributes
    ----------
    model : Path
        ONNX file.
    every : int
        Only every so many frames.
    threshold : float
        Lowest score of a box that counts.
    """

    model: Path
    every: int = 1
    threshold: float = DEFAULT_THRESHOLD


def check_options(options: DetectorOptions) -> None:
    """Refuse options that are out of their range.

    Raises
    ------
    ConfigError
    """
    if options.every < 1 or not 0.0 < options.threshold < 1.0:
        raise ConfigError(
            f"The detector is to look at every {options.every} frames for scores of {options.threshold:g}:"
            " give a whole number from 1, and a score between 0 and 1."
        )


@dataclass(frozen=True, slots=True)
class Recorded:
    """What a detector needs of a drive.

    Attributes
    ----------
    rig : Rig
    pictures : mapping of camera to Pictures
    epoch_ns : mapping of camera to int64 (frames,)
        Epochs by frame number, on the clock of the track.
    span_ns : (int, int)
        First and last epoch of the track: frames outside it cannot be placed.
    """

    rig: Rig
    pictures: Mapping[str, Pictures]
    epoch_ns: Mapping[str, IntArray]
    span_ns: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Found:
    """What the detector found: one annotation file a camera, as if a person had drawn it."""

    files: tuple[tuple[AnnotationFile, str], ...]
    skipped: tuple[Skipped, ...]
    model_sha256: str


def detect(recorded: Recorded, options: DetectorOptions, say: Callable[[str], None]) -> Found:
    """Run a detector over all cameras of a drive that have pictures.

    Parameters
    ----------
    recorded : Recorded
    options : DetectorOptions
    say : callable
        Told once a second how far it is.

    Raises
    ------
    ConfigError
        If an option is out of its range.
    DriveError
        If there are no pictures, the pictures are not of this rig, or the network cannot be run.
    """
    check_options(options)
    if not recorded.pictures:
        raise DriveError(
            "The drive has no pictures for the detector: add a video named after its camera, or name a video"
            " or a folder of images under [frames] in drive.toml."
        )
    say(f"trying {options.model.name} out")
    detector = Detector(options.model)
    # What does not fit is found before hours of video are decoded.
    detector.find(np.zeros((64, 96, 3), dtype=np.uint8), options.threshold, Counter())
    files, skipped = [], []
    for name, pictures in sorted(recorded.pictures.items()):
        file, left_out = _of_camera(detector, recorded, pictures, options, say)
        files.append((file, name))
        skipped += left_out
    return Found(tuple(files), tuple(skipped), detector.sha256)


def _of_camera(
    detector: Detector,
    recorded: Recorded,
    pictures: Pictures,
    options: DetectorOptions,
    say: Callable[[str], None],
) -> tuple[AnnotationFile, list[Skipped]]:
    camera, epoch_ns = recorded.rig.camera(pictures.camera), recorded.epoch_ns[pictures.camera]
    wanted, n_outside = _wanted(epoch_ns, recorded.span_ns, options.every)
    wanted &= np.fromiter((pictures.has(frame) for frame in range(wanted.size)), np.bool_, wanted.size)
    lost: Counter[str] = Counter()
    unfit = Counter({"outside the track": n_outside})
    boxes: Counter[str] = Counter()
    pictures_seen: list[Looked] = []
    told = _Told(say, pictures.camera, int(wanted.sum()))
    for frame in _of_size(frames(pictures, epoch_ns, wanted, lost), camera, pictures, unfit):
        detections = detector.find(frame.image, options.threshold, boxes)
        pictures_seen.append(Looked(frame.number, frame.epoch_ns, detections))
        told.one_more()
    where = f"{detector.where} on {pictures.where}"
    file, n_loose = annotation_file(pictures_seen, detector.name_of, where)
    boxes["box that the frames around it do not show"] += n_loose
    left_out = [Skipped("frames", pictures.where, n, reason) for reason, n in sorted((lost + unfit).items())]
    left_out += [Skipped("detections", where, n, reason) for reason, n in sorted(boxes.items()) if n]
    return file, left_out


def _wanted(epoch_ns: IntArray, span_ns: tuple[int, int], every: int) -> tuple[NDArray[np.bool_], int]:
    """Frames to look at, and how many are not since the car's place is not known there."""
    stamped = epoch_ns != NO_STAMP
    inside = stamped & (epoch_ns >= span_ns[0]) & (epoch_ns <= span_ns[1])
    wanted = inside & (np.arange(len(epoch_ns)) % every == 0)
    return wanted, int(np.count_nonzero(stamped & ~inside))


def _of_size(
    every: Iterator[Frame], camera: RigCamera, pictures: Pictures, unfit: Counter[str]
) -> Iterator[Frame]:
    """Leave out images of another size than the camera's; refuse a video, or images that are all so."""
    width, height = camera.model.width_px, camera.model.height_px
    other, fits = "", False
    for frame in every:
        rows, columns = frame.image.shape[:2]
        if (columns, rows) == (width, height):
            fits = True
            yield frame
            continue
        other = f"{columns} x {rows}"
        unfit["picture of another size than the camera's"] += 1
        if pictures.images is None:
            break
    if other and not fits:
        raise DriveError(
            f"The pictures of {pictures.where} have {other} pixels, but {camera.name} has {width} x {height}"
            " in the rig: give the recording in its own size, or the rig that it belongs to."
        )


class _Told:
    """Tells how far a camera is, once a second."""

    def __init__(self, say: Callable[[str], None], camera: str, total: int) -> None:
        self._say, self._camera, self._total = say, camera, total
        self._done, self._began_s = 0, time.monotonic()
        self._told_s = self._began_s

    def one_more(self) -> None:
        self._done += 1
        now_s = time.monotonic()
        if now_s - self._told_s >= _TOLD_EVERY_S or self._done == self._total:
            self._told_s = now_s
            rate = self._done / max(now_s - self._began_s, 1e-9)
            self._say(
                f"detecting in {self._camera}: {self._done:,} of {self._total:,} frames, {rate:.1f} frames/s"
            )
