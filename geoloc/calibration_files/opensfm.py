"""OpenSfM's ``camera_models.json``: lengths in parts of the image's longer side, from its middle."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from geoloc.calibration_files.document import CalibratedCamera, Section, built, json_document, sections
from geoloc.cameras import CameraModel, Fisheye624Camera, FisheyeCamera, PinholeCamera
from geoloc.errors import CalibrationError

_BROWN = ("k1", "k2", "p1", "p2", "k3")
_FISHEYE62 = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_MODELS: Mapping[str, tuple[type[CameraModel], tuple[str, ...]]] = {
    "perspective": (PinholeCamera, _BROWN),
    "simple_radial": (PinholeCamera, _BROWN),
    "radial": (PinholeCamera, _BROWN),
    "brown": (PinholeCamera, _BROWN),
    "fisheye": (FisheyeCamera, ("k1", "k2")),
    "fisheye_opencv": (FisheyeCamera, ("k1", "k2", "k3", "k4")),
    "fisheye62": (Fisheye624Camera, _FISHEYE62),
    "fisheye624": (Fisheye624Camera, (*_FISHEYE62, "s0", "s1", "s2", "s3")),
}
"""Projection to model and the order of its distortion."""
_FEWER: Mapping[str, tuple[str, ...]] = {
    "perspective": ("k1", "k2"),
    "simple_radial": ("k1",),
    "radial": ("k1", "k2"),
}
"""Projections that take not all of these coefficients from a file."""
_ONE_FOCAL_LENGTH = ("perspective", "fisheye")


def looks_like_opensfm(head: bytes) -> bool:
    """Whether a JSON file begins like OpenSfM's cameras, or its ``rig_cameras.json``."""
    cameras = b'"projection_type"' in head
    return cameras or (b'"rotation"' in head and b'"translation"' in head and b'"sensors"' not in head)


def read_opensfm(content: bytes, where: str) -> dict[str, CalibratedCamera]:
    """Read the cameras of ``camera_models.json``, under their names.

    Raises
    ------
    CalibrationError
        If there is none, one is of another model, or lacks something. ``rig_cameras.json`` holds poses alone,
        and is refused with that sentence.
    """
    cameras, poses = {}, []
    for name, section in sections(json_document(content, where), where):
        if "projection_type" in section.values:
            cameras[name] = CalibratedCamera(_model(section))
        elif "rotation" in section.values:
            poses.append(name)
    if not cameras and poses:
        raise CalibrationError(
            f"{where} holds the poses of {', '.join(poses)[:200]}, and no intrinsics: give OpenSfM's"
            " camera_models.json."
        )
    if not cameras:
        raise CalibrationError(f"{where} holds no camera: give OpenSfM's camera_models.json.")
    return cameras


def opensfm_text(models: Mapping[str, CameraModel]) -> str:
    """Write cameras as ``camera_models.json``.

    Raises
    ------
    CalibrationError
        If OpenSfM has no such model: it knows pinhole (at most k1 k2 p1 p2 k3), fisheye and fisheye624.
    """
    return json.dumps({name: _written(model) for name, model in models.items()}, indent=4) + "\n"


def _model(section: Section) -> CameraModel:
    kind = section.text("projection_type")
    if kind not in _MODELS:
        raise section.error(f"has the projection {kind!r}, and only {', '.join(_MODELS)} are supported.")
    model, names = _MODELS[kind]
    width_px, height_px = section.size("width", "height")
    longer = max(width_px, height_px)
    one = kind in _ONE_FOCAL_LENGTH
    fx, fy = (section.number("focal" if one else f"focal_{axis}") for axis in "xy")
    cx, cy = (0.0 if one else section.number(f"c_{axis}", default=0.0) for axis in "xy")
    given = _FEWER.get(kind, names)
    return built(
        section.where,
        model,
        width_px=width_px,
        height_px=height_px,
        fx_px=longer * fx,
        fy_px=longer * fy,
        cx_px=longer * cx + 0.5 * (width_px - 1),
        cy_px=longer * cy + 0.5 * (height_px - 1),
        distortion=tuple(section.number(name, default=0.0) if name in given else 0.0 for name in names),
    )


def _written(model: CameraModel) -> dict[str, Any]:
    if isinstance(model, PinholeCamera) and not any(model.distortion[5:]):
        kind = "brown"
    elif isinstance(model, FisheyeCamera):
        kind = "fisheye_opencv"
    elif isinstance(model, Fisheye624Camera):
        kind = "fisheye624" if any(model.distortion[8:]) else "fisheye62"
    else:
        raise CalibrationError(
            f"OpenSfM has no model for this {model.model} camera: write it as a rig file instead, or"
            " calibrate another model (pinhole with k1 k2 p1 p2 k3, or fisheye)."
        )
    names = _MODELS[kind][1]
    longer = max(model.width_px, model.height_px)
    coefficients = (*model.distortion, *(0.0,) * len(names))[: len(names)]
    return {
        "projection_type": kind,
        "width": model.width_px,
        "height": model.height_px,
        "focal_x": float(model.fx_px) / longer,
        "focal_y": float(model.fy_px) / longer,
        "c_x": (float(model.cx_px) - 0.5 * (model.width_px - 1)) / longer,
        "c_y": (float(model.cy_px) - 0.5 * (model.height_px - 1)) / longer,
        **{name: float(value) for name, value in zip(names, coefficients, strict=True)},
    }
