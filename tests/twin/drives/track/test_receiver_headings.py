"""Headings of receivers in a drive folder: turned, held against the course, and told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoloc.doubts import Doubt
from twin.drives.folder.drive_toml import read_settings
from twin.drives.inspection.picture import told
from twin.drives.inspection.sensors import gnss_span
from twin.drives.read import read_drive
from twin.errors import DriveError

STEP_NS = 200_000_000


def nmea(maker: Any, heading_deg: float | None, speed_mps: float = 10.0) -> str:
    """20 s due north, with a heading behind every fix."""
    lines = []
    for i in range(100):
        latitude = 6325.2 + speed_mps * 0.2 * i / 1857.0
        lines.append(maker.gga(maker.start_ns + i * STEP_NS, lat=f"{latitude:.7f}"))
        if heading_deg is not None:
            lines.append(maker.sentence(f"GNHDT,{heading_deg % 360.0:.1f},T"))
    return "".join(lines)


def trip(maker: Any, folder: Path, recording: str, gnss: str = "") -> Path:
    """A drive with one antenna."""
    rig = maker.rig(maker.camera(maker.wide), maker.antenna("roof", [0.9, 0.0, 1.6]))
    files = {
        "rig.json": json.dumps(rig),
        "roof.bin": recording,
        f"{maker.wide}.h264.timestamps": maker.stamps(),
        f"{maker.wide}.xml": maker.annotations(),
    }
    return Path(maker.write(folder, files | ({"drive.toml": f"[gnss]\n{gnss}\n"} if gnss else {})))


def about_headings(warnings: tuple[Doubt, ...]) -> list[str]:
    """Sentences about headings."""
    return [warning.sentence for warning in warnings if "headings" in warning.sentence]


def test_headings_along_the_course_are_used_and_counted(maker: Any, tmp_path: Path) -> None:
    """Whoever watches is told how many; nothing is left out, and nothing is to be known."""
    said: list[str] = []
    drive = read_drive(trip(maker, tmp_path, nmea(maker, 1.0)), progress=said.append)
    assert drive.gnss[0].heading_deg.tolist() == [1.0] * 100
    assert "GNSS roof.bin: 100 fixes at 5.0 Hz, 100 headings." in said
    assert not about_headings(drive.warnings)
    assert not [s for s in drive.skipped if "heading" in s.reason]


@pytest.mark.parametrize(
    ("heading_deg", "side", "cure"), [(90.0, "90.0° clockwise", -90), (-12.0, "12.0° anticlockwise", 12)]
)
def test_headings_off_the_course_are_refused_with_the_cure(
    maker: Any, tmp_path: Path, heading_deg: float, side: str, cure: float
) -> None:
    """One sentence says by how much they are off, and the key that it names makes them useful."""
    recording = nmea(maker, heading_deg)
    drive = read_drive(trip(maker, tmp_path / "a", recording))
    assert np.isnan(drive.gnss[0].heading_deg).all()
    (sentence,) = about_headings(drive.warnings)
    assert f"roof.bin lie {side} of the course" in sentence
    assert f"heading_offset_deg = {cure} in drive.toml" in sentence
    cured = read_drive(trip(maker, tmp_path / "b", recording, f"heading_offset_deg = {cure}"))
    np.testing.assert_allclose(cured.gnss[0].heading_deg, 0.0, atol=1e-9)
    assert not about_headings(cured.warnings)


def test_offset_that_is_wrong_is_refused_with_the_right_one(maker: Any, tmp_path: Path) -> None:
    """A sign that was mistaken: the sentence names the whole angle, not what is left of it."""
    drive = read_drive(trip(maker, tmp_path, nmea(maker, 90.0), "heading_offset_deg = 90"))
    (sentence,) = about_headings(drive.warnings)
    assert "lie 180.0° " in sentence
    assert "heading_offset_deg = -90 in drive.toml" in sentence


def test_headings_of_a_car_that_stands_are_used_and_doubted(maker: Any, tmp_path: Path) -> None:
    """Nothing shows how the antennas are mounted: an offset must be stated, if only 0."""
    recording = nmea(maker, 90.0, speed_mps=0.3)
    drive = read_drive(trip(maker, tmp_path / "a", recording))
    assert drive.gnss[0].heading_deg.tolist() == [90.0] * 100
    (sentence,) = about_headings(drive.warnings)
    assert "drives too little" in sentence
    stated = read_drive(trip(maker, tmp_path / "b", recording, "heading_offset_deg = 0"))
    assert not about_headings(stated.warnings)


def test_stated_sigma_of_headings_overrules_the_default(maker: Any, tmp_path: Path) -> None:
    """A pair that is 30 cm long is less sure than one of a metre."""
    drive = read_drive(trip(maker, tmp_path, nmea(maker, 0.0), "heading_sigma_deg = 1.5"))
    assert drive.gnss[0].heading_sigma_deg.tolist() == [1.5] * 100


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "heading_offset_deg = 400",
            "gnss.heading_offset_deg = 400.0: it must be a number of degrees from -360",
        ),
        (
            "heading_sigma_deg = 0",
            "gnss.heading_sigma_deg = 0.0: it must be a number of degrees from 0.01 to 30",
        ),
        ('heading_offset_deg = "left"', "gnss.heading_offset_deg = 'left': it must be a number"),
        (
            "heading_offset = 3",
            r"\[gnss\] heading_offset: the nearest known one is \[gnss\] heading_offset_deg",
        ),
    ],
)
def test_settings_of_headings_are_checked(text: str, message: str) -> None:
    """Each wrong value is named with what it must be."""
    with pytest.raises(DriveError, match=message):
        read_settings(f"[gnss]\n{text}".encode())


def test_inspection_tells_how_many_headings_and_velocities_are_used(maker: Any, tmp_path: Path) -> None:
    """Beside rate and quality; a recording without any says nothing of them."""
    rmc = maker.sentence("GPRMC,080000.00,A,6325.2,N,01024.0,E,19.4,0.0,100626,,,D")
    with_both = read_drive(trip(maker, tmp_path / "a", rmc + nmea(maker, 1.0))).gnss[0]
    span = gnss_span(with_both, "roof.bin")
    assert told(span).endswith("100% RTK fixed, 100 headings, 1 velocities")
    assert (span.as_json()["headings"], span.as_json()["velocities"]) == (100, 1)
    without = gnss_span(read_drive(trip(maker, tmp_path / "b", nmea(maker, None))).gnss[0], "roof.bin")
    assert told(without).endswith("100% RTK fixed")
    assert without.as_json()["headings"] is None
