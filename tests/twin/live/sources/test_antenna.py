"""What a car's folder states of its receivers is done to each fix, as a drive's is to all of them."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import pytest
from live_senders import ROOF, MakeCar, sentence

from twin.drives.read import read_drive
from twin.drives.track.formats.nmea import NmeaStream
from twin.live import arrivals_of
from twin.live.car import Car
from twin.live.events import Fix
from twin.live.sources.antenna import Antenna
from twin.live.sources.decoders import FixLines, stamped

SETTINGS = 'datum = "ITRF2014"\n[gnss]\nsigma_m = 0.5\n'


def decoded(car: Car, content: bytes) -> list[Fix]:
    """Fixes of what a receiver sends."""
    decoder = FixLines(NmeaStream(), Antenna(ROOF, car), lambda _: None)
    return [*decoder.feed(content, 1_781_078_400_000_000_000), *decoder.pause()]


def test_fixes_of_another_datum_are_those_of_the_recorded_drive(
    make_car: MakeCar, sample: Path, tmp_path: Path
) -> None:
    """Brought to EUREF89 at their epoch, and weighed as drive.toml says."""
    trip = Path(shutil.copytree(sample / "trip_trondheim", tmp_path / "trip"))
    (trip / "drive.toml").write_text(SETTINGS, encoding="utf-8")
    recorded = [one.what for one in arrivals_of(read_drive(trip))]
    expected = [one for one in recorded if isinstance(one, Fix) and one.antenna == ROOF]
    car = make_car(SETTINGS)
    found = decoded(car, (trip / "gnss50_vehicle.bin").read_bytes())
    assert len(found) == 250
    for one, other in zip(found, expected, strict=True):
        assert one[:2] == other[:2]
        assert one[2:7] == pytest.approx(other[2:7], abs=1e-11)
    assert car.live_car((ROOF,)).track_sigma_m > 0.0


def test_fix_that_no_datum_reaches_is_left_out(make_car: MakeCar) -> None:
    """By a host that shows 2098 the plate has moved too far: counted, and no end of the source."""
    decoder = FixLines(NmeaStream(), Antenna(ROOF, make_car(SETTINGS)), lambda _: None)
    gga = "GPGGA,080000.00,6325.0,N,01024.0,E,4,14,1.1,80.0,M,0.0,M,,"
    decoder.feed(sentence(gga), 4_050_000_000_000_000_000)
    assert decoder.pause() == []
    assert (decoder.readable, decoder.unreadable) == (1, 1)


@pytest.mark.parametrize(
    ("settings", "heading_deg", "used"),
    [
        ("", 1.0, range(50, 100)),
        ("", 91.0, range(0)),
        ("[gnss]\nheading_offset_deg = -90", 91.0, range(100)),
    ],
)
def test_headings_are_used_once_they_are_the_noses(
    make_car: MakeCar, settings: str, heading_deg: float, used: range
) -> None:
    """Northwards at 18 km/h: by their offset at once, else when the course agrees, and else never."""
    content = b""
    for k in range(100):
        time = f"0800{k // 5:02d}.{k % 5 * 20:02d}"
        gga = f"GPGGA,{time},{6325.0 + k / 1852:.7f},N,01024.0,E,4,14,1.1,80.0,M,0.0,M,,"
        content += sentence(gga) + sentence(f"GPHDT,{heading_deg},T")
    headings = [fix.heading_deg for fix in decoded(make_car(settings), content)]
    told = [k for k, heading in enumerate(headings) if math.isfinite(heading)]
    assert told == list(range(told[0], 100)) if told else not used
    if used:
        assert abs(told[0] - used[0]) <= 30
        assert headings[99] == pytest.approx(1.0)


def test_host_stamp_stands_behind_what_has_none() -> None:
    """In microseconds, as the recorder of a car writes it; one that is there stays."""
    at_ns = 1_781_078_399_078_496_123
    assert stamped(b"$GPGGA,1*00\r", at_ns) == b"$GPGGA,1*00 1781078399078496\n"
    assert stamped(b'{"class":"TPV"}\r', at_ns) == b'{"class":"TPV"} 1781078399078496\n'
    whole = b"$GPGGA,1*00 1781078399000000\r"
    assert stamped(whole, at_ns) == whole + b"\n"


def test_host_whose_clock_was_never_set_stamps_nothing(car: Car) -> None:
    """Its lines have no stamp, and fixes no day until the receiver says it."""
    gga, rmc = (
        "GPGGA,080000.00,6325.0,N,01024.0,E,4,14,1.1,80.0,M,0.0,M,,",
        "GPRMC,080001.00,A,,,,,,,100626,,,D",
    )
    kept: list[bytes] = []
    decoder = FixLines(NmeaStream(), Antenna(ROOF, car), kept.append)
    assert [*decoder.feed(sentence(gga), 60_000_000_000), *decoder.pause()] == []
    decoder.feed(sentence(rmc) + sentence(gga.replace("00.00", "01.00", 1)), 61_000_000_000)
    assert [fix.epoch_ns for fix in decoder.pause()] == [1_781_078_401_000_000_000]
    assert kept[0] == sentence(gga).rstrip() + b"\r\n"
