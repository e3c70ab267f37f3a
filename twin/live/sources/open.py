"""An address → a source."""

from __future__ import annotations

from enum import StrEnum

from twin.drives.detection.run import DetectorOptions
from twin.live.car import Car
from twin.live.ports import Source
from twin.live.recorder import Recorder


class Gives(StrEnum):
    """What an address is asked for."""

    FIXES = "fixes"
    DETECTIONS = "detections"


def open_source(
    url: str,
    gives: Gives,
    car: Car,
    *,
    recorder: Recorder | None = None,
    detector: DetectorOptions | None = None,
) -> Source:
    """Return the source of an address; nothing is connected before its arrivals are asked for.

    Parameters
    ----------
    url : str
        As docs/live.md lists them: ``serial:///dev/ttyUSB0?baud=115200``, ``tcp://host:port``,
        ``tcp+sbp://host:port``, ``udp://:port``, ``gpsd://host``, ``mqtt://host/topic``, ``mcap:///path``,
        ``ros2:///topic``, ``-`` for standard input. ``?antenna=NAME`` says whose fixes they are, where the
        car has several; ``?camera=NAME`` whose pictures.
    gives : Gives
    car : Car
        Antennas, cameras, datum, labels: what a drive folder states beside its recordings.
    recorder : Recorder, optional
        Gets everything that is received, before anything else is done with it.
    detector : DetectorOptions, optional
        The network that looks at the pictures of a camera or video.

    Returns
    -------
    Source
        Its `arrivals` never raise for what a sensor or a network does, which is a `Trouble`; they go on
        until `close`, or the end of a file or of standard input.

    Raises
    ------
    ConfigError
        For an address that is none, an antenna or a camera that the car does not have.
    MissingExtraError
        Where its library is not installed.
    """
    raise NotImplementedError
