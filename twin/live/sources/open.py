"""An address → a source."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
import numpy as np

from geoloc.errors import CalibrationError
from twin.drives.detection.network import Detector
from twin.drives.detection.run import DetectorOptions, check_options
from twin.drives.track.formats.gpsd import GpsdStream
from twin.drives.track.formats.nmea import NmeaStream
from twin.drives.track.formats.rosbag import POSITION_TYPE
from twin.errors import ConfigError
from twin.live.car import Car, antenna_of
from twin.live.ports import Source
from twin.live.recorder import Form, Recorder
from twin.live.sources import serial_link
from twin.live.sources.address import Address, Gives, address_for
from twin.live.sources.antenna import Antenna
from twin.live.sources.camera import CameraSource, PictureAddress
from twin.live.sources.decoders import Decoder, FixLines, FixMessages, FrameLines
from twin.live.sources.frames import FrameReader
from twin.live.sources.links import Link, ListeningLink, StdinLink, TcpLink, UdpLink
from twin.live.sources.mqtt_client import topic_of
from twin.live.sources.mqtt_link import MqttLink
from twin.live.sources.ros import TEXT_TYPE, PlayedSource, Ros2Link, ToLines, fix_lines, text_lines
from twin.live.sources.stream import StreamSource

_FASTEST = "max"


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
        Of detections: the network that looks at the pictures of the camera or video at the address.

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
    DriveError
        If a recording, or the detector's network, cannot be used.
    """
    address = address_for(url, gives, has_detector=detector is not None)
    if gives is Gives.FIXES:
        return _fixes(address, car, recorder)
    if detector is not None:
        return _pictures(address, car, recorder, detector)
    return _detections(address, car, recorder)


def _fixes(address: Address, car: Car, recorder: Recorder | None) -> Source:
    antenna = antenna_of(car, address.options.get("antenna"))
    transport, _, protocol = address.scheme.partition("+")
    form = Form.SBP if protocol else Form.GPSD if transport in ("gpsd", "mcap", "ros2") else Form.NMEA
    keep = _nowhere if recorder is None else recorder.fixes(antenna, form)
    decoder = partial(_fix_decoder, form, Antenna(antenna, car), keep)
    if transport == "mcap":
        return _played(address, POSITION_TYPE, fix_lines, decoder())
    return StreamSource(address.name, _fix_link(address, transport), decoder)


def _fix_link(address: Address, transport: str) -> Link:
    match transport:
        case "serial":
            baud = address.number("baud", serial_link.USUAL_BAUD)
            return serial_link.SerialLink(address.path, baud)
        case "udp":
            return UdpLink(address.host, address.port, lines=address.scheme == transport)
        case "ros2":
            return Ros2Link(address.path, is_position=True)
        case "gpsd":
            return TcpLink(address.host, address.port, _watch(address.path))
        case _:
            return TcpLink(address.host, address.port)


def _watch(device: str) -> bytes:
    """Ask gpsd for reports, of one of its devices where the address names one."""
    only = {"device": device} if device.strip("/") else {}
    return b"?WATCH=" + msgspec.json.encode({"enable": True, "json": True, **only}) + b";\n"


def _fix_decoder(form: Form, antenna: Antenna, keep: Callable[[bytes], None]) -> Decoder:
    if form is Form.SBP:
        return FixMessages(antenna, keep)
    return FixLines(GpsdStream() if form is Form.GPSD else NmeaStream(), antenna, keep)


def _nowhere(_data: bytes) -> None:
    """Keep nothing."""


def _detections(address: Address, car: Car, recorder: Recorder | None) -> Source:
    decoder = partial(FrameLines, FrameReader(car), recorder)
    if address.scheme == "mcap":
        return _played(address, TEXT_TYPE, text_lines, decoder())
    return StreamSource(address.name, _detection_link(address), decoder)


def _detection_link(address: Address) -> Link:
    match address.scheme:
        case "udp":
            return UdpLink(address.host, address.port)
        case "mqtt" | "mqtts":
            if not topic_of(address):
                raise ConfigError(f"{address.name} names no topic: write it behind the host.")
            return MqttLink(address)
        case "ros2":
            return Ros2Link(address.path, is_position=False)
        case "tcp" if address.host and "listen" not in address.options:
            return TcpLink(address.host, address.port)
        case "tcp":
            return ListeningLink(address.host, address.port)
        case _:
            return StdinLink()


def _played(address: Address, kind: str, to_lines: ToLines, decoder: Decoder) -> Source:
    text = address.options.get("speed", "1")
    try:
        speed = None if text == _FASTEST else float(text)
    except ValueError:
        speed = 0.0
    if speed is not None and not 0.0 < speed < 1e6:
        raise ConfigError(f"{address.name}: speed takes a number above 0, or {_FASTEST}, but not {text:.40}.")
    topic = address.options.get("topic")
    return PlayedSource(address.name, Path(address.path), kind, topic, to_lines, decoder, speed)


def _pictures(address: Address, car: Car, recorder: Recorder | None, options: DetectorOptions) -> Source:
    check_options(options)
    named, known = address.options.get("camera"), sorted(car.rig.cameras)
    if named is None and len(known) != 1:
        raise ConfigError(
            f"The car in {car.path} has the cameras {', '.join(known)}: say whose pictures come from"
            f" {address.name}, with ?camera={known[0] if known else 'NAME'} behind it."
        )
    try:
        camera = car.rig.camera(named or known[0])
    except CalibrationError as error:
        raise ConfigError(f"{address.name}: {error}") from error
    size_px = (camera.model.width_px, camera.model.height_px)
    network = Detector(options.model)
    # What does not fit is found before the car drives.
    network.find(np.zeros((64, 96, 3), dtype=np.uint8), options.threshold, Counter())
    is_device = address.scheme == "v4l2"
    where = PictureAddress(
        address.path if is_device or address.scheme == "file" else address.without("camera"),
        "v4l2" if is_device else None,
        is_file=address.scheme == "file",
    )
    return CameraSource(
        address.name,
        where,
        camera.name,
        size_px,
        network,
        options.threshold,
        options.every,
        FrameReader(car),
        recorder,
    )
