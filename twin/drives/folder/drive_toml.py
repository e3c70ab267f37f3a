"""``drive.toml``: what a drive folder says about itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from geoloc.adjustment.adjust import POLE_RADIUS_M
from geoloc.rig.poses import PoseKind
from twin.drives.folder.keys import CAMERA_KEYS, FRAME_KEYS, GNSS_KEYS, POSE_KEYS, POSE_TOPIC_KEYS, ROOT_KEYS
from twin.drives.folder.motion_settings import MotionSettings, motion_settings
from twin.drives.folder.nominal_lens import NominalCamera, nominal_camera
from twin.drives.folder.stated_errors import TERMS, can_be, wanted
from twin.drives.folder.toml_values import (
    SETTINGS_FILE,
    choice_of,
    document_of,
    flag_of,
    moment_of,
    names_of,
    number_of,
    refuse_unknown,
    table_of,
    text_of,
    wrong_value,
)
from twin.errors import DriveError

__all__ = ["DATUMS", "SETTINGS_FILE", "CameraSettings", "DriveSettings", "FrameSettings", "read_settings"]

_Default = TypeVar("_Default", float, None)
DATUMS = ("EUREF89", "ITRF2014", "ITRF2020")
POSE_KINDS = tuple(kind.value for kind in PoseKind)
PITCH_SIGNS = ("nose_down", "nose_up")
LONGEST_READOUT_MS = 200.0
"""No rolling shutter takes longer than the time between two frames of a slow camera."""
THICKEST_POLE_M = 0.5
LARGEST_GNSS_SIGMA_M = 100.0
"""Fixes that are worse locate no sign."""
LONGEST_LEVER_ARM_M = 30.0
"""No car is longer: a larger lever arm is in another unit."""

POSE_SIGMAS: Mapping[str, float] = {
    "sigma_m": 100.0,
    "sigma_height_m": 100.0,
    "sigma_roll_pitch_deg": 30.0,
    "sigma_heading_deg": 30.0,
}
"""One sigma of poses whose file states none, and the largest that locates anything."""

_TABLES = {"gnss": GNSS_KEYS, "poses": POSE_KEYS}


@dataclass(frozen=True, slots=True)
class FrameSettings:
    """Where a camera's pictures are, and what they do not say of their times themselves.

    Attributes
    ----------
    file : str
        A video, or a folder of images.
    start_ns : int or None
        Epoch of the first frame of a video.
    utc_offset_hours : float or None
        Zone of the times in the names or tags of images.
    numbered : bool
        The folder holds some of the frames: the number in an image's name is its frame's.
    """

    file: str
    start_ns: int | None = None
    utc_offset_hours: float | None = None
    numbered: bool = False


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """What ``[cameras.NAME]`` says of a camera; None leaves it to the rig file.

    Attributes
    ----------
    intrinsics : str or None
        A calibration file, ``camchain.yaml``, or one camera of it, ``camchain.yaml#cam0``.
    position_m : (x, y, z) or None
        In the rig frame.
    roll_pitch_yaw_deg : (roll, pitch, yaw)
        Where there is a position.
    mask : str or None
        A picture that is black on the car itself.
    nominal : NominalCamera or None
        In place of `intrinsics`, of a camera that nobody calibrated: ``lens`` or ``fov_deg``.
    """

    intrinsics: str | None = None
    position_m: tuple[float, float, float] | None = None
    roll_pitch_yaw_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mask: str | None = None
    nominal: NominalCamera | None = None

    @property
    def has_intrinsics(self) -> bool:
        """Whether the lens is said here."""
        return self.intrinsics is not None or self.nominal is not None


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """Content of ``drive.toml``. None means that the file does not say: the folder is searched instead.

    Attributes
    ----------
    name, rig : str or None
    rig_pose : PoseKind or None
        Which pose of the rig file counts where it has both; None says nothing: the calibrated one.
    cameras : mapping of camera to CameraSettings
    annotations_complete, detections_complete : bool
        Whether every sign in view is among the annotations, or among what a detector finds.
    frames_by_number : bool
        Whether pictures and stamps belong together by number even if there are more of one.
    first_frame : int or None
        Number of the first frame in a CSV of annotations and in names of images: 0, or 1.
    datum : str
        One of `DATUMS`.
    camera_offset_ns : int
        Added to the frame stamps.
    rolling_shutter_ms : float or None
        From the exposure of the first row to that of the last.
    pole_radius_m : float
        From the visible foot to the middle of the pole.
    pitch_nose_up : bool
        Whether positive pitch in the pose file means nose up.
    gnss : mapping of antenna to file, or None
    gnss_topics : mapping of antenna to topic
        Of ROS recordings.
    lever_arms_m : mapping of antenna to (x, y, z)
    gnss_sigma_m : float or None
        Horizontal one sigma, a horizontal axis, of fixes whose recording states none.
    heading_offset_deg, heading_sigma_deg : float or None
        How far the car's nose is clockwise from the headings of its receivers, and their one sigma.
    poses : str or None
    pose_topics : mapping
        ``position`` and ``attitude``: topics of a ROS recording.
    pose_lever_arm_m : (x, y, z) or None
        Where the point sits in the rig frame whose positions the pose file holds.
    pose_sigmas : mapping of key to one sigma
        Of poses whose file states none: ``sigma_m`` a horizontal axis, ``sigma_height_m``,
        ``sigma_roll_pitch_deg``, ``sigma_heading_deg``.
    timestamps : mapping of camera to file
        Cameras that are not named here are searched.
    frames : mapping of camera to FrameSettings, or None
    annotations : mapping of camera to files, or None
    errors : mapping of name to one sigma
        Terms of the error budget.
    motion : MotionSettings
        What the car measured of its own motion.
    """

    name: str | None = None
    rig: str | None = None
    rig_pose: PoseKind | None = None
    cameras: Mapping[str, CameraSettings] = field(default_factory=dict)
    annotations_complete: bool = False
    detections_complete: bool = False
    frames_by_number: bool = False
    first_frame: int | None = None
    datum: str = "EUREF89"
    camera_offset_ns: int = 0
    rolling_shutter_ms: float | None = None
    pole_radius_m: float = POLE_RADIUS_M
    pitch_nose_up: bool = False
    gnss: Mapping[str, str] | None = None
    gnss_topics: Mapping[str, str] = field(default_factory=dict)
    lever_arms_m: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    gnss_sigma_m: float | None = None
    heading_offset_deg: float | None = None
    heading_sigma_deg: float | None = None
    poses: str | None = None
    pose_topics: Mapping[str, str] = field(default_factory=dict)
    pose_lever_arm_m: tuple[float, float, float] | None = None
    pose_sigmas: Mapping[str, float] = field(default_factory=dict)
    timestamps: Mapping[str, str] = field(default_factory=dict)
    frames: Mapping[str, FrameSettings] | None = None
    annotations: Mapping[str, tuple[str, ...]] | None = None
    errors: Mapping[str, float] = field(default_factory=dict)
    motion: MotionSettings = field(default_factory=MotionSettings)


def read_settings(content: bytes) -> DriveSettings:
    """Read ``drive.toml``.

    Raises
    ------
    DriveError
        If it is not TOML, has an unknown key (the nearest known one is named), a value of the wrong type, or
        names both GNSS files and a pose file.
    """
    document = document_of(content)
    refuse_unknown(document, ROOT_KEYS, "")
    gnss, poses = table_of(document, "gnss"), table_of(document, "poses")
    for key, table in (("gnss", gnss), ("poses", poses)):
        refuse_unknown(table, _TABLES[key], f"[{key}] ")
    files = names_of(gnss, "files", "gnss.files") if "files" in gnss else None
    track = text_of(poses, "file", "poses.file")
    if files and track:
        raise DriveError(
            f"{SETTINGS_FILE} names both GNSS files and the pose file {track}: keep the one that says best"
            " where the car was."
        )
    annotations = table_of(document, "annotations")
    pose_topics = names_of(poses, "topics", "poses.topics")
    refuse_unknown(pose_topics, POSE_TOPIC_KEYS, "[poses] topics.")
    return DriveSettings(
        name=text_of(document, "name"),
        rig=text_of(document, "rig"),
        rig_pose=PoseKind(choice_of(document, "rig_pose", POSE_KINDS)) if "rig_pose" in document else None,
        cameras=_cameras(table_of(document, "cameras")),
        annotations_complete=flag_of(document, "annotations_complete"),
        detections_complete=flag_of(document, "detections_complete"),
        frames_by_number=flag_of(document, "frames_by_number"),
        first_frame=_first_frame(document),
        datum=_datum(document),
        camera_offset_ns=round(number_of(document.get("camera_offset_ms", 0.0), "camera_offset_ms") * 1e6),
        rolling_shutter_ms=_between(document, "rolling_shutter_ms", None, LONGEST_READOUT_MS),
        pole_radius_m=_between(document, "pole_radius_m", POLE_RADIUS_M, THICKEST_POLE_M),
        pitch_nose_up=choice_of(document, "pitch_positive", PITCH_SIGNS) == "nose_up",
        gnss=files,
        gnss_topics=names_of(gnss, "topics", "gnss.topics"),
        lever_arms_m=_lever_arms(table_of(gnss, "lever_arms", "gnss.lever_arms")),
        gnss_sigma_m=_gnss_sigma(gnss),
        heading_offset_deg=_degrees(gnss, "heading_offset_deg", -360.0, 360.0),
        heading_sigma_deg=_degrees(gnss, "heading_sigma_deg", 0.01, 30.0),
        poses=track,
        pose_topics=pose_topics,
        pose_lever_arm_m=_lever_arm(poses["lever_arm"], "poses.lever_arm") if "lever_arm" in poses else None,
        pose_sigmas=_pose_sigmas(poses),
        timestamps=names_of(document, "timestamps", "timestamps"),
        frames=_frames(table_of(document, "frames")) if "frames" in document else None,
        annotations=_file_lists(annotations) if "annotations" in document else None,
        errors=_errors(table_of(document, "errors")),
        motion=motion_settings(document),
    )


def _pose_sigmas(poses: Mapping[str, Any]) -> dict[str, float]:
    sigmas = {key: number_of(poses[key], f"poses.{key}") for key in POSE_SIGMAS if key in poses}
    for key, value in sigmas.items():
        if not 0.0 < value <= POSE_SIGMAS[key]:
            raise wrong_value(f"poses.{key}", value, f"one sigma, above 0 and up to {POSE_SIGMAS[key]:g}")
    return sigmas


def _errors(table: Mapping[str, Any]) -> dict[str, float]:
    refuse_unknown(table, TERMS, "[errors] ")
    errors = {term: number_of(value, f"errors.{term}") for term, value in table.items()}
    for term, value in errors.items():
        if not can_be(term, value):
            raise wrong_value(f"errors.{term}", value, wanted(term))
    return errors


def _first_frame(document: Mapping[str, Any]) -> int | None:
    value = document.get("first_frame")
    if value is not None and (isinstance(value, bool) or value not in (0, 1)):
        raise wrong_value("first_frame", value, "0 or 1: the number of the first frame in the annotations")
    return None if value is None else int(value)


def _datum(document: Mapping[str, Any]) -> str:
    value = document.get("datum", DATUMS[0])
    if value not in DATUMS:
        wanted = (
            '"EUREF89" (with Norwegian corrections, such as CPOS), "ITRF2014" or "ITRF2020" (without, such as'
            " PPP); WGS84 alone does not say which of them (`twin help datum-and-heights`)"
        )
        raise wrong_value("datum", value, wanted)
    return str(value)


def _between(document: Mapping[str, Any], key: str, default: _Default, most: float) -> float | _Default:
    """A number from 0 to `most`, or the default where the file does not say."""
    if key not in document:
        return default
    value = number_of(document[key], key)
    if not 0.0 <= value <= most:
        raise wrong_value(key, value, f"a number from 0 to {most:g}")
    return value


def _gnss_sigma(gnss: Mapping[str, Any]) -> float | None:
    if "sigma_m" not in gnss:
        return None
    value = number_of(gnss["sigma_m"], "gnss.sigma_m")
    if not 0.0 < value <= LARGEST_GNSS_SIGMA_M:
        wanted = f"the horizontal one sigma of a fix in metres, above 0 and up to {LARGEST_GNSS_SIGMA_M:g}"
        raise wrong_value("gnss.sigma_m", value, wanted)
    return value


def _degrees(gnss: Mapping[str, Any], key: str, least: float, most: float) -> float | None:
    if key not in gnss:
        return None
    value = number_of(gnss[key], f"gnss.{key}")
    if not least <= value <= most:
        raise wrong_value(f"gnss.{key}", value, f"a number of degrees from {least:g} to {most:g}")
    return value


def _file_lists(table: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    lists = {}
    for camera, value in table.items():
        files = value if isinstance(value, list) else [value]
        if not files or not all(isinstance(file, str) and file.strip() for file in files):
            raise wrong_value(f"annotations.{camera}", value, "a file name or a list of file names")
        lists[camera] = tuple(files)
    return lists


def _cameras(table: Mapping[str, Any]) -> dict[str, CameraSettings]:
    """Cameras that ``drive.toml`` itself describes, ``[cameras.NAME]``."""
    cameras = {}
    for camera in table:
        name = f"cameras.{camera}"
        entry = table_of(table, camera, name)
        refuse_unknown(entry, CAMERA_KEYS, f"[{name}] ")
        if ("position" in entry) != ("roll_pitch_yaw" in entry):
            raise DriveError(
                f"{SETTINGS_FILE} gives only one of position and roll_pitch_yaw under [{name}]: give both."
            )
        posed = "position" in entry
        position = _lever_arm(entry["position"], f"{name}.position") if posed else None
        angles = _angles(entry["roll_pitch_yaw"], f"{name}.roll_pitch_yaw") if posed else (0.0, 0.0, 0.0)
        intrinsics, mask = (text_of(entry, key, f"{name}.{key}") for key in ("intrinsics", "mask"))
        nominal = nominal_camera(entry, name)
        cameras[camera] = CameraSettings(intrinsics, position, angles, mask, nominal)
    return cameras


def _angles(value: object, name: str) -> tuple[float, float, float]:
    wanted = "[roll, pitch, yaw] in degrees: right side down, nose down and left are positive"
    if not isinstance(value, list) or len(value) != 3:
        raise wrong_value(name, value, wanted)
    roll, pitch, yaw = (number_of(part, name) for part in value)
    if max(abs(roll), abs(pitch), abs(yaw)) > 360.0:
        raise wrong_value(name, value, wanted)
    return roll, pitch, yaw


def _frames(table: Mapping[str, Any]) -> dict[str, FrameSettings]:
    """Pictures by camera: ``front = "front.mp4"``, or a table with `FRAME_KEYS`."""
    frames = {}
    for camera, value in table.items():
        name = f"frames.{camera}"
        entry = value if isinstance(value, dict) else {"file": value}
        refuse_unknown(entry, FRAME_KEYS, f"[{name}] ")
        file, offset = text_of(entry, "file", name), entry.get("utc_offset_hours")
        if file is None:
            raise wrong_value(name, value, "a video or a folder of images, or a table with file = …")
        if offset is not None and not -14.0 <= number_of(offset, f"{name}.utc_offset_hours") <= 14.0:
            raise wrong_value(
                f"{name}.utc_offset_hours", offset, "a number from -14 to 14, 2 in Norwegian summer"
            )
        start_ns = moment_of(entry["start"], f"{name}.start") if "start" in entry else None
        zone = None if offset is None else float(offset)
        frames[camera] = FrameSettings(file, start_ns, zone, flag_of(entry, "numbered"))
    return frames


def _lever_arms(table: Mapping[str, Any]) -> dict[str, tuple[float, float, float]]:
    return {antenna: _lever_arm(value, f"gnss.lever_arms.{antenna}") for antenna, value in table.items()}


def _lever_arm(value: object, name: str) -> tuple[float, float, float]:
    wanted = "[x forward, y left, z up] in metres from the middle of the rear axle on the ground"
    if not isinstance(value, list) or len(value) != 3:
        raise wrong_value(name, value, wanted)
    x, y, z = (number_of(part, name) for part in value)
    if max(abs(x), abs(y), abs(z)) > LONGEST_LEVER_ARM_M:
        raise wrong_value(name, value, wanted)
    return x, y, z
