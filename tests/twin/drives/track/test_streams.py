"""Receivers that are read while they send: the fixes are those of the same bytes in a file."""

from __future__ import annotations

from datetime import UTC, datetime
from random import Random
from typing import Any

import numpy as np
import pytest
from track_writers import S, sbp_clock, sbp_heading, sbp_position, sbp_velocity

from twin.drives.track.fixes import Fix, FixesRead
from twin.drives.track.formats.gpsd import GpsdStream, read_gpsd, report_of
from twin.drives.track.formats.nmea import NmeaStream, read_nmea
from twin.drives.track.formats.sbp import read_sbp
from twin.drives.track.formats.sbp_stream import SbpStream

START_NS = int(datetime(2026, 6, 10, 23, 59, 58, tzinfo=UTC).timestamp()) * S
EPOCHS = [START_NS + i * S // 5 for i in range(25)]


def assert_same(found: list[Fix], read: FixesRead, *, host: bool = True) -> None:
    """Every column, to the last bit."""
    columns = zip(*found, strict=True)
    for name, column in zip(Fix._fields, columns, strict=True):
        if host or name != "host_ns":
            np.testing.assert_array_equal(np.array(column), getattr(read.fixes, name), err_msg=name)


def sentences(maker: Any, epoch_ns: int, k: int) -> list[str]:
    """All that a receiver says of one epoch, over midnight."""
    moment = datetime.fromtimestamp(epoch_ns // S, UTC)
    time = f"{moment:%H%M%S}.{epoch_ns // 10_000_000 % 100:02d}"
    bodies = [
        f"GPRMC,{time},A,6325.2,N,01024.0,E,{10 + k}.0,{k}.0,{moment:%d%m%y},,,D",
        f"GPGST,{time},1.0,,,,0.0{k % 9 + 1},0.02,0.05",
        f"GPHDT,{k}.5,T",
    ]
    gga = maker.gga(epoch_ns, host=False, lat=f"{6325.2 + k * 1e-4:.7f}")
    return [maker.sentence(bodies[0]), gga, *(maker.sentence(body) for body in bodies[1:])]


@pytest.mark.parametrize("pauses", [True, False])
def test_nmea_stream_gives_the_fixes_of_the_file(maker: Any, pauses: bool) -> None:
    """Date, sigmas, velocity and heading of each epoch, with or without gaps between; garbage counts."""
    lines, found, stream = list[str](), list[Fix](), NmeaStream()
    for k, epoch_ns in enumerate(EPOCHS):
        of_epoch = sentences(maker, epoch_ns, k)
        if k % 5 == 0:
            of_epoch.insert(2, "$GPGGA,2359\x00\xff\r\n")
            of_epoch[1] = "$GPGGA,235" + of_epoch[1]  # a line that was cut, and a whole one behind it
        for line in of_epoch:
            # Without a date of its own it would be that of the host, which is a day off here.
            found += stream.feed(line.encode("latin-1"), START_NS + 86_400 * S)
        found += stream.pause() if pauses else []
        lines += of_epoch
    found += stream.pause()
    assert_same(found, read_nmea("".join(lines).encode("latin-1"), "a", "a.nmea"), host=False)
    assert (stream.readable, stream.unreadable) == (4 * 25, 5)
    assert np.isfinite([fix.heading_deg for fix in found]).all()


def test_nmea_stream_without_a_date_takes_the_hosts(maker: Any) -> None:
    """The UTC is that of the sentence, its day the one that brings it nearest to when it came."""
    stream = NmeaStream()
    line = maker.gga(START_NS + 1_900_000_000, host=False).encode()
    (fix,) = stream.feed(line, START_NS + 2_050_000_000) + stream.pause()
    assert fix.epoch_ns == START_NS + 1_900_000_000


def test_sbp_stream_gives_the_fixes_of_the_file() -> None:
    """Cut anywhere, with other bytes and a damaged frame between its frames."""
    content = b""
    for k, epoch_ns in enumerate(EPOCHS):
        content += b"\x55\x01$noise\r\n" if k % 5 == 2 else b""
        content += sbp_clock(epoch_ns) + sbp_position(
            epoch_ns, 63.4 + 1e-6 * k, 10.4, 80.0, accuracy_mm=(15, 20)
        )
        content += sbp_velocity(epoch_ns, 1.0 * k, 2.0, 0.1) + sbp_heading(epoch_ns, 3.0 * k)
    content = content[:500] + b"\x00" + content[501:]
    random, stream, found, at = Random(4), SbpStream(), list[Fix](), 0
    while at < len(content):
        end = at + random.randrange(1, 90)
        found += stream.feed(content[at:end])
        at = end
    found += stream.pause()
    assert_same(found, read_sbp(content, "a", "a.sbp"))
    assert stream.unreadable == 6


def test_gpsd_stream_gives_the_fixes_of_the_file() -> None:
    """Sigmas come behind their fix."""
    fixes = [Fix(at, at, 63.4, 10.4 + 1e-7 * k, 80.0, 4, 0.01 * (k + 1), 0.02) for k, at in enumerate(EPOCHS)]
    content = b'{"class":"VERSION"}\nno json\n' + b"".join(map(report_of, fixes))
    stream, found = GpsdStream(), list[Fix]()
    for line in content.splitlines():
        found += stream.feed(line, START_NS)
    found += stream.pause()
    assert_same(found, read_gpsd(content, "a", "a.gpsd"), host=False)
    assert (stream.readable, stream.unreadable) == (51, 1)
