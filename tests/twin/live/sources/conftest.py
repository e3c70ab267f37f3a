"""The sample's car, whole or with some of its sensors, and with settings of one's own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from live_senders import ROOF, WIDE, MakeCar

from twin.live.car import Car, read_car


@pytest.fixture
def make_car(sample: Path, tmp_path: Path) -> MakeCar:
    """Make a car with this ``drive.toml``, by default of one camera and one antenna."""

    def made(
        settings: str = "", sensors: tuple[str, ...] = (WIDE, ROOF), size: tuple[int, int] | None = None
    ) -> Car:
        folder = tmp_path / "car"
        folder.mkdir(exist_ok=True)
        rig = json.loads((sample / "trip_trondheim" / "rig.json").read_bytes())
        rig["rig"]["sensors"] = [one for one in rig["rig"]["sensors"] if one["name"] in sensors]
        for camera in [one for one in rig["rig"]["sensors"] if size and one["name"] == WIDE]:
            del camera["car-mask"]
            width, height = size
            camera["properties"] |= {"width": str(width), "height": str(height)}
            camera["properties"] |= {"cx": str(width / 2), "cy": str(height / 2)}
        (folder / "rig.json").write_text(json.dumps(rig), encoding="utf-8")
        (folder / "drive.toml").write_text(settings, encoding="utf-8")
        return read_car(folder)

    return made


@pytest.fixture
def car(make_car: MakeCar) -> Car:
    """One camera, one antenna."""
    return make_car()
