"""A calibrated camera in the file formats that other programs read."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from geoloc.calibration.intrinsics import Candidate
from geoloc.calibration_files import kalibr_text, ocamcalib_text, opencv_text
from geoloc.cameras import CameraModel, FThetaCamera
from geoloc.errors import CalibrationError
from geoloc.rig.intrinsics import model_properties
from geoloc.rig.rig import looks_like_rig, rig_from_document

RIG_NAME = "rig.json"
_INTRINSIC_KEYS = frozenset(
    {"Model", "model", "width", "height", "cx", "cy", "fx", "fy", "focal-x", "focalX", "focal-y", "focalY"}
    | {"xi", "alpha", "beta", "omega", "c", "d", "e", "linear-c", "linear-d", "linear-e"}
    | {"distortion", "poly", "polynomial", "polynomial-type", "bw-poly"}
)
_Writer = Callable[[Any, str], str]
_FORMATS: Mapping[str, tuple[tuple[str, ...], _Writer]] = {
    "opencv.yaml": (("fisheye", "pinhole"), opencv_text),
    "kalibr.yaml": (("fisheye",), lambda camera, _name: kalibr_text([camera])),
    "ocamcalib.txt": (("ocam",), lambda camera, _name: ocamcalib_text(camera)),
}
"""Files beside the rig, the models that each can hold, and how a camera of a name is written."""


def new_rig_document(cameras: Mapping[str, CameraModel]) -> dict[str, Any]:
    """Write a DriveWorks rig of cameras whose place on a car is not known: all zeros."""
    sensors = [_sensor(name, camera) for name, camera in cameras.items()]
    return {"rig": {"sensors": sensors, "vehicle": {"valid": False}, "vehicleio": []}, "version": 7}


def _sensor(name: str, camera: CameraModel) -> dict[str, Any]:
    return {
        "name": name,
        "protocol": "camera.virtual",
        "parameter": f"video={name}.h264,timestamp={name}.h264.timestamps",
        "properties": model_properties(name, camera),
        "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [0.0, 0.0, 0.0]},
    }


def rig_with_camera(
    document: Mapping[str, Any], source: str, name: str, camera: CameraModel, *, add: bool = False
) -> dict[str, Any]:
    """Copy a rig document with other intrinsics for one camera; everything else stays as it is.

    A camera that had its polynomial as ``bw-poly``, as older DriveWorks wrote it, has the new one so. With
    `add` a camera that the rig does not have is added to it, its place on the car not known: all zeros.

    Raises
    ------
    CalibrationError
        If it is no rig, has no such camera, or one of another size.
    """
    check_has_camera(document, source, name, add=add)
    changed = copy.deepcopy(dict(document))
    if name not in cameras_of(document):
        changed["rig"]["sensors"].append(_sensor(name, camera))
        return changed
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


def check_has_camera(document: Mapping[str, Any], source: str, name: str, *, add: bool = False) -> None:
    """Refuse a document that is no rig, or has no such camera, unless it is to be added.

    Raises
    ------
    CalibrationError
    """
    if not looks_like_rig(document):
        raise CalibrationError(f"{source} is no rig file: it has no list of sensors under rig.sensors.")
    names = cameras_of(document)
    if name not in names and not add:
        raise CalibrationError(
            f"There is no camera {name} in {source} (its cameras: {', '.join(names) or 'none'}): name one of "
            "them with --camera, or put it in with --add."
        )


def cameras_of(document: Mapping[str, Any]) -> list[str]:
    """Names of the cameras of a rig document, of whatever model."""
    return [
        str(sensor.get("name", "")).strip()
        for sensor in document["rig"]["sensors"]
        if isinstance(sensor, Mapping) and str(sensor.get("protocol", "")).startswith("camera")
    ]


def _check_read_back(document: Mapping[str, Any], source: str, name: str) -> None:
    """Refuse a rig whose new camera twin could not read: for one, with a windshield model beside it."""
    reason = rig_from_document(document, source).unsupported.get(name)
    if reason is not None:
        raise CalibrationError(f"Camera {name} cannot be written into {source}: {reason}.")


def file_name(camera: str) -> str:
    """Spell a camera's name as file systems take it: some refuse the colons of ``camera:front:120``."""
    return re.sub(r"[^\w.-]+", "_", camera).strip(".") or "camera"


def rig_text(document: Mapping[str, Any]) -> str:
    """Write a rig document as the text of a file."""
    return json.dumps(document, indent=4, ensure_ascii=False) + "\n"


def other_formats(candidates: Sequence[Candidate], name: str) -> dict[str, tuple[str, Candidate]]:
    """Text of every other format, by file name, with the candidate that it holds.

    Each format takes the best of the models that it can hold.
    """
    files = {}
    for file, (models, write) in _FORMATS.items():
        able = [(c, c.fit) for c in candidates if c.model in models and c.fit is not None]
        if able:
            candidate, fit = min(able, key=lambda pair: pair[0].held_out_deg)
            files[file] = (write(fit.camera, name), candidate)
    return files
