"""Positions in the EXIF of pictures."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest
from left_out import counts
from PIL.TiffImagePlugin import IFDRational
from track_writers import S, gps_tags, jpeg

from twin.drives.track.formats.exif import has_exif_position, looks_like_jpeg, read_exif_positions
from twin.errors import DriveError

START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * S
PLACE = (63.42, 10.4, 120.0)


def tags(second: float = 0.0, **changes: Any) -> dict[int, Any]:
    """GPS tags of a picture taken some seconds after eight."""
    return gps_tags(*PLACE, (8.0, 0.0, second), "2026:06:10") | changes.pop("tags", {})


def read(*pictures: bytes) -> Any:
    """Read pictures in this order."""
    return read_exif_positions(pictures, "camera", "pictures")


def test_exif_position_and_utc_are_those_of_the_tags() -> None:
    """Degrees, minutes and seconds as rationals; the GPS stamp is UTC; the order of names does not matter."""
    fixes = read(jpeg(tags(2.5)), jpeg(tags(1.0)), jpeg(tags(0.0))).fixes
    assert (fixes.epoch_ns - START_NS).tolist() == [0, S, 2_500_000_000]
    # Rationals of a thousandth of an arc second and better: 3 cm.
    assert fixes.latitude_deg == pytest.approx([63.42] * 3, abs=3e-7)
    assert fixes.longitude_deg == pytest.approx([10.4] * 3, abs=3e-7)
    assert set(fixes.quality.tolist()) == {1}


def test_exif_south_west_and_below_the_sea_are_negative() -> None:
    """The references carry the signs."""
    there = gps_tags(-33.5, -70.25, -12.0, (8.0, 0.0, 0.0), "2026:06:10")
    fixes = read(jpeg(there)).fixes
    assert (fixes.latitude_deg[0], fixes.longitude_deg[0]) == pytest.approx((-33.5, -70.25))
    assert fixes.height_m[0] == pytest.approx(-12.0, abs=60)  # the geoid may be known here


def test_exif_ellipsoidal_height_stays() -> None:
    """Exif 3.0 has a reference for it; no geoid is added, and nothing is said of one."""
    found = read(jpeg(tags(tags={5: b"\2"})))
    assert found.fixes.height_m.tolist() == [120.0]
    assert found.warnings == ()


def test_exif_stated_error_and_differential_fix_are_kept() -> None:
    """GPSHPositioningError and GPSDifferential."""
    fixes = read(jpeg(tags(tags={31: 0.75, 30: 1}))).fixes
    assert fixes.sigma_horizontal_m == pytest.approx([0.75])
    assert fixes.quality.tolist() == [2]


@pytest.mark.parametrize(("zone", "hours"), [("+02:00", 10), ("Z", 8)])
def test_exif_time_of_the_camera_with_its_zone_stands_in(zone: str, hours: int) -> None:
    """Without a GPS stamp: DateTimeOriginal, its zone and its fraction."""
    gps = {key: value for key, value in tags().items() if key not in (7, 29)}
    exif = {0x9003: f"2026:06:10 {hours:02d}:00:00", 0x9011: zone, 0x9291: "25"}
    assert read(jpeg(gps, exif)).fixes.epoch_ns.tolist() == [START_NS + S // 4]


@pytest.mark.parametrize(
    ("picture", "reason"),
    [
        (jpeg(), "no EXIF"),
        (jpeg(exif={0x9003: "2026:06:10 08:00:00"}), "no EXIF position"),
        (jpeg(tags(tags={9: "V"})), "position that the camera calls void"),
        (jpeg(tags(tags={1: "X"})), "position unreadable"),
        (jpeg(tags(tags={2: (IFDRational(1, 0), 0.0, 0.0)})), "position not finite"),
        (jpeg({k: v for k, v in tags().items() if k != 6}), "no altitude"),
        (jpeg(tags(tags={29: "soon"})), "time unreadable"),
        (jpeg(tags(tags={7: (25.0, 0.0, 0.0)})), "time unreadable"),
        (jpeg({k: v for k, v in tags().items() if k != 29}), "no time"),
        (
            jpeg({k: v for k, v in tags().items() if k != 29}, {0x9003: "2026:06:10 08:00:00"}),
            "local time without a zone",
        ),
        (b"\x89PNG", "no EXIF"),
        (b"", "no EXIF"),
    ],
)
def test_exif_picture_without_a_usable_position_is_counted(picture: bytes, reason: str) -> None:
    """The picture beside it stays."""
    found = read(jpeg(tags()), picture)
    assert len(found.fixes.epoch_ns) == 1
    assert counts(found.skipped) == {reason: 1}


def test_exif_pictures_without_any_position_are_refused() -> None:
    """The error says what the camera must write."""
    with pytest.raises(
        DriveError, match=r"pictures holds no usable GNSS fix \(2 × no EXIF\).*the camera must"
    ):
        read(jpeg(), jpeg())


def test_exif_is_looked_for_in_jpegs_only() -> None:
    """Whether there is a position is seen from the beginning of the file."""
    assert looks_like_jpeg(jpeg())
    assert has_exif_position(jpeg(tags()))
    assert not has_exif_position(jpeg())
    assert not has_exif_position(b"RIFF")
