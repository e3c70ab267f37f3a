"""Image files: how large, when taken by their EXIF tags, and the picture itself.

What a file declares in its header is looked at before anything is unpacked: a small file can hold a picture
that fills the memory. Pillow reads headers, OpenCV the pictures.
"""

from __future__ import annotations

import io
import re
import warnings
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from twin.drives.epochs import credible
from twin.drives.frames.video import MAX_PIXELS

Image = NDArray[np.uint8]

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
# Pillow knows dozens of others, each a reader of its own for damaged files to try.
_FORMATS = ("JPEG", "PNG", "BMP", "TIFF", "WEBP", "PPM")
HEAD_BYTES = 262_144
"""What is read of a file for its tags; EXIF stands within the first 64 kB of a JPEG."""

_EXIF_IFD, _ORIENTATION = 0x8769, 0x0112
_TAKEN, _SUBSECOND, _OFFSET = 0x9003, 0x9291, 0x9011
_TAKEN_FORM = re.compile(r"(\d{4})[:-](\d\d)[:-](\d\d)[ T](\d\d):(\d\d):(\d\d)(?:[.,](\d{1,9}))?", re.ASCII)
_OFFSET_FORM = re.compile(r"([+-])(\d\d):?(\d\d)", re.ASCII)
# How often a picture is to be turned counter-clockwise, and whether it is mirrored first: EXIF 2.32, 4.6.4.
_TURNS = {1: (0, False), 2: (0, True), 3: (2, False), 4: (2, True), 5: (1, True), 6: (3, False)} | {
    7: (3, True),
    8: (1, False),
}


class UnusableImageError(Exception):
    """An image that is left out; its text is the reason."""


def exif_epoch(head: bytes, utc_offset_hours: float | None = None) -> int | None:
    """When an image was taken, by its EXIF tags DateTimeOriginal, SubSecTimeOriginal and OffsetTimeOriginal.

    Parameters
    ----------
    head : bytes
        The first `HEAD_BYTES` of the file.
    utc_offset_hours : float or None
        Zone of a camera that writes none.

    Returns
    -------
    int or None
        Nanoseconds UTC; None where the tags are absent, unreadable or without a zone (see `exif_needs_zone`).
    """
    taken_ns, offset_ns = _exif_times(head)
    if taken_ns is None:
        return None
    if offset_ns is None and utc_offset_hours is not None:
        offset_ns = round(utc_offset_hours * 3600e9)
    return None if offset_ns is None else taken_ns - offset_ns


def exif_needs_zone(head: bytes) -> bool:
    """Whether an image says when it was taken, but not in which zone."""
    taken_ns, offset_ns = _exif_times(head)
    return taken_ns is not None and offset_ns is None


def image_size(head: bytes) -> tuple[int, int]:
    """Width and height of an image as stored, pixels, by its first `HEAD_BYTES`.

    Raises
    ------
    UnusableImageError
        If they cannot be read.
    """
    return _header(head)[:2]


def decoded_image(content: bytes) -> Image:
    """Decode one image.

    Returns
    -------
    uint8 (rows, columns, 3)
        RGB, turned as its EXIF tag says; grey, 16-bit, CMYK and transparent pictures are converted.

    Raises
    ------
    UnusableImageError
        If it is empty, larger than `MAX_PIXELS`, or cannot be decoded.
    """
    import cv2

    if not content:
        raise UnusableImageError("image empty")
    width, height, orientation = _header(content)
    if width * height > MAX_PIXELS:
        raise UnusableImageError(f"image larger than {MAX_PIXELS / 1e6:.0f} million pixels")
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        bgr = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
    except cv2.error as error:
        raise UnusableImageError("image cannot be decoded") from error
    if bgr is None:
        raise UnusableImageError("image cannot be decoded")
    quarters, mirrored = _TURNS.get(orientation, (0, False))
    rgb = bgr[..., ::-1]
    rgb = rgb[:, ::-1] if mirrored else rgb
    return np.ascontiguousarray(np.rot90(rgb, quarters), dtype=np.uint8)


def _header(content: bytes) -> tuple[int, int, int]:
    """Width, height and EXIF orientation."""
    from PIL import Image as Pillow

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Pillow.open(io.BytesIO(content), formats=_FORMATS) as image:
                return image.width, image.height, _orientation(image.getexif().get(_ORIENTATION))
    except Pillow.DecompressionBombError as error:
        raise UnusableImageError(f"image larger than {MAX_PIXELS / 1e6:.0f} million pixels") from error
    except Exception as error:  # Pillow's readers raise whatever a damaged file leads them to
        raise UnusableImageError("not an image that can be read") from error


def _orientation(value: object) -> int:
    return value if isinstance(value, int) else 1


def _exif_times(head: bytes) -> tuple[int | None, int | None]:
    """Local time of the shot as if it were UTC, and the zone's offset, in ns; None where not said."""
    from PIL import Image as Pillow

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Pillow.open(io.BytesIO(head), formats=_FORMATS) as image:
                tags = image.getexif().get_ifd(_EXIF_IFD)
                taken, fraction, offset = (str(tags.get(tag, "")) for tag in (_TAKEN, _SUBSECOND, _OFFSET))
    except Exception:  # as above: an image whose tags cannot be read has none
        return None, None
    return _taken(taken, fraction), _zone(offset)


def _taken(taken: str, fraction: str) -> int | None:
    match = _TAKEN_FORM.match(taken.strip())
    if match is None:
        return None
    try:
        moment = datetime(*(int(match[i]) for i in range(1, 6)), tzinfo=UTC)  # type: ignore[misc, arg-type]
        moment += timedelta(seconds=int(match[6]))
    except (ValueError, OverflowError):
        return None
    digits = match[7] or (fraction.strip("\0 ") if re.fullmatch(r"[0-9]{1,9}[\0 ]*", fraction) else "0")
    epoch_ns = int(moment.timestamp()) * 1_000_000_000 + int(digits.ljust(9, "0"))
    return epoch_ns if credible(epoch_ns) else None


def _zone(text: str) -> int | None:
    if text.strip("\0 ") == "Z":
        return 0
    match = _OFFSET_FORM.fullmatch(text.strip("\0 "))
    if match is None:
        return None
    offset_ns = (int(match[2]) * 60 + int(match[3])) * 60 * 1_000_000_000
    return offset_ns if match[1] == "+" else -offset_ns
