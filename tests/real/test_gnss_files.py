"""GNSS recordings that others made: every file, its known content, against an independent reading."""

from __future__ import annotations

import json
from collections import Counter
from datetime import UTC, datetime
from typing import Any

import gpxpy
import numpy as np
import pynmea2
import pytest
from checkout import REAL

from twin.drives.track.fixes import fix_rate_hz
from twin.drives.track.formats.gpx import looks_like_gpx, read_gpx
from twin.drives.track.formats.nmea import NmeaStream, looks_like_nmea, read_nmea
from twin.drives.track.formats.sbp import read_sbp, read_sbp_poses
from twin.drives.track.formats.sbp_messages import looks_like_sbp
from twin.drives.track.formats.sbp_stream import SbpStream
from twin.errors import DriveError

GNSS = REAL / "gnss"
S = 1_000_000_000


def content(name: str) -> bytes:
    """Read one real file; skip the test where it is absent."""
    path = GNSS / name
    if not path.is_file():
        pytest.skip(f"the real file {name} is not beside the checkout")
    return path.read_bytes()


def counts(skipped: Any) -> dict[str, int]:
    """Reasons and counts."""
    return {s.reason: s.count for s in skipped}


def utc(*moment: int) -> int:
    """Nanoseconds since 1970."""
    return int(datetime(*moment, tzinfo=UTC).timestamp()) * S  # type: ignore[misc,arg-type]


def gga(name: str) -> list[Any]:
    """GGA sentences as pynmea2 reads them."""
    lines = content(name).decode("latin-1").splitlines()
    return [pynmea2.parse(line) for line in lines if line[3:6] == "GGA" and line.startswith("$")]


def test_roundtrip_sbp_is_a_minute_in_san_francisco_with_sbas() -> None:
    """466 positions at 10 Hz on 25 March 2020, fix mode 6, 0.513 m and 1.115 m by the receiver's own word."""
    read = read_sbp(content("roundtrip.sbp"), "a", "roundtrip.sbp")
    fixes = read.fixes
    assert Counter(fixes.quality.tolist()) == {2: 466}
    assert fix_rate_hz(fixes) == pytest.approx(10.0)
    assert fixes.epoch_ns[0] == utc(2020, 3, 25, 3, 24, 39) + 800_000_000
    assert fixes.epoch_ns[-1] == utc(2020, 3, 25, 3, 25, 26) + 300_000_000
    first = (fixes.latitude_deg[0], fixes.longitude_deg[0], fixes.height_m[0])
    assert first == (37.831235254413826, -122.28650677009367, -17.215181577283488)
    assert set(fixes.sigma_horizontal_m.tolist()) == {0.513}
    assert set(fixes.sigma_vertical_m.tolist()) == {1.115}
    assert read.skipped == ()
    assert read.warnings == ()


def test_roundtrip_sbp_has_a_velocity_at_every_position() -> None:
    """VEL_NED as Swift's own package reads it: the receiver stands, to 3 cm/s, and states 24 cm/s."""
    from sbp.msg import SBP
    from sbp.navigation import SBP_MSG_VEL_NED, MsgVelNED

    raw, frames = content("roundtrip.sbp"), []
    at = raw.find(b"\x55")
    while 0 <= at <= len(raw) - 8:
        end = at + 8 + raw[at + 5]
        frame = SBP.unpack(raw[at:end])
        frames += [MsgVelNED(frame)] if frame.msg_type == SBP_MSG_VEL_NED else []
        at = end
    fixes = read_sbp(raw, "a", "roundtrip.sbp").fixes
    np.testing.assert_allclose(fixes.velocity_mps, [[v.e / 1000, v.n / 1000, -v.d / 1000] for v in frames])
    np.testing.assert_allclose(
        fixes.velocity_sigma_mps, [[v.h_accuracy / 1000, v.v_accuracy / 1000] for v in frames]
    )
    assert np.abs(fixes.velocity_mps[:, :2]).max() < 0.03
    assert np.median(fixes.velocity_sigma_mps[:, 0]) == pytest.approx(0.241)
    assert np.isnan(fixes.heading_deg).all()


def test_roundtrip_sbp_epochs_are_the_receivers_own_utc() -> None:
    """Week, time of week and leap seconds give what the receiver wrote in UTC_TIME, to 2 ns."""
    from twin.drives.track.formats.sbp_messages import UTC_TIME, iter_messages

    raw = content("roundtrip.sbp")
    stated = [m.field for m in iter_messages(raw, Counter()) if m.kind == UTC_TIME]
    parts = ("year", "month", "day", "hours", "minutes", "seconds")
    utc_ns = np.array([utc(*(int(f[p]) for p in parts)) + int(f["ns"]) for f in stated])
    fixes = read_sbp(raw, "a", "roundtrip.sbp").fixes
    assert np.abs(fixes.epoch_ns - utc_ns).max() <= 2


def test_real_nmea_logs_have_the_speeds_of_their_rmc_sentences() -> None:
    """A receiver carried about at up to 1.7 m/s, and one that stands and writes no course."""
    carried = read_nmea(content("gpsd_nmea-rtk.log"), "a", "a.log").fixes
    speed = np.hypot(*carried.velocity_mps[:, :2].T)
    assert speed.max() == pytest.approx(3.252 * 1852 / 3600)
    assert set(carried.velocity_sigma_mps[speed > 0.0, 0].tolist()) == {0.15}
    stands = read_nmea(content("gpsd_ublox-zed-f9p-nmea.log"), "a", "a.log").fixes
    assert not stands.velocity_mps[:, :2].any()
    assert stands.velocity_sigma_mps[:, 0].max() < 0.17


@pytest.mark.parametrize("name", ["short.sbp", "short.sbp.json"])
def test_short_sbp_has_one_fix_in_finland_before_which_the_receiver_searched(name: str) -> None:
    """188 positions, 187 of them fix mode 0; one single-point fix on 28 January 2019."""
    read = read_sbp(content(name), "a", name)
    fixes = read.fixes
    assert fixes.epoch_ns.tolist() == [utc(2019, 1, 28, 19, 5, 31) + 500_000_000]
    first = (fixes.latitude_deg[0], fixes.longitude_deg[0], fixes.height_m[0])
    assert first == (61.44696172596402, 23.8584758593452, 179.43915805976755)
    assert fixes.quality.tolist() == [1]
    assert fixes.sigma_horizontal_m.tolist() == [3.588]
    assert counts(read.skipped)["fix mode 0 or unknown"] == 187


def test_short_sbp_and_its_json_twin_hold_the_same_messages() -> None:
    """Swift's own converter wrote the JSON: every field of every message that is read agrees."""
    from twin.drives.track.formats.sbp_messages import LAYOUTS, iter_messages

    ours = list(iter_messages(content("short.sbp"), Counter()))
    lines = [json.loads(line) for line in content("short.sbp.json").splitlines() if line.strip()]
    theirs = [line for line in lines if line["msg_type"] in LAYOUTS]
    # 188 each of GPS_TIME, UTC_TIME, POS_LLH and VEL_NED.
    assert len(ours) == len(theirs) == 752
    for message, line in zip(ours, theirs, strict=True):
        assert (message.kind, message.sender) == (line["msg_type"], line["sender"])
        assert dict(message.field) == {name: line[name] for name in message.field}


@pytest.mark.parametrize("name", ["roundtrip.sbp", "short.sbp"])
def test_sbp_without_attitude_makes_no_poses(name: str) -> None:
    """Both receivers had no INS."""
    with pytest.raises(DriveError, match="holds no usable attitude"):
        read_sbp_poses(content(name), name)


def test_receivers_that_are_read_while_they_send_give_the_fixes_of_the_file() -> None:
    """Two NMEA logs line by line, two SBP logs in pieces; the first NMEA fix stands before any date."""
    for name in ("gpsd_ublox-zed-f9p-nmea.log", "gpsd_nmea-rtk.log"):
        lines, fixes = NmeaStream(), read_nmea(content(name), "a", name).fixes
        found = [fix for line in content(name).splitlines() for fix in lines.feed(line, utc(2020, 1, 1))]
        found += lines.pause()
        assert [fix.epoch_ns for fix in found[1:]] == fixes.epoch_ns.tolist()[1:]
        columns = np.array([(*fix[2:5], fix.sigma_horizontal_m, *fix.velocity_mps[:2]) for fix in found])
        places = (fixes.latitude_deg, fixes.longitude_deg, fixes.height_m, fixes.sigma_horizontal_m)
        np.testing.assert_array_equal(columns, np.column_stack([*places, fixes.velocity_mps[:, :2]]))
    for name in ("roundtrip.sbp", "short.sbp"):
        raw, messages, fixes = content(name), SbpStream(), read_sbp(content(name), "a", name).fixes
        found = [fix for at in range(0, len(raw), 37) for fix in messages.feed(raw[at : at + 37])]
        found += messages.pause()
        assert [fix[:1] + fix[2:5] for fix in found] == list(
            zip(
                *(
                    column.tolist()
                    for column in (fixes.epoch_ns, fixes.latitude_deg, fixes.longitude_deg, fixes.height_m)
                ),
                strict=True,
            )
        )


def test_gpx_track_is_93_seconds_in_san_francisco() -> None:
    """49 points of 14 March 2025, all of them as gpxpy reads them."""
    raw = content("sf_30km_h.gpx")
    read = read_gpx(raw, "a", "sf_30km_h.gpx")
    points = gpxpy.parse(raw.decode()).tracks[0].segments[0].points
    assert len(read.fixes.epoch_ns) == len(points) == 49
    assert read.fixes.latitude_deg.tolist() == [p.latitude for p in points]
    assert read.fixes.longitude_deg.tolist() == [p.longitude for p in points]
    assert read.fixes.height_m.tolist() == [p.elevation for p in points]  # outside Norway's geoid model
    assert read.fixes.epoch_ns.tolist() == [round(p.time.timestamp() * 1000) * 1_000_000 for p in points]
    assert read.fixes.epoch_ns[0] == utc(2025, 3, 14, 7)
    assert read.fixes.epoch_ns[-1] == utc(2025, 3, 14, 7, 1, 33) + 624_000_000
    assert "above sea level" in read.warnings[0]


@pytest.mark.parametrize(
    ("name", "qualities"), [("gpsd_nmea-rtk.log", {2: 104, 4: 18}), ("gpsd_ublox-zed-f9p-nmea.log", {1: 29})]
)
def test_nmea_logs_agree_with_pynmea2(name: str, qualities: dict[int, int]) -> None:
    """Positions, qualities and ellipsoidal heights of every GGA sentence with a fix."""
    fixes = read_nmea(content(name), "a", name).fixes
    oracle = [m for m in gga(name) if m.gps_qual]
    assert Counter(fixes.quality.tolist()) == qualities
    assert fixes.latitude_deg == pytest.approx([m.latitude for m in oracle], abs=1e-12)
    assert fixes.longitude_deg == pytest.approx([m.longitude for m in oracle], abs=1e-12)
    assert fixes.height_m == pytest.approx([float(m.altitude) + float(m.geo_sep) for m in oracle])


def test_zed_f9p_log_states_its_sigmas() -> None:
    """GST of the first fix: 2.3 m north, 3.5 m east, 4.0 m up, as the log has it."""
    raw = content("gpsd_ublox-zed-f9p-nmea.log")
    line = next(line for line in raw.decode().splitlines() if line[3:6] == "GST")
    stated = pynmea2.parse(line)
    fixes = read_nmea(raw, "a", "zed.log").fixes
    axis = np.hypot(stated.std_dev_latitude, stated.std_dev_longitude) / np.sqrt(2)
    assert fixes.sigma_horizontal_m[0] == pytest.approx(axis)
    assert fixes.sigma_vertical_m[0] == stated.std_dev_altitude
    assert np.isfinite(fixes.sigma_horizontal_m).all()


def test_pynmea2_log_without_a_date_is_refused() -> None:
    """Its one GGA sentence has neither host stamp nor RMC beside it."""
    with pytest.raises(DriveError, match="no date"):
        read_nmea(content("pynmea2_data.log"), "a", "data.log")


def test_every_gnss_file_is_known_by_its_content() -> None:
    """Exactly one reader takes each."""
    formats = {"sbp": looks_like_sbp, "gpx": looks_like_gpx, "nmea": looks_like_nmea}
    expected = {
        "roundtrip.sbp": "sbp",
        "short.sbp": "sbp",
        "short.sbp.json": "sbp",
        "sf_30km_h.gpx": "gpx",
        "gpsd_nmea-rtk.log": "nmea",
        "gpsd_ublox-zed-f9p-nmea.log": "nmea",
        "pynmea2_data.log": "nmea",
    }
    for name, known in expected.items():
        head = content(name)[:65_536]
        assert [kind for kind, looks_like in formats.items() if looks_like(head)] == [known], name
    assert sorted(path.name for path in GNSS.iterdir()) == sorted(expected)
