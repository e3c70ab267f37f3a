"""A drive past objects at surveyed positions → errors by camera and distance, and the rig that mends them."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.calibration.verify_mounting import (
    CameraTurn,
    KnownSightings,
    MountingPart,
    camera_turns,
    mounting_part,
    rig_turned,
    with_angles,
)
from geoloc.earth.geodesy import (
    enu_offset,
    geographic_from_utm33,
    rotation_enu_from_rig,
    utm33_covariance_from_enu,
    utm33_from_geographic,
)
from geoloc.locate.accuracy import RANGE_EDGES_M
from geoloc.locate.error_budget import ErrorBudget
from geoloc.rig.rig import Rig
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.trajectory import Poses, Trajectory
from twin.calibrate.drives.known_objects import check_near, most_misplaced
from twin.calibrate.drives.verify_doubts import LEAST_CHANCE, LEAST_DEG, few, left_out, shared, without_pose
from twin.calibrate.drives.verify_doubts import doubt as doubt_of
from twin.calibrate.mounting_files import drive_tables, write_corrected_rig
from twin.drives.drive import Drive
from twin.drives.folder.drive_toml import SETTINGS_FILE, read_settings
from twin.drives.read import read_drive
from twin.errors import RefusedError, TruthError
from twin.ingest.budget import budget_of
from twin.ingest.locate import SightedObjects, in_euref89, locate_annotations, trajectory_of
from twin.reports.evaluation import Truth, read_truth
from twin.store.atomic_files import replace_file

_LEFT_OUT_SHARE = 0.2


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
        Median horizontal error with the rig as it is, and as it would be written.
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
        What fits best, the drive's own sigmas included.
    mounting : mapping of camera to CameraTurn
        What of it is the cameras' mounting by expectation, with the sigmas that are left.
    chance : mapping of camera to float
        Probability that a camera which is turned by `mounting` sits nearer to the truth than before.
    advised : tuple of str
        Cameras whose `mounting` would be applied: worth it, and with a chance of four in five.
    doubt : str
        Why nothing of this can be applied; empty where it can.
    misplaced : mapping of str to float
        Objects that lie elsewhere than the cameras see them, left out of everything else, and metres.
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
    mounting: Mapping[str, CameraTurn]
    chance: Mapping[str, float]
    advised: tuple[str, ...]
    doubt: str
    misplaced: Mapping[str, float]
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
    level_deg: float | None = None,
    epsg: int | None = None,
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
    level_deg : float, optional
        The ground at the objects is plane with that below the car to so many degrees, as a yard's floor is:
        takes the place of the drive's own sigmas of pitch and roll.
    epsg : int, optional
        Of `known`, as :func:`twin.reports.truth.read_truth` takes it.
    progress : callable, optional

    Raises
    ------
    DriveError, TruthError, GeolocError, RefusedError
        If an input cannot be used, no known object was annotated, one is far from where it was seen, or what
        `apply` would write cannot be right.
    """
    truths = read_truth(known, epsg=epsg)
    drive = read_drive(path, progress=progress)
    drive, datum_sigma_m = in_euref89(drive)
    trajectory = trajectory_of(drive)
    budget = budget_of(drive, None, {})
    located = locate_annotations(
        drive, trajectory, method="single-frame", budget=budget, datum_sigma_m=datum_sigma_m
    )
    place = _places(truths, drive)
    if not place:
        raise TruthError(
            f"None of the {len(truths)} objects of {known} is annotated in {drive.name}: give the annotations"
            " the attribute object with the same names."
        )
    names = drive.annotations.object[located.index]
    rows = np.flatnonzero(np.isin(names, list(place)))
    not_seen = tuple(sorted({t.object for t in truths} - set(names[rows].tolist())))
    without = rows[~located.poses.valid[rows]]
    rows = rows[located.poses.valid[rows]]
    told = without_pose(names[without], _only(located.poses, without), trajectory)
    if not rows.size:
        raise TruthError(f"No annotation of the objects of {known} can be compared. {' '.join(told)}")
    check_near(names[rows], _at(place, names[rows]), _only(located.poses, rows), truths[0].epsg)
    rows, misplaced = _without_misplaced(drive, trajectory, located, rows, place, budget)
    truth_m = _at(place, names[rows])
    poses = _only(located.poses, rows)
    sightings = _known_sightings(drive, located.index[rows], poses, truth_m)
    found = camera_turns(drive.rig, sightings)
    late_s = float(np.hypot(1e-3 * budget.time_ms, trajectory.late_sigma_s))
    later = trajectory.poses_at(located.epoch_ns[rows] + round(late_s * NANOSECONDS))
    seen_later = _known_sightings(drive, located.index[rows], later, truth_m)
    drive_sigma_deg = _drive_sigma_deg(poses, level_deg, budget)
    drive_sigma_deg = np.hypot(drive_sigma_deg, _common_change_deg(drive.rig, found, seen_later))
    part = _mounting(drive.rig, found, drive_sigma_deg, budget)
    turns = _with_angles(found, [_angles_deg(turn) for turn in found.values()], part.total_covariance_deg2)
    mounting = _with_angles(found, part.turn_deg, part.covariance_deg2)
    chance = dict(zip(found, part.chance.tolist(), strict=True))
    doubt = doubt_of(turns)
    advised = () if doubt else tuple(n for n, turn in mounting.items() if _is_worth(turn, chance[n]))
    mended = {name: mounting[name] for name in advised}
    errors = [
        np.hypot(*_offsets(drive, trajectory, rows, truth_m, r, budget)[0].T)
        for r in (drive.rig, rig_turned(drive.rig, mended))
    ]
    errors_at = _errors_at(drive.rig, sightings, *errors)
    tables_text = _drive_tables(drive, mended, Path(path))
    rig = None if apply is None else _apply(drive, mended, Path(apply), doubt)
    tables = None if rig is None or not tables_text else rig.with_suffix(".cameras.toml")
    if tables is not None:
        replace_file(tables, tables_text.encode())
    return Verification(
        drive=drive.name,
        errors=tuple(row for name, rows_at in errors_at.items() for row in _table(name, rows_at)),
        turns=turns,
        mounting=mounting,
        chance=chance,
        advised=advised,
        doubt=doubt,
        misplaced=misplaced,
        not_seen=not_seen,
        warnings=(
            *map(str, drive.warnings),
            *told,
            *left_out(misplaced),
            *shared(part, drive_sigma_deg),
            *few(turns),
        ),
        rig=rig,
        rig_file=drive.rig.source,
        drive_tables=tables_text,
        tables=tables,
        errors_at=errors_at,
    )


def _without_misplaced(
    drive: Drive,
    trajectory: Trajectory,
    located: SightedObjects,
    rows: NDArray[np.int64],
    place: Mapping[str, tuple[float, float]],
    budget: ErrorBudget,
) -> tuple[NDArray[np.int64], dict[str, float]]:
    """Leave out, one by one, objects that the turned cameras see elsewhere: a fifth of them at most."""
    names = drive.annotations.object[located.index]
    most = int(_LEFT_OUT_SHARE * len(np.unique(names[rows])))
    misplaced: dict[str, float] = {}
    while len(misplaced) < most:
        truth_m = _at(place, names[rows])
        known = _known_sightings(drive, located.index[rows], _only(located.poses, rows), truth_m)
        rig = rig_turned(drive.rig, camera_turns(drive.rig, known))
        worst = most_misplaced(names[rows], *_offsets(drive, trajectory, rows, truth_m, rig, budget))
        if worst is None:
            break
        misplaced[worst[0]] = worst[1]
        rows = rows[names[rows] != worst[0]]
    return rows, misplaced


def _at(place: Mapping[str, tuple[float, float]], names: NDArray[np.str_]) -> FloatArray:
    return np.array([place[name] for name in names.tolist()])


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


def _offsets(
    drive: Drive,
    trajectory: Trajectory,
    rows: NDArray[np.int64],
    truth_m: FloatArray,
    rig: Rig,
    budget: ErrorBudget,
) -> tuple[FloatArray, FloatArray]:
    """Place by single frames less the surveyed one, east and north, its covariance; NaN without ground."""
    moved = replace(drive, rig=rig)
    found = locate_annotations(moved, trajectory, method="single-frame", budget=budget).located
    latitude, longitude = found.latitude_deg[rows], found.longitude_deg[rows]
    offset = np.column_stack(utm33_from_geographic(latitude, longitude)) - truth_m
    return offset, utm33_covariance_from_enu(found.covariance_m2[rows], latitude, longitude)


def _errors_at(
    rig: Rig, sightings: KnownSightings, before_m: FloatArray, after_m: FloatArray
) -> dict[str, FloatArray]:
    """Camera → (n, 3): horizontal distance from the camera by the survey, and both errors."""
    eye = np.array([rig.cameras[name].rig_t_camera_m for name in sightings.camera.tolist()])
    distance = np.hypot(*(sightings.rig_point_m - eye)[:, :2].T)
    at = np.column_stack([distance, before_m, after_m])
    return {str(name): at[sightings.camera == name] for name in np.unique(sightings.camera)}


def _drive_sigma_deg(poses: Poses, level_deg: float | None, budget: ErrorBudget) -> FloatArray:
    """Sigma of roll, pitch and heading that all sightings share: of the drive, and of the ground below it.

    The road below signs against the road below the car, across, is a roll of all cameras.
    """
    roll, pitch, heading = (
        float(np.median(sigma))
        for sigma in (poses.sigma_roll_deg, poses.sigma_pitch_deg, poses.sigma_heading_deg)
    )
    if level_deg is not None:
        return np.array([level_deg, level_deg, heading])
    return np.array([np.hypot(roll, np.degrees(budget.ground_fall)), pitch, heading])


def _common_change_deg(rig: Rig, found: Mapping[str, CameraTurn], otherwise: KnownSightings) -> FloatArray:
    """By how much all cameras turn together, about the rig's axes, if the car was where `otherwise` has it.

    A car that drives is nearer to what it sees if its clock is late: that is a pitch of all cameras.
    """
    changes = [
        rig.cameras[name].rig_R_camera @ (_angles_deg(turn) - _angles_deg(found[name]))
        for name, turn in camera_turns(rig, otherwise).items()
        if name in found
    ]
    return np.abs(np.mean(changes, axis=0)) if changes else np.zeros(3)


def _angles_deg(turn: CameraTurn) -> FloatArray:
    return np.array([turn.pitch_deg, turn.yaw_deg, turn.roll_deg])


def _mounting(
    rig: Rig, found: Mapping[str, CameraTurn], drive_sigma_deg: FloatArray, budget: ErrorBudget
) -> MountingPart:
    return mounting_part(
        np.array([rig.cameras[name].rig_R_camera for name in found]).reshape(-1, 3, 3),
        np.array([_angles_deg(turn) for turn in found.values()]).reshape(-1, 3),
        np.array([t.covariance_deg2 for t in found.values()]).reshape(-1, 3, 3),
        drive_sigma_deg,
        mounting_sigma_deg=budget.boresight_deg,
    )


def _with_angles(
    found: Mapping[str, CameraTurn], angles_deg: Iterable[FloatArray], covariances_deg2: FloatArray
) -> dict[str, CameraTurn]:
    return {
        name: with_angles(turn, angles, covariance)
        for (name, turn), angles, covariance in zip(found.items(), angles_deg, covariances_deg2, strict=True)
    }


def _is_worth(turn: CameraTurn, chance: float) -> bool:
    return chance >= LEAST_CHANCE and float(np.abs(_angles_deg(turn)).max()) > LEAST_DEG


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


def _apply(drive: Drive, turns: Mapping[str, CameraTurn], path: Path, doubt: str) -> Path:
    if doubt:
        raise RefusedError(f"{path} is not written. {doubt}")
    document = json.loads(drive.rig_document.removeprefix("\ufeff"))
    corrected = rig_turned(drive.rig, turns)
    rotations = {name: corrected.cameras[name].rig_R_camera for name in turns}
    return write_corrected_rig(path, document, rotations, drive.rig.source)
