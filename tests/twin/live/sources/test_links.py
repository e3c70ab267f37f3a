"""Every way by which bytes come, over real sockets, ports and pipes."""

from __future__ import annotations

import json
import os
import pty
import socket
import time
import tty
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from live_senders import WIDE, Listener, Sender, connected, free_port, until
from mqtt_broker import Broker
from track_writers import sbp_clock, sbp_position

from twin.drives.track.fixes import Fix
from twin.drives.track.formats.gpsd import report_of
from twin.drives.track.formats.nmea import read_nmea
from twin.live.car import Car
from twin.live.ports import Source, TroubleKind
from twin.live.sources import Gives, open_source
from twin.live.sources.decoders import FrameLines
from twin.live.sources.frames import FrameReader
from twin.live.sources.links import StdinLink
from twin.live.sources.stream import PAUSE_S, StreamSource


@pytest.fixture
def sentences(sample: Path) -> list[bytes]:
    """Of the sample's first antenna."""
    return (sample / "trip_trondheim" / "gnss50_vehicle.bin").read_bytes().splitlines(keepends=True)[:20]


def fixes(url: str, car: Car) -> Source:
    """A source of fixes."""
    return open_source(url, Gives.FIXES, car)


def frame(number: int) -> bytes:
    """A frame of the car's camera with one foot."""
    stamp_ns = 1_781_078_400_000_000_000 + number * 33_000_000
    found = [{"foot": [700.5, 600.5], "label": "362.50", "track": 7}]
    return json.dumps({"camera": WIDE, "frame": number, "time_ns": stamp_ns, "detections": found}).encode()


def assert_fixes(listener: Listener, sentences: list[bytes], send: Callable[[bytes], object]) -> None:
    """Those of a file of these sentences come, in their order."""
    expected = read_nmea(b"".join(sentences), "gnss50:vehicle", "a").fixes.epoch_ns.tolist()
    # Nothing tells the sender from when on it is heard; a fix that comes again is left out.
    until(lambda: send(sentences[0]) and not time.sleep(2 * PAUSE_S) and listener.fixes())
    for sentence in sentences[1:]:
        send(sentence)
    until(lambda: len(listener.fixes()) == len(expected))
    assert [fix.epoch_ns for fix in listener.fixes()] == expected
    assert listener.troubles(TroubleKind.GARBAGE, TroubleKind.LOST) == []


def test_udp_and_serial_give_fixes(car: Car, sentences: list[bytes]) -> None:
    """Datagrams without an end of line; a port that is a pair of pseudo terminals."""
    place = ("127.0.0.1", free_port())
    with Listener(fixes(f"udp://:{place[1]}", car)) as listener, socket.socket(type=socket.SOCK_DGRAM) as one:
        assert_fixes(listener, sentences, lambda sentence: one.sendto(sentence.rstrip(), place))
    controller, device = pty.openpty()
    tty.setraw(device)
    with Listener(fixes(f"serial://{os.ttyname(device)}?baud=9600", car)) as listener:
        assert_fixes(listener, sentences, lambda sentence: os.write(controller, sentence))
    os.close(controller)
    os.close(device)


def test_gpsd_is_asked_for_reports(car: Car, sentences: list[bytes]) -> None:
    """The watch names the device of the address; TPV and GST become fixes with sigmas."""
    first = open_source("gpsd://127.0.0.1", Gives.FIXES, car)
    assert first.name == "gpsd://127.0.0.1:2947"
    read = read_nmea(b"".join(sentences), "a", "a").fixes
    with Sender() as gpsd, Listener(fixes(f"gpsd://127.0.0.1:{gpsd.port}/dev/ttyACM0", car)) as listener:
        gpsd.send(b'{"class":"VERSION","release":"3.25"}\r\n')
        until(lambda: b"\n" in gpsd.heard)
        assert json.loads(gpsd.heard.removeprefix(b"?WATCH=").removesuffix(b";\n")) == {
            "enable": True,
            "json": True,
            "device": "/dev/ttyACM0",
        }
        row = (63.4, 10.4, 80.0, 4, 0.01, 0.02)
        gpsd.send(b"".join(report_of(Fix(at, at, *row)) for at in read.epoch_ns.tolist()))
        until(lambda: len(listener.fixes()) == 20)
        assert [fix.epoch_ns for fix in listener.fixes()] == read.epoch_ns.tolist()
        assert [fix.sigma_horizontal_m for fix in listener.fixes()] == pytest.approx([0.01] * 20)
        assert {fix.quality for fix in listener.fixes()} == {4}


def test_sbp_over_tcp_gives_fixes(car: Car) -> None:
    """Binary frames, cut anywhere."""
    epochs = [1_781_078_400_000_000_000 + i * 200_000_000 for i in range(10)]
    content = b"".join(sbp_clock(at) + sbp_position(at, 63.4, 10.4, 80.0) for at in epochs)
    with Sender() as receiver, Listener(fixes(f"tcp+sbp://127.0.0.1:{receiver.port}", car)) as listener:
        for at in range(0, len(content), 50):
            receiver.send(content[at : at + 50])
        until(lambda: len(listener.fixes()) == 10)
        assert [fix.epoch_ns for fix in listener.fixes()] == epochs
        assert listener.troubles() == []


def test_detectors_connect_send_datagrams_write_pipes_and_publish(car: Car) -> None:
    """Two clients at once, a datagram, standard input, which ends the source, and a broker's topic."""
    port = free_port()
    with Listener(open_source(f"tcp://:{port}", Gives.DETECTIONS, car)) as listener:
        with connected(port) as one, connected(port) as other:
            one.sendall(frame(1)[:30])
            other.sendall(frame(2) + b"\n")
            one.sendall(frame(1)[30:] + b"\n")
            until(lambda: {seen.number for seen in listener.frames()} == {1, 2})
        (found,) = listener.frames()[0].detections
        assert (found.pixel_px, found.kind, found.object) == ((700.0, 600.0), "foot", "7")
    datagrams = Listener(open_source(f"udp://127.0.0.1:{port}", Gives.DETECTIONS, car))
    with datagrams as listener, socket.socket(type=socket.SOCK_DGRAM) as sender:
        until(lambda: sender.sendto(frame(3), ("127.0.0.1", port)) and listener.frames())
    out, into = os.pipe()
    os.write(into, frame(1) + b"\n" + frame(2) + b"\n")
    os.close(into)
    reader = FrameReader(car)
    with Listener(StreamSource("-", StdinLink(out), lambda: FrameLines(reader, None))) as listener:
        until(listener.ended)
        assert [seen.number for seen in listener.frames()] == [1, 2]
        # It is not lost: nobody goes on trying.
        assert [one.kind for one in listener.troubles()] == [TroubleKind.ENDED]
    os.close(out)


def test_one_detector_more_than_there_may_be_takes_the_place_of_the_first(car: Car) -> None:
    """The first may have lost its power: nobody says so over TCP."""
    port = free_port()
    with Listener(open_source(f"tcp://:{port}", Gives.DETECTIONS, car)) as listener, ExitStack() as stack:
        clients = [stack.enter_context(connected(port)) for _ in range(33)]
        for number in (32, 1):
            clients[number].sendall(frame(number) + b"\n")
        until(lambda: {seen.number for seen in listener.frames()} == {32, 1})
        clients[0].settimeout(5.0)
        assert clients[0].recv(1) == b""


def test_broker_that_is_restarted_is_found_again(car: Car) -> None:
    """Frames of a topic; the subscription is made anew."""
    from paho.mqtt.publish import single

    with Broker() as broker:
        port = broker.port
        source = open_source(f"mqtt://car:secret@127.0.0.1:{port}/car/7", Gives.DETECTIONS, car)
        assert source.name == f"mqtt://127.0.0.1:{port}/car/7"
        listener = Listener(source)
        with listener:
            until(lambda: broker._listeners)
            single("car/7", frame(3), hostname="127.0.0.1", port=port)
            until(listener.frames)
            broker.close()
            until(lambda: listener.troubles(TroubleKind.LOST))
            with Broker(port) as again:
                until(lambda: again._listeners)
                single("car/7", frame(4), hostname="127.0.0.1", port=port)
                until(lambda: len(listener.frames()) == 2)
                assert listener.troubles(TroubleKind.BACK)
                assert "secret" not in repr(listener.got)
