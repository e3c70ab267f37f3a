"""A calibrated lens in a rig whose camera sits behind a windscreen."""

from __future__ import annotations

from typing import Any

import pytest
from rig_entries import FTHETA, camera_sensor, document

from geoloc.cameras import FThetaCamera, WindshieldCamera
from geoloc.errors import CalibrationError
from geoloc.rig.rig import rig_from_document
from twin.calibrate.camera_files import rig_with_camera

SCREEN: dict[str, Any] = {
    "windshield-horizontal-polynomial": "0.001 1.01 0",
    "windshield-vertical-polynomial": "0.002 0 1.02",
}
LENS = FThetaCamera(1920, 1208, 951.0, 610.0, (0.0, 1.1e-3))


def test_new_lens_says_what_becomes_of_the_windshield() -> None:
    """Refused while nobody says it; kept to the letter, or gone because the new lens holds it."""
    rig = document(camera_sensor(properties={**FTHETA, **SCREEN}))
    with pytest.raises(CalibrationError, match=r"front of car\.json has a windshield model.*--windshield"):
        rig_with_camera(rig, "car.json", "front", LENS)
    kept = rig_with_camera(rig, "car.json", "front", LENS, windshield="keep")
    before = rig_from_document(rig, "car.json").camera("front").model
    assert isinstance(before, WindshieldCamera)
    assert rig_from_document(kept, "car.json").camera("front").model == WindshieldCamera(
        LENS, before.windshield
    )
    assert SCREEN.items() <= kept["rig"]["sensors"][0]["properties"].items()
    assert "bw-poly" in kept["rig"]["sensors"][0]["properties"]
    gone = rig_with_camera(rig, "car.json", "front", LENS, windshield="drop")
    assert rig_from_document(gone, "car.json").camera("front").model == LENS
    assert not SCREEN.keys() & gone["rig"]["sensors"][0]["properties"].keys()


def test_windshield_that_cannot_be_read_cannot_be_kept() -> None:
    """The camera could not be used; dropped, it can."""
    broken = {**SCREEN, "windshield-vertical-polynomial": "0 0"}
    rig = document(camera_sensor(properties={**FTHETA, **broken}))
    with pytest.raises(CalibrationError, match=r"cannot be written into car\.json: its windshield model"):
        rig_with_camera(rig, "car.json", "front", LENS, windshield="keep")
    gone = rig_with_camera(rig, "car.json", "front", LENS, windshield="drop")
    assert rig_from_document(gone, "car.json").camera("front").model == LENS
