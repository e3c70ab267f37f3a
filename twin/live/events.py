"""What arrives while a drive goes on: every source gives these, a recorded drive as well as a socket."""

from __future__ import annotations

from typing import NamedTuple

from geoloc.live.samples import Fix, MotionSample

__all__ = ["Arrival", "Detection", "Fix", "Frame", "MotionSample"]


class Detection(NamedTuple):
    """One object in a frame.

    Attributes
    ----------
    pixel_px : (float, float)
        The foot, or the middle of the box; (0, 0) is the centre of the first pixel.
    kind : str
        A `geoloc.locate.records.Kind`.
    object : str or None
        What the source calls the object, the same in all frames and cameras; None: it does not know.
    label, skiltnummer, text : str
        As in `twin.drives.drive.Annotations`; "" if unknown.
    size_px : float
        Height of the box; NaN for a point.
    """

    pixel_px: tuple[float, float]
    kind: str
    object: str | None
    label: str = ""
    skiltnummer: str = ""
    text: str = ""
    size_px: float = float("nan")


class Frame(NamedTuple):
    """A frame, and all that was found in it: a frame without anything tells that nothing was there.

    Attributes
    ----------
    camera : str
    number : int
    epoch_ns : int
        UTC of the exposure of the middle row.
    detections : tuple of Detection
    """

    camera: str
    number: int
    epoch_ns: int
    detections: tuple[Detection, ...] = ()


class Arrival(NamedTuple):
    """Something, and when it arrived by the host's clock (ns, UTC), which alone drives the engine."""

    at_ns: int
    what: Fix | MotionSample | Frame
