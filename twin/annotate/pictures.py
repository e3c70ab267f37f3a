"""A drive's pictures for the page: decoded once, kept in memory, never written to the disk."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Iterator
from threading import Lock

import numpy as np

from twin.annotate.recording import Recording
from twin.drives.frames.images import Image, UnusableImageError, decoded_image
from twin.drives.frames.read import Frame, frames
from twin.errors import DriveError

MOST_BYTES = 400_000_000
_BEFORE = 20
"""A video is read again from its beginning to go back: so many pictures before the asked one are kept too."""
_QUALITY = 95


class LostPictureError(Exception):
    """A picture that does not come out; its text is a sentence for people."""


class PictureCache:
    """JPEGs of pictures, by camera and frame."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._kept: OrderedDict[tuple[str, int], bytes] = OrderedDict()
        self._bytes = 0
        self._open: dict[str, _Video] = {}
        self._lock = Lock()

    def jpeg(self, camera: str, frame: int) -> bytes:
        """Return one picture.

        Raises
        ------
        LostPictureError
            It is damaged, or does not come out of its video.
        """
        with self._lock:
            kept = self._kept.get((camera, frame))
            if kept is not None:
                self._kept.move_to_end((camera, frame))
                return kept
            if self._recording.pictures[camera].images is None:
                self._read_video(camera, frame)
            else:
                self._keep(camera, frame, self._image(camera, frame))
            if (camera, frame) not in self._kept:
                raise LostPictureError(
                    f"Frame {frame:,} of {camera} does not come out of"
                    f" {self._recording.pictures[camera].where}: go on with the next."
                )
            return self._kept[camera, frame]

    def _image(self, camera: str, frame: int) -> Image:
        of = self._recording.pictures[camera]
        name = of.images[frame] if of.images else ""
        try:
            image = decoded_image(of.folder.peek(name))
        except UnusableImageError as error:
            raise LostPictureError(f"{name}: {error}; go on with the next.") from error
        except DriveError as error:
            raise LostPictureError(f"{error} Go on with the next.") from error
        model = self._recording.rig.camera(camera).model
        if image.shape[:2] != (model.height_px, model.width_px):
            raise LostPictureError(
                f"{name} has {image.shape[1]} x {image.shape[0]} pixels, not {model.width_px} x"
                f" {model.height_px} as the camera was calibrated; go on with the next."
            )
        return image

    def _read_video(self, camera: str, frame: int) -> None:
        video = self._open.get(camera)
        if video is None or frame < video.next:
            video = self._open[camera] = _Video(self._recording, camera, max(frame - _BEFORE, 0))
        for one in video.until(frame):
            self._keep(camera, one.number, one.image)

    def _keep(self, camera: str, frame: int, image: Image) -> None:
        import cv2

        done, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        if not done:
            raise LostPictureError("OpenCV cannot write JPEG here: install opencv-python-headless again.")
        self._kept[camera, frame] = data.tobytes()
        self._bytes += data.size
        while self._bytes > MOST_BYTES and len(self._kept) > 1:
            _, old = self._kept.popitem(last=False)
            self._bytes -= len(old)


class _Video:
    """A video that is read forwards."""

    def __init__(self, recording: Recording, camera: str, first: int) -> None:
        numbers = recording.frames[camera]
        wanted = np.zeros(int(numbers[-1]) + 1 if numbers.size else 0, dtype=np.bool_)
        wanted[numbers[numbers >= first]] = True
        self.next = first
        self._frames = frames(recording.pictures[camera], np.zeros(wanted.size, np.int64), wanted, Counter())

    def until(self, frame: int) -> Iterator[Frame]:
        """Decode up to a frame."""
        try:
            while self.next <= frame:
                one = next(self._frames)
                self.next = one.number + 1
                yield one
        except StopIteration:
            self.next = frame + 1
        except DriveError as error:
            raise LostPictureError(str(error)) from error
