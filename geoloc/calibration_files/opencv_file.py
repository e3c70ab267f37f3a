"""OpenCV's calibration files (YAML and JSON), and the ROS ``camera_info`` YAML that grew out of them.

The names of the keys are not settled: OpenCV's own programs have changed them, and everybody's script has its
own. They are compared without case and underscores.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from geoloc.calibration_files.document import CalibratedCamera, Section, built, json_document, yaml_document
from geoloc.cameras import CameraModel, FisheyeCamera, PinholeCamera
from geoloc.errors import CalibrationError

_MATRIX = ("cameramatrix", "intrinsicmatrix", "k", "mtx")
_DISTORTION = (
    "distortioncoefficients",
    "distortioncoeffs",
    "distcoeffs",
    "distcoeff",
    "distcoef",
    "dist",
    "d",
)
_WIDTH, _HEIGHT = ("imagewidth", "width"), ("imageheight", "height")
_SIZE = ("imagesize", "resolution")
_NAME = ("cameraname",)
_MODEL = ("distortionmodel", "cameramodel", "model")
_PINHOLE_MODELS = ("", "pinhole", "plumb_bob", "rational_polynomial", "radtan", "brown", "opencv", "standard")
_FISHEYE_MODELS = ("fisheye", "equidistant", "kannala_brandt", "kannalabrandt", "opencv_fisheye")
_FLAG = ("fisheyemodel", "fisheye", "isfisheye")
_KEY = re.compile(
    rb"(?im)^[\s{,]*\"?(camera_?matrix|intrinsic_?matrix|dist(ortion)?_?coef\w*|K|mtx)\"?\s*:|opencv-matrix"
)


_AS_PINHOLE = (
    "{} is read as pinhole (k1 k2 p1 p2), as the file names no model: if cv2.fisheye calibrated it, add"
    " fisheye_model: 1; if not, fisheye_model: 0."
)
_UNSAFE = re.compile(r"[^ -~]|[\"\\]")


def looks_like_opencv(head: bytes) -> bool:
    """Whether a file begins like a calibration by OpenCV or ROS: a camera matrix under one of its names."""
    return _KEY.search(head) is not None


def read_opencv(content: bytes, where: str) -> dict[str, CalibratedCamera]:
    """Read a calibration by OpenCV or ROS: one camera, under its name in the file, else ``camera``.

    Fisheye is what says so: ``fisheye_model: 1``, as OpenCV's calibration program writes it, or a
    ``distortion_model`` (``camera_model``, ``model``) ``equidistant`` or ``fisheye``. Four coefficients alone
    are k1 k2 p1 p2 of the pinhole model, with a warning where the lens is wide: ``cv2.fisheye`` makes four,
    and ``cv2.FileStorage`` writes no model of its own accord.

    Raises
    ------
    CalibrationError
        If something is missing, is no number, makes no camera, or is of another model.
    """
    is_json = content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")
    document = json_document(content, where) if is_json else yaml_document(content, where)
    section = Section(_renamed(document), where)
    width_px, height_px = _size(section)
    fx_px, fy_px, cx_px, cy_px = _focal_and_centre(section)
    numbers = section.numbers(_DISTORTION[0]) if _DISTORTION[0] in section.values else ()
    model, distortion = _model(section, numbers)
    camera = built(
        where,
        model,
        width_px=width_px,
        height_px=height_px,
        fx_px=fx_px,
        fy_px=fy_px,
        cx_px=cx_px,
        cy_px=cy_px,
        distortion=distortion,
    )
    unsaid = len(numbers) == 4 and any(numbers) and not any(section.text(k) for k in (*_MODEL, _FLAG[0]))
    warning = _AS_PINHOLE.format(where) if unsaid and _is_wide(camera) else ""
    return {section.text(_NAME[0]) or "camera": CalibratedCamera(camera, warning=warning)}


def opencv_text(model: CameraModel, name: str = "camera") -> str:
    """Write a camera as OpenCV's YAML, which ``cv2.FileStorage`` and ROS read.

    Raises
    ------
    CalibrationError
        If OpenCV has no such model: it knows pinhole and fisheye.
    """
    if not isinstance(model, PinholeCamera | FisheyeCamera):
        raise CalibrationError(
            f"OpenCV has no model for this {model.model} camera: write it as a rig file instead, or calibrate"
            " another model (pinhole or fisheye)."
        )
    fisheye = isinstance(model, FisheyeCamera)
    # OpenCV takes no fewer: fisheye four, pinhole four, five, eight or twelve.
    distortion = (*model.distortion, *(0.0,) * 4)[: max(4, len(model.distortion))]
    matrix = (model.fx_px, 0.0, model.cx_px, 0.0, model.fy_px, model.cy_px, 0.0, 0.0, 1.0)
    lines = [
        "%YAML:1.0",
        "---",
        f'camera_name: "{_UNSAFE.sub("_", name)}"',
        f"image_width: {model.width_px}",
        f"image_height: {model.height_px}",
        f"fisheye_model: {int(fisheye)}",
        f"distortion_model: {'equidistant' if fisheye else _ros_model(distortion)}",
        *_matrix("camera_matrix", 3, 3, matrix),
        *_matrix("distortion_coefficients", 1, len(distortion), distortion),
    ]
    return "\n".join(lines) + "\n"


def _renamed(document: Mapping[str, Any]) -> dict[str, Any]:
    """Known keys under the first of their names; matrices as their numbers."""
    values: dict[str, Any] = {}
    for key, value in document.items():
        plain = str(key).lower().replace("_", "")
        for names in (_MATRIX, _DISTORTION, _WIDTH, _HEIGHT, _SIZE, _NAME, _FLAG):
            if plain in names:
                values.setdefault(names[0], value.get("data") if isinstance(value, Mapping) else value)
        if plain in _MODEL:
            values.setdefault(plain, value)
    return values


def _size(section: Section) -> tuple[int, int]:
    if _WIDTH[0] in section.values or _SIZE[0] not in section.values:
        for key, name in ((_WIDTH[0], "image_width"), (_HEIGHT[0], "image_height")):
            if key not in section.values:
                raise section.error(f"has no {name}: add the size of the calibrated images to the file.")
        return section.size(_WIDTH[0], _HEIGHT[0])
    return section.size(_SIZE[0])


def _focal_and_centre(section: Section) -> tuple[float, float, float, float]:
    if _MATRIX[0] not in section.values:
        raise section.error("has no camera_matrix: export the calibration with it.")
    fx, skew, cx, below, fy, cy, *last = section.numbers(_MATRIX[0], 9)
    if last != [0.0, 0.0, 1.0] or below != 0.0 or abs(skew) > 1e-6 * abs(fx):
        raise section.error(
            "has a camera_matrix that is not [fx 0 cx; 0 fy cy; 0 0 1]: skewed pixels are not supported."
        )
    return fx, fy, cx, cy


def _model(section: Section, numbers: tuple[float, ...]) -> tuple[type[CameraModel], tuple[float, ...]]:
    """The model that the file says, and its coefficients."""
    said = [section.text(key).lower() for key in _MODEL if section.text(key)]
    if any(name in _FISHEYE_MODELS for name in said) or section.text(_FLAG[0]).lower() in {"1", "true"}:
        return FisheyeCamera, numbers
    unknown = [name for name in said if name not in _PINHOLE_MODELS]
    if unknown:
        raise section.error(
            f"is of the model {unknown[0]!r}, and only pinhole and fisheye (equidistant) are supported."
        )
    if any(numbers[12:]):
        raise section.error(
            f"has {len(numbers)} distortion coefficients: tilted sensors are not supported; calibrate with at"
            " most 12 (rational with a thin prism)."
        )
    return PinholeCamera, numbers[: 12 if any(numbers[8:]) else 8]


def _is_wide(camera: CameraModel) -> bool:
    """Whether the picture spans 90 degrees or more, or reaches where the model folds."""
    if not isinstance(camera, PinholeCamera):
        return False
    corners = [[u, v] for u in (0.0, camera.width_px - 1.0) for v in (0.0, camera.height_px - 1.0)]
    if not camera.camera_ray_from_pixel(np.array(corners))[1].all():
        return True
    return 2.0 * math.atan(0.5 * camera.width_px / camera.fx_px) >= 0.5 * math.pi


def _ros_model(distortion: tuple[float, ...]) -> str:
    return "rational_polynomial" if len(distortion) > 5 else "plumb_bob"


def _matrix(name: str, rows: int, cols: int, numbers: Iterable[float]) -> list[str]:
    listed = ", ".join(repr(float(number)) for number in numbers)
    return [
        f"{name}: !!opencv-matrix",
        f"   rows: {rows}",
        f"   cols: {cols}",
        "   dt: d",
        f"   data: [ {listed} ]",
    ]
