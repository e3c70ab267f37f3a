"""The two poses of a sensor in a rig file: which counts, how far they are apart, and which is chosen."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from rig_entries import LEVEL, camera_sensor, document, front, gps_sensor
from scipy.spatial.transform import Rotation

from geoloc.rig.edit import with_rotation_correction
from geoloc.rig.poses import PoseKind, idle_corrections, pose_differences, with_pose_kind
from geoloc.rig.rig import FLU_R_RDF, rig_from_document

CORRECTIONS: dict[str, Any] = {
    "correction_sensor_R_FLU": {"roll-pitch-yaw": [0.0, 0.0, 5.0]},
    "correction_rig_T": [0.0, 0.0, 1.0],
}


def calibrated(key: str, yaw_deg: float = 1.0) -> dict[str, Any]:
    """A calibrated pose, as quaternion: turned by so much against the drawing, 3 and 4 cm beside it."""
    turn = Rotation.from_euler("z", yaw_deg, degrees=True)
    rotation = turn if key.endswith("_FLU") else turn * Rotation.from_matrix(FLU_R_RDF)
    return {"quaternion": rotation.as_quat().tolist(), "t": [1.83, 0.24, 1.5]}


@pytest.mark.parametrize("key", ["sensor2Rig", "sensor2Rig_FLU"])
def test_calibrated_pose_counts_and_takes_no_correction(key: str) -> None:
    """Beside a drawing with corrections sensor2Rig counts: the corrections are the drawing's."""
    camera = front(**{key: calibrated(key)}, **CORRECTIONS)
    expected = Rotation.from_euler("z", 1.0, degrees=True).as_matrix() @ FLU_R_RDF
    np.testing.assert_allclose(camera.rig_R_camera, expected, atol=1e-12)
    np.testing.assert_array_equal(camera.rig_t_camera_m, [1.83, 0.24, 1.5])


def test_calibrated_pose_that_nobody_filled_in_does_not_count() -> None:
    """No turn at the rig's origin is what rig tools write before a calibration; alone it is all there is."""
    unset = {"quaternion": [0.0, 0.0, 0.0, 1.0], "t": [0.0, 0.0, 0.0]}
    np.testing.assert_array_equal(front(sensor2Rig=unset).rig_t_camera_m, LEVEL["t"])
    alone = front(sensor2Rig=unset, nominalSensor2Rig_FLU=None)
    np.testing.assert_array_equal(alone.rig_t_camera_m, [0.0, 0.0, 0.0])


def test_difference_of_the_two_poses_is_told_in_degrees_and_metres() -> None:
    """The drawing with its corrections against the calibrated pose; an antenna has no direction."""
    rig = document(
        camera_sensor(sensor2Rig=calibrated("sensor2Rig")),
        camera_sensor(name="same", sensor2Rig_FLU=LEVEL),
        camera_sensor(name="alone", nominalSensor2Rig_FLU=None, sensor2Rig_FLU=LEVEL),
        gps_sensor(sensor2Rig={"quaternion": [0.0, 0.0, 1.0, 0.0], "t": [0.5, -0.4, 1.7]}),
    )
    camera, antenna = pose_differences(rig, "car.json")
    assert (camera.sensor, camera.counts, camera.other) == ("front", "sensor2Rig", "nominalSensor2Rig_FLU")
    assert camera.turned_deg == pytest.approx(1.0)
    assert camera.moved_m == pytest.approx(0.05)
    assert (antenna.sensor, antenna.turned_deg) == ("gnss50:vehicle", 0.0)
    assert antenna.moved_m == pytest.approx(0.1)


def test_corrections_without_a_drawing_are_named() -> None:
    """They would be applied to nothing."""
    lone = camera_sensor(name="lone", nominalSensor2Rig_FLU=None, sensor2Rig_FLU=LEVEL, **CORRECTIONS)
    assert idle_corrections(document(camera_sensor(**CORRECTIONS), lone), "car.json") == ["lone"]
    np.testing.assert_array_equal(
        rig_from_document(document(lone), "car.json").camera("lone").rig_t_camera_m, LEVEL["t"]
    )


def test_drawing_is_chosen_where_both_stand() -> None:
    """A sensor that has the calibrated pose alone keeps it; nothing to choose gives the document itself."""
    both = camera_sensor(sensor2Rig=calibrated("sensor2Rig"), sensor2Rig_FLU=LEVEL, colour="red")
    lone = camera_sensor(name="lone", nominalSensor2Rig_FLU=None, sensor2Rig=calibrated("sensor2Rig"))
    rig = document(both, lone)
    before = copy.deepcopy(rig)
    chosen = with_pose_kind(rig, PoseKind.NOMINAL)
    assert rig == before
    assert chosen["rig"]["sensors"] == [camera_sensor(colour="red"), lone]
    assert with_pose_kind(rig, PoseKind.CALIBRATED) is rig
    assert with_pose_kind(document(lone), PoseKind.NOMINAL)["rig"]["sensors"] == [lone]


@pytest.mark.parametrize("key", ["sensor2Rig", "sensor2Rig_FLU"])
@pytest.mark.parametrize("form", ["quaternion", "roll-pitch-yaw"])
def test_correcting_a_camera_turns_the_pose_that_counts(key: str, form: str) -> None:
    """Its form and place stay, and so does the drawing with its correction, which would change nothing."""
    pose = calibrated(key)
    if form != "quaternion":
        angles = Rotation.from_quat(pose.pop("quaternion")).as_euler("xyz", degrees=True)
        pose[form] = angles.tolist()
    rig = document(camera_sensor(**{key: pose}, **CORRECTIONS))
    wanted = Rotation.from_euler("xyz", [0.5, 2.0, 3.0], degrees=True).as_matrix() @ FLU_R_RDF
    written = with_rotation_correction(rig, "front", wanted, "car.json")
    (sensor,) = written["rig"]["sensors"]
    assert {**sensor, key: None} == {**rig["rig"]["sensors"][0], key: None}
    assert sensor[key].keys() == pose.keys()
    found = rig_from_document(written, "car.json").camera("front")
    np.testing.assert_allclose(found.rig_R_camera, wanted, atol=1e-12)
    np.testing.assert_array_equal(found.rig_t_camera_m, pose["t"])
