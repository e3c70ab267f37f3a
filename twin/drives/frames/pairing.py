"""As many frames as stamps? What is done where not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.folder.notes import Skipped
from twin.drives.frames.stamp_files import NO_STAMP
from twin.errors import DriveError

MOST_APART = 2
"""A recorder that is stopped may lose its last frames, or their stamps: NTNU's car loses up to two."""


@dataclass(frozen=True, slots=True)
class Paired:
    """Stamps by frame number of the pictures, and what was left out or is worth knowing."""

    epoch_ns: IntArray
    skipped: tuple[Skipped, ...]
    warnings: tuple[str, ...]


def pair(epoch_ns: IntArray, n_frames: int, pictures: str, stamps: str, *, by_number: bool) -> Paired:
    """Bring the stamps of a camera and its pictures together by frame number.

    - As many pictures as stamp numbers: nothing to do.
    - Stamps that are numbered from another number than 0, exactly as many as pictures: by order.
    - A difference of at most `MOST_APART`, as where a recorder was stopped between both files, or any
      difference where the user says that the numbers fit: the first ones belong together by number. Stamps
      without a picture stay out; a picture without a stamp has no time, and what is annotated in it is
      counted where it is left out.
    - More: refused, since frames that were lost in between shift all that follow.

    Parameters
    ----------
    epoch_ns : int64 (last stamp's number + 1,)
        `NO_STAMP` where a number has none.
    n_frames : int
        Pictures in the video or folder.
    pictures, stamps : str
        File names, for messages.
    by_number : bool
        ``frames_by_number`` of ``drive.toml``.

    Raises
    ------
    DriveError
        If the difference cannot be resolved by rule.
    """
    n_stamps = len(epoch_ns)
    if n_frames == n_stamps:
        return Paired(epoch_ns, (), ())
    first = int(np.argmax(epoch_ns != NO_STAMP))
    counted = f"{pictures} holds {n_frames:,} frames, {stamps} stamps for {n_stamps:,}"
    if first and n_frames == n_stamps - first and not by_number:
        said = (
            f"{stamps} numbers its stamps from {first}, and has as many as {pictures} has frames: the first"
            " stamp is taken as that of the first frame. Number the stamps from 0 to settle it."
        )
        return Paired(epoch_ns[first:], (), (said,))
    if abs(n_frames - n_stamps) > MOST_APART and not by_number:
        raise DriveError(
            f"{counted}: with frames lost in between, every later one would get a wrong time. Give the files"
            " of one recording, or write frames_by_number = true in drive.toml if frame 0 has stamp 0 and so"
            " on, and only the end is missing."
        )
    if n_frames > n_stamps:
        left_out = Skipped("frames", pictures, n_frames - n_stamps, "no stamp for the last frames")
    else:
        left_out = Skipped("time stamps", stamps, n_stamps - n_frames, "no picture for the last stamps")
    said = f"{counted}: they are paired by number from 0, and the last {left_out.count:,} left out."
    return Paired(epoch_ns[:n_frames], (left_out,), (said,))
