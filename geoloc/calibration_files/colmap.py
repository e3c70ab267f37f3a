"""COLMAP's ``cameras.txt``: a line a camera, pixels counted from the corner of the first one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from geoloc.calibration_files.document import CalibratedCamera, Section, built, first_lines, text_lines
from geoloc.cameras import CameraModel, Fisheye624Camera, FisheyeCamera, FovCamera, OmniCamera, PinholeCamera
from geoloc.errors import CalibrationError

_MODELS: Mapping[str, tuple[type[CameraModel], str]] = {
    "SIMPLE_PINHOLE": (PinholeCamera, "f cx cy"),
    "PINHOLE": (PinholeCamera, "fx fy cx cy"),
    "SIMPLE_RADIAL": (PinholeCamera, "f cx cy k1"),
    "RADIAL": (PinholeCamera, "f cx cy k1 k2"),
    "OPENCV": (PinholeCamera, "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": (PinholeCamera, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "SIMPLE_FISHEYE": (FisheyeCamera, "f cx cy"),
    "FISHEYE": (FisheyeCamera, "fx fy cx cy"),
    "SIMPLE_RADIAL_FISHEYE": (FisheyeCamera, "f cx cy k1"),
    "RADIAL_FISHEYE": (FisheyeCamera, "f cx cy k1 k2"),
    "OPENCV_FISHEYE": (FisheyeCamera, "fx fy cx cy k1 k2 k3 k4"),
    # Its sx1 and sy1 are our s0 and s2.
    "THIN_PRISM_FISHEYE": (Fisheye624Camera, "fx fy cx cy k1 k2 p1 p2 k3 k4 s0 s2"),
    "FOV": (FovCamera, "fx fy cx cy omega_rad"),
    "EUCM": (OmniCamera, "fx fy cx cy alpha beta"),
}
_DISTORTION: Mapping[type[CameraModel], str] = {
    PinholeCamera: "k1 k2 p1 p2 k3 k4 k5 k6",
    FisheyeCamera: "k1 k2 k3 k4",
    Fisheye624Camera: "k1 k2 k3 k4 k5 k6 p1 p2 s0 s1 s2 s3",
}
"""Order of `distortion`."""
_CAMERA = re.compile(r"\d+\s+[A-Z][A-Z0-9_]+\s+\d+\s+\d+\s+\S", re.ASCII)
_MOST_WORDS, _MOST_CAMERAS = 40, 1000


def looks_like_colmap(head: bytes) -> bool:
    """Whether a file begins like ``cameras.txt``: after comments, ``1 OPENCV 1920 1080 …``."""
    return _CAMERA.match(first_lines(head, 1)[0]) is not None


def read_colmap(content: bytes, where: str) -> dict[str, CalibratedCamera]:
    """Read the cameras of ``cameras.txt``, under their numbers.

    Raises
    ------
    CalibrationError
        If there is none or more than 1000, one is of another model or lacks something, or two share a number.
    """
    cameras: dict[str, CalibratedCamera] = {}
    lines = text_lines(content, where)
    if len(lines) > _MOST_CAMERAS:
        raise CalibrationError(
            f"{where} holds {len(lines)} cameras, one for each picture it seems: reconstruct with one for a"
            " whole drive (--ImageReader.single_camera_per_folder 1)."
        )
    for line in lines:
        number, model, *numbers = (*line.split(maxsplit=_MOST_WORDS)[:_MOST_WORDS], "", "")
        section = Section(
            {"size": numbers[:2], "parameters": numbers[2:-2]}, f"camera {number:.80} in {where}"
        )
        if number in cameras:
            raise section.error("stands there twice: leave one of them out.")
        cameras[number] = CalibratedCamera(_model(section, model))
    if not cameras:
        raise CalibrationError(f"{where} holds no camera: give COLMAP's cameras.txt.")
    return cameras


def _model(section: Section, name: str) -> CameraModel:
    if name not in _MODELS:
        raise section.error(f"is of the model {name[:60]!r}, and only {', '.join(_MODELS)} are supported.")
    model, order = _MODELS[name]
    width_px, height_px = section.size("size")
    names = order.split()
    values = dict(zip(names, section.numbers("parameters", len(names)), strict=True))
    coefficients = _DISTORTION.get(model, "").split()
    bent = any(name in coefficients for name in names)
    shape: dict[str, Any] = {key: values[key] for key in ("omega_rad", "alpha", "beta") if key in values}
    if bent:
        shape["distortion"] = tuple(values.get(key, 0.0) for key in coefficients)
    if model is OmniCamera:
        shape["xi"] = 0.0
    return built(
        section.where,
        model,
        width_px=width_px,
        height_px=height_px,
        fx_px=values.get("fx", values.get("f")),
        fy_px=values.get("fy", values.get("f")),
        cx_px=values["cx"] - 0.5,
        cy_px=values["cy"] - 0.5,
        **shape,
    )
