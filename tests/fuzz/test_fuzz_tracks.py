"""Damaged and forged GNSS recordings and pose files: a result with counts, or one sentence."""

from __future__ import annotations

import binascii
import struct
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from functools import reduce
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from mutate import Draw, either, fuzzed, listed, mutated, real_files
from track_writers import (
    Ros,
    S,
    gps_tags,
    gpx_document,
    gpx_point,
    jpeg,
    sbp_clock,
    sbp_heading,
    sbp_position,
    sbp_velocity,
)

from geoloc.trajectory.fix_checks import MAX_SPEED_MPS
from twin.drives.track.fixes import FixesRead
from twin.drives.track.formats.exif import has_exif_position, read_exif_positions
from twin.drives.track.formats.gpx import looks_like_gpx, read_gpx
from twin.drives.track.formats.nmea import looks_like_nmea, read_nmea
from twin.drives.track.formats.poses_csv import looks_like_poses, read_poses
from twin.drives.track.formats.rosbag import looks_like_rosbag, read_rosbag, read_rosbag_poses
from twin.drives.track.formats.sbp import read_sbp, read_sbp_poses
from twin.drives.track.formats.sbp_messages import LAYOUTS, looks_like_sbp
from twin.errors import DriveError

START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * S
PLACE = (63.42, 10.4, 80.0)


def checked(read: Callable[[], Any]) -> None:
    """Whatever comes out is finite and in order of time."""
    try:
        result = read()
    except DriveError:
        return
    track = result.fixes if isinstance(result, FixesRead) else result.track
    assert np.all(np.diff(track.epoch_ns) > 0)
    assert len(track.epoch_ns)
    assert np.isfinite([track.latitude_deg, track.longitude_deg, track.height_m]).all()
    assert all(skipped.count > 0 for skipped in result.skipped)
    if not isinstance(result, FixesRead):
        assert np.isfinite([track.roll_deg, track.pitch_deg, track.heading_deg]).all()
        stated = track.sigma_heading_deg[~np.isnan(track.sigma_heading_deg)]
        assert ((stated > 0.0) & np.isfinite(stated)).all()
    else:
        assert np.all(track.quality > 0)
        headings, velocities = track.heading_deg, track.velocity_mps
        assert not np.any((headings < 0.0) | (headings >= 360.0) | np.isinf(headings))
        assert np.isnan(velocities[np.abs(velocities) > MAX_SPEED_MPS + 1e-9]).all()
        assert np.isfinite(headings[np.isfinite(track.heading_sigma_deg)]).all()
        sigmas = np.concatenate([track.heading_sigma_deg, *track.velocity_sigma_mps.T])
        assert not np.any((sigmas <= 0.0) | np.isinf(sigmas))


def nmea_sentence(body: str) -> bytes:
    """Put dollar and checksum around a sentence."""
    return f"${body}*{reduce(lambda total, char: total ^ ord(char), body, 0):02X}\n".encode()


NMEA = b"".join(
    nmea_sentence(body)
    for body in (
        "GNRMC,080000.00,A,6325.2,N,01024.0,E,1.0,0.0,100626,,,D",
        "GNGGA,080000.00,6325.2,N,01024.0,E,4,14,1.1,80.0,M,39.4,M,0.9,0246",
        "GNGST,080000.00,1.0,0.01,0.01,0.0,0.012,0.011,0.025",
        "GNZDA,080000.00,10,06,2026,00,00",
        "GNHDT,12.5,T",
        "GNTHS,12.5,A",
        "GNVTG,0.0,T,,M,1.0,N,1.9,K,A",
        "GNGGA,080000.20,6325.2,N,01024.0,E,5,14,1.1,80.0,M,39.4,M,0.9,0246",
    )
)
SBP = b"".join(
    sbp_clock(t) + sbp_position(t, *PLACE) + sbp_velocity(t, 1.0, 2.0, 0.1) + sbp_heading(t, 26.6)
    for t in (START_NS + i * S for i in range(3))
)
SBP_JSON = (
    b'{"msg_type":258,"sender":1,"wn":2422,"tow":288018000,"ns_residual":0,"flags":1}\n'
    b'{"msg_type":522,"sender":1,"tow":288018000,"lat":63.42,"lon":10.4,"height":80.0,"h_accuracy":10,'
    b'"v_accuracy":20,"n_sats":9,"flags":4}\n'
    b'{"msg_type":544,"sender":1,"tow":288018000,"w":2147483647,"x":0,"y":0,"z":0,"w_accuracy":0.1,'
    b'"x_accuracy":0.1,"y_accuracy":0.1,"z_accuracy":0.1,"flags":1}\n'
    b'{"msg_type":526,"sender":1,"tow":288018000,"n":900,"e":-20,"d":1,"h_accuracy":40,"v_accuracy":80,'
    b'"n_sats":9,"flags":1}\n'
    b'{"msg_type":527,"sender":1,"tow":288018000,"heading":358700,"n_sats":9,"flags":4}\n'
)
GPX = gpx_document(gpx_point(START_NS + i * S, *PLACE) for i in range(3))
POSES = (
    b"time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg,sigma_heading_deg\n"
    + b"".join(f"{START_NS + i * S},63.42,10.4,80,0,1.5,{i},0.1\n".encode() for i in range(3))
)
JPEG = jpeg(
    gps_tags(*PLACE, (8.0, 0.0, 1.5), "2026:06:10") | {31: 0.5},
    {0x9003: "2026:06:10 08:00:00", 0x9011: "+02:00", 0x9291: "5"},
)


def bags() -> list[tuple[str, bytes]]:
    """One small recording a container, with its suffix."""
    made = []
    with tempfile.TemporaryDirectory() as folder:
        for version, compression in ((1, ""), (1, "bz2"), (1, "lz4"), (2, ""), (2, "zstd"), (2, "db3")):
            ros = Ros(version)
            messages = [("/fix", START_NS + i * S, ros.fix(START_NS + i * S, *PLACE)) for i in range(3)]
            messages += [("/imu", t, ros.imu(t, (0.0, 0.0, 0.0, 1.0))) for _, t, _ in messages]
            path = Path(folder) / f"{version}{compression}.bag"
            ros.write(path, messages, compression)
            files = [path] if path.is_file() else [p for p in path.iterdir() if p.suffix != ".yaml"]
            made += [(file.suffix, file.read_bytes()) for file in files]
    return made


BAGS = bags() + [(kind, content) for kind in (".bag", ".mcap") for content in real_files("recordings", kind)]


@fuzzed(mutated([NMEA, *real_files("gnss", ".log")]))
def test_fuzz_nmea_gives_fixes_or_a_drive_error(content: bytes) -> None:
    """Damaged sentences, real logs among them."""
    looks_like_nmea(content)
    checked(lambda: read_nmea(content, "a", "a.nmea"))


def sentence(random: Random) -> bytes:
    """Any fields behind a known type, and a sound checksum."""
    kind = random.choice(["GPGGA", "GNRMC", "GPZDA", "GNGST", "GPHDT", "GNTHS", "GPVTG", "PASHR"])
    fields = ("".join(random.choices("0123456789.,-NSEWMAVnaife", k=random.randrange(13))) for _ in range(15))
    host = random.choice([b"", b" 1684739920978036", b" 0", b" x", b" " + b"9" * 23])
    return nmea_sentence(",".join([kind, *fields][: random.randrange(1, 17)])).strip() + host


def head_of(random: Random) -> bytes:
    """The beginning of a damaged recording."""
    return bytes(mutated([NMEA])(random)[:300])


@fuzzed(listed(either(sentence, head_of), 8), parsers=3)
def test_fuzz_nmea_with_sound_checksums_gives_fixes_or_a_drive_error(lines: list[bytes]) -> None:
    """What a checksum does not catch."""
    checked(lambda: read_nmea(b"\n".join(lines), "a", "a.nmea"))


@fuzzed(mutated([SBP, SBP_JSON, *real_files("gnss", ".sbp", ".json")]), parsers=2)
def test_fuzz_sbp_gives_fixes_or_a_drive_error(content: bytes) -> None:
    """Damaged frames and lines of JSON, real recordings among them."""
    looks_like_sbp(content)
    checked(lambda: read_sbp(content, "a", "a.sbp"))
    checked(lambda: read_sbp_poses(content, "a.sbp"))


def framed(kind: int, sender: int, payload: bytes) -> bytes:
    """An SBP frame with a sound checksum."""
    body = struct.pack("<HHB", kind, sender, len(payload)) + payload
    return b"\x55" + body + struct.pack("<H", binascii.crc_hqx(body, 0))


def frame(random: Random) -> bytes:
    """Any payload in a frame of a type that is read."""
    payload = random.randbytes(random.randrange(61))
    return framed(random.choice(sorted(LAYOUTS)), random.randrange(3), payload)


@fuzzed(listed(either(frame, lambda _random: SBP), 8))
def test_fuzz_sbp_with_sound_checksums_gives_fixes_or_a_drive_error(parts: list[bytes]) -> None:
    """Any payload, also one that is too short."""
    content = b"".join(parts)
    checked(lambda: read_sbp(content, "a", "a.sbp"))
    checked(lambda: read_sbp_poses(content, "a.sbp"))


@fuzzed(mutated([GPX, *real_files("gnss", ".gpx")]))
def test_fuzz_gpx_gives_fixes_or_a_drive_error(content: bytes) -> None:
    """Damaged tracks."""
    looks_like_gpx(content)
    checked(lambda: read_gpx(content, "a", "a.gpx"))


@fuzzed(mutated([POSES]), parsers=2)
def test_fuzz_poses_give_a_track_or_a_drive_error(content: bytes) -> None:
    """Damaged pose files."""
    looks_like_poses(content)
    checked(lambda: read_poses(content, "poses.csv"))


@fuzzed(listed(mutated([JPEG]), 3))
def test_fuzz_exif_gives_fixes_or_a_drive_error(pictures: list[bytes]) -> None:
    """Damaged pictures beside a sound one."""
    for picture in pictures:
        has_exif_position(picture)
    checked(lambda: read_exif_positions([JPEG, *pictures], "a", "pictures"))


def damaged(bag: tuple[str, bytes]) -> Draw:
    """Suffix and damaged content of a recording."""
    suffix, content = bag
    draw = mutated([content])
    return lambda random: (suffix, draw(random))


@fuzzed(either(*map(damaged, BAGS)), parsers=3)
def test_fuzz_rosbag_gives_fixes_or_a_drive_error(bag: tuple[str, bytes]) -> None:
    """Damaged recordings of every container."""
    suffix, content = bag
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{suffix}"
        path.write_bytes(content)
        looks_like_rosbag(content)
        checked(lambda: read_rosbag([path], "a", path.name))
        checked(lambda: read_rosbag_poses([path], path.name, {}))
