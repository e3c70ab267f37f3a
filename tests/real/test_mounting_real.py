"""Where cameras sit, written into the real rig of NTNU's car."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from checkout import ROOT

from geoloc.calibration.verify_mounting import turned
from geoloc.rig.edit import with_extrinsics, with_rotation_correction
from geoloc.rig.rig import rig_from_document
from twin.calibrate.extrinsics.given_rig import read_given_rig

RIG = ROOT.parent / "shared" / "real" / "naplab" / "ntnu_naplab_rig_carlo.json"
POSE_KEYS = {"nominalSensor2Rig_FLU", "sensor2Rig_FLU", "nominalSensor2Rig", "sensor2Rig"}
POSE_KEYS |= {"correction_sensor_R_FLU", "correction_rig_T"}


@pytest.fixture(scope="module")
def document() -> Any:
    """The rig file as it is."""
    if not RIG.exists():
        pytest.skip("the real rig file is not beside the checkout")
    return json.loads(RIG.read_text(encoding="utf-8"))


def without_pose(document: Any, camera: str) -> Any:
    """The document with nothing of where that camera sits."""
    copied = json.loads(json.dumps(document))
    for sensor in copied["rig"]["sensors"]:
        if sensor["name"] == camera:
            for key in POSE_KEYS:
                sensor.pop(key, None)
    return copied


def test_pose_written_into_the_real_rig_is_read_back_and_nothing_else_changes(document: Any) -> None:
    """Each of the eight cameras gets another pose to 1e-9; unknown keys, CAN, masks and antennas stay."""
    rig = rig_from_document(document, "rig.json")
    assert len(rig.cameras) == 8
    for name, camera in rig.cameras.items():
        moved = turned(camera, 0.3, -0.2, 0.1)
        place = camera.rig_t_camera_m + np.array([0.01, -0.02, 0.03])
        written = with_extrinsics(document, name, moved.rig_R_camera, place, "rig.json")
        again = rig_from_document(written, "rig.json").camera(name)
        assert again.rig_R_camera == pytest.approx(moved.rig_R_camera, abs=1e-9)
        assert again.rig_t_camera_m == pytest.approx(place, abs=1e-12)
        assert without_pose(written, name) == without_pose(document, name)


def test_correction_written_into_the_real_rig_keeps_the_nominal_pose(document: Any) -> None:
    """A turn by correction_sensor_R_FLU is read back to 1e-9; the drawing's pose stays in the file."""
    rig = rig_from_document(document, "rig.json")
    for name, camera in rig.cameras.items():
        right = turned(camera, -0.25, 0.4, 0.05).rig_R_camera
        written = with_rotation_correction(document, name, right, "rig.json")
        assert rig_from_document(written, "rig.json").camera(name).rig_R_camera == pytest.approx(
            right, abs=1e-9
        )
        (before,) = (s for s in document["rig"]["sensors"] if s["name"] == name)
        (after,) = (s for s in written["rig"]["sensors"] if s["name"] == name)
        assert {k: v for k, v in after.items() if k != "correction_sensor_R_FLU"} == {
            k: v for k, v in before.items() if k != "correction_sensor_R_FLU"
        }


def test_real_rig_gives_rough_poses_to_start_from(document: Any) -> None:
    """Cameras of the real rig have places, so the calibration tells how far each was off."""
    given = read_given_rig(RIG)
    assert given.document == document
    assert given.nominal.keys() == given.rig.cameras.keys()
