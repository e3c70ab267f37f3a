"""A calibrated camera in the file formats that other programs read."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from geoloc.calibration.intrinsics import Candidate
from geoloc.calibration_files import kalibr_text, mrcal_text, ocamcalib_text, opencv_text
from geoloc.cameras import CameraModel
from geoloc.errors import CalibrationError
from geoloc.rig.intrinsics import WINDSHIELD_KEYS, is_behind_windshield, model_properties, with_model
from geoloc.rig.rig import looks_like_rig, no_rig, rig_from_document
from geoloc.rig.sensor_entry import SensorEntry

RIG_NAME = "rig.json"
KEEP, DROP = "keep", "drop"
"""What becomes of a camera's windshield model when its lens is calibrated anew."""
_Writer = Callable[[Any, str], str]
_FORMATS: Mapping[str, tuple[tuple[str, ...], _Writer]] = {
    "opencv.yaml": (("fisheye", "pinhole"), opencv_text),
    "kalibr.yaml": (("fisheye",), lambda camera, _name: kalibr_text([camera])),
    "mrcal.cameramodel": (("pinhole",), lambda camera, _name: mrcal_text(camera)),
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
    document: Mapping[str, Any],
    source: str,
    name: str,
    camera: CameraModel,
    *,
    add: bool = False,
    windshield: str | None = None,
) -> dict[str, Any]:
    """Copy a rig document with other intrinsics for one camera; everything else stays as it is.

    A camera that had its polynomial as ``bw-poly``, as older DriveWorks wrote it, has the new one so. With
    `add` a camera that the rig does not have is added to it, its place on the car not known: all zeros. A
    windshield model of the camera is kept by `KEEP`, where the lens was calibrated without the screen, and
    goes by `DROP`, where the new lens holds it.

    Raises
    ------
    CalibrationError
        If it is no rig, has no such camera, or one of another size, or one with a windshield model of which
        `windshield` does not say what becomes of it.
    """
    check_has_camera(document, source, name, add=add, windshield=windshield)
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
    screen = {key: old[key] for key in WINDSHIELD_KEYS if key in old and windshield == KEEP}
    sensor["properties"] = {**with_model(old, name, camera), **screen}
    reason = rig_from_document(changed, source).unsupported.get(name)
    if reason is not None:
        raise CalibrationError(f"Camera {name} cannot be written into {source}: {reason}.")
    return changed


def check_has_camera(
    document: Mapping[str, Any],
    source: str,
    name: str,
    *,
    add: bool = False,
    windshield: str | None = None,
) -> None:
    """Refuse a document that is no rig, or has no such camera, unless it is to be added.

    A camera with a windshield model is refused too while nobody says whether the board was seen through it.

    Raises
    ------
    CalibrationError
    """
    if not looks_like_rig(document):
        raise no_rig(source)
    names = cameras_of(document)
    if name not in names and not add:
        raise CalibrationError(
            f"There is no camera {name} in {source} (its cameras: {', '.join(names) or 'none'}): name one of "
            "them with --camera, or put it in with --add."
        )
    if windshield is None and any(
        is_behind_windshield(SensorEntry.of(sensor, index, source))
        for index, sensor in enumerate(document["rig"]["sensors"])
        if isinstance(sensor, Mapping) and str(sensor.get("name", "")).strip() == name
    ):
        raise CalibrationError(
            f"Camera {name} of {source} has a windshield model, which must not bend its rays twice: say"
            " --windshield drop if the board was seen through the windscreen, as the new lens holds it then,"
            " or --windshield keep if the pictures were taken without it."
        )


def cameras_of(document: Mapping[str, Any]) -> list[str]:
    """Names of the cameras of a rig document, of whatever model."""
    return [
        str(sensor.get("name", "")).strip()
        for sensor in document["rig"]["sensors"]
        if isinstance(sensor, Mapping) and str(sensor.get("protocol", "")).startswith("camera")
    ]


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
