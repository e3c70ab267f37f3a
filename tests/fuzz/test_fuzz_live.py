"""Damaged and forged bytes on the sockets of a live drive: fixes and frames that are ones, or a count."""

from __future__ import annotations

import json
import math
from functools import cache

from live_senders import ROOF, WIDE, sentence
from mutate import fuzzed, mutated, real_files
from track_writers import S, sbp_clock, sbp_position, sbp_velocity

from geoloc.live.samples import Fix
from twin.drives.epochs import credible
from twin.drives.track import fixes as recorded
from twin.drives.track.formats.gpsd import GpsdStream, read_gpsd, report_of
from twin.drives.track.formats.nmea import NmeaStream
from twin.errors import DriveError
from twin.live.car import Car, read_car
from twin.live.events import Arrival, Frame
from twin.live.sources.antenna import Antenna
from twin.live.sources.decoders import Decoder, FixLines, FixMessages, FrameLines
from twin.live.sources.epochs import Epochs
from twin.live.sources.frames import FrameReader
from twin.samples.demo import sample_folder

AT_NS = 1_781_078_400 * S
EPOCHS = [AT_NS + k * S // 5 for k in range(10)]
NMEA = b"".join(
    sentence(f"GPGGA,0800{k:02d}.00,6325.0,N,01024.0,E,4,14,1.1,80.0,M,0.0,M,,")
    + sentence(f"GPRMC,0800{k:02d}.00,A,6325.0,N,01024.0,E,10.0,{k}.0,100626,,,D")
    + sentence(f"GPHDT,{k}.0,T")
    for k in range(10)
)
SBP = b"".join(
    sbp_clock(at) + sbp_position(at, 63.4, 10.4, 80.0) + sbp_velocity(at, 1.0, 2.0, 0.0) for at in EPOCHS
)
GPSD = b'{"class":"VERSION"}\n' + b"".join(
    report_of(recorded.Fix(at, at, 63.4, 10.4, 80.0, 4, 0.01, 0.02)) for at in EPOCHS
)
FRAMES = b"".join(
    json.dumps(
        {
            "camera": WIDE,
            "frame": k,
            "time_ns": at,
            "detections": [
                {"foot": [700.5, 600.5], "object": f"P{k}", "skiltnummer": "362.50"},
                {"box": [300.0, 80.0, 340.0, 120.0], "label": "stop", "track": 7, "text": "x", "score": 0.9},
            ],
        }
    ).encode()
    + b"\n"
    for k, at in enumerate(EPOCHS)
)


@cache
def car() -> Car:
    """The sample's."""
    return read_car(sample_folder() / "trip_trondheim")


def checked(decoder: Decoder, content: bytes) -> None:
    """Whatever comes out can be what the car has measured."""
    epochs = Epochs("tcp://receiver")
    found: list[Fix | Frame] = []
    for at in range(0, len(content), 61):
        found += decoder.feed(content[at : at + 61], AT_NS + at)
    found += decoder.pause()
    for what in found:
        assert list(epochs.checked(Arrival(AT_NS, what))) is not None
        assert credible(what.epoch_ns)
        if isinstance(what, Fix):
            assert abs(what.latitude_deg) <= 90.0
            assert math.isfinite(what.height_m)
            assert what.quality > 0
        else:
            assert what.camera in car().rig.cameras
            assert all(map(math.isfinite, (x for one in what.detections for x in one.pixel_px)))


@fuzzed(mutated([NMEA, *real_files("gnss", ".log")]), mutated([GPSD]), parsers=2)
def test_fuzz_lines_of_receivers(nmea: bytes, gpsd: bytes) -> None:
    """Damaged sentences and reports."""
    checked(FixLines(NmeaStream(), Antenna(ROOF, car()), len), nmea)
    checked(FixLines(GpsdStream(), Antenna(ROOF, car()), len), gpsd)
    try:
        read_gpsd(gpsd, "a", "a.gpsd")
    except DriveError:
        return


@fuzzed(mutated([SBP, *real_files("gnss", ".sbp")]))
def test_fuzz_frames_of_receivers(content: bytes) -> None:
    """Damaged SBP."""
    checked(FixMessages(Antenna(ROOF, car()), len), content)


@fuzzed(mutated([FRAMES]))
def test_fuzz_frames_of_detectors(content: bytes) -> None:
    """Damaged lines of JSON."""
    checked(FrameLines(FrameReader(car()), None), content)
