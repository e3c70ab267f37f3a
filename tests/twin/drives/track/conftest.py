"""One simulated drive, to be recorded in every format."""

from __future__ import annotations

import pytest
from track_writers import Recorded

from geoloc.simulation.simulate import scenario, simulate_drive
from twin.drives.read import read_drive
from twin.samples.write_drive import write_driveworks_trip


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Eleven seconds past one pole."""
    drive = simulate_drive(scenario("approach", 20.0), 8)
    folder = tmp_path_factory.mktemp("formats") / "nmea"
    write_driveworks_trip(drive, folder)
    return Recorded(drive, folder, read_drive(folder).gnss)
