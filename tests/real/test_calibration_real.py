"""A calibrated camera written into the real rig of NTNU's car."""

from __future__ import annotations

import json
from typing import Any

import pytest
from checkout import ROOT

from geoloc.cameras import FThetaCamera, OcamCamera
from geoloc.rig.rig import rig_from_document
from twin.calibrate.camera_files import rig_with_camera

RIG = ROOT.parent / "shared" / "real" / "naplab" / "ntnu_naplab_rig_carlo.json"


@pytest.fixture(scope="module")
def document() -> Any:
    """The rig file as it is."""
    if not RIG.exists():
        pytest.skip("the real rig file is not beside the checkout")
    return json.loads(RIG.read_text(encoding="utf-8"))


def test_rig_with_a_new_camera_keeps_everything_else(document: Any) -> None:
    """One camera's numbers change; its keys, its mask and pose, the others, CAN and antennas do not."""
    new = FThetaCamera(1920, 1208, 977.1, 651.2, theta_from_r=(0.0, 9.9e-4, 3e-8, 5.5e-11, 2.2e-15))
    written = rig_with_camera(document, "rig.json", "C3_tricam120", new)
    assert rig_from_document(written, "rig.json").camera("C3_tricam120").model == new
    changed = [
        (old["name"], {key for key in old if old[key] != sensor[key]})
        for old, sensor in zip(document["rig"]["sensors"], written["rig"]["sensors"], strict=True)
        if old != sensor
    ]
    assert changed == [("C3_tricam120", {"properties"})]
    (properties,) = (s["properties"] for s in written["rig"]["sensors"] if s["name"] == "C3_tricam120")
    (before,) = (s["properties"] for s in document["rig"]["sensors"] if s["name"] == "C3_tricam120")
    assert set(properties) == set(before)
    assert {key: value for key, value in written.items() if key != "rig"} == {
        key: value for key, value in document.items() if key != "rig"
    }


def test_same_camera_gives_the_same_rig(document: Any) -> None:
    """A camera that was read from the rig and written again is the same camera to the last bit."""
    before = rig_from_document(document, "rig.json")
    for name, camera in before.cameras.items():
        written = rig_with_camera(document, "rig.json", name, camera.model)
        assert rig_from_document(written, "rig.json").camera(name).model == camera.model


def test_camera_of_another_model_leaves_nothing_of_the_old_one(document: Any) -> None:
    """An ocam camera in the place of an f-theta one: no polynomial of the old camera stays behind."""
    ocam = OcamCamera(1920, 1208, 962.0, 611.0, (-980.0, 0.0, 2.6e-4, -1.1e-7, 9.0e-11))
    written = rig_with_camera(document, "rig.json", "C3_tricam120", ocam)
    (properties,) = (s["properties"] for s in written["rig"]["sensors"] if s["name"] == "C3_tricam120")
    assert "bw-poly" not in properties
    assert rig_from_document(written, "rig.json").camera("C3_tricam120").model == ocam
