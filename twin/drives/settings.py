"""``drive.toml``: what a drive folder says about itself."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from geoloc.adjust import POLE_RADIUS_M
from twin.errors import DriveError

SETTINGS_FILE = "drive.toml"
_Default = TypeVar("_Default", float, None)
DATUMS = ("EUREF89", "ITRF2014", "ITRF2020")
PITCH_SIGNS = ("nose_down", "nose_up")
LONGEST_READOUT_MS = 200.0
"""No rolling shutter takes longer than the time between two frames of a slow camera."""
THICKEST_POLE_M = 0.5
LONGEST_LEVER_ARM_M = 30.0
"""No car is longer: a larger lever arm is in another unit."""

_TABLES: Mapping[str, tuple[str, ...]] = {"gnss": ("files", "lever_arms"), "poses": ("file",)}
_KEYS = (
    "name",
    "rig",
    "annotations_complete",
    "datum",
    "camera_offset_ms",
    "rolling_shutter_ms",
    "pole_radius_m",
    "pitch_positive",
    "gnss",
    "poses",
    "timestamps",
    "annotations",
)


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """Content of ``drive.toml``. None means that the file does not say: the folder is searched instead.

    Attributes
    ----------
    name, rig : str or None
    annotations_complete : bool
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
    lever_arms_m : mapping of antenna to (x, y, z)
    poses : str or None
    timestamps : mapping of camera to file
        Cameras that are not named here are searched.
    annotations : mapping of camera to files, or None
    """

    name: str | None = None
    rig: str | None = None
    annotations_complete: bool = False
    datum: str = "EUREF89"
    camera_offset_ns: int = 0
    rolling_shutter_ms: float | None = None
    pole_radius_m: float = POLE_RADIUS_M
    pitch_nose_up: bool = False
    gnss: Mapping[str, str] | None = None
    lever_arms_m: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    poses: str | None = None
    timestamps: Mapping[str, str] = field(default_factory=dict)
    annotations: Mapping[str, tuple[str, ...]] | None = None


def read_settings(content: bytes) -> DriveSettings:
    """Read ``drive.toml``.

    Raises
    ------
    DriveError
        If it is not TOML, has an unknown key (the nearest known one is named), a value of the wrong type, or
        names both GNSS files and a pose file.
    """
    document = _document(content)
    _refuse_unknown(document, _KEYS, "")
    gnss, poses = _table(document, "gnss"), _table(document, "poses")
    for key, table in (("gnss", gnss), ("poses", poses)):
        _refuse_unknown(table, _TABLES[key], f"[{key}] ")
    files = _files(gnss, "files", "gnss.files") if "files" in gnss else None
    track = _text(poses, "file", "poses.file")
    if files and track:
        raise DriveError(
            f"{SETTINGS_FILE} names both GNSS files and the pose file {track}: keep the one that says best"
            " where the car was."
        )
    annotations = _table(document, "annotations")
    return DriveSettings(
        name=_text(document, "name"),
        rig=_text(document, "rig"),
        annotations_complete=_flag(document, "annotations_complete"),
        datum=_datum(document),
        camera_offset_ns=round(_number(document.get("camera_offset_ms", 0.0), "camera_offset_ms") * 1e6),
        rolling_shutter_ms=_between(document, "rolling_shutter_ms", None, LONGEST_READOUT_MS),
        pole_radius_m=_between(document, "pole_radius_m", POLE_RADIUS_M, THICKEST_POLE_M),
        pitch_nose_up=_choice(document, "pitch_positive", PITCH_SIGNS) == "nose_up",
        gnss=files,
        lever_arms_m=_lever_arms(_table(gnss, "lever_arms", "gnss.lever_arms")),
        poses=track,
        timestamps=_files(document, "timestamps", "timestamps"),
        annotations=_file_lists(annotations) if "annotations" in document else None,
    )


def _document(content: bytes) -> dict[str, Any]:
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise DriveError(f"{SETTINGS_FILE} is not UTF-8 text: save it as UTF-8.") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DriveError(f"{SETTINGS_FILE} is not valid TOML ({error}): correct that line.") from error


def _refuse_unknown(table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    for key in table:
        if key not in known:
            nearest = difflib.get_close_matches(key, list(known), n=1, cutoff=0.0)[0]
            raise DriveError(
                f"{SETTINGS_FILE} has the unknown key {where}{key}: the nearest known one is"
                f" {where}{nearest}."
            )


def _wrong(key: str, value: object, wanted: str) -> DriveError:
    return DriveError(f"{SETTINGS_FILE} gives {key} = {value!r}: it must be {wanted}.")


def _table(parent: Mapping[str, Any], key: str, name: str = "") -> Mapping[str, Any]:
    table = parent.get(key, {})
    if not isinstance(table, dict):
        raise _wrong(name or key, table, "a table of keys and values")
    return table


def _text(table: Mapping[str, Any], key: str, name: str = "") -> str | None:
    value = table.get(key)
    if value is not None and (not isinstance(value, str) or not value.strip()):
        raise _wrong(name or key, value, "a text in quotation marks")
    return value


def _flag(table: Mapping[str, Any], key: str) -> bool:
    value = table.get(key, False)
    if not isinstance(value, bool):
        raise _wrong(key, value, "true or false")
    return value


def _choice(table: Mapping[str, Any], key: str, choices: tuple[str, ...]) -> str:
    value = table.get(key, choices[0])
    if value not in choices:
        raise _wrong(key, value, " or ".join(f'"{choice}"' for choice in choices))
    return str(value)


def _datum(document: Mapping[str, Any]) -> str:
    value = document.get("datum", DATUMS[0])
    if value not in DATUMS:
        wanted = (
            '"EUREF89" (with Norwegian corrections, such as CPOS), "ITRF2014" or "ITRF2020" (without, such as'
            " PPP); WGS84 alone does not say which of them (docs/datum-and-heights.md)"
        )
        raise _wrong("datum", value, wanted)
    return str(value)


def _number(value: object, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _wrong(key, value, "a number")
    return float(value)


def _between(document: Mapping[str, Any], key: str, default: _Default, most: float) -> float | _Default:
    """A number from 0 to `most`, or the default where the file does not say."""
    if key not in document:
        return default
    value = _number(document[key], key)
    if not 0.0 <= value <= most:
        raise _wrong(key, value, f"a number from 0 to {most:g}")
    return value


def _files(parent: Mapping[str, Any], key: str, name: str) -> dict[str, str]:
    table = _table(parent, key, name)
    for sensor, file in table.items():
        if not isinstance(file, str) or not file.strip():
            raise _wrong(f"{name}.{sensor}", file, "a file name in quotation marks")
    return dict(table)


def _file_lists(table: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    lists = {}
    for camera, value in table.items():
        files = value if isinstance(value, list) else [value]
        if not files or not all(isinstance(file, str) and file.strip() for file in files):
            raise _wrong(f"annotations.{camera}", value, "a file name or a list of file names")
        lists[camera] = tuple(files)
    return lists


def _lever_arms(table: Mapping[str, Any]) -> dict[str, tuple[float, float, float]]:
    arms = {}
    for antenna, value in table.items():
        name = f"gnss.lever_arms.{antenna}"
        wanted = "[x forward, y left, z up] in metres from the middle of the rear axle on the ground"
        if not isinstance(value, list) or len(value) != 3:
            raise _wrong(name, value, wanted)
        x, y, z = (_number(part, name) for part in value)
        if max(abs(x), abs(y), abs(z)) > LONGEST_LEVER_ARM_M:
            raise _wrong(name, value, wanted)
        arms[antenna] = (x, y, z)
    return arms
