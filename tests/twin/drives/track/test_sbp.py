"""SwiftNav SBP recordings, binary and JSON."""

from __future__ import annotations

import json
from collections import Counter
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from left_out import counts
from sbp.msg import SBP
from sbp.navigation import MsgGPSTime, MsgPosLLHCov, MsgPosLLHGnss
from sbp.orientation import MsgOrientEuler, MsgOrientQuat
from sbp.table import dispatch
from track_writers import S, sbp_clock, sbp_position, sbp_time

from geoloc.earth.geodesy import rotation_enu_from_rig
from twin.drives.track.formats.sbp import read_sbp, read_sbp_poses
from twin.drives.track.formats.sbp_messages import LAYOUTS, iter_messages, looks_like_sbp
from twin.errors import DriveError

PLACE = (63.42, 10.4, 80.0)
START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * S


def epoch(*moment: int) -> int:
    """Nanoseconds since 1970 of a UTC date and time."""
    return int(datetime(*moment, tzinfo=UTC).timestamp()) * S  # type: ignore[misc,arg-type]


def recording(n: int = 5, start_ns: int = START_NS, step_ns: int = S // 5, **options: Any) -> bytes:
    """Positions at 5 Hz, each after its time messages."""
    times = [start_ns + i * step_ns for i in range(n)]
    return b"".join(sbp_clock(t) + sbp_position(t, *PLACE, **options) for t in times)


def as_json(*frames: Any, wrapped: bool = False) -> bytes:
    """Messages as ``sbp2json`` writes them, or as Swift's console wraps them."""
    lines = [message.to_json_dict() for message in frames]
    return "\n".join(json.dumps({"time": "", "data": x} if wrapped else x) for x in lines).encode()


def test_sbp_position_keeps_every_digit_of_epoch_and_place() -> None:
    """UTC is GPS week and time of week less 18 s; degrees are doubles; height is ellipsoidal."""
    fixes = read_sbp(recording(accuracy_mm=(12, 25)), "left", "a.sbp").fixes
    assert fixes.epoch_ns.tolist() == [START_NS + i * S // 5 for i in range(5)]
    assert fixes.host_ns.tolist() == fixes.epoch_ns.tolist()
    assert (fixes.latitude_deg[0], fixes.longitude_deg[0], fixes.height_m[0]) == PLACE
    assert fixes.sigma_horizontal_m.tolist() == [0.012] * 5
    assert fixes.sigma_vertical_m.tolist() == [0.025] * 5


@pytest.mark.parametrize(("mode", "quality"), [(1, 1), (2, 2), (3, 5), (4, 4), (5, 6), (6, 2)])
def test_sbp_fix_mode_becomes_a_gga_quality(mode: int, quality: int) -> None:
    """As Swift's own converter to NMEA does it."""
    assert set(read_sbp(recording(mode=mode), "a", "a.sbp").fixes.quality.tolist()) == {quality}


def test_sbp_fix_mode_0_is_left_out() -> None:
    """A receiver without a fix writes positions all the same."""
    content = sbp_position(START_NS - S, 0.0, 0.0, 0.0, mode=0) + recording()
    read = read_sbp(content, "a", "a.sbp")
    assert len(read.fixes.epoch_ns) == 5
    assert counts(read.skipped) == {"fix mode 0 or unknown": 1}


def test_sbp_sub_millisecond_residual_is_added() -> None:
    """GPS_TIME says what the whole milliseconds of the positions leave out."""
    exact_ns = START_NS + 123_456
    read = read_sbp(sbp_clock(exact_ns) + sbp_position(exact_ns, *PLACE), "a", "a.sbp")
    assert read.fixes.epoch_ns.tolist() == [exact_ns]


def test_sbp_drive_over_the_end_of_the_week_goes_on() -> None:
    """Saturday 23:59:42 UTC is where GPS weeks begin; a position may come before its GPS_TIME."""
    start_ns = epoch(2026, 6, 13, 23, 59, 41)
    times = [start_ns + i * S // 5 for i in range(10)]
    content = b"".join(sbp_position(t, *PLACE) for t in times[:8]) + sbp_clock(times[8])
    content += b"".join(sbp_position(t, *PLACE) for t in times[8:])
    assert read_sbp(content, "a", "a.sbp").fixes.epoch_ns.tolist() == times


def test_sbp_leap_seconds_are_those_of_the_time() -> None:
    """In 2014 GPS time was 16 s ahead; where UTC_TIME says so or not."""
    start_ns = epoch(2014, 6, 10, 8)
    # The writer's 18 s are not those of 2014: the same week and time of week are 2 s later in UTC.
    content = sbp_clock(start_ns, utc=False) + sbp_position(start_ns, *PLACE)
    assert read_sbp(content, "a", "a.sbp").fixes.epoch_ns.tolist() == [start_ns + 2 * S]


def test_sbp_utc_time_settles_the_offset() -> None:
    """What the receiver decoded itself holds against the table."""
    start_ns = epoch(2014, 6, 10, 8)
    content = sbp_clock(start_ns) + sbp_position(start_ns, *PLACE)
    assert read_sbp(content, "a", "a.sbp").fixes.epoch_ns.tolist() == [start_ns]


def test_sbp_week_that_has_run_over_is_moved_on_and_told() -> None:
    """A receiver with ten-bit weeks writes week 360 in 2026."""
    week, tow, _ = sbp_time(START_NS)
    clock = MsgGPSTime(wn=week % 1024, tow=tow, ns_residual=0, flags=1).to_binary()
    read = read_sbp(clock + sbp_position(START_NS, *PLACE), "a", "a.sbp")
    assert read.fixes.epoch_ns.tolist() == [START_NS]
    assert "1024 weeks were added" in read.warnings[0]


def test_sbp_without_a_date_is_refused_with_the_cure() -> None:
    """Positions alone say the time of the week only."""
    with pytest.raises(DriveError, match=r"a\.sbp.*no date.*switch the message GPS_TIME on"):
        read_sbp(sbp_position(START_NS, *PLACE), "a", "a.sbp")


def test_sbp_damage_costs_the_frames_that_it_hits() -> None:
    """A recording that begins in the middle of a frame, with a flipped byte and NMEA between its frames."""
    whole = recording(20)
    at = len(whole) // 2
    damaged = whole[7:at] + b"$GPGGA,,,*56\r\n" + bytes([whole[at] ^ 1]) + whole[at + 1 :]
    read = read_sbp(damaged, "a", "a.sbp")
    assert len(read.fixes.epoch_ns) >= 18
    assert "stretch of bytes that is no SBP frame" in counts(read.skipped)


def test_sbp_covariance_is_preferred_and_gives_the_sigmas() -> None:
    """POS_LLH_COV beside POS_LLH: 3 cm north and 4 cm east are 3.5 cm an axis."""
    message = MsgPosLLHCov(
        tow=sbp_time(START_NS)[1], lat=PLACE[0], lon=PLACE[1], height=81.0, n_sats=9, flags=4,
        cov_n_n=0.0009, cov_n_e=0.0, cov_n_d=0.0, cov_e_e=0.0016, cov_e_d=0.0, cov_d_d=0.0025,
    )  # fmt: skip
    fixes = read_sbp(recording(1) + message.to_binary(), "a", "a.sbp").fixes
    assert fixes.height_m.tolist() == [81.0]
    assert fixes.sigma_horizontal_m == pytest.approx([np.sqrt(0.00125)])
    assert fixes.sigma_vertical_m == pytest.approx([0.05])


def test_sbp_antenna_positions_are_those_before_the_ins() -> None:
    """An antenna's recording takes POS_LLH_GNSS, a pose recording POS_LLH."""
    tow = sbp_time(START_NS)[1]
    pure = MsgPosLLHGnss(
        tow=tow, lat=63.5, lon=10.4, height=80.0, h_accuracy=0, v_accuracy=0, n_sats=9, flags=4
    )
    content = recording(1, mode=4 | 1 << 3) + pure.to_binary()
    assert read_sbp(content, "a", "a.sbp").fixes.latitude_deg.tolist() == [63.5]
    content += orient(tow, 0, 0, 0)
    assert read_sbp_poses(content, "a.sbp").track.latitude_deg.tolist() == [63.42]


def test_sbp_positions_of_an_ins_are_told() -> None:
    """Their point is the one that was set up in the receiver, not the antenna."""
    assert "receiver's INS" in read_sbp(recording(mode=4 | 1 << 3), "a", "a.sbp").warnings[0]


def test_sbp_base_is_no_rover() -> None:
    """Positions of another sender are not mixed in."""
    base = _from_sender(sbp_position(START_NS + S // 10, 60.0, 10.0, 0.0), 7)
    read = read_sbp(recording() + base, "a", "a.sbp")
    assert set(read.fixes.latitude_deg.tolist()) == {63.42}
    assert counts(read.skipped) == {"position of another sender": 1}


@pytest.mark.parametrize("wrapped", [False, True])
def test_sbp_json_is_the_same_recording(wrapped: bool) -> None:
    """Line by line, as sbp2json or Swift's console writes it; a line that is none is counted."""
    binary = recording()
    frames, at = [], 0
    while at < len(binary):
        end = at + 8 + binary[at + 5]
        frames.append(dispatch(SBP.unpack(binary[at:end])))
        at = end
    text = as_json(*frames, wrapped=wrapped) + b"\n\nnot a message\n"
    assert looks_like_sbp(text)
    read, plain = read_sbp(text, "a", "a.json"), read_sbp(binary, "a", "a.sbp")
    assert read.fixes.epoch_ns.tolist() == plain.fixes.epoch_ns.tolist()
    assert read.fixes.latitude_deg.tolist() == plain.fixes.latitude_deg.tolist()
    assert counts(read.skipped) == {"line that is no SBP message": 1}


@pytest.mark.parametrize("kind", sorted(LAYOUTS))
def test_sbp_layout_is_swifts(kind: int) -> None:
    """Every field of a message of random bytes is what Swift's own package reads."""
    rng = np.random.default_rng(kind)
    payload = rng.integers(0, 64, LAYOUTS[kind].packed.size, dtype=np.uint8).tobytes()
    swift = dispatch(SBP(kind, 1, len(payload), payload, 0))
    frame = swift.to_binary()
    (message,) = iter_messages(frame, Counter())
    assert frame[6:-2] == payload
    assert dict(message.field) == {name: getattr(swift, name) for name in message.field}
    assert len(message.field) == len(type(swift).__slots__)


def orient(tow: int, roll: float, nose_up: float, yaw: float) -> bytes:
    """ORIENT_QUAT of Swift's angles in degrees: forward, right, down against north, east, down."""
    half = np.radians([roll, nose_up, yaw]) / 2
    (sr, sp, sy), (cr, cp, cy) = np.sin(half), np.cos(half)
    q = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    w, x, y, z = (round(float(part) * (2**31 - 1)) for part in q)
    accuracy = dict.fromkeys(("w_accuracy", "x_accuracy", "y_accuracy", "z_accuracy"), 0.001)
    return bytes(MsgOrientQuat(tow=tow, w=w, x=x, y=y, z=z, flags=1, **accuracy).to_binary())


def test_sbp_attitude_turns_the_car_as_swift_means_it() -> None:
    """Heading 100°, nose 3° up, right side 2° down: the bonnet points east, a little south, and up."""
    tow = sbp_time(START_NS)[1]
    track = read_sbp_poses(recording(1) + orient(tow, 2.0, 3.0, 100.0), "a.sbp").track
    assert track.heading_deg == pytest.approx([100.0])
    assert track.pitch_deg == pytest.approx([-3.0])
    assert track.roll_deg == pytest.approx([2.0])
    assert track.sigma_heading_deg == pytest.approx([np.degrees(0.002)])
    turn = rotation_enu_from_rig(track.heading_deg, track.pitch_deg, track.roll_deg)[0]
    forward, left = turn[:, 0], turn[:, 1]
    assert forward == pytest.approx([0.9835, -0.1734, 0.0523], abs=1e-4)
    assert left[2] > 0.03  # right side down is left side up


def test_sbp_euler_angles_say_the_same() -> None:
    """Millionths of a degree, in the same axes."""
    tow = sbp_time(START_NS)[1]
    euler = MsgOrientEuler(
        tow=tow, roll=2_000_000, pitch=3_000_000, yaw=100_000_000, flags=1,
        roll_accuracy=0.1, pitch_accuracy=0.2, yaw_accuracy=0.3,
    ).to_binary()  # fmt: skip
    track = read_sbp_poses(recording(1) + euler, "a.sbp").track
    assert [track.roll_deg[0], track.pitch_deg[0], track.heading_deg[0]] == pytest.approx([2, -3, 100])
    assert [track.sigma_roll_pitch_deg[0], track.sigma_heading_deg[0]] == pytest.approx([0.2, 0.3])


def test_sbp_attitude_between_two_is_on_the_shorter_way() -> None:
    """From 359° to 3° by way of 1°; a position without an attitude near is counted."""
    times = [START_NS, START_NS + S // 5, START_NS + 5 * S]
    tows = [sbp_time(t)[1] for t in times]
    content = b"".join(sbp_clock(t) + sbp_position(t, *PLACE) for t in times)
    content += (
        orient(tows[0] - 100, 0, 0, 359.0) + orient(tows[0] + 100, 0, 0, 3.0) + orient(tows[1], 0, 0, 5.0)
    )
    read = read_sbp_poses(content, "a.sbp")
    assert read.track.heading_deg == pytest.approx([1.0, 5.0], abs=1e-6)
    assert counts(read.skipped) == {"position without an attitude within 0.25 s": 1}


def test_sbp_poses_without_attitude_are_refused() -> None:
    """The error says what to switch on."""
    with pytest.raises(DriveError, match=r"a\.sbp holds no usable attitude.*ORIENT_QUAT"):
        read_sbp_poses(recording(), "a.sbp")


def test_sbp_is_known_by_its_content(maker: Any) -> None:
    """Two sound frames, or messages as JSON; NMEA, rig files and noise are none."""
    assert looks_like_sbp(b"noise" + recording())
    for other in (b"", b"\x55" * 400, (b"\x55" + bytes(7)) * 40, maker.nmea().encode(), b'{"rig": {}}'):
        assert not looks_like_sbp(other)


def _from_sender(frame: bytes, sender: int) -> bytes:
    """The same frame of another sender."""
    import binascii

    body = frame[1:3] + sender.to_bytes(2, "little") + frame[5:-2]
    return frame[:1] + body + binascii.crc_hqx(body, 0).to_bytes(2, "little")
