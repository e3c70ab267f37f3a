"""Image files and their names → times and pictures."""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest

from twin.drives.frames.images import UnusableImageError, decoded_image, exif_epoch, exif_needs_zone
from twin.drives.frames.name_times import epoch_from_name, needs_zone

EIGHT_NS = 1_781_078_400_000_000_000
"""2026-06-10 08:00:00 UTC."""
TAKEN, SUBSECOND, OFFSET = 0x9003, 0x9291, 0x9011


@pytest.mark.parametrize(
    ("name", "after_ns"),
    [
        ("1781078400.jpg", 0),
        ("1781078400.25.png", 250_000_000),
        ("1781078400_078496.jpg", 78_496_000),
        ("1781078400078.jpg", 78_000_000),
        ("front/1781078400078496.jpg", 78_496_000),
        ("C3_tricam120_1781078400078496123.png", 78_496_123),
        ("20260610T080000Z.jpg", 0),
        ("2026-06-10T10-00-00.5+0200.jpg", 500_000_000),
        ("front_2026-06-10T08_00_00.123Z.jpg", 123_000_000),
    ],
)
def test_name_that_says_utc_gives_its_epoch(name: str, after_ns: int) -> None:
    """Unix seconds to nanoseconds are told by their digits; dates by Z or zone."""
    assert epoch_from_name(name) == EIGHT_NS + after_ns
    assert not needs_zone(name)


@pytest.mark.parametrize(
    ("name", "after_ns"),
    [
        ("2026-06-10T10_00_00.123.jpg", 123_000_000),
        ("20260610_100000_123.jpg", 123_000_000),
        ("IMG_20260610_100000.jpg", 0),
        ("20260610100000.png", 0),
    ],
)
def test_name_with_a_local_time_needs_its_zone(name: str, after_ns: int) -> None:
    """Ten o'clock in Norway's summer is eight UTC; without the zone nothing is guessed."""
    assert epoch_from_name(name) is None
    assert needs_zone(name)
    assert epoch_from_name(name, 2.0) == EIGHT_NS + after_ns


@pytest.mark.parametrize(
    "name",
    [
        "frame_000123.jpg",
        "2026-13-10T07_59_59Z.jpg",
        "9999999999999999999.jpg",
        "1234567890123456789012.png",
        "",
    ],
)
def test_name_without_a_time_says_nothing(name: str) -> None:
    """Frame numbers, impossible dates and longer numbers are no times."""
    assert epoch_from_name(name, 0.0) is None
    assert not needs_zone(name)


def test_exif_gives_time_fraction_and_zone(movies: Any) -> None:
    """DateTimeOriginal, SubSecTimeOriginal and OffsetTimeOriginal together are an epoch."""
    tags = {TAKEN: "2026:06:10 10:00:00", SUBSECOND: "25", OFFSET: "+02:00"}
    assert exif_epoch(movies.jpeg(ifd=tags)) == EIGHT_NS + 250_000_000


def test_exif_without_zone_is_not_guessed(movies: Any) -> None:
    """Most cameras write local time alone: it takes utc_offset_hours to use it."""
    head = movies.jpeg(ifd={TAKEN: "2026:06:10 10:00:00"})
    assert exif_epoch(head) is None
    assert exif_needs_zone(head)
    assert exif_epoch(head, 2.0) == EIGHT_NS


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xd8\xff\xe1\0\x10Exif\0\0MM", b"no image", b"\xff\xd8" + bytes(50)]
)
def test_exif_of_damaged_images_says_nothing(content: bytes) -> None:
    """What cannot be read has no time, and raises nothing."""
    assert exif_epoch(content, 0.0) is None
    assert not exif_needs_zone(content)


KINDS = [("JPEG", "CMYK"), ("PNG", "I;16"), ("PNG", "L"), ("PNG", "RGBA")]
FORMATS = ["JPEG", "PNG", "BMP", "TIFF", "WEBP", "PPM"]


@pytest.mark.parametrize(("form", "mode"), [*KINDS, *((form, "RGB") for form in FORMATS)])
def test_pictures_of_any_kind_become_rgb(movies: Any, form: str, mode: str) -> None:
    """Every format, CMYK, 16-bit, grey and transparent: the left half is white, the right one black."""
    if mode == "I;16":
        from PIL import Image

        wide = Image.fromarray(np.repeat(np.array([[65535, 0]], np.uint16), 32, axis=1).repeat(48, axis=0))
        file = io.BytesIO()
        wide.save(file, "PNG")
        content = file.getvalue()
    else:
        content = movies.jpeg(form=form, mode=mode)
    image = decoded_image(content)
    assert (image.shape, image.dtype) == ((48, 64, 3), np.uint8)
    assert image[:, :24].min() > 245
    assert image[:, 40:].max() < 10


@pytest.mark.parametrize("form", ["PNG", "JPEG"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_agrees_with_pillow(orientation: int, form: str) -> None:
    """Pillow's own transposition is the oracle, on a picture without symmetry; JPEG rounds its colours."""
    from PIL import Image, ImageOps

    rng = np.random.default_rng(0)
    source = Image.fromarray(np.kron(rng.integers(0, 255, (3, 4, 3)), np.ones((16, 16, 1))).astype(np.uint8))
    tags = Image.Exif()
    tags[0x0112] = orientation
    file = io.BytesIO()
    source.save(file, form, exif=tags, quality=100)
    with Image.open(io.BytesIO(file.getvalue())) as opened:
        expected = np.asarray(ImageOps.exif_transpose(opened))
    np.testing.assert_allclose(decoded_image(file.getvalue()), expected, atol=3 if form == "JPEG" else 0)


def test_decompression_bomb_is_refused_by_its_header() -> None:
    """A PNG of 50 bytes that declares 60,000 x 60,000 pixels is never unpacked."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
    bomb = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")
    with pytest.raises(UnusableImageError, match="larger than 100 million pixels"):
        decoded_image(bomb)


@pytest.mark.parametrize("content", [b"", b"<html>no</html>", b"\xff\xd8\xff\xe0"])
def test_what_is_no_image_has_a_reason(content: bytes) -> None:
    """Empty files and other files give a reason to count."""
    with pytest.raises(UnusableImageError, match="image"):
        decoded_image(content)


def test_truncated_image_is_refused_or_whole(movies: Any) -> None:
    """An image that was cut in its header is no image."""
    with pytest.raises(UnusableImageError):
        decoded_image(movies.jpeg()[:120])
