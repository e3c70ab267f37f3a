"""Intrinsics in a rig file: the models beside f-theta and pinhole."""

from __future__ import annotations

from typing import Any

import pytest

from geoloc.cameras import CameraModel, FisheyeCamera, OcamCamera, OmniCamera
from geoloc.errors import CalibrationError
from geoloc.rig.rig import rig_from_document

CENTRE = {"width": "1280", "height": "960", "cx": "640.5", "cy": "480.25"}


def model_of(**properties: str) -> CameraModel:
    """Read one camera with these properties."""
    sensor: dict[str, Any] = {
        "name": "front",
        "protocol": "camera.virtual",
        "properties": {**CENTRE, **properties},
        "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [0.0, 0.0, 1.5]},
    }
    return rig_from_document({"rig": {"sensors": [sensor]}}, "car.json").camera("front").model


def test_rig_reads_an_ocam_camera_in_both_directions_of_its_depth() -> None:
    """The constant is OCamCalib's negative one, or the positive one of a depth that counts forward."""
    expected = OcamCamera(1280, 960, 640.5, 480.25, (-300.0, 0.0, 1e-3), 1.01, 2e-3, -1e-3)
    linear = {"c": "1.01", "d": "2e-3", "e": "-1e-3"}
    assert model_of(Model="ocam", polynomial="-300 0 1e-3", **linear) == expected
    assert model_of(Model="OCam", poly="300 0 -1e-3 ", **linear) == expected
    assert model_of(Model="ocam", polynomial="-300 0 1e-3") == OcamCamera(
        1280, 960, 640.5, 480.25, (-300.0, 0.0, 1e-3)
    )


def test_rig_reads_fisheye_and_omni_cameras() -> None:
    """The focal lengths and the distortion have the names of a pinhole camera."""
    focal = {"fx": "500", "fy": "501"}
    assert model_of(Model="fisheye", distortion="0.01 -0.02 0.003 0", **focal) == FisheyeCamera(
        1280, 960, 500.0, 501.0, 640.5, 480.25, (0.01, -0.02, 0.003, 0.0)
    )
    assert model_of(Model="omni", xi="1.5", distortion="-0.2 0.1 0 0", **focal) == OmniCamera(
        1280, 960, 1.5, 500.0, 501.0, 640.5, 480.25, (-0.2, 0.1, 0.0, 0.0)
    )


@pytest.mark.parametrize(
    ("properties", "message"),
    [
        ({"Model": "ocam"}, "polynomial of sensor front in car.json is missing"),
        ({"Model": "ocam", "polynomial": "0 0 1"}, "cannot be used.*negative constant"),
        ({"Model": "fisheye", "fx": "500"}, "fy or focal-y or focalY of sensor front"),
        ({"Model": "fisheye", "fx": "5", "fy": "5", "distortion": "1 2 3 4 5"}, "has 5 numbers"),
        ({"Model": "omni", "fx": "500", "fy": "500"}, "xi of sensor front in car.json is missing"),
    ],
)
def test_rig_names_what_a_camera_lacks(properties: dict[str, str], message: str) -> None:
    """The property, the sensor and the file."""
    with pytest.raises(CalibrationError, match=message):
        model_of(**properties)
