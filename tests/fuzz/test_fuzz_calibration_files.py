"""Calibration files and rig files, damaged."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from calibration_samples import EXTENDED, FISHEYE, FISHEYE624, FOV, MRCAL, OCAM, OMNI, PINHOLE, SPHERES
from mutate import either, fuzzed, mutated, mutated_json, real_files

from geoloc.calibration_files.colmap import read_colmap
from geoloc.calibration_files.kalibr import kalibr_text, read_kalibr
from geoloc.calibration_files.mrcal import read_mrcal
from geoloc.calibration_files.ocamcalib import ocamcalib_text, read_ocam_yaml, read_ocamcalib
from geoloc.calibration_files.opencv_file import opencv_text, read_opencv
from geoloc.calibration_files.opensfm import opensfm_text, read_opensfm
from geoloc.calibration_files.read import CalibratedCamera, calibration_kind, read_cameras
from geoloc.cameras import (
    FThetaCamera,
)
from geoloc.errors import CalibrationError
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera, rig_document

FTHETA = FThetaCamera(1920, 1208, 950.25, 610.5, (0.0, 1e-3, 2e-8, 4e-11))
POSE = "  T_cam_imu:\n  - [0, -1, 0, 1]\n  - [1, 0, 0, 2]\n  - [0, 0, 1, 3]\n  - [0, 0, 0, 1]\n"
LAFIDA = b"%YAML:1.0\nCamera.Iw: 754\nCamera.Ih: 480\nCamera.nrpol: 3\nCamera.a0:-209.5\nCamera.a1: 0.0\n"
LAFIDA += (
    b"Camera.a2: 2e-3\nCamera.c: 1.0\nCamera.d: 0.0\nCamera.e: 0.0\nCamera.u0: 392.5\nCamera.v0: 243.25\n"
)
MASK = np.zeros((12, 16), dtype=bool)
MODELS = {
    "a": PINHOLE,
    "b": FISHEYE,
    "c": OMNI,
    "d": OCAM,
    "e": FTHETA,
    "f": SPHERES,
    "g": FISHEYE624,
    "h": FOV,
}
COLMAP = b"""# Camera list
1 FULL_OPENCV 1280 720 900 905 640.5 360.25 0.4 0.1 3e-4 -2e-4 0.01 0.75 0.25 0.03
2 THIN_PRISM_FISHEYE 1280 720 500 505 640.5 360.25 0.01 -0.002 1e-3 -5e-4 0.001 -1e-4 2e-3 -1e-3
3 FOV 1280 720 600 605 640.5 360.25 0.9
4 EUCM 1280 720 500 505 640.5 360.25 0.6 1.1
5 RADIAL_FISHEYE 1280 720 500 640.5 360.25 0.01 -0.002
"""
RIG = Rig(
    {name: RigCamera(name, model, FLU_R_RDF, np.ones(3), None, None, MASK) for name, model in MODELS.items()},
    {},
    "made up",
)
SOUND = [
    (kalibr_text([PINHOLE, FISHEYE, FOV, SPHERES, EXTENDED, OMNI]) + POSE).encode(),
    opencv_text(PINHOLE).encode(),
    opencv_text(FISHEYE).encode(),
    json.dumps({"K": np.eye(3).tolist(), "dist": [0.0] * 5, "image_size": [640, 480]}).encode(),
    opensfm_text({"a": PINHOLE, "b": FISHEYE, "c": FISHEYE624}).encode(),
    ocamcalib_text(OCAM).encode(),
    LAFIDA,
    COLMAP,
    MRCAL.encode(),
    json.dumps(rig_document(RIG)).encode(),
]
DOCUMENTS = [json.loads(sound) for sound in SOUND if sound.startswith(b"{")]
REAL = [*real_files("camera_models"), *real_files("naplab", ".json")]
Reader = Callable[[bytes, str], Mapping[str, CalibratedCamera]]
READERS: tuple[Reader, ...] = (
    read_cameras,
    read_cameras,
    read_kalibr,
    read_opencv,
    read_opensfm,
    read_colmap,
    read_ocamcalib,
    read_ocam_yaml,
    read_mrcal,
)


def check(camera: CalibratedCamera) -> None:
    """A camera that was read answers finitely, or says that it does not see."""
    model = camera.model
    pixel = np.array([[0.0, 0.0], [0.5 * model.width_px, 0.5 * model.height_px]])
    ray, seen = model.camera_ray_from_pixel(pixel)
    again, _ = model.pixel_from_camera_point(ray)
    assert np.isfinite(ray[seen]).all()
    np.testing.assert_allclose(again[seen], pixel[seen], rtol=0, atol=1e-3)


@pytest.mark.parametrize("sound", SOUND)
def test_sound_calibration_files_are_read(sound: bytes) -> None:
    """What the damage begins with is whole."""
    assert calibration_kind(sound) is not None
    for camera in read_cameras(sound, "a.file").values():
        check(camera)


@fuzzed(
    either(mutated([*SOUND, *REAL]), *(mutated([sound]) for sound in SOUND), mutated_json(DOCUMENTS)),
    lambda random: random.choice(READERS),
    parsers=len(READERS) + 1,
)
def test_calibration_readers_raise_nothing_but_calibration_errors(content: bytes, read: Reader) -> None:
    """Whatever the bytes, and whichever reader: a CalibrationError that names the file, or cameras."""
    cameras: Mapping[str, CalibratedCamera] = {}
    said = ""
    try:
        cameras = read(content, "a.file")
    except CalibrationError as error:
        said = str(error)
    assert cameras or "a.file" in said
    assert len(said) < 2000
    for camera in cameras.values():
        check(camera)
