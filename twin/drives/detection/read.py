"""Signs that a detector finds in a drive's pictures, in place of annotations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.annotations.gather import AnnotationsRead, gather
from twin.drives.annotations.read import read_drive_labels, unmapped_warning
from twin.drives.detection.run import DetectorOptions, Found, Recorded, detect
from twin.drives.folder.drive_toml import DriveSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, ReadingNotes
from twin.drives.frames.find import Pictures
from twin.drives.track.read import Track


def read_detections(
    folder: DriveFolder,
    settings: DriveSettings,
    track: Track,
    pictures: Mapping[str, Pictures],
    stamps: Mapping[str, IntArray],
    options: DetectorOptions,
    notes: ReadingNotes,
    *,
    labels: Path | None = None,
) -> AnnotationsRead:
    """Run a detector over the pictures of all cameras; what it finds is read as if a person had drawn it.

    Parameters
    ----------
    stamps : mapping of camera to int64 (frames,)
        As the recorder wrote them.
    labels : Path, optional
        What the detector's classes mean, instead of the folder's own ``labels.toml``.

    Raises
    ------
    ConfigError, DriveError
        As :func:`twin.drives.detection.run.detect`.
    """
    meanings = read_drive_labels(folder, labels)
    first, last = (epoch - settings.camera_offset_ns for epoch in track.span_ns())
    detected = detect(Recorded(track.rig, pictures, stamps, (first, last)), options, notes.say)
    _enter(folder, detected, options)
    read = gather(detected.files, track.rig, meanings)
    notes.skipped += (*detected.skipped, *read.skipped)
    notes.warn(DriveDoubt.LABELS, *unmapped_warning(read))
    if not len(read.annotations.frame):
        notes.warn(
            DriveDoubt.ANNOTATIONS,
            f"{options.model.name} found no sign in the pictures, so the drive has no sightings: try a lower"
            " --detector-threshold, and see that the network was trained on such pictures.",
        )
    notes.say(f"Detections: {len(read.annotations.frame)} in {len(detected.files)} cameras.")
    return read


def _enter(folder: DriveFolder, detected: Found, options: DetectorOptions) -> None:
    """Make model and boxes part of what the drive was read from: other boxes are other results."""
    boxes = [(camera, shape.frame, *shape.box_px) for file, camera in detected.files for shape in file.shapes]
    content = np.array([box[1:] for box in boxes], dtype=np.float64).tobytes()
    cameras = " ".join(box[0] for box in boxes)
    folder.enter(
        f"--detector {options.model.name}", f"{detected.model_sha256}\n{cameras}\n".encode() + content
    )
