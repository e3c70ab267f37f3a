"""What gpsd reports, recorded with ``gpspipe -w``."""

from __future__ import annotations

import json
from typing import Any

import pytest
from left_out import counts

from twin.drives.track.fixes import Fix
from twin.drives.track.formats.gpsd import looks_like_gpsd, read_gpsd, report_of

S = 1_000_000_000
EPOCH_NS = 1_781_078_399_200_000_000


def tpv(**changes: Any) -> bytes:
    """A fix, as gpsd 3.25 writes it, with what matters here."""
    report: dict[str, Any] = {"class": "TPV", "device": "/dev/ttyACM0", "status": 3, "mode": 3}
    report |= {"time": "2026-06-10T07:59:59.200Z", "leapseconds": 18, "lat": 63.42, "lon": 10.4}
    report |= {
        "altHAE": 80.25,
        "altMSL": 40.8,
        "epx": 1.2,
        "epy": 1.6,
        "epv": 3.0,
        "track": 90.0,
        "speed": 10.0,
    }
    return json.dumps(report | changes).encode()


GST = b'{"class":"GST","time":"2026-06-10T07:59:59.200Z","rms":1.0,"lat":0.03,"lon":0.04,"alt":0.05}'
HEAD = b'{"class":"VERSION","release":"3.25","proto_major":3}\r\n{"class":"DEVICES","devices":[]}\r\n'


def test_gpsd_fix_has_its_time_height_quality_and_sigmas() -> None:
    """UTC of the report, height above the ellipsoid, RTK fixed, sigmas of the GST of the same time."""
    content = HEAD + tpv() + b" 1781078399278000\r\n" + GST + b"\n"
    assert looks_like_gpsd(content)
    assert looks_like_gpsd(b'S":[]}\n' + content)
    assert not looks_like_gpsd(b'[{"class": "TPV"}]')
    fixes = read_gpsd(content, "roof", "a.gpsd").fixes
    assert fixes.epoch_ns.tolist() == [EPOCH_NS]
    assert fixes.host_ns.tolist() == [EPOCH_NS + 78_000_000]
    assert (fixes.latitude_deg[0], fixes.longitude_deg[0], fixes.height_m[0]) == (63.42, 10.4, 80.25)
    assert fixes.quality.tolist() == [4]
    assert fixes.sigma_horizontal_m == pytest.approx([(0.5 * (0.03**2 + 0.04**2)) ** 0.5])
    assert fixes.sigma_vertical_m == pytest.approx([0.05])
    assert fixes.velocity_mps[0, :2] == pytest.approx([10.0, 0.0])


def test_gpsd_without_gst_has_its_estimates_of_error() -> None:
    """Nobody knows how probably they hold: they count as one sigma."""
    fixes = read_gpsd(tpv(), "roof", "a.gpsd").fixes
    assert fixes.sigma_horizontal_m == pytest.approx([2.0**0.5])
    assert fixes.sigma_vertical_m == pytest.approx([3.0])


def test_gpsd_reports_that_are_no_fix_are_counted() -> None:
    """In the plane, simulated, without a height, cut."""
    faulty = [tpv(mode=2), tpv(status=8), tpv(altHAE=None), tpv()[:40]]
    faulty[2] = faulty[2].replace(b'"altHAE": null, ', b"")
    read = read_gpsd(b"\n".join([*faulty, tpv()]), "roof", "a.gpsd")
    assert len(read.fixes.epoch_ns) == 1
    assert sorted(counts(read.skipped).values()) == [1, 1, 2]


def test_fix_that_is_written_as_a_report_is_read_as_it_was() -> None:
    """So recordings of ROS topics keep every digit, and the microsecond."""
    fix = Fix(EPOCH_NS + 123_456_000, EPOCH_NS, 63.4123456789012, 10.4, 80.123456789, 5, 0.0123456, 0.05)
    read = read_gpsd(report_of(fix), "roof", "a.gpsd").fixes
    assert read.epoch_ns.tolist() == [fix.epoch_ns]
    assert (read.latitude_deg[0], read.height_m[0], read.quality[0]) == (fix.latitude_deg, fix.height_m, 5)
    assert read.sigma_horizontal_m == pytest.approx([fix.sigma_horizontal_m], rel=1e-12)
