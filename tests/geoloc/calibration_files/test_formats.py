"""Calibration files of other tools: read, written, told apart, and refused in one sentence."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_samples import (
    EXTENDED,
    FILES,
    FISHEYE,
    FISHEYE62,
    FISHEYE624,
    FOV,
    FTHETA,
    KALIBR,
    KALIBR_FOV,
    LAFIDA,
    OCAM,
    OCAMCALIB,
    OMNI,
    OPENCV,
    OPENSFM,
    PINHOLE,
    PRISM,
    RATIONAL,
    ROS,
    SPHERES,
)

from geoloc.calibration_files import (
    CALIBRATION_KINDS,
    calibration_kind,
    kalibr_text,
    ocamcalib_text,
    opencv_text,
    opensfm_text,
    read_cameras,
)
from geoloc.calibration_files.document import MAX_BYTES, MAX_YAML_BYTES
from geoloc.cameras import (
    CameraModel,
    FisheyeCamera,
    FovCamera,
    OcamCamera,
    OmniCamera,
    PinholeCamera,
)
from geoloc.errors import CalibrationError


def only(text: str) -> CameraModel:
    """Read the one camera of a file."""
    cameras = read_cameras(text.encode(), "front.file")
    assert len(cameras) == 1
    return next(iter(cameras.values())).model


def assert_same_rays(a: CameraModel, b: CameraModel, rad: float) -> None:
    """Both see every pixel of the image alike, to this many radians."""
    assert (a.width_px, a.height_px) == (b.width_px, b.height_px)
    u, v = np.meshgrid(np.linspace(0.0, a.width_px - 1.0, 30), np.linspace(0.0, a.height_px - 1.0, 20))
    pixel = np.stack([u, v], axis=-1)
    (one, seen), (other, also) = a.camera_ray_from_pixel(pixel), b.camera_ray_from_pixel(pixel)
    np.testing.assert_array_equal(seen, also)
    np.testing.assert_allclose(one[seen], other[seen], rtol=0, atol=rad)


@pytest.mark.parametrize("kind", CALIBRATION_KINDS)
def test_calibration_kind_is_told_by_the_content(kind: str) -> None:
    """Each format is recognised, also behind a byte order mark; other files are none of them."""
    assert calibration_kind(FILES[kind].encode()) == kind
    assert calibration_kind(b"\xef\xbb\xbf" + FILES[kind].encode()) == kind
    assert read_cameras(FILES[kind].encode(), "x")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"frame,time_ns\n0,1\n",
        b"$GPGGA,1,2*00\n",
        b'{"images": []}',
        b"\x89PNG\r\n",
        b"5 1 2 3\n",
        b"K\n",
    ],
)
def test_calibration_kind_of_other_files_is_none(content: bytes) -> None:
    """What is no calibration is not taken for one, and the refusal lists the formats."""
    assert calibration_kind(content) is None
    with pytest.raises(CalibrationError, match=r"^x\.bin is no calibration file.*Kalibr camchain"):
        read_cameras(content, "x.bin")


def test_kalibr_chain_is_read_as_written() -> None:
    """Models, and the pose of the second camera against the first."""
    cameras = read_cameras(KALIBR.encode(), "camchain.yaml")
    assert list(cameras) == ["cam0", "cam1"]
    assert cameras["cam0"].model == PinholeCamera(
        752, 480, 458.0, 457.0, 367.0, 248.0, (-0.28, 0.07, 1e-4, 2e-5)
    )
    assert cameras["cam0"].camera_T_body is None
    assert cameras["cam1"].model == OmniCamera(
        752, 480, 1.5, 800.0, 801.0, 370.0, 240.0, (-0.2, 0.1, 0.0, 0.0)
    )
    assert cameras["cam1"].body == "cam0"
    pose = cameras["cam1"].camera_T_body
    assert pose is not None
    np.testing.assert_allclose(pose @ [1.0, 2.0, 3.0, 1.0], [-1.9, 1.2, 3.3, 1.0], atol=1e-15)


def test_kalibr_fov_is_read_as_written() -> None:
    """Kalibr's one coefficient w is the ω of Devernay and Faugeras."""
    assert only(KALIBR_FOV) == FovCamera(752, 480, 458.0, 457.0, 367.0, 248.0, 0.9)


def test_opencv_yaml_is_read_as_written() -> None:
    """OpenCV's own matrices; five coefficients are the pinhole model's."""
    assert only(OPENCV) == PinholeCamera(
        1280, 720, 900.5, 905.25, 645.1, 352.7, (-0.2, 0.05, 8e-4, -1.2e-3, 0.0)
    )


def test_ros_camera_info_is_read_as_fisheye_where_it_says_so() -> None:
    """``equidistant`` is the fisheye model, and the camera has its name."""
    cameras = read_cameras(ROS.encode(), "camera_info.yaml")
    assert list(cameras) == ["narrow_stereo"]
    assert cameras["narrow_stereo"].model == FISHEYE


@pytest.mark.parametrize("suffix", ["yaml", "json"])
@pytest.mark.parametrize("fisheye", [False, True])
def test_opencv_file_storage_is_read(tmp_path: Path, suffix: str, fisheye: bool) -> None:
    """Files that OpenCV itself writes, under the names of its calibration program."""
    model = FISHEYE if fisheye else RATIONAL
    path = tmp_path / f"out.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", model.width_px)
    storage.write("image_height", model.height_px)
    storage.write("fisheye_model", int(fisheye))
    matrix = [[model.fx_px, 0.0, model.cx_px], [0.0, model.fy_px, model.cy_px], [0.0, 0.0, 1.0]]
    storage.write("camera_matrix", np.array(matrix))
    storage.write("distortion_coefficients", np.array(model.distortion)[:, np.newaxis])
    storage.release()
    assert calibration_kind(path.read_bytes()) == "opencv"
    assert only(path.read_text()) == model


@pytest.mark.parametrize("model", [PINHOLE, RATIONAL, PRISM, FISHEYE])
def test_opencv_text_is_read_by_opencv(tmp_path: Path, model: PinholeCamera | FisheyeCamera) -> None:
    """``cv2.FileStorage`` finds the same numbers in what is written, and so does our reader."""
    path = tmp_path / "front.yaml"
    path.write_text(opencv_text(model, 'C1 "front"'))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    matrix = storage.getNode("camera_matrix").mat()
    distortion = storage.getNode("distortion_coefficients").mat()
    assert storage.getNode("image_width").real() == model.width_px
    assert storage.getNode("fisheye_model").real() == isinstance(model, FisheyeCamera)
    storage.release()
    np.testing.assert_array_equal(
        matrix[:2].ravel(), [model.fx_px, 0, model.cx_px, 0, model.fy_px, model.cy_px]
    )
    np.testing.assert_array_equal(distortion.ravel(), model.distortion)
    assert only(path.read_text()) == model


def test_opencv_json_of_a_script_is_read() -> None:
    """Nested lists and other spellings of the keys, as scripts dump them."""
    document = {
        "K": [[900.5, 0, 645.1], [0, 905.25, 352.7], [0, 0, 1]],
        "dist": [[-0.2, 0.05, 8.0e-4, -1.2e-3]],
        "image_size": [1280, 720],
        "rms": 0.3,
    }
    assert only(json.dumps(document, indent=1)) == PINHOLE


def test_ocamcalib_agrees_with_a_hand_worked_ray() -> None:
    """Row first: with the plane 40 down and 30 right, ρ is 50 and f = -200 + 0.002 · 2500 = -195."""
    model = only(OCAMCALIB)
    # [row - 240.5, column - 390.25] = [[1.25, 0.5], [0.25, 1]] @ [40, 30] = [65, 40].
    ray, seen = model.camera_ray_from_pixel(np.array([390.25 + 40.0, 240.5 + 65.0]))
    assert seen
    np.testing.assert_allclose(ray * math.sqrt(30**2 + 40**2 + 195**2), [30.0, 40.0, 195.0], atol=1e-12)


def test_ocam_yaml_puts_the_column_first() -> None:
    """Its own program computes u = c x + d y + u0, which is how the model has it."""
    assert only(LAFIDA) == OcamCamera(754, 480, 392.5, 243.25, (-209.5, 0.0, 0.002), 0.999, -0.003, 0.004)


def test_opensfm_lengths_are_parts_of_the_longer_side() -> None:
    """From the middle of the image: 1920 · 0.01 + 959.5 is the column of the principal point."""
    cameras = read_cameras(OPENSFM.encode(), "camera_models.json")
    front, wide = (camera.model for camera in cameras.values())
    distortion = (-0.1, 0.02, 1e-4, 2e-4, 0.003)
    assert isinstance(front, PinholeCamera)
    assert (front.fx_px, front.cx_px, front.cy_px) == pytest.approx((1440.0, 978.7, 501.1))
    assert front.fy_px == pytest.approx(1459.2)
    assert front.distortion == distortion
    assert wide == FisheyeCamera(600, 800, 400.0, 400.0, 299.5, 399.5, (0.01, 0.02))


@pytest.mark.parametrize(
    ("write", "model", "rad"),
    [
        (lambda m: kalibr_text([m]), PINHOLE, 0.0),
        (lambda m: kalibr_text([m]), FISHEYE, 0.0),
        (lambda m: kalibr_text([m]), FOV, 0.0),
        (lambda m: kalibr_text([m]), OMNI, 0.0),
        (lambda m: kalibr_text([m]), SPHERES, 0.0),
        (lambda m: kalibr_text([m]), EXTENDED, 0.0),
        (lambda m: opensfm_text({"front": m}), PINHOLE, 1e-12),
        (lambda m: opensfm_text({"front": m}), FISHEYE, 1e-12),
        (lambda m: opensfm_text({"front": m}), FISHEYE62, 1e-12),
        (lambda m: opensfm_text({"front": m}), FISHEYE624, 1e-12),
        (ocamcalib_text, OCAM, 1e-12),
    ],
    ids=[
        "kalibr pinhole",
        "kalibr fisheye",
        "kalibr fov",
        "kalibr omni",
        "kalibr ds",
        "kalibr eucm",
        "opensfm brown",
        "opensfm fisheye",
        "opensfm fisheye62",
        "opensfm fisheye624",
        "ocamcalib",
    ],
)
def test_written_calibration_sees_the_same(
    write: Callable[[CameraModel], str], model: CameraModel, rad: float
) -> None:
    """What is written is read back as the same rays: exactly, or to rounding where lengths are scaled."""
    assert_same_rays(only(write(model)), model, rad)


def test_ocamcalib_text_carries_a_fitted_inverse() -> None:
    """Its inverse polynomial, used as OCamCalib's own program does, gives the pixel to 0.02 px."""
    lines = [line.split() for line in ocamcalib_text(OCAM).splitlines() if line and not line.startswith("#")]
    inverse = [float(word) for word in lines[1][1:]]
    c, d, e = (float(word) for word in lines[3])
    assert int(lines[1][0]) == len(inverse)
    pixel = np.random.default_rng(1).uniform(0.0, [751.0, 479.0], (200, 2))
    ray, _ = OCAM.camera_ray_from_pixel(pixel)
    down, right, backward = ray[:, 1], ray[:, 0], -ray[:, 2]
    across = np.hypot(down, right)
    rho = np.polynomial.polynomial.polyval(np.arctan(backward / across), inverse)
    x, y = down / across * rho, right / across * rho
    row, column = c * x + d * y + float(lines[2][0]), e * x + y + float(lines[2][1])
    np.testing.assert_allclose(np.column_stack([column, row]), pixel, rtol=0, atol=0.02)


@pytest.mark.parametrize(
    "write",
    [lambda m: kalibr_text([m]), opencv_text, lambda m: opensfm_text({"front": m})],
    ids=["kalibr", "opencv", "opensfm"],
)
def test_writers_refuse_a_model_that_the_format_lacks(write: Callable[[CameraModel], str]) -> None:
    """The tool, the model, and what to do instead."""
    with pytest.raises(CalibrationError, match="has no model for this ftheta camera: write it as a rig file"):
        write(FTHETA)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            KALIBR.replace("radtan", "odd", 1),
            r"cam0 in a\.file is of the model 'pinhole' with 'odd', and only",
        ),
        (KALIBR.replace("radtan", "fov", 1), "gives distortion_coeffs as 4 numbers: expected 1"),
        (KALIBR_FOV.replace("0.9", "9.0"), "makes no camera: a fov camera with omega 9 is none"),
        (KALIBR.replace("pinhole", "ds"), "'ds' with 'radtan'"),
        (KALIBR.replace("458.0, ", ""), "gives intrinsics as 3 numbers: expected 4"),
        (KALIBR.replace("458.0", ".nan"), "gives intrinsics as a list of 4: expected finite numbers"),
        (KALIBR.replace("  resolution: [752, 480]\n", ""), "has no resolution"),
        (KALIBR.replace("[752, 480]", "[752.5, 480]"), "image side of 752.5 pixels"),
        (KALIBR.replace("-1.0, 0.0, 0.1", "-0.9, 0.0, 0.1"), "T_cn_cnm1 that is no rotation"),
        (KALIBR.replace("458.0", "-458.0"), "cam0 in a.file makes no camera: a pinhole camera with focal"),
        (KALIBR + "  x: [", "not valid YAML"),
        (OPENCV.replace("image_width: 1280\n", ""), "has no image_width: add the size"),
        (OPENCV.replace("data: [ -2.0", "data: [ 1, -2.0"), "6 distortion coefficients given"),
        (OPENCV.replace("e+02, 0., 6", "e+02, 3., 6"), "skewed pixels are not supported"),
        (
            OPENCV.replace("flags: 0", "distortion_model: ftheta"),
            "is of the model 'ftheta', and only pinhole",
        ),
        (OPENCV.replace("camera_matrix: !!", "odd_matrix: !!"), "has no camera_matrix"),
        (OCAMCALIB.replace("480 752", ""), "has 4 lines of numbers: OCamCalib writes five"),
        (OCAMCALIB.replace("1.25 0.5", "0.0 0.5"), "affine parameter c as 0"),
        (OCAMCALIB.replace("390.25", "1e999"), "gives centre as a list of 2"),
        (OCAMCALIB.replace("-200.0", "200.0"), "makes no camera: the ocam polynomial"),
        (LAFIDA.replace("Camera.u0: 392.5", ""), "has no u0"),
        (LAFIDA.replace("nrpol: 3", "nrpol: 1e9"), "announces 1e"),
        (OPENSFM.replace("brown", "spherical"), "has the projection 'spherical', and only perspective"),
        (OPENSFM.replace('"focal_y": 0.76, ', ""), "has no focal_y"),
        ('{"a": {"rotation": [0, 0, 0], "translation": [0, 0, 0]}}', "poses of a, and no intrinsics"),
        (OPENSFM[:-1], "not valid JSON"),
    ],
)
def test_damaged_calibration_is_refused_with_its_fault(text: str, message: str) -> None:
    """The file, the camera in it, what is wrong and what to do."""
    with pytest.raises(CalibrationError, match=message) as caught:
        read_cameras(text.encode(), "a.file")
    assert "a.file" in str(caught.value)


def test_calibration_of_a_flagged_rational_model_keeps_eight_coefficients() -> None:
    """Fourteen with zeros behind the eighth, as OpenCV may write them, are the rational model.

    With zeros behind the twelfth they are one with a thin prism; a tilted sensor is refused.
    """
    document = {
        "camera_matrix": [820.0, 0, 955.0, 0, 822.0, 548.0, 0, 0, 1],
        "dist_coeffs": [*RATIONAL.distortion, *[0.0] * 6],
        "image_size": [1920, 1080],
    }
    assert only(json.dumps(document, indent=1)) == RATIONAL
    document["dist_coeffs"] = [*PRISM.distortion, 0.0, 0.0]
    assert only(json.dumps(document, indent=1)) == PRISM
    document["dist_coeffs"] = [*PRISM.distortion, 0.1, 0.0]
    with pytest.raises(CalibrationError, match="tilted sensors"):
        only(json.dumps(document, indent=1))


def test_yaml_that_multiplies_itself_stays_small() -> None:
    """Nine nested aliases of nine each, a thousand million lines if written out, are only not numbers."""
    bomb = "a0: &a0 [x, x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 10)
    )
    text = KALIBR.replace("intrinsics: [458.0, 457.0, 367.0, 248.0]", "intrinsics: *a9")
    with pytest.raises(CalibrationError, match="gives intrinsics as a list of 9"):
        read_cameras((bomb + text).encode(), "bomb.yaml")


def test_yaml_nested_beyond_all_depth_is_refused() -> None:
    """Brackets that would overflow a stack are only no valid YAML."""
    for nested in ("[" * 500_000, "- " * 100_000, "{a: " * 100_000):
        with pytest.raises(CalibrationError, match="not valid YAML"):
            read_cameras(f"{KALIBR}x: {nested}".encode(), "deep.yaml")


def test_calibration_file_beyond_the_cap_is_refused() -> None:
    """A file of megabytes is not parsed at all."""
    with pytest.raises(CalibrationError, match=r"is 2 MB, and a calibration file of its kind has at most 1"):
        read_cameras(KALIBR.encode() + b"#" * (2 * MAX_YAML_BYTES), "camchain.yaml")
    with pytest.raises(CalibrationError, match="is 8 MB"):
        read_cameras(OPENSFM.encode() + b" " * (2 * MAX_BYTES), "camera_models.json")
