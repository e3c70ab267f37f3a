"""A folder as it comes from a small camera: one video, and a GPX or GoPro's own track."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from geoloc.trajectory.poses import GnssFixes

_NS = 1_000_000_000
_TICKS = 90_000
_SCALES = (10_000_000, 10_000_000, 1000, 1000, 100)


def write_video(
    path: Path,
    stamps_ns: NDArray[np.int64],
    created_ns: int | None,
    size_px: tuple[int, int] = (64, 48),
    data: Sequence[tuple[int, bytes]] = (),
    tags: dict[str, str] | None = None,
) -> None:
    """Write a video with a frame at each stamp, all showing the same; `data` are GPMF packets with times."""
    with av.open(str(path), "w") as container:
        if created_ns is not None:
            moment = datetime.fromtimestamp(created_ns // _NS, UTC)
            container.metadata["creation_time"] = f"{moment:%Y-%m-%dT%H:%M:%S}.000000Z"
        container.metadata.update(tags or {})
        stream = container.add_stream("libx264", rate=30, options={"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = *size_px, "yuv420p"
        stream.codec_context.time_base = Fraction(1, _TICKS)
        gpmf = container.add_data_stream("bin_data") if data else None
        if gpmf is not None:
            gpmf.time_base = Fraction(1, 1000)
        grey = np.full((size_px[1], size_px[0], 3), 90, np.uint8)
        (whole,) = [*stream.encode(av.VideoFrame.from_ndarray(grey, "rgb24")), *stream.encode()]
        for stamp in stamps_ns.tolist():
            packet = av.Packet(bytes(whole))
            packet.stream, packet.is_keyframe, packet.time_base = stream, True, Fraction(1, _TICKS)
            packet.pts = packet.dts = (stamp - int(stamps_ns[0])) * _TICKS // _NS
            container.mux(packet)
        for offset_ms, content in data:
            packet = av.Packet(content)
            packet.stream, packet.time_base = gpmf, Fraction(1, 1000)
            packet.pts = packet.dts = offset_ms
            packet.duration = 1000
            container.mux(packet)


def write_gpx(path: Path, fixes: GnssFixes) -> None:
    """Write fixes as a telephone exports them."""
    points = "".join(
        f'<trkpt lat="{lat:.8f}" lon="{lon:.8f}"><ele>{height:.2f}</ele>'
        f"<time>{datetime.fromtimestamp(epoch / 1e9, UTC).isoformat()}</time></trkpt>"
        for lat, lon, height, epoch in zip(
            fixes.latitude_deg, fixes.longitude_deg, fixes.height_m, fixes.epoch_ns.tolist(), strict=True
        )
    )
    path.write_text(
        f'<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{points}'
        "</trkseg></trk></gpx>"
    )


def entry(name: bytes, kind: bytes, size: int, payload: bytes) -> bytes:
    """One entry of GPMF, padded to four bytes; `size` is that of one sample."""
    count = len(payload) // size
    return name + kind + struct.pack(">BH", size, count) + payload + bytes(-len(payload) % 4)


def _nested(name: bytes, content: bytes) -> bytes:
    return entry(name, b"\0", 1, content)


def gps5_packet(utc_ns: int, places: Sequence[tuple[float, float, float]], *, fix: int = 3) -> bytes:
    """One packet of a HERO5 to 10: fixes that share a time."""
    moment = datetime.fromtimestamp(utc_ns // 1_000_000 / 1e3, UTC)
    rows = b"".join(
        struct.pack(">5i", *(round(v * s) for v, s in zip((*p, 10.0, 10.0), _SCALES, strict=True)))
        for p in places
    )
    stream = (
        entry(b"GPSF", b"L", 4, struct.pack(">I", fix))
        + entry(b"GPSU", b"U", 16, f"{moment:%y%m%d%H%M%S}.{moment.microsecond // 1000:03d}".encode())
        + entry(b"GPSP", b"S", 2, struct.pack(">H", 180))
        + entry(b"SCAL", b"l", 4, struct.pack(">5i", *_SCALES))
        + entry(b"GPS5", b"l", 20, rows)
    )
    return _nested(b"DEVC", entry(b"DVID", b"L", 4, struct.pack(">I", 1)) + _nested(b"STRM", stream))


def gyro_packet(rates_rad_s: Sequence[tuple[float, float, float]]) -> bytes:
    """One packet of a gyro, in 939ths of a radian a second."""
    rows = b"".join(struct.pack(">3h", *(round(939 * rate) for rate in row)) for row in rates_rad_s)
    stream = (
        entry(b"SIUN", b"c", 5, b"rad/s")
        + entry(b"SCAL", b"s", 2, struct.pack(">h", 939))
        + entry(b"GYRO", b"s", 6, rows)
    )
    return _nested(b"DEVC", _nested(b"STRM", stream))


def gps9_packet(rows: Sequence[tuple[int, tuple[float, float, float]]], *, fix: int = 3) -> bytes:
    """One packet of a HERO11 and later: fixes with a time each."""
    scales = (*_SCALES, 1, 1000, 100, 1)
    epoch_2000 = datetime(2000, 1, 1, tzinfo=UTC)
    content = b""
    for utc_ns, place in rows:
        since = datetime.fromtimestamp(utc_ns / 1e9, UTC) - epoch_2000
        seconds = since.seconds + since.microseconds / 1e6
        values = (*place, 10.0, 10.0, since.days, seconds, 1.8, fix)
        content += struct.pack(">7i2H", *(round(v * s) for v, s in zip(values, scales, strict=True)))
    stream = (
        entry(b"TYPE", b"c", 1, b"lllllllSS")
        + entry(b"SCAL", b"l", 4, struct.pack(">9i", *scales))
        + entry(b"GPS9", b"?", 32, content)
    )
    return _nested(b"DEVC", _nested(b"STRM", stream))
