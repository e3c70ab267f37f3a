"""Rigs that are changed and written: lever arms, car masks, and a document that reads back the same."""

from __future__ import annotations

import base64
import json
import math
import struct
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from rig_entries import FTHETA, camera_sensor, document, front, gps_sensor
from scipy.spatial.transform import Rotation

from geoloc.cameras import (
    CameraModel,
    Fisheye624Camera,
    FisheyeCamera,
    FovCamera,
    FThetaCamera,
    OcamCamera,
    OmniCamera,
    PinholeCamera,
    Windshield,
    WindshieldCamera,
)
from geoloc.errors import CalibrationError
from geoloc.rig.rig import (
    FLU_R_RDF,
    Antenna,
    Rig,
    RigCamera,
    rig_document,
    rig_from_document,
    rig_with_lever_arms,
    without_template_masks,
)


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
        "lamp": PinholeCamera(
            1280,
            720,
            900.1,
            905.2,
            640.3,
            360.4,
            (0.1, 0.2, 1e-3, 1e-3, 0.0, 0.0, 0.1, 0.0, 1 / 3e3, 0.0, 1e-4, 0.0),
        ),
        "wing": Fisheye624Camera(
            1280, 800, 600.1, 601.2, 639.9, 399.1, (0.01, 0, 0, 0, 0, 0, 1 / 3e3, 0, 1e-4)
        ),
        "sill": FovCamera(1280, 800, 600.1, 601.2, 639.9, 399.1, 2 / 3),
        "back": OmniCamera(1280, 960, 4 / 3, 900.1, 901.2, 640.3, 480.4, (-0.2, 0.05, 1e-3, -1e-3)),
        "screen": WindshieldCamera(
            FThetaCamera(1920, 1208, 950.1, 610.7, theta_from_r=(0.0, 1e-3)),
            Windshield((1 / 3e3, 1.0, 0.0), (0.0, 1 / 3e4, 1.01), False, (), (0.0, -1 / 3e4, 0.99)),
        ),
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
    """A rig with a camera of an unsupported model, of which no file is known, is not written without it."""
    read = rig_from_document(document(camera_sensor(properties={"Model": "mystery"})), "car.json")
    rig = Rig({}, {}, "car.json", read.unsupported)
    with pytest.raises(CalibrationError, match="front are not supported"):
        rig_document(rig)


def test_rig_that_was_read_is_written_as_it_was_read() -> None:
    """Spelling, poses, windshield, other sensors and keys, the vehicle: what did not change stays."""
    screen = {
        "windshield-horizontal-polynomial": "0.001 1.01 0",
        "windshield-vertical-polynomial": [0, 0, 1.02],
    }
    pose = {"quaternion": [0.0, 0.0, 0.0, 1.0], "t": [1.0, 2.0, 1.5]}
    read = document(
        {"name": "can", "protocol": "can.virtual", "parameter": "file=can.bin"},
        camera_sensor(colour="red", properties={**FTHETA, **screen, "readout": "11"}, sensor2Rig_FLU=pose),
        camera_sensor(name="odd", properties={"Model": "mystery"}),
        gps_sensor(correction_rig_T=[0.0, 0.0, 0.1]),
    )
    read["rig"]["vehicle"] = {"valid": True, "value": {"axleFront": {"x": 2.9}}}
    rig = rig_from_document(read, "car.json")
    assert rig_document(rig) == read
    camera = rig.cameras["front"]
    steeper = FThetaCamera(1920, 1208, 950.25, 610.5, (0.0, 1.1e-3))
    moved = replace(camera, model=steeper, rig_t_camera_m=np.array([1.0, 2.0, 1.6]))
    changed = rig_document(replace(rig, cameras={"front": moved}, antennas={}))
    can, front, odd = changed["rig"]["sensors"]
    assert (can, odd) == (read["rig"]["sensors"][0], read["rig"]["sensors"][2])
    assert front["properties"] == {**FTHETA, "bw-poly": "0.0 0.0011", "readout": "11"}
    assert front["nominalSensor2Rig_FLU"]["t"] == [1.0, 2.0, 1.6]
    assert "sensor2Rig_FLU" not in front
    assert front["colour"] == "red"
    assert rig_from_document(changed, "car.json").cameras["front"].model == steeper


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
