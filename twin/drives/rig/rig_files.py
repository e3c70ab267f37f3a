"""The rig of a drive folder: a DriveWorks rig file, the table ``[cameras]`` of ``drive.toml``, or both.

Everything is brought together in one DriveWorks document before it is read, and that document is what is kept
with the drive: it makes the same rig again without the calibration files and masks that it came from.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.calibration_files import CalibratedCamera, read_cameras
from geoloc.errors import CalibrationError
from geoloc.rig.intrinsics import model_properties, with_model
from geoloc.rig.poses import NOMINAL, POSE_KEYS, PoseKind, with_pose_kind
from geoloc.rig.rig import (
    Rig,
    lens_properties,
    looks_like_rig,
    no_rig,
    rig_from_document,
    without_template_masks,
)
from geoloc.rig.sensor_entry import mask_document
from twin.drives.folder.drive_toml import SETTINGS_FILE, CameraSettings, DriveSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, ReadingNotes
from twin.drives.folder.sensor_names import which_camera
from twin.drives.rig.driveworks import find_rig
from twin.drives.rig.rig_conflicts import pose_conflicts, two_poses, unused_rigs
from twin.errors import DriveError

_BLACK_BELOW = 128
_MASK_FORMATS = ("PNG", "PPM", "BMP", "JPEG")
# The mask's sides may be rounded where it was made smaller.
_SHAPE_TOLERANCE = 0.02
_MOST_CAR = 0.5


def rig_of_folder(folder: DriveFolder, settings: DriveSettings, notes: ReadingNotes) -> tuple[Rig, str]:
    """Read the drive's rig.

    A rig file is looked for unless every camera of ``[cameras]`` says where it sits. A camera of that table
    replaces the intrinsics, the pose or the mask of the rig file's camera of that name, or is added.

    Returns
    -------
    Rig
        Without car masks that are a template.
    str
        The document that makes this rig: the rig file's text where ``drive.toml`` adds nothing to it.

    Raises
    ------
    DriveError
        If there is no rig, or something of it cannot be used.
    """
    name = settings.rig or _rig_file(folder, settings.cameras)
    text = "" if name is None else _text(folder, name)
    document = _document(text, name) if name is not None else {"rig": {"sensors": []}, "version": 7}
    source = name or SETTINGS_FILE
    try:
        posed = with_pose_kind(document, settings.rig_pose or PoseKind.CALIBRATED)
        added = _with_cameras(posed, settings.cameras, folder, notes)
        masked = _with_mask_files(added, folder, source, notes)
        rig = rig_from_document(masked, source)
    except CalibrationError as error:
        raise DriveError(str(error)) from error
    notes.warn(DriveDoubt.RIG, *two_poses(masked, source, settled=settings.rig_pose is not None))
    others = unused_rigs(folder) if name is None else {source: posed}
    for file, other in others.items():
        notes.warn(DriveDoubt.RIG, *pose_conflicts(rig, other, file, settings.cameras))
    _check_masks(rig, notes)
    rig, shared = without_template_masks(rig)
    if shared:
        notes.warn(
            DriveDoubt.RIG,
            f"{source}: {', '.join(shared)} share one car mask bit for bit, which cannot be what each of them"
            " sees of the car: the mask is not used.",
        )
    antennas = len({*rig.antennas, *(settings.gnss or ())})
    counts = [_counted(len(rig.cameras), "camera"), *([_counted(antennas, "antenna")] if antennas else [])]
    notes.say(f"Rig {source}: {', '.join(counts)}.")
    return rig, text if masked is document else json.dumps(masked)


def _rig_file(folder: DriveFolder, cameras: Mapping[str, CameraSettings]) -> str | None:
    """Name of the folder's rig file; None where ``[cameras]`` says all, or all but intrinsics without one."""
    posed = bool(cameras) and all(camera.position_m for camera in cameras.values())
    if posed and (all(camera.has_intrinsics for camera in cameras.values()) or not unused_rigs(folder)):
        return None
    return find_rig(folder)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _text(folder: DriveFolder, name: str) -> str:
    try:
        return folder.content(name).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DriveError(f"{name} is not JSON ({error}): export the rig file again.") from error


def _document(text: str, name: str) -> Mapping[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DriveError(f"{name} is not JSON ({error}): export the rig file again.") from error
    if not looks_like_rig(document):
        raise DriveError(str(no_rig(name)))
    return document  # type: ignore[no-any-return]  # looks_like_rig asks for a mapping


def _with_sensors(document: Mapping[str, Any], sensors: list[Any]) -> Mapping[str, Any]:
    return {**document, "rig": {**document["rig"], "sensors": sensors}}


def _with_cameras(
    document: Mapping[str, Any],
    cameras: Mapping[str, CameraSettings],
    folder: DriveFolder,
    notes: ReadingNotes,
) -> Mapping[str, Any]:
    """Document in which cameras have what ``drive.toml`` says of them; itself if that is nothing."""
    if not cameras:
        return document
    files: dict[str, Mapping[str, CalibratedCamera]] = {}
    sensors = list(document["rig"]["sensors"])
    place = {sensor["name"].strip(): i for i, sensor in enumerate(sensors) if _named(sensor)}
    for name, camera in cameras.items():
        if name not in place:
            if not camera.has_intrinsics or camera.position_m is None:
                there = [other for other, i in place.items() if _is_camera(sensors[i])]
                raise DriveError(
                    f"{SETTINGS_FILE} names the camera {name}, which no rig file has"
                    f" ({which_camera(name, there)}): correct the name, or give [cameras.{name}] intrinsics"
                    " (or lens, or fov_deg), position and roll_pitch_yaw."
                )
            place[name] = len(sensors)
            sensors.append({"name": name, "protocol": "camera.virtual"})
        sensor = dict(sensors[place[name]])
        if camera.intrinsics is not None:
            calibrated = _calibrated(name, camera.intrinsics, folder, files)
            old = sensor.get("properties")
            properties = old if isinstance(old, Mapping) else {}
            sensor["properties"] = with_model(properties, name, calibrated.model)
            notes.warn(DriveDoubt.RIG, *filter(None, [calibrated.warning]))
        if camera.nominal is not None:
            lens = camera.nominal.sigmas
            sensor["properties"] = model_properties(name, camera.nominal.model) | lens_properties(lens)
            notes.warn(DriveDoubt.RIG, _nominal(name, camera.nominal.lens.name))
        if camera.position_m is not None:
            sensor = {key: value for key, value in sensor.items() if key not in POSE_KEYS}
            angles = list(camera.roll_pitch_yaw_deg)
            sensor[NOMINAL[0]] = {"roll-pitch-yaw": angles, "t": list(camera.position_m)}
        if camera.mask is not None:
            sensor["car-mask"] = mask_document(_read_mask(folder.content(camera.mask), camera.mask))
        sensors[place[name]] = sensor
    return _with_sensors(document, sensors)


def _nominal(camera: str, lens: str) -> str:
    return (
        f"The lens of {camera} is a nominal one ({lens}). The drive corrects it as far as it shows, and the"
        " ellipses hold the rest: calibrate the camera (twin help calibration) for better positions."
    )


def _is_camera(sensor: Mapping[str, Any]) -> bool:
    return str(sensor.get("protocol")).startswith("camera")


def _named(sensor: object) -> bool:
    return isinstance(sensor, Mapping) and isinstance(sensor.get("name"), str)


def _calibrated(
    name: str, intrinsics: str, folder: DriveFolder, files: dict[str, Mapping[str, CalibratedCamera]]
) -> CalibratedCamera:
    """Find the camera that ``file`` or ``file#camera`` means."""
    file, _, wanted = (intrinsics, "", "") if folder.has(intrinsics) else intrinsics.rpartition("#")
    file = file or intrinsics
    if file not in files:
        files[file] = read_cameras(folder.content(file), file)
    cameras = files[file]
    wanted = wanted or (name if name in cameras else next(iter(cameras)))
    if wanted not in cameras:
        raise DriveError(
            f"{SETTINGS_FILE} gives cameras.{name}.intrinsics = {intrinsics!r:.80}, but {file} has no camera"
            f" {wanted:.80} ({which_camera(wanted, cameras)}): correct what stands after #."
        )
    if len(cameras) > 1 and wanted != name and "#" not in intrinsics:
        raise DriveError(
            f"{file} holds the cameras {', '.join(cameras)[:300]}: say which of them is {name},"
            f' intrinsics = "{file}#{next(iter(cameras))}".'
        )
    return cameras[wanted]


def _with_mask_files(
    document: Mapping[str, Any], folder: DriveFolder, source: str, notes: ReadingNotes
) -> Mapping[str, Any]:
    """Document with the masks inside that the property ``car-mask`` names; itself if there is none."""
    sensors, changed = [], False
    for sensor in document["rig"]["sensors"]:
        file = _mask_file(sensor)
        mask_file = folder.found(file)
        if file is not None and mask_file is None:
            notes.warn(
                DriveDoubt.RIG,
                f"{source} names the car mask {file} of {sensor['name']}, which is not in the folder: what is"
                " marked on the car itself is taken for signs.",
            )
        if mask_file is not None:
            mask = mask_document(_read_mask(folder.content(mask_file), mask_file))
            sensors.append({**sensor, "car-mask": mask})
            changed = True
        else:
            sensors.append(sensor)
    return _with_sensors(document, sensors) if changed else document


def _mask_file(sensor: object) -> str | None:
    """File of a sensor's mask, if it has no mask inside."""
    if not isinstance(sensor, Mapping) or isinstance(sensor.get("car-mask"), Mapping) or not _named(sensor):
        return None
    properties = sensor.get("properties")
    file = properties.get("car-mask") if isinstance(properties, Mapping) else None
    return file.strip() or None if isinstance(file, str) else None


def _read_mask(content: bytes, where: str) -> NDArray[np.bool_]:
    """Pixels of a mask picture that show the car, (h, w): the black ones."""
    import io
    import warnings

    from PIL import Image

    try:
        with warnings.catch_warnings():
            # What could fill the memory is only a warning to Pillow.
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content), formats=_MASK_FORMATS) as picture:
                grey = np.asarray(picture.convert("L"))
    except Exception as error:  # damaged pictures make decoders raise anything
        raise DriveError(
            f"{where} cannot be read as a picture: give the car mask as PNG or PGM, black on the car."
        ) from error
    return grey < _BLACK_BELOW


def _check_masks(rig: Rig, notes: ReadingNotes) -> None:
    """Refuse masks of another shape than their camera's picture; warn of those that hide most of it."""
    for camera in rig.cameras.values():
        if camera.ego_mask is None:
            continue
        rows, columns = camera.ego_mask.shape
        width, height = camera.model.width_px, camera.model.height_px
        if abs(columns * height / (rows * width) - 1.0) > _SHAPE_TOLERANCE:
            raise DriveError(
                f"The car mask of {camera.name} has {columns} x {rows} pixels, another shape than the"
                f" camera's {width} x {height}: give the mask of this camera, in its shape."
            )
        share = float(camera.ego_mask.mean())
        if share > _MOST_CAR:
            notes.warn(
                DriveDoubt.RIG,
                f"The car mask of {camera.name} hides {share:.0%} of the picture: black is the car, white the"
                " rest. Is it the wrong way round?",
            )


def check_camera(rig: Rig, camera: str, table: str) -> None:
    """Refuse a camera of ``drive.toml`` that the rig does not have.

    Raises
    ------
    DriveError
        Naming the table and the cameras that there are.
    """
    if camera not in {*rig.cameras, *rig.unsupported}:
        raise DriveError(
            f"{table} in {SETTINGS_FILE} names the camera {camera}, which {rig.source} does not have"
            f" ({which_camera(camera, rig.cameras)}): correct the name."
        )
    try:
        rig.camera(camera)
    except CalibrationError as error:
        raise DriveError(f"{table} in {SETTINGS_FILE} names the camera {camera}: {error}") from error
