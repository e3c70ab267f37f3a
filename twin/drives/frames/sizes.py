"""How large a camera's pictures are, against the size that it was calibrated at."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from geoloc.rig.rig import Rig
from twin.drives.frames.find import Pictures
from twin.drives.frames.images import HEAD_BYTES, UnusableImageError, image_size
from twin.drives.frames.video import video_size
from twin.errors import DriveError

_MOST_IMAGES = 5


def picture_size(pictures: Pictures) -> tuple[int, int] | None:
    """Width and height of a camera's pictures, as stored; None where no picture says."""
    if not pictures.where:
        return None
    if pictures.images is None:
        try:
            with pictures.folder.open(pictures.where) as file:
                return video_size(file, pictures.where)
        except DriveError:
            return None  # whoever needs the video says what is wrong with it
    for image in [image for image in pictures.images if image][:_MOST_IMAGES]:
        try:
            return image_size(pictures.folder.head(image, HEAD_BYTES))
        except (DriveError, UnusableImageError):
            continue
    return None


def check_picture_sizes(pictures: Mapping[str, Pictures], cameras: Iterable[str], rig: Rig) -> None:
    """Refuse cameras whose pictures are of another size than they were calibrated at.

    Parameters
    ----------
    pictures : mapping of camera to Pictures
    cameras : iterable of str
        Those whose annotations are pixels of these pictures and do not say of which size.
    rig : Rig

    Raises
    ------
    DriveError
        The first of :func:`size_contradictions`.
    """
    for contradiction in size_contradictions(pictures, cameras, rig):
        raise DriveError(contradiction)


def size_contradictions(pictures: Mapping[str, Pictures], cameras: Iterable[str], rig: Rig) -> Iterator[str]:
    """Say of each camera whose pictures are of another size than it was calibrated at how large both are.

    Pictures that are stored turned by a right angle are of the same size.
    """
    for name in sorted(set(cameras) & set(pictures)):
        model, size = rig.camera(name).model, picture_size(pictures[name])
        calibrated = (model.width_px, model.height_px)
        if size is None or size in (calibrated, calibrated[::-1]):
            continue
        yield (
            f"The pictures of {name} in {pictures[name].where} have {size[0]} x {size[1]} pixels, but"
            f" {rig.source} calibrates it at {calibrated[0]} x {calibrated[1]}: {_cure(size, calibrated)}."
        )


def _cure(size: tuple[int, int], calibrated: tuple[int, int]) -> str:
    if size[0] * calibrated[1] == size[1] * calibrated[0]:
        factor = size[0] / calibrated[0]
        return (
            "give the calibration of pictures of this size (focal length and principal point are"
            f" {factor:g} times as large in pixels)"
        )
    return "give the calibration of pictures of this size, neither cropped nor stretched"
