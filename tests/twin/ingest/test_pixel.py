"""A pixel that a person names has the place that its annotation would have."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.drives.read import read_drive
from twin.errors import ConfigError, DriveError
from twin.ingest.locate import locate_annotations, trajectory_of
from twin.ingest.pixel import locate_pixel
from twin.samples.sample import TRIP

CAMERA = "C3_tricam120"


@pytest.mark.parametrize("method", ["single-frame", "paper"])
def test_a_pixel_is_where_its_annotation_is(sample: Path, method: str) -> None:
    """Annotation tools count from the corner."""
    drive = read_drive(sample / TRIP)
    notes = drive.annotations
    row = next(i for i in range(notes.frame.size) if notes.camera[i] == CAMERA and notes.kind[i] == "foot")
    sighted = locate_annotations(drive, trajectory_of(drive), method=method)
    u, v = notes.pixel_px[row] + 0.5
    found = locate_pixel(sample / TRIP, CAMERA, int(notes.frame[row]), (u, v), method=method)
    k = sighted.index.tolist().index(row)
    assert found.latitude_deg == pytest.approx(sighted.located.latitude_deg[k], abs=1e-12)
    assert found.longitude_deg == pytest.approx(sighted.located.longitude_deg[k], abs=1e-12)
    assert found.range_m == pytest.approx(sighted.located.range_m[k])
    assert found.major95_m > found.minor95_m > 0.0


def test_a_camera_without_annotations_serves_too(sample: Path) -> None:
    """Its frames have times all the same."""
    found = locate_pixel(sample / TRIP, "C1_front60Single", 1, (900.0, 900.0))
    assert 5.0 < found.range_m < 12.0


def test_what_has_no_place_says_why(sample: Path) -> None:
    """And which camera and frames there are."""
    with pytest.raises(DriveError, match="above the horizon"):
        locate_pixel(sample / TRIP, CAMERA, 84, (900.0, 100.0))
    with pytest.raises(ConfigError, match="no camera 'C9'"):
        locate_pixel(sample / TRIP, "C9", 84, (900.0, 100.0))
    with pytest.raises(ConfigError, match="frames 0 to"):
        locate_pixel(sample / TRIP, CAMERA, 10**6, (900.0, 100.0))
