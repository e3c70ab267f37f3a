"""A rig file with something of one camera replaced."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from geoloc.earth.geodesy import rotation_from_rpy
from geoloc.errors import CalibrationError
from geoloc.rig.edit import with_extrinsics, with_rotation_correction
from geoloc.rig.rig import FLU_R_RDF, rig_document, rig_from_document
from geoloc.simulation.car import simulated_rig

WIDE = "C3_tricam120"
ROTATION = rotation_from_rpy(0.3, 2.0, -1.0) @ FLU_R_RDF
PLACE_M = np.array([1.7, 0.05, 1.5])


def document() -> dict[str, Any]:
    """A rig whose wide camera has its pose in two forms, and both corrections."""
    made = rig_document(simulated_rig())
    (wide,) = (s for s in made["rig"]["sensors"] if s["name"] == WIDE)
    wide["sensor2Rig_FLU"] = {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [0.0, 0.0, 0.0]}
    wide["correction_sensor_R_FLU"] = {"roll-pitch-yaw": [1.0, 1.0, 1.0]}
    wide["correction_rig_T"] = [0.1, 0.1, 0.1]
    return made


def test_new_pose_takes_the_place_of_all_forms_of_the_old_one() -> None:
    """Corrections and other forms go with the old pose; the document that was given stays as it was."""
    before = document()
    kept = copy.deepcopy(before)
    written = with_extrinsics(before, WIDE, ROTATION, PLACE_M, "rig.json")
    assert before == kept
    (wide,) = (s for s in written["rig"]["sensors"] if s["name"] == WIDE)
    assert not {"sensor2Rig_FLU", "correction_sensor_R_FLU", "correction_rig_T"} & wide.keys()
    found = rig_from_document(written, "rig.json").camera(WIDE)
    assert found.rig_R_camera == pytest.approx(ROTATION, abs=1e-12)
    assert found.rig_t_camera_m == pytest.approx(PLACE_M, abs=1e-12)


def test_correction_makes_the_rotation_and_leaves_the_place() -> None:
    """A new correction replaces the old one: the rotation is the wanted one, the position as before."""
    before = document()
    written = with_rotation_correction(before, WIDE, ROTATION, "rig.json")
    found = rig_from_document(written, "rig.json").camera(WIDE)
    assert found.rig_R_camera == pytest.approx(ROTATION, abs=1e-12)
    place = rig_from_document(before, "rig.json").camera(WIDE).rig_t_camera_m
    assert found.rig_t_camera_m == pytest.approx(place, abs=1e-12)


def test_camera_that_is_not_there_is_named_with_those_that_are() -> None:
    """A name that the rig does not have ends with the names it has; so does a document that is no rig."""
    with pytest.raises(CalibrationError, match=rf"has no sensor C9 \(its sensors: .*{WIDE}"):
        with_extrinsics(document(), "C9", ROTATION, PLACE_M, "rig.json")
    with pytest.raises(CalibrationError, match="no list of sensors"):
        with_rotation_correction({"rig": {}}, WIDE, ROTATION, "rig.json")
