"""Rigs: what a DriveWorks rig file means."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rig_entries import FTHETA, LEVEL, camera_sensor, document, front, gps_sensor
from scipy.spatial.transform import Rotation

from geoloc.cameras import FThetaCamera, PinholeCamera, Windshield, WindshieldCamera
from geoloc.errors import CalibrationError
from geoloc.rig.rig import FLU_R_RDF, looks_like_rig, read_rig, rig_from_document

PINHOLE = {
    "Model": "pinhole",
    "width": "1280",
    "height": "720",
    "cx": "640",
    "cy": "360",
    "fx": "900",
    "fy": "905",
}


def ftheta_of(**changes: str | None) -> FThetaCamera:
    """Read an f-theta camera whose properties have changes; None removes one."""
    properties = {key: value for key, value in {**FTHETA, **changes}.items() if value is not None}
    model = front(properties=properties).model
    assert isinstance(model, FThetaCamera)
    return model


def pinhole_of(**changes: str | None) -> PinholeCamera:
    """Read a pinhole camera whose properties have changes; None removes one."""
    properties = {key: value for key, value in {**PINHOLE, **changes}.items() if value is not None}
    model = front(properties=properties).model
    assert isinstance(model, PinholeCamera)
    return model


def test_rig_reads_an_ftheta_camera_as_drives_record_it() -> None:
    """Numbers in strings with trailing blanks, files from the parameter, the position from ``t``."""
    camera = front()
    assert camera.model == FThetaCamera(1920, 1208, 950.25, 610.5, (0.0, 1e-3, 2e-8, 4e-11, 1.2e-14))
    assert camera.video == "front.h264"
    assert camera.timestamps == "front.h264.timestamps"
    assert camera.ego_mask is None
    np.testing.assert_array_equal(camera.rig_t_camera_m, [1.8, 0.2, 1.5])


@pytest.mark.parametrize(
    ("rpy", "camera_axis", "rig_direction"),
    [
        ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]),
        ([0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
        ([0.0, 0.0, 90.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
        ([0.0, 30.0, 0.0], [0.0, 0.0, 1.0], [math.sqrt(0.75), 0.0, -0.5]),
        ([30.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -math.sqrt(0.75), -0.5]),
    ],
    ids=["forward", "right", "down", "yaw left", "pitch nose down", "roll right down"],
)
def test_rig_camera_axes_follow_iso_8855(
    rpy: list[float], camera_axis: list[float], rig_direction: list[float]
) -> None:
    """Yaw turns left, pitch the nose down, roll the right side down; unturned, a camera looks forward."""
    camera = front(nominalSensor2Rig_FLU={"roll-pitch-yaw": rpy, "t": [0.0, 0.0, 1.0]})
    np.testing.assert_allclose(camera.rig_R_camera @ camera_axis, rig_direction, atol=1e-15)


def test_rig_applies_corrections_as_driveworks_does() -> None:
    """R = R_nominal R_correction S, by SciPy's own composition; translations are summed unrotated."""
    camera = front(
        nominalSensor2Rig_FLU={"roll-pitch-yaw": [1.0, 2.5, -131.0], "t": [1.9, -0.9, 1.1]},
        correction_sensor_R_FLU={"roll-pitch-yaw": [0.3, -0.4, 0.8]},
        correction_rig_T=[0.01, -0.02, 0.03],
    )
    nominal = Rotation.from_euler("xyz", [1.0, 2.5, -131.0], degrees=True).as_matrix()
    correction = Rotation.from_euler("xyz", [0.3, -0.4, 0.8], degrees=True).as_matrix()
    np.testing.assert_allclose(camera.rig_R_camera, nominal @ correction @ FLU_R_RDF, atol=1e-15)
    np.testing.assert_allclose(camera.rig_t_camera_m, [1.91, -0.92, 1.13], atol=1e-15)


@pytest.mark.parametrize(
    "key", ["sensor2Rig", "nominalSensor2Rig", "sensor2Rig_FLU", "nominalSensor2Rig_FLU"]
)
def test_rig_reads_every_form_of_the_extrinsics(key: str) -> None:
    """Quaternions (x, y, z, w) turn the renamed axes in the FLU forms, the camera's own in the older ones."""
    flu = Rotation.from_euler("xyz", [2.0, -3.0, 50.0], degrees=True)
    rotation = flu if key.endswith("_FLU") else flu * Rotation.from_matrix(FLU_R_RDF)
    transform = {"quaternion": rotation.as_quat().tolist(), "t": [1.0, 2.0, 3.0]}
    camera = front(**{"nominalSensor2Rig_FLU": None, key: transform})
    np.testing.assert_allclose(camera.rig_R_camera, flu.as_matrix() @ FLU_R_RDF, atol=1e-14)
    np.testing.assert_array_equal(camera.rig_t_camera_m, [1.0, 2.0, 3.0])


def test_rig_reads_antennas_with_their_lever_arms() -> None:
    """A gps sensor is an antenna: lever arm with its correction, and the recording's file."""
    rig = rig_from_document(document(gps_sensor(correction_rig_T=[0.0, 0.1, 0.0])), "car.json")
    antenna = rig.antennas["gnss50:vehicle"]
    np.testing.assert_allclose(antenna.rig_t_antenna_m, [0.5, -0.3, 1.6])
    assert antenna.file == "gnss50_vehicle.bin"


def test_rig_ignores_what_it_does_not_know() -> None:
    """Other sensors, other keys and null properties change nothing."""
    can = {"name": "can:vehicle0", "protocol": "can.virtual", "properties": None}
    lidar = {"name": "lidar", "protocol": "lidar.virtual", "parameter": "file=x.pcap"}
    rig = rig_from_document(document(can, camera_sensor(colour="red"), lidar, gps_sensor()), "car.json")
    assert list(rig.cameras) == ["front"]
    assert list(rig.antennas) == ["gnss50:vehicle"]


def test_rig_reads_the_model_in_any_case() -> None:
    """``FTheta`` and ``ftheta`` are the same model."""
    assert ftheta_of(Model=" FTheta ") == ftheta_of()


def test_rig_reads_polynomials_in_both_directions() -> None:
    """``polynomial-type`` says which way a polynomial goes, and ``polynomial`` wins over ``bw-poly``."""
    backward = ftheta_of(**{"polynomial": "0 0.001 1e-9", "polynomial-type": "pixeldistance-to-angle"})
    assert backward.theta_from_r == (0.0, 1e-3, 1e-9)
    assert backward.r_from_theta is None
    forward = ftheta_of(**{"polynomial": "0 1000 1 2 3 4", "polynomial-type": "angle-to-pixeldistance"})
    assert forward.r_from_theta == (0.0, 1000.0, 1.0, 2.0, 3.0, 4.0)
    assert forward.theta_from_r is None


def test_rig_reads_polynomials_that_are_lists() -> None:
    """A JSON list of numbers, or of their texts, is the string with blanks; what is in it must be numbers."""
    listed = [0.0, 1e-3, "2.0e-8", 4e-11, 1.2e-14]
    assert front(properties={**FTHETA, "bw-poly": listed}).model == ftheta_of()
    brown = [-0.2, 0.05, 1e-3, -1e-3, 0]
    assert front(properties={**PINHOLE, "distortion": brown}).model == pinhole_of(
        distortion="-0.2 0.05 1e-3 -1e-3 0"
    )
    for bad in ([0.0, None], [[0.0, 1e-3]], [0.0, True]):
        with pytest.raises(CalibrationError, match=r"bw-poly of sensor front .* expected finite numbers"):
            front(properties={**FTHETA, "bw-poly": bad})


def test_rig_reads_linear_terms() -> None:
    """``linear-c``, ``linear-d`` and ``linear-e`` reach the camera; without them they are the identity."""
    camera = ftheta_of(**{"linear-c": "1.002", "linear-d": "-0.001", "linear-e": "0.003"})
    assert (camera.c, camera.d, camera.e) == (1.002, -0.001, 0.003)
    assert (ftheta_of().c, ftheta_of().d, ftheta_of().e) == (1.0, 0.0, 0.0)


def test_rig_reads_pinhole_cameras_under_all_their_names() -> None:
    """Focal lengths by three names; five coefficients are OpenCV's, three DriveWorks' radial ones."""
    plain = PinholeCamera(1280, 720, 900.0, 905.0, 640.0, 360.0)
    assert pinhole_of() == plain
    assert pinhole_of(fx=None, fy=None, **{"focal-x": "900", "focal-y": "905"}) == plain
    assert pinhole_of(fx=None, fy=None, focalX="900", focalY="905") == plain
    assert pinhole_of(distortion="-0.2 0.05 1e-3 -1e-3 0.01").distortion == (-0.2, 0.05, 1e-3, -1e-3, 0.01)
    assert pinhole_of(distortion="-0.2 0.05 0.01").distortion == (-0.2, 0.05, 0.0, 0.0, 0.01)


@pytest.mark.parametrize(
    ("properties", "reason"),
    [
        (
            {"Model": "mystery", "cx": "1"},
            "model is mystery, and only ftheta, pinhole, ocam, fisheye, fisheye624, fov and omni are",
        ),
        ({"cx": "1"}, "name no Model"),
        (None, "name no Model"),
        (
            {**FTHETA, "windshield-horizontal-polynomial": "0 1 0"},
            "vertical windshield polynomial has 0 numbers",
        ),
    ],
)
def test_rig_keeps_cameras_it_cannot_use_apart(properties: dict[str, str] | None, reason: str) -> None:
    """One camera of another model does not stop the rig; asking for it says why it cannot be used."""
    odd = {"name": "odd", "protocol": "camera.gmsl", "properties": properties}
    rig = rig_from_document(document(camera_sensor(), odd), "car.json")
    assert list(rig.cameras) == ["front"]
    assert reason in rig.unsupported["odd"]
    with pytest.raises(CalibrationError, match=rf"odd in car\.json cannot be used.*{reason}"):
        rig.camera("odd")


def test_rig_reads_the_screen_before_a_camera() -> None:
    """Polynomials as text or list, forward unless said otherwise; zeros and the identity are no screen."""
    horizontal, vertical = "windshield-horizontal-polynomial", "windshield-vertical-polynomial"
    inverse = {f"{horizontal}-approx-inverse": "0 0.99 0", f"{vertical}-approx-inverse": [0, 0, 0.98]}
    bending = {horizontal: "0.001 1.01 0", vertical: [0.002, 0.0, 1.02]}
    for more, forward in ({}, True), ({"windshield-polynomial-type": "Backward"}, False):
        model = front(properties={**FTHETA, **bending, **inverse, **more}).model
        screen = Windshield((0.001, 1.01, 0), (0.002, 0, 1.02), forward, (0, 0.99, 0), (0, 0, 0.98))
        assert model == WindshieldCamera(ftheta_of(), screen)
    for flat in ({horizontal: "0 0 0", vertical: "0 " * 15}, {horizontal: "0 1 0", vertical: "0 0 1"}):
        assert front(properties={**FTHETA, **flat}).model == ftheta_of()
    odd = camera_sensor(properties={**FTHETA, **bending, "windshield-polynomial-type": "up"})
    reason = rig_from_document(document(odd), "car.json").unsupported["front"]
    assert 'windshield-polynomial-type of sensor front in car.json is "up"' in reason


def test_rig_names_its_cameras_when_asked_for_another() -> None:
    """A camera that only the annotations know is an error that lists those of the rig."""
    rig = rig_from_document(document(camera_sensor(), camera_sensor(name="rear")), "car.json")
    with pytest.raises(CalibrationError, match=r"no camera left in car\.json \(its cameras: front, rear\)"):
        rig.camera("left")


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (
            camera_sensor(nominalSensor2Rig_FLU=None),
            r"nominalSensor2Rig_FLU of sensor front in car\.json is mis",
        ),
        (gps_sensor(nominalSensor2Rig_FLU=None), r"nominalSensor2Rig_FLU of sensor gnss50:vehicle"),
        (camera_sensor(nominalSensor2Rig_FLU={"t": [0, 0, 0]}), "neither roll-pitch-yaw nor quaternion"),
        (camera_sensor(nominalSensor2Rig_FLU={**LEVEL, "t": [1, 2]}), r"FLU\.t of sensor front .* 3 finite"),
        (camera_sensor(nominalSensor2Rig_FLU={**LEVEL, "t": "here"}), r"FLU\.t of sensor front"),
        (
            camera_sensor(nominalSensor2Rig_FLU={"roll-pitch-yaw": [0, 0, math.nan]}),
            "roll-pitch-yaw of sensor",
        ),
        (camera_sensor(nominalSensor2Rig_FLU={"quaternion": [1, 1, 0, 0]}), "expected a unit quaternion"),
        (camera_sensor(correction_rig_T=[1]), "correction_rig_T of sensor front"),
        (camera_sensor(correction_sensor_R_FLU=[1, 2, 3]), "correction_sensor_R_FLU of sensor front"),
        (camera_sensor(properties={**FTHETA, "cx": "abc"}), r'cx of sensor front in car\.json is "abc"'),
        (camera_sensor(properties={**FTHETA, "cy": " "}), "cy of sensor front .* is missing"),
        (camera_sensor(properties={**FTHETA, "width": "12.5"}), "width of sensor front .* is 12.5"),
        (camera_sensor(properties={**FTHETA, "bw-poly": " "}), "polynomial or bw-poly of sensor front"),
        (camera_sensor(properties={**FTHETA, "bw-poly": "0 1e-3 inf"}), "bw-poly of sensor front"),
        (
            camera_sensor(properties={**FTHETA, "bw-poly": "0 -1e-3"}),
            r"sensor front in car\.json .* not rise",
        ),
        (
            camera_sensor(properties={**FTHETA, "polynomial": "0 1"}),
            'polynomial-type of sensor front .* is ""',
        ),
        (camera_sensor(properties={**PINHOLE, "fx": None}), "fx or focal-x or focalX of sensor front"),
        (camera_sensor(properties={**PINHOLE, "distortion": "1 2"}), "distortion of sensor front .* has 2"),
        ({"protocol": "camera.virtual"}, r"Sensor number 1 in car\.json has no name"),
        ({"name": "front"}, r"Sensor front in car\.json has no protocol"),
        ("front", r"Sensor number 1 in car\.json is not an object"),
    ],
)
def test_rig_errors_name_sensor_key_and_file(sensor: Any, message: str) -> None:
    """What is malformed is refused with one sentence that says what and where."""
    with pytest.raises(CalibrationError, match=message):
        rig_from_document(document(sensor), "car.json")


def test_rig_refuses_two_sensors_of_one_name() -> None:
    """Which of the two a recording belongs to cannot be known."""
    with pytest.raises(CalibrationError, match=r"Two sensors in car\.json are called front"):
        rig_from_document(document(camera_sensor(), gps_sensor(name="front")), "car.json")


def test_rig_file_is_known_by_its_content() -> None:
    """A rig is what has a list of sensors, whatever the file is called."""
    assert looks_like_rig(document())
    others: tuple[object, ...] = ({}, {"rig": {}}, {"rig": {"sensors": {}}}, {"sensors": []}, [], None, "rig")
    for other in others:
        assert not looks_like_rig(other)


def test_rig_file_is_read_with_or_without_a_byte_order_mark(tmp_path: Path) -> None:
    """Editors on Windows put one there."""
    for encoding in ("utf-8", "utf-8-sig"):
        path = tmp_path / f"{encoding}.json"
        path.write_text(json.dumps(document(camera_sensor())), encoding=encoding)
        rig = read_rig(path)
        assert list(rig.cameras) == ["front"]
        assert rig.source == str(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"rig": ', r"car\.json is not JSON"),
        (b"\xff\xfe\x00", r"car\.json is not JSON"),
        (b'{"version": 7}', r"car\.json is no rig file"),
        (b"[1, 2]", r"car\.json is no rig file"),
        (None, r"Cannot read the rig file .*car\.json"),
    ],
)
def test_rig_file_that_is_none_is_refused(tmp_path: Path, content: bytes | None, message: str) -> None:
    """Missing, truncated, binary and foreign files are one clear sentence each."""
    path = tmp_path / "car.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CalibrationError, match=message):
        read_rig(path)
