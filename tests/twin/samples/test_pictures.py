"""Pictures of the sample: what the cameras truly saw, the same each time, and read as a drive's frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from geoloc.simulation.pictures.scene import Kind
from twin.drives.read import read_drive
from twin.errors import TwinError
from twin.samples.pictures import Studio, with_pictures
from twin.samples.sample import TRIP, sample_drives

DATA = Path(__file__).parents[3] / "data"
POLE_RGB = (126, 130, 132)


@pytest.fixture(scope="module")
def drive() -> Any:
    """The sample's first drive, simulated."""
    return sample_drives()[TRIP]


@pytest.fixture(scope="module")
def studio(drive: Any) -> Studio:
    """Its world; painting changes nothing in it."""
    return Studio(drive)


def test_poles_stand_where_the_annotator_saw_their_feet(drive: Any, studio: Studio) -> None:
    """Just above a true foot the picture shows the pole, just below it the ground: two projections agree."""
    seen = drive.sightings
    camera, frame = "C2_tricam60", 672
    rows = (seen.camera == camera) & (seen.frame == frame) & (seen.range_m < 15.0)
    picture = studio.picture(camera, frame).rgb.astype(int)
    assert rows.sum() == 1
    u, v = seen.true_pixel_px[rows][0]
    column, row = round(u), round(v)
    above, below = picture[row - 4, column], picture[row + 4, column]
    assert np.abs(above - POLE_RGB).max() < 12
    assert np.abs(below - POLE_RGB).max() > 30


def test_mask_tells_people_vehicles_and_faces(studio: Studio) -> None:
    """Behind the obstacle marker P08 a person and a car stand: all three are seen, each in its own pixels."""
    picture = studio.picture("C2_tricam60", 672)
    counts = {kind: int(np.count_nonzero(picture.mask == kind)) for kind in Kind}
    assert min(counts.values()) > 4000
    yellow = picture.rgb[picture.mask == Kind.SIGN].astype(int) - np.array([255, 207, 0])
    assert np.count_nonzero(np.abs(yellow).max(axis=-1) < 30) > 2000


@pytest.mark.slow
def test_pictures_are_the_same_each_time_and_read_as_frames(studio: Studio, tmp_path: Path) -> None:
    """A copy with every 240th frame reads as the drive itself; its pictures have their frames' numbers."""
    made = [with_pictures(DATA / TRIP, tmp_path / name, every=240) for name in ("a", "b")]
    files = [
        {p.name: p.read_bytes() for p in sorted(report.folder.glob("C*_tricam*/*.jpg"))} for report in made
    ]
    assert files[0] == files[1]
    assert made[0].n_pictures == 12
    plain, copy = read_drive(DATA / TRIP), read_drive(tmp_path / "a")
    assert len(copy.annotations.frame) == len(plain.annotations.frame)
    pictures = copy.pictures["C3_tricam120"]
    assert [frame for frame in range(1440) if pictures.has(frame)] == list(range(0, 1440, 240))
    image = cv2.imread(str(tmp_path / "a" / "C3_tricam120" / "000480.jpg"))[..., ::-1].astype(int)
    assert np.abs(image - studio.picture("C3_tricam120", 480).rgb).mean() < 3.0


def test_other_drives_are_refused(tmp_path: Path) -> None:
    """Only what was simulated can be rendered."""
    with pytest.raises(TwinError, match="no drive of the sample"):
        with_pictures(tmp_path, tmp_path / "out")
