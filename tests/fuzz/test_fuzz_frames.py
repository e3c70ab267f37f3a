"""Stamps, image names, images and videos, damaged."""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
from mutate import fuzzed, mutated

from twin.drives.epochs import credible
from twin.drives.frames.find import in_order
from twin.drives.frames.images import UnusableImageError, decoded_image, exif_epoch, exif_needs_zone
from twin.drives.frames.name_times import epoch_from_name, needs_zone
from twin.drives.frames.stamp_files import NO_STAMP, names_images, read_image_times, read_timestamps
from twin.drives.frames.video import decoded, index_video
from twin.errors import DriveError

STAMPS = b"".join(b"%d\t%d\n" % (i, 1_781_078_400_000_000 + 33_333 * i) for i in range(20))
TABLE = b"frame,time_ns\n" + b"".join(b"%d,%d\n" % (i, 1_781_078_400_000_000_000 + i) for i in range(20))
IMAGES = b"image,time_ns\n" + b"".join(
    b"a/f%d.jpg,%d\n" % (i, 1_781_078_400_000_000_000 + i) for i in range(9)
)
NAMES = (b"1781078400078496.jpg", b"2026-06-10T07_59_59.123Z.jpg", b"cam_20260610_075959_123+0200.png")


@cache
def _videos() -> list[bytes]:
    """One small video of each kind."""
    import av

    made = []
    for form, codec in (("mp4", "libx264"), ("h264", "libx264"), ("matroska", "mpeg4"), ("avi", "mjpeg")):
        file = io.BytesIO()
        with av.open(file, "w", format=form) as container:
            stream: Any = container.add_stream(codec, rate=30)
            stream.width, stream.height = 32, 16
            stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
            for i in range(6):
                frame = av.VideoFrame.from_ndarray(np.full((16, 32, 3), 40 * i, np.uint8), format="rgb24")
                frame.pts, frame.time_base = i, Fraction(1, 30)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        made.append(file.getvalue())
    return made


def _png() -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", 4, 3, 8, 2, 0, 0, 0)
    rows = zlib.compress(b"".join(b"\0" + bytes(range(12)) for _ in range(3)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def _jpeg() -> bytes:
    from PIL import Image

    tags = Image.Exif()
    tags[0x0112] = 6
    tags.get_ifd(0x8769).update({0x9003: "2026:06:10 10:00:00", 0x9291: "25", 0x9011: "+02:00"})
    file = io.BytesIO()
    Image.new("RGB", (16, 8), (200, 30, 30)).save(file, "JPEG", exif=tags)
    return file.getvalue()


@fuzzed(mutated([STAMPS, TABLE, IMAGES]), parsers=3)
def test_stamp_readers_raise_nothing_but_drive_errors(content: bytes) -> None:
    """Whatever the bytes: a DriveError, or stamps that increase."""
    try:
        if names_images(content[:4096]):
            times, _ = read_image_times(content, "a.csv")
            assert all(credible(time) for time in times.values())
            return
        epoch_ns, _ = read_timestamps(content, "a.timestamps")
    except DriveError:
        return
    known = epoch_ns[epoch_ns != NO_STAMP]
    assert known.size
    assert np.all(np.diff(known) > 0)


@fuzzed(mutated(NAMES), lambda random: random.choice([None, random.uniform(-14, 14)]))
def test_names_give_a_credible_epoch_or_none(name: bytes, offset_hours: float | None) -> None:
    """Whatever the name: an epoch of this century, or nothing; and an order."""
    text = name.decode("utf-8", "replace")
    epoch_ns = epoch_from_name(text, offset_hours)
    assert (
        epoch_ns is None or credible(epoch_ns + 14 * 3600 * 10**9) or credible(epoch_ns - 14 * 3600 * 10**9)
    )
    if epoch_ns is not None and offset_hours is None:
        assert not needs_zone(text)
    assert set(in_order([text, "9", "10"])) == {text, "9", "10"}


@fuzzed(mutated([_png(), _jpeg()]))
def test_image_reader_gives_a_picture_or_a_reason(content: bytes) -> None:
    """Whatever the bytes: RGB, or a reason to count; tags never raise."""
    epoch_ns = exif_epoch(content, 1.0)
    assert epoch_ns is None or isinstance(exif_needs_zone(content), bool)
    try:
        image = decoded_image(content)
    except UnusableImageError:
        return
    assert image.dtype == np.uint8
    assert image.shape[2] == 3


@fuzzed(mutated(_videos()))
def test_video_reader_raises_nothing_but_drive_errors(content: bytes) -> None:
    """Whatever the bytes: a DriveError, or frames with numbers that are in the video, each once."""
    try:
        index = index_video(io.BytesIO(content), "a.mp4")
    except DriveError:
        return
    wanted = np.ones(index.n_frames, dtype=np.bool_)
    numbers = [number for number, _ in decoded(io.BytesIO(content), index, wanted, Counter())]
    assert all(0 <= number < index.n_frames for number in numbers)
    assert len(set(numbers)) == len(numbers)
