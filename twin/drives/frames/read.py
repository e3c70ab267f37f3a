"""Pictures of one camera → an iterator of numbered frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from twin.drives.frames.find import Pictures
from twin.drives.frames.images import UnusableImageError, decoded_image
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.frames.times import video_index
from twin.drives.frames.video import decoded
from twin.errors import DriveError


class Frame(NamedTuple):
    """One picture.

    Attributes
    ----------
    number : int
        Frame number in the recording.
    epoch_ns : int
        Its stamp.
    image : uint8 (rows, columns, 3)
        RGB.
    """

    number: int
    epoch_ns: int
    image: NDArray[np.uint8]


def frames(
    pictures: Pictures, epoch_ns: IntArray, wanted: NDArray[np.bool_], faults: Counter[str]
) -> Iterator[Frame]:
    """Decode the frames that are asked for, one at a time.

    Parameters
    ----------
    pictures : Pictures
    epoch_ns : int64 (n,)
        Stamps by frame number; a frame without one is not decoded.
    wanted : bool (n,)
        By frame number.
    faults : Counter
        Gets the reasons why frames that were asked for did not come out.

    Yields
    ------
    Frame
        In order of their numbers.

    Raises
    ------
    DriveError
        If the video cannot be opened, or a folder of images is not there.
    """
    wanted = wanted & (epoch_ns != NO_STAMP)
    asked, came, counted = int(wanted.sum()), 0, sum(faults.values())
    for number, image in _images(pictures, wanted, faults) if asked else ():
        came += 1
        yield Frame(number, int(epoch_ns[number]), image)
    # What neither came out nor gave a reason was never in the file.
    silent = asked - came - (sum(faults.values()) - counted)
    if silent > 0:
        faults["frame that did not come out of the decoder"] += silent


def _images(
    pictures: Pictures, wanted: NDArray[np.bool_], faults: Counter[str]
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    if not pictures.where:
        raise DriveError(
            f"The images of {pictures.camera} are not in {pictures.folder.root}: add their folder."
        )
    if pictures.images is None:
        index = video_index(pictures)
        fits = np.zeros(index.n_frames, dtype=np.bool_)
        fits[: len(wanted)] = wanted[: index.n_frames]
        with pictures.folder.open(pictures.where) as file:
            yield from decoded(file, index, fits, faults)
        return
    for number in np.flatnonzero(wanted).tolist():
        if not pictures.has(number):
            faults["no picture of this frame"] += 1
            continue
        try:
            yield number, decoded_image(pictures.folder.peek(pictures.images[number]))
        except (UnusableImageError, DriveError) as error:
            faults[str(error) if isinstance(error, UnusableImageError) else "image unreadable"] += 1
