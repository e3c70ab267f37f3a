"""mrcal's ``.cameramodel``: one camera, written as a Python dictionary.

mrcal counts pixels from the centre of the first one, and its ``LENSMODEL_OPENCV…`` have OpenCV's coefficients
in OpenCV's order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration_files.document import CalibratedCamera, Section, built, text_lines
from geoloc.cameras import CameraModel, OmniCamera, PinholeCamera
from geoloc.errors import CalibrationError

_OPENCV: Final = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
}
"""Models of OpenCV, and how many coefficients they have."""
_STEREOGRAPHIC, _CAHVOR = "LENSMODEL_STEREOGRAPHIC", "LENSMODEL_CAHVOR"
_HEAD = re.compile(rb"['\"](lensmodel|distortion_model)['\"]\s*:\s*['\"](LENSMODEL|DISTORTION)_")
# Megabytes of base 85, which has no quotation marks: the pictures' corners, for mrcal's own tools.
_OPTIMIZATION = re.compile(rb"['\"]optimization_inputs['\"]\s*:\s*b?['\"][^'\"]*['\"]")
_VALUE = re.compile(
    r"['\"](lensmodel|distortion_model|intrinsics|extrinsics|imagersize)['\"]\s*:"
    r"\s*(?:['\"]([^'\"]*)['\"]|[\[(]([^\])]*)[\])])"
)
_CONVERT = "mrcal-convert-lensmodel LENSMODEL_OPENCV8"
_MOST_WORDS = 65


def looks_like_mrcal(head: bytes) -> bool:
    """Whether a file begins like mrcal's: a dictionary that names its lens model."""
    return _HEAD.search(head) is not None


def read_mrcal(content: bytes, where: str) -> dict[str, CalibratedCamera]:
    """Read a ``.cameramodel``: one camera, named ``camera``.

    Pinhole and OpenCV's models, the stereographic one, and CAHVOR where its axis is the camera's, which makes
    it OpenCV's with two coefficients.

    Raises
    ------
    CalibrationError
        If something is missing, is no number, makes no camera, or is of another model: splined ones have
        hundreds of parameters, and mrcal converts them.
    """
    lines = text_lines(_OPTIMIZATION.sub(b"'optimization_inputs': ''", content), where)
    text = "\n".join(line.partition("#")[0] for line in lines)
    values: dict[str, Any] = {}
    for key, word, numbers in _VALUE.findall(text):
        values.setdefault(key, word or numbers.replace(",", " ").split(maxsplit=_MOST_WORDS)[:_MOST_WORDS])
    section = Section(values, where)
    name = (section.text("lensmodel") or section.text("distortion_model")).replace("DISTORTION", "LENSMODEL")
    known = (*_OPENCV, _STEREOGRAPHIC, _CAHVOR)
    if name not in known:
        raise section.error(
            f"is of the model {name[:80]!r}, and only {', '.join(known)} are supported: convert it with"
            f" {_CONVERT} {where[:80]}."
        )
    width_px, height_px = section.size("imagersize")
    model, parameters = _parameters(section, name)
    camera = built(where, model, width_px=width_px, height_px=height_px, **parameters)
    if "extrinsics" not in values:
        return {"camera": CalibratedCamera(camera)}
    return {"camera": CalibratedCamera(camera, _transform(section.numbers("extrinsics", 6)), "ref")}


def mrcal_text(model: CameraModel, camera_T_ref: FloatArray | None = None, note: str = "") -> str:
    """Write a camera as ``.cameramodel``.

    Parameters
    ----------
    model : CameraModel
    camera_T_ref : float64 (4, 4), optional
        Turns points of mrcal's reference frame into the camera's (RDF), metres; the identity by default.
    note : str
        Comment lines at the top.

    Raises
    ------
    CalibrationError
        If mrcal has no such model: it knows pinhole, and the stereographic of omni.
    """
    from scipy.spatial.transform import Rotation

    name, numbers = _written(model)
    transform = np.eye(4) if camera_T_ref is None else camera_T_ref
    extrinsics = [*Rotation.from_matrix(transform[:3, :3]).as_rotvec(), *transform[:3, 3]]
    lines = [
        *(f"# {line}" for line in note.splitlines()),
        "{",
        f"    'lensmodel':  '{name}',",
        "",
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....",
        f"    'intrinsics': [ {_listed(numbers)} ],",
        "",
        "    # extrinsics are rt_fromref",
        f"    'extrinsics': [ {_listed(extrinsics)} ],",
        "",
        f"    'imagersize': [ {model.width_px}, {model.height_px}, ],",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _parameters(section: Section, name: str) -> tuple[type[CameraModel], dict[str, Any]]:
    """The model here that a lens model is, and its parameters but for the size."""
    more = 5 if name == _CAHVOR else _OPENCV.get(name, 0)
    fx, fy, cx, cy, *distortion = section.numbers("intrinsics", 4 + more)
    if name == _STEREOGRAPHIC:
        # 2 f tan(θ / 2) is 2 f sin θ / (1 + cos θ), Mei's model of a unit sphere.
        return OmniCamera, {"xi": 1.0, "fx_px": 2.0 * fx, "fy_px": 2.0 * fy, "cx_px": cx, "cy_px": cy}
    if name == _CAHVOR:
        *axis, r0, r1, r2 = distortion
        if any(axis) or r0 <= -1.0:
            raise section.error(
                f"is a CAHVOR camera whose lens leans: convert it with {_CONVERT} {section.where[:80]}."
            )
        fx, fy = fx * (1.0 + r0), fy * (1.0 + r0)
        distortion = [r1 / (1.0 + r0), r2 / (1.0 + r0), 0.0, 0.0]
    focal = {"fx_px": fx, "fy_px": fy, "cx_px": cx, "cy_px": cy}
    return PinholeCamera, {**focal, "distortion": tuple(distortion)}


def _written(model: CameraModel) -> tuple[str, tuple[float, ...]]:
    if isinstance(model, PinholeCamera):
        name = next(key for key, count in _OPENCV.items() if count == len(model.distortion))
        return name, (model.fx_px, model.fy_px, model.cx_px, model.cy_px, *model.distortion)
    if isinstance(model, OmniCamera) and (model.xi, model.alpha) == (1.0, 0.0) and not any(model.distortion):
        return _STEREOGRAPHIC, (0.5 * model.fx_px, 0.5 * model.fy_px, model.cx_px, model.cy_px)
    raise CalibrationError(
        f"mrcal has no model for this {model.model} camera: write it as a rig file instead, or calibrate the"
        " model pinhole."
    )


def _transform(rt: Sequence[float]) -> FloatArray:
    from scipy.spatial.transform import Rotation

    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(rt[:3]).as_matrix()
    transform[:3, 3] = rt[3:]
    return transform


def _listed(numbers: Sequence[float]) -> str:
    return " ".join(f"{float(number)!r}," for number in numbers)
