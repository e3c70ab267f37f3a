"""NMEA recordings."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np
import pynmea2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from left_out import counts

from twin.drives.track.fixes import fix_rate_hz
from twin.drives.track.formats.nmea import iter_sentences, read_nmea
from twin.errors import DriveError

S = 1_000_000_000


def epoch(*moment: int) -> int:
    """Nanoseconds since 1970 of a UTC date and time."""
    return int(datetime(*moment, tzinfo=UTC).timestamp()) * S  # type: ignore[misc,arg-type]


def test_nmea_epoch_is_the_time_in_the_sentence(maker: Any) -> None:
    """The host stamp gives the date only; it is kept beside the epoch."""
    read = read_nmea(maker.nmea().encode(), "gnss50", "a.bin")
    assert read.fixes.epoch_ns.tolist() == [maker.start_ns + i * S // 5 for i in range(50)]
    assert set((read.fixes.host_ns - read.fixes.epoch_ns).tolist()) == {78_000_000}
    assert fix_rate_hz(read.fixes) == pytest.approx(5.0)
    assert read.skipped == ()
    assert read.warnings == ()


def test_nmea_positions_agree_with_pynmea2(maker: Any) -> None:
    """An independent reader gets the same degrees, south and west included."""
    lines = [
        maker.gga(maker.start_ns + i * S, lat=lat, ns=ns, lon=lon, ew=ew)
        for i, (lat, ns, lon, ew) in enumerate(
            [
                ("6324.8972646", "N", "01023.9477304", "E"),
                ("0030.5", "S", "17959.9999", "W"),
                ("8959.9", "N", "00000.1", "E"),
            ]
        )
    ]
    fixes = read_nmea("".join(lines).encode(), "a", "a.bin").fixes
    oracle = [pynmea2.parse(line.split(" ")[0]) for line in lines]
    # 1e-12 degrees is a tenth of a micrometre: both divide the same decimal minutes by 60.
    assert fixes.latitude_deg == pytest.approx([m.latitude for m in oracle], abs=1e-12)
    assert fixes.longitude_deg == pytest.approx([m.longitude for m in oracle], abs=1e-12)


def test_nmea_height_is_altitude_plus_separation(maker: Any) -> None:
    """40 m above a geoid of 39.4 m is an ellipsoidal height of 79.4 m."""
    line = maker.gga(maker.start_ns, altitude="40.00", separation="39.4")
    assert read_nmea(line.encode(), "a", "a.bin").fixes.height_m == pytest.approx([79.4])


def test_nmea_without_separation_takes_the_altitude_and_says_so(maker: Any) -> None:
    """An empty separation costs a warning, not the fix."""
    read = read_nmea(maker.gga(maker.start_ns, separation="").encode(), "a", "a.bin")
    assert read.fixes.height_m.tolist() == [80.0]
    assert "no geoid separation" in read.warnings[0]


@pytest.mark.parametrize("host", [True, False])
def test_nmea_drive_over_midnight_keeps_its_dates(maker: Any, host: bool) -> None:
    """Ten seconds around midnight stay ten seconds, with host stamps and with RMC dates."""
    start_ns = epoch(2026, 6, 10, 23, 59, 55)
    fixes = read_nmea(maker.nmea(host=host, start_ns=start_ns).encode(), "a", "a.bin").fixes
    assert fixes.epoch_ns.tolist() == [start_ns + i * S // 5 for i in range(50)]


def test_nmea_sentence_from_before_midnight_that_arrives_after_it_keeps_its_day(maker: Any) -> None:
    """23:59:59.95 with a host stamp of 00:00:00.028 the next day is the evening before."""
    epoch_ns = epoch(2026, 6, 11) - 50_000_000
    assert read_nmea(maker.gga(epoch_ns).encode(), "a", "a.bin").fixes.epoch_ns.tolist() == [epoch_ns]


def test_nmea_host_clock_behind_utc_does_not_lose_a_day(maker: Any) -> None:
    """00:00:00 with a host stamp of 23:59:59 the day before is the new day."""
    epoch_ns = epoch(2026, 6, 11)
    fixes = read_nmea(maker.gga(epoch_ns, delay_ns=-S).encode(), "a", "a.bin").fixes
    assert fixes.epoch_ns.tolist() == [epoch_ns]


@given(st.integers(0, 10**7), st.integers(-11 * 3600, 11 * 3600))
def test_nmea_epoch_does_not_depend_on_the_host_clock(maker: Any, hundredths: int, delay_s: int) -> None:
    """Any host clock less than half a day off gives the same epoch."""
    epoch_ns = maker.start_ns + hundredths * 10_000_000
    fixes = read_nmea(maker.gga(epoch_ns, delay_ns=delay_s * S).encode(), "a", "a.bin").fixes
    assert fixes.epoch_ns.tolist() == [epoch_ns]


def test_nmea_time_keeps_every_digit(maker: Any) -> None:
    """.57 s, which is 569,999.99… µs in floating point, is 570 ms."""
    line = maker.gga(maker.start_ns, time="080000.57")
    assert read_nmea(line.encode(), "a", "a.bin").fixes.epoch_ns.tolist() == [maker.start_ns + 570_000_000]


def test_nmea_zda_gives_the_date_of_fixes_before_and_after_it(maker: Any) -> None:
    """One ZDA sentence anywhere dates the whole recording."""
    lines = [maker.gga(maker.start_ns + i * S, host=False) for i in range(3)]
    lines.insert(1, maker.sentence("GPZDA,080000.50,10,06,2026,00,00"))
    fixes = read_nmea("".join(lines).encode(), "a", "a.nmea").fixes
    assert fixes.epoch_ns.tolist() == [maker.start_ns + i * S for i in range(3)]
    assert fixes.host_ns.tolist() == fixes.epoch_ns.tolist()


def test_nmea_without_any_date_is_refused_with_the_cure(maker: Any) -> None:
    """GGA alone carries no date."""
    with pytest.raises(DriveError, match=r"a\.nmea.*no date.*RMC or ZDA"):
        read_nmea(maker.gga(maker.start_ns, host=False).encode(), "a", "a.nmea")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"quality": "0"}, "fix quality 0"),
        ({"quality": ""}, "fix quality is not a digit"),
        ({"quality": "99999999999999999999"}, "fix quality is not a digit"),
        ({"lat": ""}, "no position"),
        ({"lat": "nan"}, "position unreadable"),
        ({"lat": "6399.0"}, "position unreadable"),
        ({"ns": ""}, "position unreadable"),
        ({"lat": "9100.0"}, "position outside the globe"),
        ({"lon": "18100.0"}, "position outside the globe"),
        ({"lat": "0000.0", "lon": "00000.0"}, "position 0° N 0° E (null island)"),
        ({"altitude": ""}, "no altitude"),
        ({"altitude": "nan"}, "height absurd"),
        ({"altitude": "inf"}, "height absurd"),
        ({"altitude": "high"}, "height unreadable"),
        ({"time": ""}, "no UTC time"),
        ({"time": "256000.00"}, "no UTC time"),
    ],
)
def test_nmea_fix_that_cannot_be_used_is_counted(maker: Any, changes: dict[str, str], reason: str) -> None:
    """The fixes around it stay, and the count names the reason."""
    lines = [
        maker.gga(maker.start_ns),
        maker.gga(maker.start_ns + S, **changes),
        maker.gga(maker.start_ns + 2 * S),
    ]
    read = read_nmea("".join(lines).encode(), "a", "a.bin")
    assert len(read.fixes.epoch_ns) == 2
    assert counts(read.skipped) == {reason: 1}


def test_nmea_line_that_is_no_sound_sentence_is_counted(maker: Any) -> None:
    """Noise, a broken checksum, a missing one, a cut line and a bad host stamp each have their reason."""
    good = maker.gga(maker.start_ns)
    later = maker.gga(maker.start_ns + S)
    lines = [
        good,
        later.replace(",4,14,", ",5,14,"),
        later.split("*")[0] + "\n",
        later[20:],
        "# comment\n",
        later.split(" ")[0] + " soon\n",
        later.split(" ")[0] + " 12\n",
        maker.sentence("GPGGA,080001.00,6325.2,N"),
        maker.sentence("GPVTG,1.0,T,,M,2.0,N,3.7,K,D"),
    ]
    read = read_nmea("".join(lines).encode(), "a", "a.bin")
    assert len(read.fixes.epoch_ns) == 1
    assert counts(read.skipped) == {
        "checksum": 1,
        "no checksum": 1,
        "not an NMEA sentence": 2,
        "host stamp is not a number": 1,
        "host stamp outside the years 2000–2099": 1,
        "sentence too short": 1,
    }


def test_nmea_duplicate_and_backward_epochs_are_counted(maker: Any) -> None:
    """Each epoch once, in order; one fix from the future does not cost the rest."""
    seconds = [0, 1, 1, 500, 2, 3, 2, 4]
    lines = [maker.gga(maker.start_ns + s * S) for s in seconds]
    read = read_nmea("".join(lines).encode(), "a", "a.bin")
    assert ((read.fixes.epoch_ns - maker.start_ns) // S).tolist() == [0, 1, 2, 3, 4]
    assert counts(read.skipped) == {"epoch not after the fix before": 3}


def test_nmea_any_talker_is_read(maker: Any) -> None:
    """GNGGA is as good as GPGGA."""
    body = maker.gga(maker.start_ns).partition("*")[0][1:].replace("GPGGA", "GNGGA")
    line = maker.sentence(body, maker.start_ns // 1000)
    assert len(read_nmea(line.encode(), "a", "a.bin").fixes.epoch_ns) == 1


def test_nmea_host_clock_on_local_time_is_told(maker: Any) -> None:
    """Two hours between host and UTC is no link delay."""
    read = read_nmea(maker.gga(maker.start_ns, delay_ns=7200 * S).encode(), "a", "a.bin")
    assert "+7200.0 s" in read.warnings[0]
    assert "camera_offset_ms = -7200000" in read.warnings[0]


@pytest.mark.parametrize("content", [b"", b"\0\1\2" * 50, b"<html><body>404</body></html>"])
def test_nmea_file_without_a_fix_is_refused_by_name(content: bytes) -> None:
    """The error names the file and the cure."""
    with pytest.raises(DriveError, match=r"a\.bin holds no usable GNSS fix.*check"):
        read_nmea(content, "a", "a.bin")


def test_nmea_recording_without_gga_says_what_to_switch_on(maker: Any) -> None:
    """A recording of RMC sentences alone has no height."""
    line = maker.sentence("GPRMC,080000.00,A,6325.2,N,01024.0,E,1.0,0.0,100626,,,D")
    with pytest.raises(DriveError, match="switch GGA sentences on"):
        read_nmea(line.encode(), "a", "a.bin")


LINE = "$GPGGA,071840.90,6324.8972646,N,01023.9477304,E,4,14,1.1,65.70,M,0.0,M,0.9,0246"


@given(st.integers(0, len(LINE) - 1), st.integers(1, 255))
def test_nmea_checksum_finds_every_changed_byte(position: int, change: int) -> None:
    """One changed byte before the checksum never yields a GGA sentence with other content."""
    sound = (LINE + "*75").encode()
    damaged = bytearray(sound)
    damaged[position] ^= change
    for sentence in iter_sentences(bytes(damaged)):
        # Only a byte that ends the line or the body early can leave something that still sums up.
        assert sentence.kind != "GGA" or len(sentence.field) < 12


def test_nmea_gst_gives_the_sigmas_of_its_epoch(maker: Any) -> None:
    """3 cm north and 4 cm east are 3.5 cm an axis; a fix without GST of its time has none."""
    lines = [
        maker.gga(maker.start_ns),
        maker.sentence("GNGST,080000.00,1.0,0.04,0.03,0.0,0.03,0.04,0.05"),
        maker.gga(maker.start_ns + S),
        maker.sentence("GNGST,080001.00,1.0,,,,much,0.04,0.05"),
    ]
    read = read_nmea("".join(lines).encode(), "a", "a.bin")
    assert read.fixes.sigma_horizontal_m == pytest.approx([np.sqrt(0.00125), np.nan], nan_ok=True)
    assert read.fixes.sigma_vertical_m == pytest.approx([0.05, np.nan], nan_ok=True)
    assert counts(read.skipped) == {"GST sentence unreadable": 1}


def test_nmea_leap_second_is_the_next_midnight(maker: Any) -> None:
    """23:59:60 and the 0:00:00 after it are one epoch since 1970: the second of them is left out."""
    midnight = epoch(2017, 1, 1)
    lines = [
        maker.sentence("GPRMC,235959.00,A,6325.2,N,01024.0,E,1.0,0.0,311216,,,D"),
        *(maker.gga(midnight, host=False, time=time) for time in ("235959.00", "235960.00", "000000.00")),
        maker.gga(midnight, host=False, time="000001.00"),
    ]
    read = read_nmea("".join(lines).encode(), "a", "a.bin")
    assert read.fixes.epoch_ns.tolist() == [midnight - S, midnight, midnight + S]
    assert counts(read.skipped) == {"epoch not after the fix before": 1}


@pytest.mark.parametrize("host", [True, False])
def test_nmea_week_rollover_is_moved_on_and_told(maker: Any, host: bool) -> None:
    """A date 1024 weeks back; a host stamp overrules it without a word."""
    rmc = maker.sentence("GPRMC,080000.00,A,6325.2,N,01024.0,E,1.0,0.0,251006,,,D")
    read = read_nmea((rmc + maker.gga(maker.start_ns, host=host)).encode(), "a", "a.bin")
    assert read.fixes.epoch_ns.tolist() == [maker.start_ns]
    assert [("1024 weeks were added" in warning) for warning in read.warnings] == ([] if host else [True])
