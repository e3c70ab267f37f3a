"""A drive past objects at surveyed positions → errors by camera and distance, and the rig that mends them."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geoloc.accuracy import RANGE_EDGES_M
from geoloc.calibration.verify import CameraTurn, KnownSightings, camera_turns, rig_turned
from geoloc.geodesy import (
    enu_offset,
    geographic_from_utm33,
    rotation_enu_from_rig,
    utm33_from_geographic,
)
from geoloc.rig import Rig
from geoloc.rig_edit import with_rotation_correction
from geoloc.trajectory import Poses, Trajectory
from twin.calibrate.mounting_files import drive_tables
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.drives.settings import SETTINGS_FILE, read_settings
from twin.errors import TruthError
from twin.evaluate import Truth, read_truth
from twin.export.atomic import replace_file
from twin.folders import make_folder
from twin.sighted import in_euref89, locate_annotations, trajectory_of

FloatArray = NDArray[np.float64]

SURE_SIGMAS = 2.0
_FEW_OBJECTS = 5
LEAST_DEG = 0.02
"""A smaller turn is 4 mm at 12 m to the side: not worth another rig file."""


@dataclass(frozen=True, slots=True)
class ErrorRow:
    """Errors of single frames of one camera in one class of distance, as in the paper's table 1.

    Attributes
    ----------
    camera : str
    distance_m : float
        Median horizontal distance of the objects from the camera, by the survey.
    n : int
    before_m, after_m : float
        Median horizontal error with the rig as it is, and with the turns found.
    """

    camera: str
    distance_m: float
    n: int
    before_m: float
    after_m: float


@dataclass(frozen=True, slots=True)
class Verification:
    """What a drive past known objects says of the cameras.

    Attributes
    ----------
    drive : str
    errors : tuple of ErrorRow
    turns : mapping of camera to CameraTurn
    advised : tuple of str
        Cameras whose turn is certain (two sigmas) and worth applying.
    not_seen : tuple of str
        Known objects without an annotation of their foot.
    warnings : tuple of str
    rig : Path or None
        The corrected rig file, where one was asked for.
    rig_file : str
        Name of the drive's own.
    drive_tables : str
        What ``[cameras]`` of the drive's ``drive.toml`` has to say of the advised cameras; empty without one.
    tables : Path or None
        The file with `drive_tables`, where a corrected rig was asked for.
    """

    drive: str
    errors: tuple[ErrorRow, ...]
    turns: Mapping[str, CameraTurn]
    advised: tuple[str, ...]
    not_seen: tuple[str, ...]
    warnings: tuple[str, ...]
    rig: Path | None
    rig_file: str
    drive_tables: str
    tables: Path | None
    errors_at: Mapping[str, FloatArray]
    """Camera → (n, 3): distance, error before and after, of every sighting; not part of the JSON document."""


def verify_drive(
    path: Path | str,
    known: Path | str,
    *,
    apply: Path | str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Verification:
    """Compare what single frames say of objects with where they were surveyed.

    Only feet count: the ground is where the survey is. The car should stand or drive on level ground there.

    Parameters
    ----------
    path : Path or str
        A drive whose annotations name the objects (attribute ``object``).
    known : Path or str
        CSV with object, easting, northing (EPSG:25833), as for ``twin evaluate``.
    apply : Path or str, optional
        Rig file to write: the drive's rig with ``correction_sensor_R_FLU`` of the advised cameras. Where the
        drive's ``drive.toml`` has ``[cameras]``, their new tables are written beside it (``.cameras.toml``).
    progress : callable, optional

    Raises
    ------
    DriveError, TruthError, GeolocError, RefusedError
        If an input cannot be used, or no known object was annotated.
    """
    truths = read_truth(known)
    drive = read_drive(path, progress=progress)
    drive, datum_sigma_m = in_euref89(drive)
    trajectory = trajectory_of(drive)
    located = locate_annotations(drive, trajectory, method="single-frame", datum_sigma_m=datum_sigma_m)
    place = _places(truths, drive)
    if not place:
        raise TruthError(
            f"None of the {len(truths)} objects of {known} is annotated in {drive.name}: give the annotations"
            " the attribute object with the same names."
        )
    names = drive.annotations.object[located.index]
    rows = np.flatnonzero(np.isin(names, list(place)))
    truth_m = np.array([place[name] for name in names[rows].tolist()])
    sightings = _known_sightings(drive, located.index[rows], _only(located.poses, rows), truth_m)
    turns = camera_turns(drive.rig, sightings)
    errors = [
        _errors_m(drive, trajectory, rows, truth_m, r) for r in (drive.rig, rig_turned(drive.rig, turns))
    ]
    errors_at = _errors_at(drive.rig, sightings, *errors)
    advised = tuple(name for name, turn in turns.items() if _is_sure(turn))
    mended = {name: turns[name] for name in advised}
    tables_text = _drive_tables(drive, mended, Path(path))
    rig = None if apply is None else _apply(drive, mended, Path(apply))
    tables = None if rig is None or not tables_text else rig.with_suffix(".cameras.toml")
    if tables is not None:
        replace_file(tables, tables_text.encode())
    return Verification(
        drive=drive.name,
        errors=tuple(row for name, rows_at in errors_at.items() for row in _table(name, rows_at)),
        turns=turns,
        advised=advised,
        not_seen=tuple(sorted({t.object for t in truths} - set(names[rows].tolist()))),
        warnings=(*drive.warnings, *_shared(turns, located.poses, rows)),
        rig=rig,
        rig_file=drive.rig.source,
        drive_tables=tables_text,
        tables=tables,
        errors_at=errors_at,
    )


def _places(truths: list[Truth], drive: Drive) -> dict[str, tuple[float, float]]:
    mine = [t for t in truths if t.drive_id in ("", drive.drive_id)]
    return {t.object: (t.east_m, t.north_m) for t in mine if t.object in set(drive.annotations.object)}


def _only(poses: Poses, rows: NDArray[np.int64]) -> Poses:
    from dataclasses import fields

    return replace(poses, **{f.name: getattr(poses, f.name)[rows] for f in fields(Poses)})


def _known_sightings(
    drive: Drive, index: NDArray[np.int64], poses: Poses, truth_m: FloatArray
) -> KnownSightings:
    """Where the known objects are in the rig frame, on its ground plane, when they are seen."""
    latitude, longitude = geographic_from_utm33(truth_m[:, 0], truth_m[:, 1])
    east, north = enu_offset(poses.latitude_deg, poses.longitude_deg, latitude, longitude)
    enu_R_rig = rotation_enu_from_rig(poses.heading_deg, poses.pitch_deg, poses.roll_deg)
    # On the rig's ground plane the height follows from the place: the plane's normal has no part of it.
    normal = enu_R_rig[:, :, 2]
    up = -(normal[:, 0] * east + normal[:, 1] * north) / normal[:, 2]
    offset = np.stack([east, north, up], axis=-1)
    # What is annotated is the near side of the pole, not its middle.
    away = np.maximum(np.hypot(east, north), 1.0)
    offset[:, :2] *= (1.0 - drive.pole_radius_m / away)[:, np.newaxis]
    notes = drive.annotations
    return KnownSightings(
        camera=notes.camera[index],
        pixel_px=notes.pixel_px[index],
        rig_point_m=np.einsum("nji,nj->ni", enu_R_rig, offset),
        object=np.unique(notes.object[index], return_inverse=True)[1].astype(np.int64),
    )


def _errors_m(
    drive: Drive, trajectory: Trajectory, rows: NDArray[np.int64], truth_m: FloatArray, rig: Rig
) -> FloatArray:
    """Horizontal error of every sighting by single frames; NaN where its ray meets no ground."""
    located = locate_annotations(replace(drive, rig=rig), trajectory, method="single-frame").located
    east, north = utm33_from_geographic(located.latitude_deg[rows], located.longitude_deg[rows])
    return np.asarray(np.hypot(east - truth_m[:, 0], north - truth_m[:, 1]))


def _errors_at(
    rig: Rig, sightings: KnownSightings, before_m: FloatArray, after_m: FloatArray
) -> dict[str, FloatArray]:
    """Camera → (n, 3): horizontal distance from the camera by the survey, and both errors."""
    eye = np.array([rig.cameras[name].rig_t_camera_m for name in sightings.camera.tolist()])
    distance = np.hypot(*(sightings.rig_point_m - eye)[:, :2].T)
    at = np.column_stack([distance, before_m, after_m])
    return {str(name): at[sightings.camera == name] for name in np.unique(sightings.camera)}


def _is_sure(turn: CameraTurn) -> bool:
    pairs = (
        (turn.pitch_deg, turn.sigma_pitch_deg),
        (turn.yaw_deg, turn.sigma_yaw_deg),
        (turn.roll_deg, turn.sigma_roll_deg),
    )
    return any(abs(value) > max(SURE_SIGMAS * sigma, LEAST_DEG) for value, sigma in pairs)


def _shared(turns: Mapping[str, CameraTurn], poses: Poses, rows: NDArray[np.int64]) -> tuple[str, ...]:
    """Tell of a turn that all cameras ask for: it may be the drive's own heading, pitch or roll."""
    found = []
    for axis, pose in (("yaw", "heading"), ("pitch", "pitch"), ("roll", "roll")):
        turn = np.array([getattr(t, f"{axis}_deg") for t in turns.values()])
        sigma = np.array([getattr(t, f"sigma_{axis}_deg") for t in turns.values()])
        if len(turn) < 1:
            continue
        common = float(turn.mean())
        drive = float(np.median(getattr(poses, f"sigma_{pose}_deg")[rows]))
        alike = len(turn) == 1 or bool((np.sign(turn) == np.sign(common)).all())
        if alike and abs(common) > max(SURE_SIGMAS * float(sigma.min()), LEAST_DEG) and drive > LEAST_DEG:
            found.append(
                f"The cameras ask for {common:+.2f}° of {axis} together, and the drive's own {pose} is known"
                f" to {drive:.2f}° only: verify in other directions, or driving, before this is applied."
            )
    if turns and min(turn.n_objects for turn in turns.values()) < _FEW_OBJECTS:
        found.append(
            f"Fewer than {_FEW_OBJECTS} objects: the sigmas are rough, since they count how objects differ."
        )
    return tuple(found)


def _table(camera: str, at: FloatArray) -> list[ErrorRow]:
    rows = []
    for nearest, furthest in itertools.pairwise(RANGE_EDGES_M):
        inside = (at[:, 0] >= nearest) & (at[:, 0] < furthest) & np.isfinite(at).all(axis=1)
        if inside.any():
            distance, before, after = np.median(at[inside], axis=0).tolist()
            rows.append(ErrorRow(camera, distance, int(inside.sum()), before, after))
    return rows


def _drive_tables(drive: Drive, turns: Mapping[str, CameraTurn], root: Path) -> str:
    """``[cameras]`` with the turned cameras; empty where the drive has no such table, or none is turned."""
    file = root / SETTINGS_FILE
    tables = read_settings(file.read_bytes()).cameras if file.exists() else {}
    return drive_tables(rig_turned(drive.rig, turns), turns, tables) if tables else ""


def _apply(drive: Drive, turns: Mapping[str, CameraTurn], path: Path) -> Path:
    document = json.loads(drive.rig_document.removeprefix("\ufeff"))
    corrected = rig_turned(drive.rig, turns)
    for name in turns:
        document = with_rotation_correction(
            document, name, corrected.cameras[name].rig_R_camera, drive.rig.source
        )
    make_folder(path.parent)
    replace_file(path, (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode())
    return path
