"""Rigs: what a DriveWorks rig file means, and that it can be written again."""

from __future__ import annotations

import base64
import json
import math
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from geoloc.cameras import CameraModel, FisheyeCamera, FThetaCamera, OcamCamera, OmniCamera, PinholeCamera
from geoloc.errors import CalibrationError
from geoloc.rig import (
    FLU_R_RDF,
    Antenna,
    Rig,
    RigCamera,
    looks_like_rig,
    read_rig,
    rig_document,
    rig_from_document,
    rig_with_lever_arms,
    without_template_masks,
)

FTHETA = {
    "Model": "ftheta",
    "width": "1920",
    "height": "1208",
    "cx": "950.25",
    "cy": "610.5",
    "bw-poly": "0.000000000000000 1.0e-3 2.0e-8 4.0e-11 1.2e-14 ",
}
PINHOLE = {
    "Model": "pinhole",
    "width": "1280",
    "height": "720",
    "cx": "640",
    "cy": "360",
    "fx": "900",
    "fy": "905",
}
LEVEL = {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [1.8, 0.2, 1.5]}


def camera_sensor(**changes: Any) -> dict[str, Any]:
    """Build one good camera entry with changes; None removes a key."""
    sensor = {
        "name": "front",
        "protocol": "camera.virtual",
        "parameter": "video=front.h264,timestamp=front.h264.timestamps",
        "properties": FTHETA,
        "nominalSensor2Rig_FLU": LEVEL,
    }
    return {key: value for key, value in {**sensor, **changes}.items() if value is not None}


def gps_sensor(name: str = "gnss50:vehicle", **changes: Any) -> dict[str, Any]:
    """Build one good antenna entry with changes."""
    return {
        "name": name,
        "protocol": "gps.virtual",
        "parameter": "file=gnss50_vehicle.bin,output-timestamp=smoothed",
        "properties": None,
        "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, -0.0, 0.0], "t": [0.5, -0.4, 1.6]},
        **changes,
    }


def document(*sensors: dict[str, Any]) -> dict[str, Any]:
    """Wrap sensors as a rig file does."""
    return {"rig": {"sensors": list(sensors), "vehicle": {"valid": True}, "vehicleio": []}, "version": 7}


def front(**changes: Any) -> RigCamera:
    """Read one camera entry with changes."""
    return rig_from_document(document(camera_sensor(**changes)), "car.json").camera("front")


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


def test_rig_prefers_the_nominal_extrinsics_in_flu() -> None:
    """A file that keeps an older form beside the new one is read by the new one."""
    older = {"quaternion": [0.0, 0.0, 0.0, 1.0], "t": [9.0, 9.0, 9.0]}
    np.testing.assert_array_equal(front(sensor2Rig=older).rig_t_camera_m, LEVEL["t"])


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
            {"Model": "fov", "cx": "1"},
            "camera model is fov, and only ftheta, pinhole, ocam, fisheye and omni are",
        ),
        ({"cx": "1"}, "name no Model"),
        (None, "name no Model"),
        ({**FTHETA, "windshield-horizontal-polynomial": "0 1 0"}, "windshield"),
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


def test_rig_lever_arms_can_be_replaced() -> None:
    """The copy has the new lever arm, the other antenna its own, and the original is untouched."""
    rig = rig_from_document(document(gps_sensor(), gps_sensor("gnss52:vehicle")), "car.json")
    copy = rig_with_lever_arms(rig, {"gnss52:vehicle": (0.1, 0.2, 1.7)})
    np.testing.assert_array_equal(copy.antennas["gnss52:vehicle"].rig_t_antenna_m, [0.1, 0.2, 1.7])
    np.testing.assert_array_equal(copy.antennas["gnss50:vehicle"].rig_t_antenna_m, [0.5, -0.4, 1.6])
    np.testing.assert_array_equal(rig.antennas["gnss52:vehicle"].rig_t_antenna_m, [0.5, -0.4, 1.6])
    assert copy.antennas["gnss52:vehicle"].file == rig.antennas["gnss52:vehicle"].file


@pytest.mark.parametrize(
    ("lever_arms", "message"),
    [
        (
            {"gnss99": (0.0, 0.0, 0.0)},
            r"gnss99, but car\.json has no such antenna \(its antennas: gnss50:vehicle\)",
        ),
        ({"gnss50:vehicle": (0.0, 0.0)}, "x forward, y left and z up"),
        ({"gnss50:vehicle": (0.0, 0.0, math.nan)}, "x forward, y left and z up"),
    ],
)
def test_rig_lever_arms_that_fit_no_antenna_are_refused(lever_arms: Any, message: str) -> None:
    """A misspelt antenna or a vector of another length is not silently dropped."""
    rig = rig_from_document(document(gps_sensor()), "car.json")
    with pytest.raises(CalibrationError, match=message):
        rig_with_lever_arms(rig, lever_arms)


def test_rig_arrays_are_read_only() -> None:
    """Many hold the same rig, so nobody may turn its cameras."""
    rig = rig_from_document(document(camera_sensor(), gps_sensor()), "car.json")
    for array in (
        rig.cameras["front"].rig_R_camera,
        rig.cameras["front"].rig_t_camera_m,
        rig.antennas["gnss50:vehicle"].rig_t_antenna_m,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_rig_decodes_the_car_mask() -> None:
    """Runs of (count, value), row by row, value 0 is the car: five of scene, two of car, one of scene."""
    runs = b"\x05\x00\x01" + b"\x02\x00\x00" + b"\x01\x00\x01"
    mask = {"data/rle16-base64": base64.b64encode(runs).decode(), "resolution": [4, 2]}
    camera = front(**{"car-mask": mask})
    assert camera.ego_mask is not None
    assert camera.ego_mask.tolist() == [[False] * 4, [False, True, True, False]]


@pytest.mark.parametrize(
    ("data", "resolution", "message"),
    [
        ("BQAB", [4, 2], "decodes to 5 pixels, not 4 x 2"),
        ("BQABAg==", [4, 2], "4 bytes, not a multiple of 3"),
        ("?!", [4, 2], "not base64"),
        ("BQAB", None, r"car-mask\.resolution of sensor front"),
        ("BQAB", [2.5, 2], r"car-mask\.resolution of sensor front"),
        ("BQAB", [-5, -1], r"car-mask\.resolution of sensor front"),
        ("//8A" * 2000, [65535, 2000], r"car-mask\.resolution of sensor front"),
    ],
)
def test_rig_refuses_a_broken_car_mask(data: str, resolution: list[int] | None, message: str) -> None:
    """A mask that does not fill its resolution would hide the wrong pixels."""
    with pytest.raises(CalibrationError, match=message):
        front(**{"car-mask": {"data/rle16-base64": data, "resolution": resolution}})


def rig_of(rpy_deg: tuple[float, float, float], mask: NDArray[np.bool_] | None = None) -> Rig:
    """A rig with all that can be written: every model, both polynomial directions, a mask, an antenna."""
    rotation = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix() @ FLU_R_RDF
    models: dict[str, CameraModel] = {
        "front": FThetaCamera(1920, 1208, 950.1, 610.7, theta_from_r=(0.0, 1e-3, 1 / 3e8), c=1.01, d=1e-3),
        "left": FThetaCamera(1920, 1080, 950.1, 540.7, r_from_theta=(0.0, 1000.0 / 3.0, 1.0)),
        "rear": PinholeCamera(1280, 720, 900.1, 905.2, 640.3, 360.4, (-0.2, 0.05, 1e-3, -1e-3, 1 / 3)),
        "roof": OcamCamera(752, 480, 394.1, 241.7, (-620 / 3, 0.0, 2e-3, -5e-6, 1.9e-8), 1.01, 1e-3, -2e-3),
        "right": FisheyeCamera(1280, 800, 600.1, 601.2, 639.9, 399.1, (0.01, 1 / 3e2, -0.001, 1e-4)),
        "back": OmniCamera(1280, 960, 4 / 3, 900.1, 901.2, 640.3, 480.4, (-0.2, 0.05, 1e-3, -1e-3)),
        "down": OmniCamera(1280, 960, -1 / 7, 400.1, 401.2, 640.3, 480.4, (), 0.6, 1.1),
    }
    cameras = {
        name: RigCamera(name, model, rotation, np.array([1 / 3, -0.1, 1.5]), f"{name}.h264", None, mask)
        for name, model in models.items()
    }
    antennas = {"gnss50": Antenna("gnss50", np.array([0.1, 1 / 3, 1.7]), "gnss50.bin")}
    return Rig(cameras, antennas, "made up")


@given(st.tuples(st.floats(-180.0, 180.0), st.floats(-90.0, 90.0), st.floats(-180.0, 180.0)))
def test_rig_document_reads_back_as_the_same_rig(rpy_deg: tuple[float, float, float]) -> None:
    """Through JSON text and back: intrinsics exactly, rotations to 1e-9, positions exactly."""
    rig = rig_of(rpy_deg)
    again = rig_from_document(json.loads(json.dumps(rig_document(rig))), rig.source)
    assert list(again.cameras) == list(rig.cameras)
    for name, camera in rig.cameras.items():
        assert again.cameras[name].model == camera.model
        assert again.cameras[name].video == camera.video
        assert again.cameras[name].timestamps is None
        np.testing.assert_allclose(again.cameras[name].rig_R_camera, camera.rig_R_camera, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(again.cameras[name].rig_t_camera_m, camera.rig_t_camera_m)
    np.testing.assert_array_equal(
        again.antennas["gnss50"].rig_t_antenna_m, rig.antennas["gnss50"].rig_t_antenna_m
    )
    assert again.antennas["gnss50"].file == "gnss50.bin"


@pytest.mark.parametrize("share", [0.0, 0.08, 1.0])
def test_rig_document_keeps_the_ego_mask(share: float) -> None:
    """Any mask comes back bit for bit, runs longer than a 16-bit count included."""
    mask = np.random.default_rng(5).random((302, 480)) < share
    rig = rig_of((0.0, 0.0, 0.0), mask)
    again = rig_from_document(rig_document(rig), rig.source)
    assert again.cameras["front"].ego_mask is not None
    np.testing.assert_array_equal(again.cameras["front"].ego_mask, mask)


def test_rig_document_of_numpy_numbers_is_plain_text() -> None:
    """Intrinsics that come out of a calibration as NumPy scalars are written as numbers."""
    poly = tuple(np.array([0.0, 1e-3, 1e-9]))
    model = FThetaCamera(1920, 1208, np.float64(950.5), np.float64(600.5), theta_from_r=poly)
    rig = Rig({"a": RigCamera("a", model, FLU_R_RDF, np.zeros(3))}, {}, "made up")
    again = rig_from_document(json.loads(json.dumps(rig_document(rig))), "made up")
    assert again.cameras["a"].model == model


def test_rig_document_refuses_to_lose_a_camera() -> None:
    """A rig with a camera of an unsupported model is not written without it."""
    rig = rig_from_document(document(camera_sensor(properties={"Model": "fov"})), "car.json")
    with pytest.raises(CalibrationError, match="front are not supported"):
        rig_document(rig)


def test_rig_document_refuses_a_model_that_rig_files_cannot_hold() -> None:
    """A camera model from elsewhere is named, not written as something else."""
    model: Any = SimpleNamespace(model="equirectangular", width_px=4096, height_px=2048)
    rig = Rig({"pano": RigCamera("pano", model, FLU_R_RDF, np.zeros(3))}, {}, "made up")
    with pytest.raises(CalibrationError, match="equirectangular of pano cannot be written"):
        rig_document(rig)


def test_without_template_masks_drops_only_shared_ones() -> None:
    """A mask that two cameras share bit for bit is a template; one that is a camera's own stays."""
    rig = rig_from_document(_three_masks(), "rig.json")
    kept, shared = without_template_masks(rig)
    assert shared == ("a", "b")
    assert kept.cameras["a"].ego_mask is None
    assert kept.cameras["b"].ego_mask is None
    assert kept.cameras["c"].ego_mask is not None
    assert rig.cameras["a"].ego_mask is not None  # the argument is not changed


def _three_masks() -> dict[str, Any]:
    """Three cameras with 2 x 1 masks: a and b the same, c another."""
    masks = {"a": (1, 0, 1, 1), "b": (1, 0, 1, 1), "c": (1, 1, 1, 0)}
    properties = {"Model": "pinhole", "width": "64", "height": "48", "fx": "60", "fy": "60", "cx": "31.5"}
    sensors = [
        {
            "name": name,
            "protocol": "camera.virtual",
            "properties": {**properties, "cy": "23.5"},
            "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0, 0, 0], "t": [0, 0, 1.5]},
            "car-mask": {
                "data/rle16-base64": base64.b64encode(
                    b"".join(struct.pack("<HB", runs[i], runs[i + 1]) for i in (0, 2))
                ).decode(),
                "resolution": [2, 1],
            },
        }
        for name, runs in masks.items()
    ]
    return {"rig": {"sensors": sensors}, "version": 7}
