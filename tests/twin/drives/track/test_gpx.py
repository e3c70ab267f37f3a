"""GPX tracks."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import gpxpy
import numpy as np
import pytest
from left_out import counts
from track_writers import S, gpx_document, gpx_point

from twin.drives.track.formats.gpx import looks_like_gpx, read_gpx
from twin.errors import DriveError

START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * S


def point(inside: str, lat: str = "63.42", lon: str = "10.4") -> str:
    """One track point as text."""
    return f'<trkpt lat="{lat}" lon="{lon}">{inside}</trkpt>'


def at(text: str, ele: str = "<ele>40</ele>") -> bytes:
    """A track of one point with this time."""
    return gpx_document([point(f"{ele}<time>{text}</time>")])


def test_gpx_agrees_with_gpxpy() -> None:
    """An independent reader gets the same places and times."""
    content = gpx_document(
        gpx_point(START_NS + i * S // 2, 63.42 + i * 1e-5, 10.4, 40.0 + i) for i in range(5)
    )
    fixes = read_gpx(content, "a", "a.gpx").fixes
    oracle = gpxpy.parse(content.decode()).tracks[0].segments[0].points
    assert fixes.latitude_deg.tolist() == [p.latitude for p in oracle]
    assert fixes.longitude_deg.tolist() == [p.longitude for p in oracle]
    assert (fixes.epoch_ns / S).tolist() == [p.time.timestamp() for p in oracle]
    assert set(fixes.quality.tolist()) == {1}


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2026-06-10T08:00:00Z", 0.0),
        ("2026-06-10T08:00:00.250Z", 0.25),
        ("2026-06-10T10:00:00+02:00", 0.0),
        ("2026-06-10T08:00:00.1234567Z", 0.123456),
    ],
)
def test_gpx_time_is_utc_whatever_its_zone(text: str, seconds: float) -> None:
    """A zone that is stated is taken off; digits beyond the microsecond are cut."""
    assert read_gpx(at(text), "a", "a.gpx").fixes.epoch_ns.tolist() == [START_NS + round(seconds * S)]


@pytest.mark.parametrize(
    ("inside", "reason"),
    [
        ("<ele>40</ele>", "no time"),
        ("<ele>40</ele><time>2026-06-10T08:00:00</time>", "time without a zone (Z for UTC)"),
        ("<ele>40</ele><time>today</time>", "time unreadable"),
        ("<ele>40</ele><time>1970-01-01T00:00:00Z</time>", "stamp outside the years 2000–2099"),
        ("<time>2026-06-10T08:00:00Z</time>", "no elevation"),
        ("<ele>high</ele><time>2026-06-10T08:00:00Z</time>", "elevation is no number"),
        ("<ele>nan</ele><time>2026-06-10T08:00:00Z</time>", "position not finite"),
        ("<ele>40</ele><fix>none</fix><time>2026-06-10T08:00:00Z</time>", "fix none"),
    ],
)
def test_gpx_point_that_cannot_be_used_is_counted(inside: str, reason: str) -> None:
    """The point beside it stays."""
    content = gpx_document([point(inside), gpx_point(START_NS, 63.42, 10.4, 40.0)])
    read = read_gpx(content, "a", "a.gpx")
    assert read.fixes.epoch_ns.tolist() == [START_NS]
    assert counts(read.skipped) == {reason: 1}


def test_gpx_values_of_extensions_are_not_the_points_own() -> None:
    """An <ele> or <time> deeper in a point belongs to its extension."""
    deeper = "<extensions><a><ele>9</ele><time>x</time></a></extensions>"
    inside = f"<ele>40</ele><time>2026-06-10T08:00:00Z</time>{deeper}"
    assert read_gpx(gpx_document([point(inside)]), "a", "a.gpx").fixes.epoch_ns.tolist() == [START_NS]


def test_gpx_height_is_brought_to_the_ellipsoid_where_the_geoid_is_known(monkeypatch: Any) -> None:
    """40 m above the sea at Trondheim are 79.4 m above the ellipsoid; without the model a warning says so."""
    import twin.drives.track.sea_level as module
    from geoloc.earth.heights import Heights

    plain = read_gpx(at("2026-06-10T08:00:00Z"), "a", "a.gpx")
    raised = Heights(np.array([79.4]), 0.02, "")
    monkeypatch.setattr(module, "ellipsoidal_from_nn2000", lambda *_: raised)
    known = read_gpx(at("2026-06-10T08:00:00Z"), "a", "a.gpx")
    assert known.fixes.height_m.tolist() == [79.4]
    assert "HREF2018B" in known.warnings[0]
    if plain.fixes.height_m[0] == 40.0:
        assert "no geoid model" in plain.warnings[0]


def test_gpx_with_entities_or_without_end_is_refused() -> None:
    """Entities can blow up or read other files; a cut file says where it ends."""
    bomb = b'<?xml version="1.0"?><!DOCTYPE g [<!ENTITY a "b">]><gpx><trk/></gpx>'
    for content in (
        bomb,
        at("2026-06-10T08:00:00Z")[:-20],
        b"",
        b'<?xml version="1.0" encoding="x-y"?><gpx/>',
    ):
        with pytest.raises(DriveError, match=r"a\.gpx"):
            read_gpx(content, "a", "a.gpx")


def test_gpx_route_without_times_says_what_to_export() -> None:
    """A planned route is no recording."""
    content = b'<gpx><rte><rtept lat="1" lon="2"/></rte></gpx>'
    with pytest.raises(DriveError, match=r"a\.gpx holds no usable GNSS fix.*export the recorded track"):
        read_gpx(content, "a", "a.gpx")


def test_gpx_is_known_by_its_content() -> None:
    """By its root element."""
    assert looks_like_gpx(gpx_document([]))
    assert not looks_like_gpx(b"<annotations/>")
