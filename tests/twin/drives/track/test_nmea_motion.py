"""Headings, speeds and courses in NMEA recordings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from left_out import counts

from geoloc.trajectory.poses import GnssFixes
from twin.drives.track.formats.nmea import read_nmea

S = 1_000_000_000


def fixes_of(*lines: str) -> GnssFixes:
    """Fixes of a recording."""
    return read_nmea("".join(lines).encode(), "a", "a.nmea").fixes


def reasons(*lines: str) -> dict[str, int]:
    """What was left out."""
    return counts(read_nmea("".join(lines).encode(), "a", "a.nmea").skipped)


@pytest.mark.parametrize("body", ["GNHDT,12.5,T", "GPTHS,12.5,A", "INTHS,12.5,E"])
def test_heading_is_that_of_the_fix_before_it(maker: Any, body: str) -> None:
    """HDT and THS carry no time; a fix without one has none, and no sigma."""
    fixes = fixes_of(
        maker.gga(maker.start_ns),
        maker.sentence(body),
        maker.gga(maker.start_ns + S),
        maker.gga(maker.start_ns + 2 * S),
    )
    np.testing.assert_array_equal(fixes.heading_deg, [12.5, np.nan, np.nan])
    np.testing.assert_array_equal(fixes.heading_sigma_deg, [0.5, np.nan, np.nan])


def test_heading_before_the_first_fix_is_that_of_the_first_fix(maker: Any) -> None:
    """A recording that begins in the middle of a burst."""
    fixes = fixes_of(maker.sentence("GNHDT,12.5,T"), maker.gga(maker.start_ns))
    assert fixes.heading_deg.tolist() == [12.5]


def test_heading_follows_the_nearer_host_stamp(maker: Any) -> None:
    """A receiver that sends HDT ahead of GGA: the host stamped it 1 ms before the fix it belongs to."""
    lines = []
    for i in range(3):
        epoch_ns = maker.start_ns + i * S
        host_us = (epoch_ns + 77_000_000) // 1000
        lines += [maker.sentence(f"GNHDT,{10.0 + i},T", host_us), maker.gga(epoch_ns)]
    assert fixes_of(*lines).heading_deg.tolist() == [10.0, 11.0, 12.0]


@pytest.mark.parametrize(
    "body", ["GNHDT,,T", "GPTHS,12.5,V", "GPTHS,12.5", "GNHDT,361.0,T", "GNHDT,-3,T", "GNHDT,x,T"]
)
def test_heading_that_is_none_is_counted(maker: Any, body: str) -> None:
    """Empty, called invalid, or off the circle."""
    lines = [maker.gga(maker.start_ns), maker.sentence(body)]
    assert np.isnan(fixes_of(*lines).heading_deg).all()
    assert reasons(*lines) == {"heading that the receiver calls invalid": 1}


def test_heading_of_a_compass_is_counted(maker: Any) -> None:
    """The talker HC is a magnetic compass."""
    lines = [maker.gga(maker.start_ns), maker.sentence("HCHDT,12.5,T")]
    assert reasons(*lines) == {"heading of a magnetic compass": 1}


def test_velocity_is_speed_and_course_of_rmc(maker: Any) -> None:
    """10 knots to the south-west, 0.15 m/s an axis; nothing is said of the vertical."""
    rmc = maker.sentence("GPRMC,080000.00,A,6325.2,N,01024.0,E,10.0,225.0,100626,,,D")
    fixes = fixes_of(rmc, maker.gga(maker.start_ns), maker.gga(maker.start_ns + S))
    axis = -10.0 * 1852 / 3600 / np.sqrt(2)
    np.testing.assert_allclose(fixes.velocity_mps, [[axis, axis, np.nan], [np.nan] * 3])
    np.testing.assert_allclose(fixes.velocity_sigma_mps, [[0.15, np.nan], [np.nan] * 2])


def test_velocity_of_vtg_is_taken_where_rmc_has_none(maker: Any) -> None:
    """VTG carries no time: it belongs to the fix before it."""
    vtg = maker.sentence("GPVTG,90.0,T,,M,,N,36.0,K,A")
    rmc = maker.sentence("GPRMC,080001.00,A,6325.2,N,01024.0,E,10.0,0.0,100626,,,D")
    fixes = fixes_of(maker.gga(maker.start_ns), vtg, maker.gga(maker.start_ns + S), rmc, vtg)
    np.testing.assert_allclose(fixes.velocity_mps[:, 0], [10.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("course", "knots"), [("", "0.2"), ("123.4", "0.2")])
def test_velocity_of_a_creeping_car_has_no_direction(maker: Any, course: str, knots: str) -> None:
    """Below 0.5 m/s a course is noise: the velocity is 0, as good as the speed."""
    rmc = maker.sentence(f"GPRMC,080000.00,A,6325.2,N,01024.0,E,{knots},{course},100626,,,D")
    fixes = fixes_of(rmc, maker.gga(maker.start_ns))
    assert fixes.velocity_mps[0, :2].tolist() == [0.0, 0.0]
    assert fixes.velocity_sigma_mps[0, 0] == pytest.approx(np.hypot(0.15, 0.2 * 1852 / 3600))


@pytest.mark.parametrize(
    "fields",
    ["V,6325.2,N,01024.0,E,10.0,0.0", "A,6325.2,N,01024.0,E,10.0,", "A,6325.2,N,01024.0,E,900.0,0.0"],
)
def test_velocity_that_is_none_is_passed_by(maker: Any, fields: str) -> None:
    """A void sentence, no course, or faster than any car."""
    rmc = maker.sentence(f"GPRMC,080000.00,{fields},100626,,,D")
    assert np.isnan(fixes_of(rmc, maker.gga(maker.start_ns)).velocity_mps).all()
