"""mrcal's camera files, against mrcal itself."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_samples import FTHETA, MRCAL, OMNI, PINHOLE, PRISM, RATIONAL

from geoloc.calibration_files import mrcal_text, read_cameras
from geoloc.calibration_files.document import MAX_BYTES
from geoloc.cameras import CameraModel, OmniCamera, PinholeCamera
from geoloc.errors import CalibrationError

STEREOGRAPHIC = OmniCamera(1280, 960, 1.0, 800.0, 801.0, 640, 480)
FOCAL = [900.5, 905.25, 645.1, 352.7]
BROWN = [-0.2, 0.05, 8e-4, -1.2e-3, 0.01, 0.03, -0.02, 0.005, 1e-3, -4e-4, -8e-4, 3e-4]
POINTS = np.array([[0.3, -0.2, 1.0], [-0.5, 0.3, 1.2], [0.6, 0.35, 1.0]])
PIXELS = {
    "PINHOLE": [[915.25, 171.65], [269.89166666666665, 579.0125], [1185.4, 669.5375]],
    "OPENCV4": [
        [908.0329427500001, 176.48675075],
        [285.78354035172333, 569.4441786313657],
        [1138.55345734375, 642.7213782617187],
    ],
    "OPENCV5": [
        [908.0388779455, 176.48277308149997],
        [285.7341523163778, 569.4739677611802],
        [1139.160371015172, 643.0772787065996],
    ],
    "OPENCV8": [
        [907.1012456474598, 177.111158524995],
        [287.884942408521, 568.1766866522989],
        [1134.074216485487, 640.0947051626443],
    ],
    "OPENCV12": [
        [907.2122232674599, 177.02160214249503],
        [288.07747986994076, 568.020834872785],
        [1134.424850924237, 639.8085030199882],
    ],
    "STEREOGRAPHIC": [
        [906.9982943234854, 177.18015477598723],
        [289.75632654536366, 567.0308342441817],
        [1132.3880398412282, 638.4507390768001],
    ],
    "CAHVOR": [
        [912.0995107, 173.76140509999996],
        [277.95719827031894, 574.1476543692129],
        [1162.3865293375, 656.0421631296874],
    ],
}
"""`POINTS` by ``mrcal.project`` of mrcal 2.2, through these models with `FOCAL` and `BROWN`."""


def cameramodel(lens: str, numbers: list[float], **more: str) -> bytes:
    """A file as mrcal writes it, in one line."""
    values = {
        "lensmodel": f"'LENSMODEL_{lens}'",
        "intrinsics": str(numbers),
        "imagersize": "[1280, 720]",
        **more,
    }
    return ("{" + ", ".join(f"'{key}': {value}" for key, value in values.items()) + "}").encode()


@pytest.mark.parametrize("lens", PIXELS)
def test_every_lens_projects_as_mrcal_does(lens: str) -> None:
    """To 1e-9 px; CAHVOR's axis is the camera's here."""
    count = int(lens.removeprefix("OPENCV")) if lens.startswith("OPENCV") else 0
    more = [0.0, 0.0, 0.001, -0.1, 0.02] if lens == "CAHVOR" else BROWN[:count]
    camera = read_cameras(cameramodel(lens, FOCAL + more), "a.cameramodel")["camera"]
    pixel, _ = camera.model.pixel_from_camera_point(POINTS)
    np.testing.assert_allclose(pixel, PIXELS[lens], rtol=0, atol=1e-9)
    assert camera.camera_T_body is None


def test_pose_is_read_as_mrcals() -> None:
    """Rodrigues vector and translation, from the reference frame, as ``mrcal.transform_point_rt`` has it."""
    camera = read_cameras(MRCAL.encode(), "a.cameramodel")["camera"]
    assert camera.camera_T_body is not None
    assert camera.body == "ref"
    point = camera.camera_T_body @ [1.0, 2.0, 3.0, 1.0]
    expected = [0.9796280447045543, 2.198000233322445, 2.7387908073134453, 1.0]
    np.testing.assert_allclose(point, expected, rtol=0, atol=1e-14)


def test_megabytes_of_optimization_inputs_are_passed_over() -> None:
    """Mrcal keeps the corners of all pictures in the file, which may be longer than any camera needs."""
    long = MRCAL.replace("P)h>@", "P)h>@#{" * MAX_BYTES)
    (camera,) = read_cameras(long.encode(), "a.cameramodel").values()
    assert camera.model == PinholeCamera(1280, 720, *FOCAL, tuple(BROWN[:8]))


@pytest.mark.parametrize(
    "model",
    [
        PinholeCamera(1280, 720, *FOCAL),
        PINHOLE,
        RATIONAL,
        PRISM,
        OmniCamera(1280, 960, 1.0, 800.0, 801.0, 640, 480),
    ],
)
def test_camera_is_written_and_read_again(model: CameraModel) -> None:
    """To the last bit, with its pose."""
    pose = np.array([[0.0, -1, 0, 1 / 3], [0, 0, -1, 1.4], [1, 0, 0, -1.7], [0, 0, 0, 1]])
    text = mrcal_text(model, pose, "front\nmounted")
    assert text.startswith("# front\n# mounted\n{")
    camera = read_cameras(text.encode(), "a.cameramodel")["camera"]
    assert camera.model == model
    assert camera.camera_T_body is not None
    np.testing.assert_allclose(camera.camera_T_body, pose, rtol=0, atol=1e-15)


@pytest.mark.parametrize("model", [FTHETA, OMNI])
def test_model_that_mrcal_does_not_have_is_not_written(model: CameraModel) -> None:
    """It is named, with what to do."""
    with pytest.raises(CalibrationError, match=f"mrcal has no model for this {model.model} camera"):
        mrcal_text(model)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            cameramodel("SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=18_fov_x_deg=150", FOCAL + [0.0] * 1080),
            "SPLINED_STEREOGRAPHIC_order=3.*convert it with mrcal-convert-lensmodel LENSMODEL_OPENCV8 a",
        ),
        (cameramodel("CAHVOR", [*FOCAL, 0.01, 0.0, 0.0, 0.0, 0.0]), "whose lens leans: convert it"),
        (cameramodel("OPENCV4", FOCAL), "gives intrinsics as 4 numbers: expected 8"),
        (cameramodel("OPENCV4", [*FOCAL, 0, 0, 0, float("nan")]), "expected finite numbers"),
        (cameramodel("PINHOLE", FOCAL, extrinsics="[1, 2, 3]"), "gives extrinsics as 3 numbers: expected 6"),
        (cameramodel("PINHOLE", FOCAL, imagersize="[0, 720]"), "makes no camera: an image of 0 x 720"),
        (b"{'lensmodel': 'LENSMODEL_PINHOLE'}", "has no imagersize"),
    ],
)
def test_camera_file_that_cannot_be_used_is_refused(content: bytes, message: str) -> None:
    """One sentence: what, where, cure."""
    with pytest.raises(CalibrationError, match=rf"a\.cameramodel.*{message}|{message}.*a\.cameramodel"):
        read_cameras(content, "a.cameramodel")
