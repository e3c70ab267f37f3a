"""The writer of simulated drives against the one line that is known from the real car."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checkout import REAL

from geoloc.simulation.simulate import scenario, simulate_drive
from twin.drives.track.formats.nmea import read_nmea
from twin.samples.write_drive import write_driveworks_trip

LINE = REAL / "naplab" / "gnss_sample_lines.txt"


def test_written_sentence_equals_the_recorded_one(tmp_path: Path) -> None:
    """The fix of the real line, read and written again, is the real line, character for character."""
    if not LINE.is_file():
        pytest.skip("the recorded line of the real car is not on this machine")
    recorded = LINE.read_text(encoding="utf-8").strip()
    fixes = read_nmea(recorded.encode(), "gnss50:vehicle", LINE.name).fixes
    drive = simulate_drive(scenario("still"), 1)
    write_driveworks_trip(replace(drive, gnss=(fixes,)), tmp_path)
    written = (tmp_path / "gnss50_vehicle.bin").read_bytes().decode("ascii")
    assert written == recorded + "\r\n"
    assert np.array_equal(fixes.quality, [4])
