"""A calibrated camera in the file formats that other programs read."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping, Sequence
from typing import Any

from geoloc.calibration.comparison import Candidate
from geoloc.calibration_files.kalibr import kalibr_text
from geoloc.calibration_files.ocamcalib import ocamcalib_text
from geoloc.calibration_files.opencv_file import opencv_text
from geoloc.cameras import CameraModel, FThetaCamera, OcamCamera
from geoloc.errors import CalibrationError
from geoloc.rig import looks_like_rig, rig_from_document
from geoloc.rig_models import model_properties

_INTRINSIC_KEYS = frozenset(
    {"Model", "model", "width", "height", "cx", "cy", "fx", "fy", "focal-x", "focalX", "focal-y", "focalY"}
    | {"xi", "c", "d", "e", "distortion", "poly", "polynomial", "polynomial-type", "bw-poly"}
    | {"linear-c", "linear-d", "linear-e"}
)
_FORMATS = {"opencv.yaml": ("fisheye", "pinhole"), "kalibr.yaml": ("fisheye",), "ocamcalib.txt": ("ocam",)}
"""Files beside the rig, and the models that each can hold."""


def new_rig_document(name: str, camera: CameraModel) -> dict[str, Any]:
    """Write a DriveWorks rig of this one camera, whose place on a car is not known: all zeros."""
    sensor = {
        "name": name,
        "protocol": "camera.virtual",
        "parameter": f"video={name}.h264,timestamp={name}.h264.timestamps",
        "properties": model_properties(name, camera),
        "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [0.0, 0.0, 0.0]},
    }
    return {"rig": {"sensors": [sensor], "vehicle": {"valid": False}, "vehicleio": []}, "version": 7}


def rig_with_camera(
    document: Mapping[str, Any], source: str, name: str, camera: CameraModel
) -> dict[str, Any]:
    """Copy a rig document with other intrinsics for one camera; everything else stays as it is.

    A camera that had its polynomial as ``bw-poly``, as older DriveWorks wrote it, has the new one so.

    Raises
    ------
    CalibrationError
        If it is no rig, has no such camera, or one of another size.
    """
    check_has_camera(document, source, name)
    changed = copy.deepcopy(dict(document))
    sensor = next(s for s in changed["rig"]["sensors"] if str(s.get("name", "")).strip() == name)
    old = sensor.get("properties") or {}
    size = (str(camera.width_px), str(camera.height_px))
    stated = tuple(
        str(old.get(key, ours)).strip() for key, ours in zip(("width", "height"), size, strict=True)
    )
    if stated != size:
        raise CalibrationError(
            f"Camera {name} of {source} has {' x '.join(stated)} pixels, the pictures have "
            f"{' x '.join(size)}: calibrate from pictures in the camera's full size."
        )
    new = model_properties(name, camera)
    if isinstance(camera, FThetaCamera) and "bw-poly" in old and "polynomial" not in old:
        new = _older(new, old)
    kept = {key: value for key, value in old.items() if key not in _INTRINSIC_KEYS}
    sensor["properties"] = {**kept, **new}
    _check_read_back(changed, source, name)
    return changed


def _older(new: Mapping[str, str], old: Mapping[str, Any]) -> dict[str, str]:
    """Spell an f-theta camera as older DriveWorks does; linear terms only where there are any."""
    older = {key: value for key, value in new.items() if key not in {"polynomial", "polynomial-type"}}
    older["bw-poly"] = new["polynomial"]
    identity = {"linear-c": "1.0", "linear-d": "0.0", "linear-e": "0.0"}
    if all(older[key] == value and key not in old for key, value in identity.items()):
        older = {key: value for key, value in older.items() if key not in identity}
    return older


def check_has_camera(document: Mapping[str, Any], source: str, name: str) -> None:
    """Refuse a document that is no rig, or has no such camera.

    Raises
    ------
    CalibrationError
    """
    if not looks_like_rig(document):
        raise CalibrationError(f"{source} is no rig file: it has no list of sensors under rig.sensors.")
    names = [
        str(sensor.get("name", "")).strip()
        for sensor in document["rig"]["sensors"]
        if isinstance(sensor, Mapping) and str(sensor.get("protocol", "")).startswith("camera")
    ]
    if name not in names:
        raise CalibrationError(
            f"There is no camera {name} in {source} (its cameras: {', '.join(names) or 'none'}): name one of "
            "them with --camera."
        )


def _check_read_back(document: Mapping[str, Any], source: str, name: str) -> None:
    """Refuse a rig whose new camera twin could not read: for one, with a windshield model beside it."""
    reason = rig_from_document(document, source).unsupported.get(name)
    if reason is not None:
        raise CalibrationError(f"Camera {name} cannot be written into {source}: {reason}.")


def rig_text(document: Mapping[str, Any]) -> str:
    """Write a rig document as the text of a file."""
    return json.dumps(document, indent=4, ensure_ascii=False) + "\n"


def other_formats(candidates: Sequence[Candidate], name: str) -> dict[str, tuple[str, Candidate]]:
    """Text of every other format, by file name, with the candidate that it holds.

    Each format takes the best of the models that it can hold.
    """
    files = {}
    for file, models in _FORMATS.items():
        able = [c for c in candidates if c.model in models and c.fit is not None]
        if not able:
            continue
        candidate = min(able, key=lambda c: c.held_out_deg)
        files[file] = (_text(file, candidate, name), candidate)
    return files


def _text(file: str, candidate: Candidate, name: str) -> str:
    camera = candidate.fit.camera if candidate.fit is not None else None
    if isinstance(camera, OcamCamera):
        return ocamcalib_text(camera)
    if camera is None:
        raise CalibrationError(f"There is no camera to write to {file}.")
    return kalibr_text([camera]) if file.startswith("kalibr") else opencv_text(camera, name)
