"""COLMAP's ``cameras.txt``: what its models mean, against COLMAP's own pixels, and damaged ones."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.calibration_files import calibration_kind, read_cameras
from geoloc.cameras import FisheyeCamera, OmniCamera, PinholeCamera
from geoloc.errors import CalibrationError

LINE = "1 OPENCV 1280 720 900 905 640.5 360.25 -0.1 0.02 0.001 -0.0005"
# Three points, and where pycolmap 4.2.1 (`Camera.img_from_cam`) sees them, in its own pixels.
POINTS = np.array([[0.5, -0.3, 1.0], [-1.2, 0.7, 1.0], [0.1, 0.9, 0.4]])
SEEN = {
    "OPENCV 1280 720 900 905 640.5 360.25 -0.1 0.02 0.001 -0.0005": (
        (1075.5924, 97.959642),
        (-315.19434, 922.072733),
        (867.032813, 2435.881641),
    ),
    "FOV 1280 720 600 605 640.5 360.25 0.9": (
        (933.775675, 182.818216),
        (104.691899, 675.409348),
        (724.571774, 1123.201349),
    ),
    "THIN_PRISM_FISHEYE 1280 720 500 505 640.5 360.25 0.01 -0.002 0.001 -0.0005 0.001 -0.0001 0.002 -0.001": (
        (867.417814, 222.864462),
        (228.216399, 603.549944),
        (706.158773, 947.995985),
    ),
}


@pytest.mark.parametrize("line", SEEN, ids=lambda line: line.split()[0])
def test_colmap_camera_sees_what_colmap_sees(line: str) -> None:
    """Half a pixel less, as COLMAP counts from the corner of the first pixel."""
    (camera,) = read_cameras(f"3 {line}\n".encode(), "cameras.txt").values()
    pixel, _ = camera.model.pixel_from_camera_point(POINTS)
    np.testing.assert_allclose(pixel + 0.5, SEEN[line], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("line", "model"),
    [
        ("SIMPLE_PINHOLE 640 480 500 320 240", PinholeCamera(640, 480, 500, 500, 319.5, 239.5)),
        ("PINHOLE 640 480 500 501 320 240", PinholeCamera(640, 480, 500, 501, 319.5, 239.5)),
        (
            "RADIAL 640 480 500 320 240 -0.1 0.02",
            PinholeCamera(640, 480, 500, 500, 319.5, 239.5, (-0.1, 0.02, 0, 0, 0, 0, 0, 0)),
        ),
        (
            "FULL_OPENCV 640 480 500 501 320 240 1 2 3 4 5 6 7 8",
            PinholeCamera(640, 480, 500, 501, 319.5, 239.5, (1, 2, 3, 4, 5, 6, 7, 8)),
        ),
        ("FISHEYE 640 480 500 501 320 240", FisheyeCamera(640, 480, 500, 501, 319.5, 239.5)),
        (
            "RADIAL_FISHEYE 640 480 500 320 240 0.01 0.02",
            FisheyeCamera(640, 480, 500, 500, 319.5, 239.5, (0.01, 0.02, 0, 0)),
        ),
        (
            "OPENCV_FISHEYE 640 480 500 501 320 240 0.01 0.02 0.03 0.04",
            FisheyeCamera(640, 480, 500, 501, 319.5, 239.5, (0.01, 0.02, 0.03, 0.04)),
        ),
        (
            "EUCM 640 480 500 501 320 240 0.6 1.1",
            OmniCamera(640, 480, 0.0, 500, 501, 319.5, 239.5, alpha=0.6, beta=1.1),
        ),
    ],
    ids=lambda value: value.split()[0] if isinstance(value, str) else "",
)
def test_colmap_models_are_ours(line: str, model: object) -> None:
    """Each of COLMAP's models, its parameters in its own order."""
    (camera,) = read_cameras(f"1 {line}".encode(), "cameras.txt").values()
    assert camera.model == model
    assert camera.camera_T_body is None


def test_colmap_cameras_are_called_by_their_numbers() -> None:
    """Comments and blank lines aside; a camera 7 is no polynomial of seven coefficients."""
    text = "# Camera list\r\n\r\n7 PINHOLE 640 480 500 501 320 240\r\n12 SIMPLE_PINHOLE 64 48 50 32 24\r\n"
    assert calibration_kind(text.encode()) == "colmap"
    assert list(read_cameras(text.encode(), "cameras.txt")) == ["7", "12"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LINE.replace("OPENCV", "RAD_TAN_THIN_PRISM_FISHEYE"), "camera 1 in a.txt is of the model 'RAD_TAN"),
        (LINE.removesuffix(" -0.0005"), "gives parameters as 7 numbers: expected 8"),
        (LINE.replace("900", "nine"), "gives parameters as a list of 8: expected finite numbers"),
        (LINE.replace("900", "-900"), "camera 1 in a.txt makes no camera: a pinhole camera with focal"),
        (f"{LINE}\n2", "camera 2 in a.txt is of the model ''"),
        (f"{LINE}\n{LINE}", "camera 1 in a.txt stands there twice"),
        (f"{LINE}\n" * 1001, "a.txt holds 1001 cameras, one for each picture"),
    ],
    ids=range(7),
)
def test_damaged_colmap_file_is_refused_with_its_fault(text: str, message: str) -> None:
    """The camera, the file, what is wrong."""
    with pytest.raises(CalibrationError, match=message.replace(".", r"\.")):
        read_cameras(text.encode(), "a.txt")
