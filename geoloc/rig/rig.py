"""The rig: cameras, antennas and where they sit on the car.

Rigs are read from, and written as, NVIDIA DriveWorks rig files (JSON). The axes and signs that a rig file
leaves to its readers are spelled out in `rig_from_document`.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.cameras.base import CameraModel
from geoloc.cameras.nominal import EXACT, LensSigmas
from geoloc.earth.geodesy import rpy_from_rotation
from geoloc.errors import CalibrationError
from geoloc.rig.intrinsics import LENS_KEYS, camera_model, model_properties, unsupported_model, with_model
from geoloc.rig.poses import FLU_R_RDF, NOMINAL, POSE_KEYS, sensor_pose
from geoloc.rig.sensor_entry import SensorEntry, mask_document

__all__ = [
    "FLU_R_RDF",
    "Antenna",
    "Rig",
    "RigCamera",
    "lens_properties",
    "looks_like_rig",
    "read_rig",
    "rig_document",
    "rig_from_document",
    "rig_with_lever_arms",
    "without_template_masks",
]

_RIG_FILE_VERSION = 7
_Scalar = TypeVar("_Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True)
class RigCamera:
    """One camera on the car.

    Attributes
    ----------
    name : str
    model : CameraModel
    rig_R_camera : float64 (3, 3)
        Turns camera axes (RDF) into rig axes (FLU), corrections included.
    rig_t_camera_m : float64 (3,)
        The camera's position in the rig frame.
    video, timestamps : str or None
        File names of the recording, from ``parameter``.
    ego_mask : bool (h, w) or None
        True on pixels that show the car itself, at the mask's own resolution.
    lens : LensSigmas
        How far its intrinsics may be off: not at all where it was calibrated.
    """

    name: str
    model: CameraModel
    rig_R_camera: FloatArray
    rig_t_camera_m: FloatArray
    video: str | None = None
    timestamps: str | None = None
    ego_mask: NDArray[np.bool_] | None = None
    lens: LensSigmas = EXACT

    @property
    def is_placed(self) -> bool:
        """Whether its position is one: nobody mounts a camera at the origin, on the road below the axle."""
        return bool(np.any(self.rig_t_camera_m))


@dataclass(frozen=True, slots=True)
class Antenna:
    """One GNSS antenna: its lever arm in the rig frame (FLU, metres) and its recording."""

    name: str
    rig_t_antenna_m: FloatArray
    file: str | None = None


@dataclass(frozen=True, slots=True)
class Rig:
    """All sensors of one car.

    Rig frame: ISO 8855 FLU (x forward, y left, z up), origin on the ground below the middle of the rear axle.

    Attributes
    ----------
    cameras, antennas : mapping of name to sensor
    source : str
        Where the rig was read from: named in error messages.
    unsupported : mapping of camera name to reason
        Cameras that are in the file but whose model this package cannot compute with. They do not stand in
        the way of the others; `camera` says why when one is asked for.
    document : mapping or None
        The file that it was read from, parsed: what of it is not read is written again.
    """

    cameras: Mapping[str, RigCamera]
    antennas: Mapping[str, Antenna]
    source: str
    unsupported: Mapping[str, str] = field(default_factory=dict)
    document: Mapping[str, Any] | None = field(default=None, repr=False, compare=False)

    def camera(self, name: str) -> RigCamera:
        """Return the camera of that name.

        Raises
        ------
        CalibrationError
            If the rig has none, or one of an unsupported model.
        """
        if name in self.cameras:
            return self.cameras[name]
        if name in self.unsupported:
            raise CalibrationError(
                f"Camera {name} in {self.source} cannot be used: {self.unsupported[name]}."
            )
        raise CalibrationError(
            f"There is no camera {name} in {self.source} (its cameras: {_listed(self.cameras)}): rename the "
            "camera in the annotations or give the rig that it belongs to."
        )


def looks_like_rig(document: object) -> bool:
    """Whether a parsed JSON document is a DriveWorks rig file, judged by its content."""
    if not isinstance(document, Mapping):
        return False
    rig = document.get("rig")
    return isinstance(rig, Mapping) and isinstance(rig.get("sensors"), list)


def no_rig(source: str) -> CalibrationError:
    """Build the error that says of a document that it is no rig."""
    return CalibrationError(f"{source} is no rig file: it has no list of sensors under rig.sensors.")


def read_rig(path: Path) -> Rig:
    """Read a DriveWorks rig file.

    Raises
    ------
    CalibrationError
        If the file cannot be read, is not JSON, or `rig_from_document` refuses it.
    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise CalibrationError(f"Cannot read the rig file {path}: {error.strerror or error}.") from error
    except ValueError as error:
        raise CalibrationError(f"The rig file {path} is not JSON: {error}; export it again.") from error
    return rig_from_document(document, str(path))


def rig_from_document(document: Mapping[str, Any], source: str) -> Rig:
    """Build a rig from a parsed DriveWorks rig file.

    Parameters
    ----------
    document : mapping
        The whole document: ``{"rig": {"sensors": [...]}, "version": ...}``. Unknown keys and sensors that are
        neither cameras (``camera.*``) nor GNSS (``gps.*``) are ignored.
    source : str
        What to call it in error messages.

    Returns
    -------
    Rig
        Cameras of a model that is not known here are listed in `Rig.unsupported`.

    Raises
    ------
    CalibrationError
        Naming sensor, key, file and cure, where something needed is missing, malformed or ambiguous.

    Notes
    -----
    Extrinsics are taken from the first of ``sensor2Rig_FLU``, ``sensor2Rig`` (calibrated),
    ``nominalSensor2Rig_FLU`` and ``nominalSensor2Rig`` (drawn), each with ``t`` and either ``roll-pitch-yaw``
    (degrees, ``Rz(yaw) Ry(pitch) Rx(roll)``, positive pitch nose down) or ``quaternion`` (x, y, z, w). The
    ``_FLU`` forms turn a camera whose axes were renamed to forward-left-up, the older forms the camera's own
    right-down-forward axes. Corrections apply to a nominal pose, as in DriveWorks: ``R = R_nominal @
    R_correction @ S`` with S from RDF to FLU, ``t = t_nominal + correction_rig_T``. Where the two differ
    `geoloc.rig.poses.pose_differences` says so, and `geoloc.rig.poses.with_pose_kind` chooses.

    Polynomials of an f-theta camera: ``polynomial`` with ``polynomial-type``, else ``bw-poly``. Of a pinhole
    camera: ``fx``, ``fy`` (or ``focal-x``, ``focalX``) and ``distortion``, "k1 k2 p1 p2 k3" in OpenCV's
    order, or DriveWorks' three radial ones, "k1 k2 k3". Of the other models see `geoloc.rig.intrinsics`.

    NVIDIA DriveWorks 4.0, "Rig Configuration" and "Coordinate Systems".
    """
    if not looks_like_rig(document):
        raise no_rig(source)
    cameras: dict[str, RigCamera] = {}
    antennas: dict[str, Antenna] = {}
    unsupported: dict[str, str] = {}
    for index, sensor in enumerate(document["rig"]["sensors"]):
        entry = SensorEntry.of(sensor, index, source)
        if entry.name in cameras or entry.name in antennas or entry.name in unsupported:
            raise CalibrationError(
                f"Two sensors in {source} are called {entry.name:.80}: rename one of them."
            )
        if entry.kind == "gps":
            antennas[entry.name] = _antenna(entry)
        elif entry.kind == "camera":
            reason = unsupported_model(entry)
            if reason is None:
                cameras[entry.name] = _camera(entry)
            else:
                unsupported[entry.name] = reason
    return Rig(cameras, antennas, source, unsupported, document)


def rig_with_lever_arms(rig: Rig, lever_arms_m: Mapping[str, Sequence[float]]) -> Rig:
    """Copy a rig with other lever arms.

    Parameters
    ----------
    lever_arms_m : mapping of antenna name to (x, y, z)
        Phase centre of the antenna in the rig frame (FLU), metres. Antennas that are not named keep theirs.

    Raises
    ------
    CalibrationError
        If the rig has no such antenna, or a lever arm is not three finite numbers.
    """
    antennas = dict(rig.antennas)
    for name, lever_arm in lever_arms_m.items():
        if name not in antennas:
            raise CalibrationError(
                f"A lever arm is given for {name}, but {rig.source} has no such antenna (its antennas: "
                f"{_listed(rig.antennas)}): spell the name as the rig file does."
            )
        vector = np.array(lever_arm, dtype=np.float64)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise CalibrationError(
                f"The lever arm of {name} is {list(lever_arm)}: give x forward, y left and z up in metres."
            )
        antennas[name] = replace(antennas[name], rig_t_antenna_m=_frozen(vector))
    return replace(rig, antennas=antennas)


def without_template_masks(rig: Rig) -> tuple[Rig, tuple[str, ...]]:
    """Drop car masks that several cameras share bit for bit.

    What one camera sees of the car, another cannot see in the same pixels: such a mask is a template of the
    rig tool (all eight cameras of NTNU's rig file carry one) and would reject good feet of poles.

    Returns
    -------
    Rig
        Without those masks.
    tuple of str
        The cameras that lost one.
    """
    masks = {name: camera.ego_mask for name, camera in rig.cameras.items() if camera.ego_mask is not None}
    shared = tuple(
        name
        for name, mask in masks.items()
        if any(name != other and np.array_equal(mask, masks[other]) for other in masks)
    )
    kept = {
        name: replace(camera, ego_mask=None) if name in shared else camera
        for name, camera in rig.cameras.items()
    }
    return replace(rig, cameras=kept), shared


def rig_document(rig: Rig) -> dict[str, Any]:
    """Write a rig as a DriveWorks rig document (version 7), ready for ``json.dumps``.

    Reading it back with `rig_from_document` gives the same rig, rotations to 1e-9. Of a rig that was read
    from a file, what did not change since and what is not read (other keys, other sensors, the vehicle,
    cameras of models that are not known) is as that file has it; a pose that did change is written as one
    nominal pose, corrections included. Of an f-theta camera only the reference polynomial is written.

    Raises
    ------
    CalibrationError
        If the rig has a camera of an unsupported model that was not read from a file: it would be lost.
    """
    given = rig.document or {"rig": {"sensors": [], "vehicle": {"valid": False}, "vehicleio": []}}
    document = copy.deepcopy(dict(given))
    document.setdefault("version", _RIG_FILE_VERSION)
    read = [SensorEntry.of(s, i, rig.source) for i, s in enumerate(document["rig"]["sensors"])]
    names = {entry.name for entry in read}
    lost = {name: reason for name, reason in rig.unsupported.items() if name not in names}
    if lost:
        raise CalibrationError(
            f"The rig of {rig.source} cannot be written, because the camera models of "
            f"{_listed(lost)} are not supported: leave those cameras out."
        )
    sensors = [written for entry in read if (written := _written(entry, rig)) is not None]
    sensors += [_camera_entry(camera) for name, camera in rig.cameras.items() if name not in names]
    sensors += [_antenna_entry(antenna) for name, antenna in rig.antennas.items() if name not in names]
    document["rig"] = {**document["rig"], "sensors": sensors}
    return document


def _written(entry: SensorEntry, rig: Rig) -> dict[str, Any] | None:
    """Sensor as it was read, with what has changed of it since; None where the rig has it no longer."""
    sensor = dict(entry.sensor)
    if entry.kind == "camera" and entry.name not in rig.unsupported:
        return _camera_written(entry, sensor, rig.cameras.get(entry.name))
    if entry.kind != "gps":
        return sensor
    antenna = rig.antennas.get(entry.name)
    if antenna is None:
        return None
    if not np.array_equal(_antenna(entry).rig_t_antenna_m, antenna.rig_t_antenna_m):
        return _posed(sensor, _antenna_entry(antenna))
    return sensor


def _camera_written(
    entry: SensorEntry, sensor: dict[str, Any], camera: RigCamera | None
) -> dict[str, Any] | None:
    if camera is None:
        return None
    before, new = _camera(entry), _camera_entry(camera)
    if (before.model, before.lens) != (camera.model, camera.lens):
        old = sensor.get("properties") or {}
        sensor["properties"] = with_model(old, camera.name, camera.model) | lens_properties(camera.lens)
    if (before.video, before.timestamps) != (camera.video, camera.timestamps):
        sensor["parameter"] = new["parameter"]
    if not np.array_equal(before.rig_R_camera, camera.rig_R_camera) or not np.array_equal(
        before.rig_t_camera_m, camera.rig_t_camera_m
    ):
        sensor = _posed(sensor, new)
    if before.ego_mask is not None and camera.ego_mask is None:
        del sensor["car-mask"]
    elif camera.ego_mask is not None and (
        before.ego_mask is None or not np.array_equal(before.ego_mask, camera.ego_mask)
    ):
        sensor["car-mask"] = new["car-mask"]
    return sensor


def _posed(sensor: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Sensor with the pose of another entry and no other form of it."""
    kept = {key: value for key, value in sensor.items() if key not in POSE_KEYS}
    return {**kept, NOMINAL[0]: new[NOMINAL[0]]}


def _camera(entry: SensorEntry) -> RigCamera:
    pose = sensor_pose(entry)
    parameter = entry.parameter()
    mask = entry.ego_mask()
    return RigCamera(
        name=entry.name,
        model=camera_model(entry),
        rig_R_camera=_frozen(pose.rig_R_flu @ FLU_R_RDF),
        rig_t_camera_m=_frozen(pose.rig_t_sensor_m),
        video=parameter.get("video"),
        timestamps=parameter.get("timestamp"),
        ego_mask=None if mask is None else _frozen(mask),
        lens=_lens(entry),
    )


def lens_properties(lens: LensSigmas) -> dict[str, str]:
    """Write how far a lens may be off as ``properties``; none for one that was calibrated."""
    if lens.is_exact:
        return {}
    stated = zip(LENS_KEYS, (lens.focal_share, lens.centre_px, lens.distortion_share), strict=True)
    return {key: repr(float(value)) for key, value in stated}


def _lens(entry: SensorEntry) -> LensSigmas:
    return LensSigmas(*(abs(entry.number(key, default=0.0)) for key in LENS_KEYS))


def _antenna(entry: SensorEntry) -> Antenna:
    return Antenna(entry.name, _frozen(sensor_pose(entry).rig_t_sensor_m), entry.parameter().get("file"))


def _camera_entry(camera: RigCamera) -> dict[str, Any]:
    files = (("video", camera.video), ("timestamp", camera.timestamps))
    entry: dict[str, Any] = {
        "name": camera.name,
        "protocol": "camera.virtual",
        "parameter": ",".join(f"{key}={file}" for key, file in files if file is not None),
        "properties": model_properties(camera.name, camera.model) | lens_properties(camera.lens),
        "nominalSensor2Rig_FLU": {
            "roll-pitch-yaw": rpy_from_rotation(camera.rig_R_camera @ FLU_R_RDF.T),
            "t": camera.rig_t_camera_m.tolist(),
        },
    }
    if camera.ego_mask is not None:
        entry["car-mask"] = mask_document(camera.ego_mask)
    return entry


def _antenna_entry(antenna: Antenna) -> dict[str, Any]:
    return {
        "name": antenna.name,
        "protocol": "gps.virtual",
        "parameter": "" if antenna.file is None else f"file={antenna.file}",
        "properties": None,
        "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": antenna.rig_t_antenna_m.tolist()},
    }


def _frozen(array: NDArray[_Scalar]) -> NDArray[_Scalar]:
    """Read-only copy: many hold the same rig."""
    copy = np.array(array)
    copy.setflags(write=False)
    return copy


def _listed(names: Mapping[str, Any]) -> str:
    return ", ".join(names) if names else "none"
