"""Bytes of one sender → fixes or frames; the recorder gets what was received before anything else is done."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Protocol

from geoloc.live.samples import Fix
from twin.drives.annotations.formats.frame_lines import frame_of_line
from twin.drives.epochs import credible
from twin.drives.track import fixes as recorded
from twin.drives.track.formats.sbp_stream import SbpStream
from twin.live.events import Frame
from twin.live.recorder import Recorder
from twin.live.sources.antenna import Antenna
from twin.live.sources.frames import FrameReader, UnknownCameraError, UnusableFrameError

LONGEST_SENTENCE, LONGEST_FRAME = 1024, 1_000_000
"""Bytes of a line. NMEA allows 82; a frame of 5,000 detections stays below a million."""
_MOST_REASONS = 16
_NONE: Mapping[str, int] = MappingProxyType({})
_STAMPED = re.compile(rb"[*}][^*}]*\s\d{16}\s*$")
"""A line behind whose sentence or report a host stamp stands already."""


class Decoder(Protocol):
    """What the bytes of one sender say."""

    @property
    def readable(self) -> int:
        """Lines or messages so far that can be read, whatever they say."""

    @property
    def unreadable(self) -> int:
        """Those that cannot."""

    @property
    def why(self) -> str:
        """Return why the last one could not, for people."""

    @property
    def refused(self) -> Mapping[str, int]:
        """Frames so far of cameras that the car does not have, by what is to be said of it."""

    def feed(self, data: bytes, at_ns: int, /) -> Iterable[Fix | Frame]:
        """Take what came when the host's clock showed `at_ns`."""

    def pause(self) -> Iterable[Fix | Frame]:
        """Return what waits: nothing more has come for a moment, or the sender has left."""


class LineStream(Protocol):
    """Lines of a receiver → fixes."""

    readable: int
    unreadable: int

    def feed(self, line: bytes, at_ns: int) -> list[recorded.Fix]:
        """Take a line."""

    def pause(self) -> list[recorded.Fix]:
        """Return what waits."""


class Cutter:
    """Cuts bytes into lines of bounded length.

    Attributes
    ----------
    too_long : int
        Lines so far that were left out.
    """

    def __init__(self, longest: int) -> None:
        self.too_long = 0
        self._longest, self._held, self._skips = longest, b"", False

    def feed(self, data: bytes) -> list[bytes]:
        """Return the lines that have become whole, without their ends."""
        *whole, self._held = (self._held + data).split(b"\n")
        lines = []
        for line in whole:
            if self._skips or len(line) > self._longest:
                self.too_long += 1
            else:
                lines.append(line)
            self._skips = False
        if len(self._held) > self._longest:
            self._held, self._skips = b"", True
        return lines


class FixLines:
    """Sentences of NMEA, or reports of gpsd."""

    why = "no sentence with a sound checksum"
    refused = _NONE

    def __init__(self, stream: LineStream, antenna: Antenna, keep: Callable[[bytes], None]) -> None:
        self._stream, self._antenna, self._keep = stream, antenna, keep
        self._cutter = Cutter(LONGEST_SENTENCE)

    @property
    def readable(self) -> int:
        """Lines that are sentences."""
        return self._stream.readable

    @property
    def unreadable(self) -> int:
        """Lines that are none, and fixes that are nowhere."""
        return self._stream.unreadable + self._cutter.too_long + self._antenna.left_out

    def feed(self, data: bytes, at_ns: int) -> list[Fix]:
        """Take bytes."""
        fixes: list[recorded.Fix] = []
        for line in self._cutter.feed(data):
            if line.strip():
                self._keep(stamped(line, at_ns))
                fixes += self._stream.feed(line, at_ns)
        return self._antenna.fixes(fixes)

    def pause(self) -> list[Fix]:
        """Return what waits."""
        return self._antenna.fixes(self._stream.pause())


class FixMessages:
    """Messages of SBP."""

    why = "bytes that are no SBP frame"
    refused = _NONE

    def __init__(self, antenna: Antenna, keep: Callable[[bytes], None]) -> None:
        self._stream, self._antenna, self._keep = SbpStream(), antenna, keep

    @property
    def readable(self) -> int:
        """Frames with a sound checksum."""
        return self._stream.readable

    @property
    def unreadable(self) -> int:
        """Stretches of other bytes, and fixes that are nowhere."""
        return self._stream.unreadable + self._antenna.left_out

    def feed(self, data: bytes, _at_ns: int) -> list[Fix]:
        """Take bytes."""
        self._keep(data)
        return self._antenna.fixes(self._stream.feed(data))

    def pause(self) -> list[Fix]:
        """Return what waits."""
        return self._antenna.fixes(self._stream.pause())


class FrameLines:
    """Frames of a detector, a line each."""

    def __init__(self, reader: FrameReader, recorder: Recorder | None) -> None:
        self.readable, self.why = 0, f"a line of more than {LONGEST_FRAME:,} bytes"
        self.refused: Counter[str] = Counter()
        self._reader, self._recorder = reader, recorder
        self._cutter, self._unusable = Cutter(LONGEST_FRAME), 0

    @property
    def unreadable(self) -> int:
        """Lines that are no frame, and detections that are nowhere."""
        return self._unusable + self._cutter.too_long

    def feed(self, data: bytes, _at_ns: int) -> list[Frame]:
        """Take bytes."""
        frames = []
        for text in self._cutter.feed(data):
            if not text.strip():
                continue
            try:
                frames.append(self._frame(text))
                self.readable += 1
            except UnknownCameraError as reason:
                self.readable += 1
                told = str(reason)
                # Garbage may name many.
                is_told = told in self.refused or len(self.refused) < _MOST_REASONS
                self.refused[told if is_told else next(iter(self.refused))] += 1
            except UnusableFrameError as reason:
                self._unusable += 1
                self.why = str(reason)
        return frames

    def pause(self) -> list[Frame]:
        """Nothing waits: a line is a frame."""
        return []

    def _frame(self, text: bytes) -> Frame:
        line = frame_of_line(text)
        if line is None:
            raise UnusableFrameError("no JSON of a frame, as twin help live describes it")
        stamp_ns = self._reader.stamp_ns(line)
        if self._recorder is not None:
            self._recorder.frame(line, text, stamp_ns)
        frame, left_out = self._reader.frame(line, stamp_ns)
        for why, count in left_out.items():
            self._unusable += count
            self.why = f"a detection: {why}"
        return frame


def stamped(line: bytes, at_ns: int) -> bytes:
    """Return a line with the host's clock in µs behind it, and its end; one that has a stamp keeps it.

    A clock that was never set stamps nothing: readers leave such lines out.
    """
    if _STAMPED.search(line) or not credible(at_ns):
        return line + b"\n"
    return line.rstrip() + b" %d\n" % (at_ns // 1000)
