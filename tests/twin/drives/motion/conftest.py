"""One simulated drive through a town; its folder is copied before anything is added."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from moving_car import MovingCar

from geoloc.simulation.simulate import scenario, simulate_drive
from twin.samples.write_drive import write_driveworks_trip


@pytest.fixture(scope="session")
def driven(tmp_path_factory: pytest.TempPathFactory) -> MovingCar:
    """Through the bends of a town, with two antennas."""
    drive = simulate_drive(scenario("urban"), 3)
    folder = tmp_path_factory.mktemp("motion") / "trip"
    write_driveworks_trip(drive, folder)
    return MovingCar(drive, folder)


@pytest.fixture
def car(driven: MovingCar, tmp_path: Path) -> MovingCar:
    """The same drive, and a folder that holds its rig file alone."""
    shutil.copy(driven.trip / "rig.json", tmp_path)
    return MovingCar(driven.drive, tmp_path)


@pytest.fixture
def whole(driven: MovingCar, tmp_path: Path) -> MovingCar:
    """The same drive with all its files in a folder of its own."""
    return MovingCar(driven.drive, Path(shutil.copytree(driven.trip, tmp_path / "trip")))
