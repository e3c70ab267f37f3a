"""Kalibr's ``camchain.yaml``, also as OpenVINS writes it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.calibration_files.document import CalibratedCamera, Section, built, sections, yaml_document
from geoloc.cameras import CameraModel, FisheyeCamera, FovCamera, OmniCamera, PinholeCamera
from geoloc.errors import CalibrationError

_MAKES: Mapping[tuple[str, str], type[CameraModel]] = {
    ("pinhole", "radtan"): PinholeCamera,
    ("pinhole", "none"): PinholeCamera,
    ("pinhole", "equidistant"): FisheyeCamera,
    ("pinhole", "fov"): FovCamera,
    ("omni", "radtan"): OmniCamera,
    ("omni", "none"): OmniCamera,
    ("ds", "none"): OmniCamera,
    ("eucm", "none"): OmniCamera,
}
_SHAPES: Mapping[str, tuple[str, ...]] = {
    "pinhole": (),
    "omni": ("xi",),
    "ds": ("xi", "alpha"),
    "eucm": ("alpha", "beta"),
}
"""What stands before the focal lengths."""
_CAMERA = re.compile(rb"^cam\d+[ \t]*:", re.MULTILINE)


def looks_like_kalibr(head: bytes) -> bool:
    """Whether a file begins like a camera chain: keys ``cam0``, ``cam1``, … and an intrinsics line."""
    return _CAMERA.search(head) is not None and b"intrinsics" in head


def read_kalibr(content: bytes, where: str) -> dict[str, CalibratedCamera]:
    """Read a camera chain.

    ``pinhole`` with ``radtan``, ``equidistant``, ``fov`` or no distortion, ``omni`` with ``radtan`` or none,
    and ``ds`` and ``eucm`` without. Poses are taken from ``T_cam_imu`` (OpenVINS: its inverse ``T_imu_cam``),
    else from the chain of ``T_cn_cnm1``, which is against the first camera.

    Returns
    -------
    dict of name (``cam0``, …) to camera

    Raises
    ------
    CalibrationError
        If the file is no camera chain, or a camera is of another model or lacks something.
    """
    cameras: dict[str, CalibratedCamera] = {}
    previous: tuple[str, CalibratedCamera] | None = None
    for name, section in sections(yaml_document(content, where), where):
        if re.fullmatch(r"cam\d+", name):
            cameras[name] = _with_pose(section, _model(section), previous)
            previous = name, cameras[name]
    if not cameras:
        raise CalibrationError(f"{where} holds no camera (cam0, cam1, …): give Kalibr's camchain file.")
    return cameras


def kalibr_text(
    models: Iterable[CameraModel], camera_T_body: Sequence[NDArray[np.float64]] | None = None
) -> str:
    """Write cameras as a camera chain: ``cam0``, ``cam1``, … in the order given.

    Parameters
    ----------
    models : iterable of CameraModel
    camera_T_body : sequence of float64 (4, 4), optional
        Turns points of a common body into each camera's frame (RDF): written as ``T_cam_imu``, and against
        the camera before as ``T_cn_cnm1``.

    Raises
    ------
    CalibrationError
        If Kalibr has no such model: it knows pinhole (at most k1 k2 p1 p2), fisheye, fov, omni, ds and eucm.
    """
    lines = []
    for number, model in enumerate(models):
        kind, distortion, intrinsics, coefficients = _written(model)
        lines += [
            f"cam{number}:",
            f"  camera_model: {kind}",
            f"  intrinsics: [{_listed(intrinsics)}]",
            f"  distortion_model: {distortion}",
            f"  distortion_coeffs: [{_listed(coefficients)}]",
            f"  resolution: [{model.width_px}, {model.height_px}]",
        ]
        if camera_T_body is not None:
            lines += _matrix("T_cam_imu", camera_T_body[number])
        if camera_T_body is not None and number > 0:
            lines += _matrix("T_cn_cnm1", camera_T_body[number] @ _inverse(camera_T_body[number - 1]))
    return "\n".join(lines) + "\n"


def _model(section: Section) -> CameraModel:
    kind, distortion = section.text("camera_model"), section.text("distortion_model") or "none"
    if (kind, distortion) not in _MAKES:
        known = ", ".join(f"{k} with {d}" for k, d in _MAKES)
        raise section.error(f"is of the model {kind!r} with {distortion!r}, and only {known} are supported.")
    width_px, height_px = section.size("resolution")
    names = (*_SHAPES[kind], "fx_px", "fy_px", "cx_px", "cy_px")
    arguments: dict[str, Any] = dict(zip(names, section.numbers("intrinsics", len(names)), strict=True))
    if distortion == "fov":
        arguments["omega_rad"] = section.numbers("distortion_coeffs", 1)[0]
    elif distortion != "none":
        arguments["distortion"] = section.numbers("distortion_coeffs", 4)
    if kind == "eucm":
        arguments["xi"] = 0.0
    return built(section.where, _MAKES[kind, distortion], width_px=width_px, height_px=height_px, **arguments)


def _with_pose(
    section: Section, model: CameraModel, previous: tuple[str, CalibratedCamera] | None
) -> CalibratedCamera:
    if "T_cam_imu" in section.values:
        return CalibratedCamera(model, section.transform("T_cam_imu"), "imu")
    if "T_imu_cam" in section.values:
        return CalibratedCamera(model, _inverse(section.transform("T_imu_cam")), "imu")
    if "T_cn_cnm1" in section.values and previous is not None:
        name, before = previous
        pose = np.eye(4) if before.camera_T_body is None else before.camera_T_body
        return CalibratedCamera(model, section.transform("T_cn_cnm1") @ pose, before.body or name)
    return CalibratedCamera(model)


def _inverse(transform: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of a rigid transform."""
    inverse = np.eye(4)
    inverse[:3, :3] = transform[:3, :3].T
    inverse[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return inverse


def _written(model: CameraModel) -> tuple[str, str, tuple[float, ...], tuple[float, ...]]:
    """Model, distortion model and their numbers, as Kalibr has them."""
    if isinstance(model, FovCamera):
        return "pinhole", "fov", (model.fx_px, model.fy_px, model.cx_px, model.cy_px), (model.omega_rad,)
    if isinstance(model, PinholeCamera | FisheyeCamera | OmniCamera) and not any(model.distortion[4:]):
        intrinsics = (model.fx_px, model.fy_px, model.cx_px, model.cy_px)
        coefficients = (*model.distortion, *(0.0,) * 4)[:4]
        if isinstance(model, PinholeCamera):
            return "pinhole", "radtan", intrinsics, coefficients
        if isinstance(model, FisheyeCamera):
            return "pinhole", "equidistant", intrinsics, coefficients
        if model.alpha == 0.0 and model.beta == 1.0:
            return "omni", "radtan", (model.xi, *intrinsics), coefficients
        if model.beta == 1.0 and not any(coefficients):
            return "ds", "none", (model.xi, model.alpha, *intrinsics), ()
        if model.xi == 0.0 and not any(coefficients):
            return "eucm", "none", (model.alpha, model.beta, *intrinsics), ()
    raise CalibrationError(
        f"Kalibr has no model for this {model.model} camera: write it as a rig file instead, or calibrate"
        " another model (pinhole with k1 k2 p1 p2, fisheye, fov, omni, ds or eucm)."
    )


def _matrix(key: str, transform: NDArray[np.float64]) -> list[str]:
    return [f"  {key}:", *(f"  - [{_listed(row)}]" for row in transform)]


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(repr(float(number)) for number in numbers)
