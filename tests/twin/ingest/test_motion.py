"""A car's own sensors carry an ingest through an outage, and the report says what was found of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from moving_car import TABLE, MovingCar

from geoloc.simulation.simulate import scenario, simulate_drive
from twin.ingest.ingest import ingest_drive
from twin.samples.write_drive import write_driveworks_trip
from twin.store.store import Store


def test_an_outage_is_bridged_and_told(tmp_path: Path) -> None:
    """One antenna, a third of its fixes gone: annotations in the gap are located by wheels and gyro."""
    drive, folder = simulate_drive(scenario("urban"), 3), tmp_path / "trip"
    write_driveworks_trip(drive, folder)
    (folder / "gnss52_vehicle.bin").unlink()
    fixes = folder / "gnss50_vehicle.bin"
    lines = fixes.read_text(encoding="ascii").splitlines(keepends=True)
    fixes.write_text(
        "".join(lines[: int(0.4 * len(lines))] + lines[int(0.7 * len(lines)) :]), encoding="ascii"
    )
    MovingCar(drive, folder).table(folder / "can.csv")
    with Store.open(tmp_path / "twin.db") as store:
        without = ingest_drive(store, folder, method="single-frame", partial=True)
        settings = "\n".join(f"{key} = {value}" for key, value in TABLE.items())
        (folder / "drive.toml").write_text(f"[motion]\n{settings}\n", encoding="utf-8")
        bridged = ingest_drive(store, folder, method="single-frame")
    assert without.motion is None
    assert bridged.n_located > 1.2 * without.n_located
    found = bridged.motion
    assert found is not None
    assert found.wheel_scale is not None
    assert found.turns_show
    assert found.wheel_scale.value == pytest.approx(1.0, abs=max(4 * found.wheel_scale.sigma, 1e-3))
    assert found.bridged_s == pytest.approx(0.3 * np.ptp(drive.poses.epoch_ns) / 1e9, rel=0.1)
