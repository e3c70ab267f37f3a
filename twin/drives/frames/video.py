"""Videos: how many frames, when, and the frames themselves; through PyAV, which bundles FFmpeg.

A video is read twice at most: once without decoding, to count its packets and take their times, and once
more to decode the frames that are asked for. Both go through an open file, so that neither a name nor a play
list inside the file can lead elsewhere; formats that are lists of other files are refused.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from twin.drives.epochs import credible
from twin.drives.frames.stamp_files import MAX_FRAME
from twin.errors import DriveError, MissingExtraError

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

Image = NDArray[np.uint8]

VIDEO_SUFFIXES = (".h264", ".264", ".h265", ".hevc", ".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".ts")
MAX_PIXELS = 100_000_000
"""Largest picture that is decoded: 300 MB in memory. The largest road cameras have half of it."""
LONGEST_NS = 7 * 86_400 * 1_000_000_000
"""No drive is longer than a week: times further apart are a damaged file's."""

# Containers and raw streams; no play lists, which name other files.
_FORMATS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,h264,hevc,obu,ivf,mjpeg,asf,mxf,ogg"
)
_BUFFER_BYTES = 1 << 20
_RAW_BYTES = 1 << 16  # raw streams are read in pieces of 1 kB otherwise


@dataclass(frozen=True, slots=True)
class VideoIndex:
    """What a video holds, without having decoded it.

    Attributes
    ----------
    where : str
        File name.
    codec : str
        As FFmpeg calls it.
    width_px, height_px : int
        As stored; a picture that is marked as turned comes out turned.
    n_frames : int
        Packets with a picture in them.
    pts : int64 (n_frames,) or None
        Presentation times in the container's own unit, increasing. None for a raw stream, and where two
        frames have the same one, as in AVI: their frames are known by their order only.
    offset_ns : int64 (n_frames,) or None
        Time since the first frame; None for a raw stream, whose frame rate is not written anywhere.
    created_ns : int or None
        The tag ``creation_time``, whole seconds UTC as most cameras write it.
    n_damaged : int
        Packets that the container calls damaged.
    """

    where: str
    codec: str
    width_px: int
    height_px: int
    n_frames: int
    pts: IntArray | None
    offset_ns: IntArray | None
    created_ns: int | None
    n_damaged: int


def index_video(file: BinaryIO, where: str) -> VideoIndex:
    """Count the frames of a video and take their times, without decoding them.

    Parameters
    ----------
    file : binary file
        Read from where it stands.
    where : str
        File name, for messages.

    Raises
    ------
    MissingExtraError
        If the extra `video` is not installed.
    DriveError
        If it is no video, holds no frame, or declares pictures of more than `MAX_PIXELS`.
    """
    with _opened(file, where) as (container, stream):
        times, n_damaged = _packet_times(container, stream, where)
        codec, created = stream.codec_context, container.metadata.get("creation_time")
        if not times.size:
            raise DriveError(f"{where} holds no frame: the recording stopped at once, or the file was cut.")
        times = np.sort(times)
        timed = times[0] != _NO_PTS
        return VideoIndex(
            where=where,
            codec=codec.name,
            width_px=codec.width,
            height_px=codec.height,
            n_frames=times.size,
            pts=times if timed and np.all(np.diff(times) > 0) else None,
            offset_ns=_offsets(times, stream, where) if timed else None,
            created_ns=_created(created or stream.metadata.get("creation_time")),
            n_damaged=n_damaged,
        )


def video_size(file: BinaryIO, where: str) -> tuple[int, int]:
    """Width and height of a video's pictures as stored, pixels, by its header.

    Raises
    ------
    DriveError
        As :func:`index_video`.
    """
    with _opened(file, where) as (_, stream):
        return stream.codec_context.width, stream.codec_context.height


def video_tags(file: BinaryIO, where: str) -> dict[str, str]:
    """Tags of a video and of its streams, by name: maker, model, what wrote it.

    Raises
    ------
    DriveError
        As :func:`index_video`.
    """
    with _opened(file, where) as (container, _):
        tags = {key: value for one in container.streams for key, value in one.metadata.items()}
        return tags | dict(container.metadata)


def decoded(
    file: BinaryIO, index: VideoIndex, wanted: NDArray[np.bool_], faults: Counter[str]
) -> Iterator[tuple[int, Image]]:
    """Decode frames of a video.

    Parameters
    ----------
    file : binary file
        At its beginning.
    index : VideoIndex
        Of that file.
    wanted : bool (frames,)
        By frame number; frames beyond its end are not wanted. All are decoded, since most are stored as
        differences, but only these are turned into pictures.
    faults : Counter
        Gets the reasons why frames were left out.

    Yields
    ------
    number : int
    image : uint8 (rows, columns, 3)
        RGB, upright as the video says.

    Raises
    ------
    DriveError
        If the file cannot be opened; damage further on is counted.
    """
    last = int(np.flatnonzero(wanted)[-1]) if wanted.any() else -1
    with _opened(file, index.where) as (container, stream):
        for number, frame in _numbered(container, stream, index, faults):
            if number > last:
                return
            if not wanted[number]:
                continue
            if frame.is_corrupt:
                faults["frame damaged"] += 1
            elif (frame.width, frame.height) != (index.width_px, index.height_px):
                faults["frame of another size than the first"] += 1
            else:
                yield number, _upright(frame)


_NO_PTS = np.iinfo(np.int64).min


@contextmanager
def _opened(file: BinaryIO, where: str) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a video; what FFmpeg says against it becomes one sentence."""
    try:
        import av
    except ImportError as error:
        raise MissingExtraError(f"The video {where}", "PyAV", "video") from error
    try:
        container = av.open(
            file,
            "r",
            options={"format_whitelist": _FORMATS, "raw_packet_size": str(_RAW_BYTES)},
            buffer_size=_BUFFER_BYTES,
            metadata_errors="replace",
        )
    except (av.error.FFmpegError, ValueError, OSError) as error:
        raise DriveError(_no_video(file, where)) from error
    with container:
        if not container.streams.video:
            raise DriveError(f"{where} holds no video stream: give the recording of the camera.")
        stream = container.streams.video[0]
        codec = stream.codec_context
        if codec is None or codec.width < 1 or codec.height < 1:
            raise DriveError(
                f"{where} does not say how large its pictures are: it was cut, or its codec is unknown."
            )
        if codec.width * codec.height > MAX_PIXELS:
            raise DriveError(
                f"{where} declares pictures of {codec.width} x {codec.height} pixels, more than the"
                f" {MAX_PIXELS / 1e6:.0f} million that are decoded: check that it is the right file."
            )
        codec.options = {"max_pixels": str(MAX_PIXELS)}
        yield container, stream


def _no_video(file: BinaryIO, where: str) -> str:
    """Say what a file is that FFmpeg cannot open."""
    try:
        file.seek(0)
        head = file.read(4096)
    except (OSError, ValueError):
        head = b""
    if not head:
        return f"{where} is empty: copy the recording again."
    if head.lstrip()[:1] == b"<":
        return f"{where} is a web page or XML, not a video: download the recording itself."
    if b"ftyp" in head[:12]:
        return (
            f"{where} has no index (moov), so its frames cannot be found: the recorder was cut off before it"
            " closed the file. Copy it again, or repair it with the recorder's own tool."
        )
    return f"{where} is not a video that can be read: check that it is whole, and which format it has."


def _packet_times(container: InputContainer, stream: VideoStream, where: str) -> tuple[IntArray, int]:
    """Time of every packet with a picture, `_NO_PTS` where it has none, and how many are damaged."""
    import av

    times, damaged = array("q"), 0
    try:
        for packet in container.demux(stream):
            if not packet.size or packet.is_discard:
                continue
            times.append(_NO_PTS if packet.pts is None else packet.pts)
            damaged += packet.is_corrupt
            if len(times) > MAX_FRAME:
                raise DriveError(f"{where} holds more than {MAX_FRAME:,} frames: split the recording.")
    except (av.error.FFmpegError, ValueError, OSError):
        # What comes before the damage is kept; that frames are missing shows against the stamps.
        damaged += 1
    return np.frombuffer(times, dtype=np.int64) if len(times) else np.empty(0, np.int64), damaged


def _offsets(pts: IntArray, stream: VideoStream, where: str) -> IntArray:
    unit = stream.time_base
    first, last = int(pts[0]), int(pts[-1])
    if unit is None or unit <= 0 or (last - first) * unit * 1_000_000_000 > LONGEST_NS:
        raise DriveError(
            f"The frames of {where} lie further apart than a week: its times are damaged, so copy it again."
        )
    numerator, denominator = unit.numerator * 1_000_000_000, unit.denominator
    # Whole numbers of any size: the product leaves 64 bits for fine units.
    return np.array([(t - first) * numerator // denominator for t in pts.tolist()], dtype=np.int64)


def _created(text: str | None) -> int | None:
    try:
        moment = datetime.fromisoformat(text or "")
    except ValueError:
        return None
    if moment.tzinfo is None:
        return None
    try:
        epoch_ns = int(moment.timestamp()) * 1_000_000_000 + moment.microsecond * 1000
    except (OverflowError, ValueError):
        return None
    return epoch_ns if credible(epoch_ns) else None


def _numbered(
    container: InputContainer, stream: VideoStream, index: VideoIndex, faults: Counter[str]
) -> Iterator[tuple[int, VideoFrame]]:
    """Decoded frames with their numbers, whatever is lost between them.

    A container's frames are known by their times. Where there are none, as in a raw stream, its packets are
    numbered, which the decoder hands through. If it stores frames out of order (B-frames) only the order of
    output counts, and after a loss the rest cannot be numbered.
    """
    position = {t: i for i, t in enumerate(index.pts.tolist())} if index.pts is not None else None
    given = np.zeros(index.n_frames, dtype=np.bool_)
    shown = 0
    for frames, lost in _decoded_packets(container, stream, raw=position is None):
        if lost:
            faults["frame that cannot be decoded"] += 1
            if position is None and stream.codec_context.has_b_frames:
                faults["frame after a loss, whose number is unknown"] += max(index.n_frames - shown - 1, 0)
                return
        for frame in frames:
            if position is not None:
                number = position.get(frame.pts) if frame.pts is not None else None
            elif stream.codec_context.has_b_frames:
                number = shown
            else:
                number = frame.pts
            shown += 1
            if number is None or not 0 <= number < given.size:
                continue
            if given[number]:
                faults["frame that the decoder gave before"] += 1
                continue
            given[number] = True
            yield number, frame


def _decoded_packets(
    container: InputContainer, stream: VideoStream, *, raw: bool
) -> Iterator[tuple[list[VideoFrame], bool]]:
    """Frames that come out for each packet, and whether the packet was lost."""
    import av

    number = 0
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            return
        except (av.error.FFmpegError, ValueError, OSError):
            yield [], True
            return
        if raw and packet.size:
            packet.pts = packet.dts = number
            number += 1
        try:
            yield packet.decode(), False
        except (av.error.FFmpegError, ValueError):
            yield [], True


def _upright(frame: VideoFrame) -> Image:
    image = frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False)
    quarters = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(image, quarters)) if quarters else image
