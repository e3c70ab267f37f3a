"""Which frame an annotation is of, and whether annotations count from 1 where the times count from 0."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.annotations.formats.plain_csv import TOOL as CSV
from twin.drives.annotations.formats.shapes import Shape
from twin.drives.annotations.picture_names import PictureNames, plain_name
from twin.drives.drive import Annotations
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.frames.stamp_files import NO_STAMP

_MOST_DIGITS = 30
"""The longest number that is converted keeps int() linear; it is far above any frame."""


def is_numbered(shape: Shape, tool: str, pictures: PictureNames | None) -> bool:
    """Whether a person or a script numbered the frame: in a CSV's column, or in the name of an image.

    Annotation tools count the frames of a video from 0 themselves, and a folder's images have an order.
    """
    return tool == CSV if shape.frame is not None else pictures is None


def frame_of(shape: Shape, camera: str, pictures: PictureNames | None, first_frame: int) -> int:
    """Frame number of a shape.

    Parameters
    ----------
    camera : str
        Digits of its name are none of the number.
    pictures : PictureNames or None
        The camera's, where they are files.
    first_frame : int
        Number that the first frame has where `is_numbered`.

    Returns
    -------
    int
        `NOT_AMONG_PICTURES` where the image is none of the camera's, `UPLOADED_TWICE` where it may be
        another's, another negative number where there is none.
    """
    if shape.frame is not None:
        return shape.frame - first_frame
    if pictures is not None:
        return pictures.frame_of(shape.image)
    digits = re.findall(r"[0-9]+", plain_name(shape.image).replace(camera, ""))
    number = int(digits[-1][:_MOST_DIGITS]) if digits else shape.image_id
    return max(number - first_frame, -1)


def first_frame_warnings(
    annotations: Annotations,
    numbered: Mapping[str, str],
    stamps: Mapping[str, IntArray],
    sources: Mapping[str, str],
) -> list[str]:
    """Tell of annotations that seem to number the first frame 1, as ffmpeg and MATLAB do.

    That is so where not one is of frame 0, the lowest is of frame 1 or the highest is one beyond the last,
    and the times begin at 0.

    Parameters
    ----------
    annotations : Annotations
        Before those without a time are left out.
    numbered : mapping of camera to example
        Cameras whose frames were numbered (:func:`is_numbered`).
    stamps, sources : mapping of camera to int64 (frames,), and to the file that says so
    """
    used = set(annotations.camera.tolist())
    lowest = {c: int(annotations.frame[annotations.camera == c].min()) for c in numbered if c in used}
    if not lowest or min(lowest.values()) < 1:
        return []
    warnings = []
    for camera, first in lowest.items():
        stamped = np.flatnonzero(stamps[camera] != NO_STAMP)
        if not stamped.size or stamped[0] != 0:
            continue
        highest = int(annotations.frame[annotations.camera == camera].max())
        is_beyond = highest == stamped[-1] + 1
        if first != 1 and not is_beyond:
            continue
        why = f"the last is {highest}, one beyond it" if is_beyond else "the first is 1, and none is 0"
        warnings.append(
            f"The annotated frames of {camera} ({numbered[camera]:.60}) seem to be numbered from 1, as"
            f" ffmpeg and MATLAB do, but {sources[camera]} from 0: {why}. Write first_frame = 1 in"
            f" {SETTINGS_FILE} if so, and first_frame = 0 if not."
        )
    return warnings
