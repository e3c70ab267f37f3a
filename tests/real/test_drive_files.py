"""Recordings and annotations that others made."""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from checkout import REAL

from twin.drives.annotations.formats.cvat import is_cvat, read_cvat
from twin.drives.read import read_drive
from twin.drives.track.fixes import fix_rate_hz
from twin.drives.track.formats.nmea import looks_like_nmea, read_nmea
from twin.errors import DriveError


def content(name: str) -> bytes:
    """Read one real file; skip the test where it is absent."""
    path = REAL / name
    if not path.is_file():
        pytest.skip(f"the real file {name} is not beside the repository")
    return path.read_bytes()


def utc(*moment: int) -> int:
    """Nanoseconds since 1970."""
    return int(datetime(*moment, tzinfo=UTC).timestamp()) * 1_000_000_000  # type: ignore[misc,arg-type]


def test_real_line_of_the_car_gives_its_position_and_delay() -> None:
    """Trip077: 63.41495441° N 10.39912884° E, 65.70 m, stamped 78 ms after its epoch."""
    fixes = read_nmea(content("naplab/gnss_sample_lines.txt"), "gnss50:vehicle", "gnss50_vehicle.bin").fixes
    # The eighth decimal of a degree is a millimetre: the rounding of the published numbers.
    assert fixes.latitude_deg == pytest.approx([63.41495441], abs=5e-9)
    assert fixes.longitude_deg == pytest.approx([10.39912884], abs=5e-9)
    assert fixes.height_m.tolist() == [65.70]
    assert fixes.quality.tolist() == [4]
    assert fixes.epoch_ns.tolist() == [utc(2023, 5, 22, 7, 18, 40) + 900_000_000]
    assert (fixes.host_ns - fixes.epoch_ns).tolist() == [78_036_000]


def test_real_rtk_log_without_host_stamps_is_dated_by_rmc() -> None:
    """The Trimble log of gpsd: 104 DGNSS and 18 RTK-fixed fixes at 10 Hz on 18 March 2020."""
    read = read_nmea(content("gnss/gpsd_nmea-rtk.log"), "rover", "nmea-rtk.log")
    assert Counter(read.fixes.quality.tolist()) == {2: 104, 4: 18}
    assert fix_rate_hz(read.fixes) == pytest.approx(10.0)
    assert read.fixes.epoch_ns[0] == utc(2020, 3, 18, 13, 28, 19) + 600_000_000
    # 278.161 m over a geoid that lies 31.442 m under the ellipsoid.
    assert read.fixes.height_m[0] == pytest.approx(278.161 - 31.442)
    assert {s.reason: s.count for s in read.skipped} == {"not an NMEA sentence": 9}  # the log's comments


def test_real_multi_sentence_log_is_dated_by_zda_and_rmc() -> None:
    """The u-blox log of gpsd: 29 single-point fixes in Dunedin among a thousand other sentences."""
    read = read_nmea(content("gnss/gpsd_ublox-zed-f9p-nmea.log"), "rover", "zed.log")
    assert Counter(read.fixes.quality.tolist()) == {1: 29}
    assert fix_rate_hz(read.fixes) == pytest.approx(1.0)
    assert read.fixes.epoch_ns[0] == utc(2019, 4, 12, 0, 39, 56)
    # The header of the log states 45.877591500° S 170.500124833° E: a few metres for a single-point fix.
    assert read.fixes.latitude_deg == pytest.approx(-45.8775915, abs=1e-4)
    assert read.fixes.longitude_deg == pytest.approx(170.500124833, abs=1e-4)
    assert read.fixes.height_m[0] == pytest.approx(14.2 + 1.8)


def test_real_log_without_any_date_is_refused() -> None:
    """pynmea2's sample has one GGA sentence, no date, and a line of noise."""
    with pytest.raises(DriveError, match="record it with host stamps, or with RMC or ZDA"):
        read_nmea(content("gnss/pynmea2_data.log"), "rover", "data.log")


def test_real_logs_are_told_from_binary_ones() -> None:
    """NMEA text is recognised by a sound sentence; SBP binary, JSON and GPX are not taken for it."""
    assert looks_like_nmea(content("naplab/gnss_sample_lines.txt"))
    assert looks_like_nmea(content("gnss/gpsd_nmea-rtk.log"))
    for name in ("gnss/short.sbp", "gnss/short.sbp.json", "gnss/sf_30km_h.gpx"):
        assert not looks_like_nmea(content(name)[:65_536])


def test_real_cvat_image_export_is_read() -> None:
    """Two images: a box and a polygon; a polyline, two skeletons and points of three are left out."""
    file = read_cvat(content("annotations/cvat/images_train.xml"), "images_train.xml")
    assert [(s.kind, s.label, s.image, s.size_px) for s in file.shapes] == [
        ("box", "label1", "img0.jpg", (8, 8)),
        ("box", "", "img1.jpg", (10, 10)),
    ]
    assert file.shapes[0].box_px == (-0.5, 1.5, 3.5, 3.5)
    assert file.shapes[0].attributes == {"a1": "true", "a2": "v3", "a3": "0003", "a4": "2.4"}
    assert {s.reason: s.count for s in file.skipped} == {
        "kind polyline": 1,
        "kind skeleton": 2,
        "points with 3 points": 1,
    }


def test_real_cvat_project_export_is_read() -> None:
    """Three subsets of two images: three boxes, three polygons, and the names of the three tasks."""
    file = read_cvat(content("annotations/cvat/project_annotations.xml"), "project.xml")
    assert [s.kind for s in file.shapes] == ["box"] * 6
    assert file.tasks == {"39": ("Test",), "37": ("train",), "38": ("Validation",)}
    assert {s.reason: s.count for s in file.skipped} == {
        "kind polyline": 3,
        "points with 3 points": 3,
    }


def test_real_cvat_video_export_keeps_absolute_frames() -> None:
    """A task of frames 10, 13, … of t.mp4: one box before its track ends, the rest of other kinds."""
    file = read_cvat(content("annotations/cvat/video_annotations.xml"), "video.xml")
    assert [(s.frame, s.track, s.kind, s.size_px) for s in file.shapes] == [(10, "0", "box", (25, 20))]
    assert file.shapes[0].box_px == (2.5, 3.5, 9.5, 4.5)
    assert set(file.source) == {"t.mp4", "v1"}
    # Of the skeleton only its three rows count, not the tracks of its parts.
    assert {s.reason: s.count for s in file.skipped} == {
        "kind polyline": 1,
        "kind skeleton": 3,
        "points with 3 points": 1,
    }


def test_real_cvat_exports_are_recognised() -> None:
    """By their root, with and without an XML declaration."""
    for name in ("images_train", "project_annotations", "video_annotations"):
        assert is_cvat(content(f"annotations/cvat/{name}.xml")[:200])


def test_real_rig_with_the_real_line_makes_a_trip(tmp_path: Path) -> None:
    """The car's own rig file, found by content, with its one public GNSS line: a drive with its warnings."""
    (tmp_path / "calibration.json").write_bytes(content("naplab/ntnu_naplab_rig_carlo.json"))
    line = content("naplab/gnss_sample_lines.txt")
    for name in ("gnss50_vehicle.bin", "gnss52_vehicle.bin"):
        (tmp_path / name).write_bytes(line)
    stamp_us = utc(2023, 5, 22, 7, 18, 40) // 1000 + 900_000
    (tmp_path / "C3_tricam120.h264.timestamps").write_text(f"0\t{stamp_us - 33_333}\n1\t{stamp_us}\n")
    points = '<points frame="1" outside="0" points="1000,700"/>'
    export = f'<annotations><track id="0" label="362.50">{points}</track></annotations>'
    (tmp_path / "C3_tricam120.xml").write_text(export)
    drive = read_drive(tmp_path)
    assert len(drive.rig.cameras) == 8
    assert drive.annotations.skiltnummer.tolist() == ["362.50"]
    assert np.array_equal(drive.gnss[0].epoch_ns, [stamp_us * 1000])
    masks, lever_arms = (doubt.sentence for doubt in drive.warnings)
    assert "C8_R2 share one car mask bit for bit" in masks
    assert all(camera.ego_mask is None for camera in drive.rig.cameras.values())
    assert "gnss50:vehicle, gnss52:vehicle are all zero" in lever_arms
