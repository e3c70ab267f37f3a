"""Pictures of a camera or a video, looked at by a network while they come."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from threading import Condition, Event, Thread
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.drives.annotations.formats.frame_lines import Found, FrameLine, line_of_frame
from twin.drives.detection.network import Detector
from twin.errors import MissingExtraError
from twin.live.events import Arrival
from twin.live.ports import Trouble, TroubleKind
from twin.live.recorder import Recorder
from twin.live.sources.epochs import Epochs
from twin.live.sources.frames import FrameReader

if TYPE_CHECKING:
    from av.container import InputContainer

Image = NDArray[np.uint8]

_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 10.0
_ANSWER_S = 5.0
_LOOK_S, _TOLD_EVERY_S = 0.1, 1.0
_CORNER_TO_CENTRE_PX = 0.5
_DECIMALS_PX = 3


@dataclass(frozen=True, slots=True)
class PictureAddress:
    """Where pictures come from, as FFmpeg takes it.

    Attributes
    ----------
    url : str
        May hold a password.
    format : str or None
        FFmpeg's name of what a device speaks.
    is_file : bool
        A video that is played at its own pace, and ends.
    """

    url: str
    format: str | None = None
    is_file: bool = False


class _Picture(NamedTuple):
    number: int
    stamp_ns: int
    image: Image


class _Newest:
    """Holds the newest picture until it is taken: one that comes before that takes its place."""

    def __init__(self) -> None:
        self.dropped = 0
        self.lost = ""
        self.ended = False
        self._picture: _Picture | None = None
        self._changed = Condition()

    def put(self, picture: _Picture) -> None:
        with self._changed:
            self.dropped += self._picture is not None
            self._picture, self.lost = picture, ""
            self._changed.notify()

    def lose(self, why: str) -> None:
        with self._changed:
            self.lost = why

    def end(self) -> None:
        with self._changed:
            self.ended = True
            self._changed.notify()

    def take(self, patience_s: float) -> _Picture | None:
        with self._changed:
            if self._picture is None and not self.ended:
                self._changed.wait(patience_s)
            picture, self._picture = self._picture, None
            return picture


class CameraSource:
    """Detections in the pictures of one camera. Pictures are stamped when they are decoded.

    Parameters
    ----------
    name : str
        Of its address, without a password.
    address : PictureAddress
    camera : str
        As the rig calls it.
    size_px : (int, int)
        Width and height of its pictures.
    detector : Detector
    threshold : float
        Lowest score that counts.
    every : int
        Only every so many frames.
    reader : FrameReader
    recorder : Recorder, optional

    Raises
    ------
    MissingExtraError
        If PyAV is not installed.
    """

    def __init__(
        self,
        name: str,
        address: PictureAddress,
        camera: str,
        size_px: tuple[int, int],
        detector: Detector,
        threshold: float,
        every: int,
        reader: FrameReader,
        recorder: Recorder | None,
    ) -> None:
        try:
            import av  # noqa: F401
        except ImportError as error:
            raise MissingExtraError(f"The camera {name}", "PyAV", "video") from error
        self._name, self._address, self._camera, self._size_px = name, address, camera, size_px
        self._detector, self._threshold, self._every = detector, threshold, every
        self._reader, self._recorder = reader, recorder
        self._newest, self._stopped, self._epochs = _Newest(), Event(), Epochs(name)
        self._number = self._told = self._unfit = 0

    @property
    def name(self) -> str:
        """Return its address, without a password."""
        return self._name

    def close(self) -> None:
        """End `arrivals`, from another thread."""
        self._stopped.set()
        self._newest.end()

    def arrivals(self) -> Iterator[Arrival | Trouble]:
        """Yield frames with what was found in them, and what goes wrong; return at the end of a video."""
        Thread(target=self._grab, name=f"pictures of {self._camera}", daemon=True).start()
        is_lost, told_s = False, time.monotonic()
        while not self._stopped.is_set():
            picture = self._newest.take(_LOOK_S)
            if picture is not None:
                if is_lost:
                    is_lost = False
                    yield self._trouble(TroubleKind.BACK)
                yield from self._taken(picture)
            elif self._newest.ended:
                break
            elif self._newest.lost and not is_lost:
                is_lost = True
                yield self._trouble(TroubleKind.LOST, detail=self._newest.lost)
            if time.monotonic() - told_s >= _TOLD_EVERY_S:
                told_s = time.monotonic()
                yield from self._left_out()
        yield from self._left_out()

    def _taken(self, picture: _Picture) -> Iterator[Arrival | Trouble]:
        if picture.image.shape[1::-1] == self._size_px:
            yield from self._epochs.checked(self._seen(picture))
        else:
            self._unfit += 1

    def _left_out(self) -> Iterator[Trouble]:
        """Tell what was left out since the last time."""
        dropped, self._told = self._newest.dropped - self._told, self._newest.dropped
        if dropped:
            yield self._trouble(TroubleKind.DROPPED, dropped, "the detector is too slow")
        if self._unfit:
            width, height = self._size_px
            size = f"pictures of another size than the {width} x {height} of {self._camera} in the rig"
            yield self._trouble(TroubleKind.GARBAGE, self._unfit, size)
        self._unfit = 0

    def _seen(self, picture: _Picture) -> Arrival:
        """Look at a picture; what was found goes the way of what other detectors send."""
        found = self._detector.find(picture.image, self._threshold, Counter())
        corners = np.round(found.box_px + _CORNER_TO_CENTRE_PX, _DECIMALS_PX).tolist()
        boxes = zip(corners, found.score.tolist(), found.class_index.tolist(), strict=True)
        line = FrameLine(
            camera=self._camera,
            frame=picture.number,
            stamp_ns=picture.stamp_ns,
            detections=tuple(
                Found(box=tuple(box), label=self._detector.name_of(kind), score=round(score, 4))
                for box, score, kind in boxes
            ),
        )
        if self._recorder is not None:
            self._recorder.frame(line, line_of_frame(line).rstrip(b"\n"), picture.stamp_ns)
        frame, _ = self._reader.frame(line, picture.stamp_ns)
        return Arrival(time.time_ns(), frame)

    def _grab(self) -> None:
        """Decode pictures as they come, again where the camera was lost; in a thread of its own."""
        wait_s = _FIRST_WAIT_S
        while not self._stopped.is_set():
            before = self._number
            try:
                with self._opened() as container:
                    self._decode(container)
            except (OSError, ValueError) as error:
                self._newest.lose(getattr(error, "strerror", None) or type(error).__name__)
            else:
                self._newest.lose("its pictures have ended")
            if self._number > before:
                wait_s = _FIRST_WAIT_S
                if self._address.is_file:
                    break
            self._stopped.wait(wait_s)
            wait_s = min(2.0 * wait_s, _LONGEST_WAIT_S)
        self._newest.end()

    def _opened(self) -> InputContainer:
        import av

        rtsp = {"rtsp_transport": "tcp"} if self._address.url.startswith("rtsp") else {}
        timeout = None if self._address.is_file else (_ANSWER_S, _ANSWER_S)
        return av.open(self._address.url, "r", format=self._address.format, options=rtsp, timeout=timeout)

    def _decode(self, container: InputContainer) -> None:
        """Hand pictures on; those of a file at its own pace."""
        began_s = time.monotonic()
        for frame in container.decode(video=0):
            if self._stopped.is_set():
                return
            if self._address.is_file:
                early_s = float(frame.time or 0.0) - (time.monotonic() - began_s)
                self._stopped.wait(max(early_s, 0.0))
            stamp_ns = time.time_ns()
            if self._number % self._every == 0:
                image = frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False)
                self._newest.put(_Picture(self._number, stamp_ns, image))
            self._number += 1

    def _trouble(self, kind: TroubleKind, count: int = 1, detail: str = "") -> Trouble:
        return Trouble(time.time_ns(), self._name, kind, count, detail)
