"""How each camera sat on the car, drive by drive, as the adjustment of ordinary drives found it."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import sqlalchemy as sa
from scipy.spatial.transform import Rotation

from geoloc.arrays import FloatArray
from geoloc.calibration.verify_mounting import mounting_part, turned
from geoloc.locate.error_budget import ErrorBudget
from geoloc.rig.rig import Rig, rig_from_document
from twin.calibrate.mounting_files import write_corrected_rig
from twin.errors import ConfigError
from twin.store import schema
from twin.store.records import Boresight, Corrections
from twin.store.store import Store

AXES = ("pitch", "yaw", "roll")
"""About the camera's own x, y and z."""
MOVED_DEG = 0.05
MOVED_SIGMAS = 3.0
_LEAST_CHANCE = 0.93
_PRIOR_DEG = ErrorBudget().boresight_deg
_KNOWS_NOTHING_DEG = 5.0
_SYSTEMATIC_DEG = 0.02
"""What the adjustments of two drives share and do not know of: the load of the car, the temperature."""
_ROLL_DEG = 0.6
"""Roll that the drives' roads share. The smoother takes a car on the right to lean by 2 ± 3 %, anew every
300 m (`smoother_tilt`); straight roads fall by 3 % (Statens vegvesen, håndbok N100), so that many drives
along them are off by 1 % = 0.6° in the mean, all cameras alike."""


@dataclass(frozen=True, slots=True)
class DriveTurn:
    """One camera in one drive.

    Attributes
    ----------
    drive_id, name : str
    started_ns : int
    turn_deg, sigma_deg : tuple of float
        Pitch, yaw and roll against the newest drive's rig file, one sigma.
    """

    drive_id: str
    name: str
    started_ns: int
    turn_deg: tuple[float, float, float]
    sigma_deg: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CameraHistory:
    """One camera over all drives.

    Attributes
    ----------
    camera : str
    drives : tuple of DriveTurn
        By time.
    since : int
        Index of the first drive since which it has not moved.
    turn_deg, sigma_deg : tuple of float
        Weighted mean over the drives since then; sigma of roll with the crossfall that drives share.
    mounting_deg : tuple of float
        What of the mean is this camera's mounting by expectation: little of a roll common to all cameras,
        which roads may have made.
    chance : float
        Probability that the camera, turned so, sits nearer to the truth than before.
    """

    camera: str
    drives: tuple[DriveTurn, ...]
    since: int
    turn_deg: tuple[float, float, float]
    sigma_deg: tuple[float, float, float]
    mounting_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    chance: float = 0.5


@dataclass(frozen=True, slots=True)
class Histories:
    """All cameras, and the sentences that a person should read.

    Attributes
    ----------
    cameras : tuple of CameraHistory
    warnings : tuple of str
        One for each move of a camera, and one for a roll that roads may have made.
    advised : tuple of str
        Cameras that sit otherwise than in the newest rig file, with a chance of 93 % (three sigmas).
    rig : Path or None
        The corrected rig, where one was asked for.
    """

    cameras: tuple[CameraHistory, ...]
    warnings: tuple[str, ...]
    advised: tuple[str, ...]
    rig: Path | None


def cameras_from_drives(store: Store, *, apply: Path | str | None = None) -> Histories:
    """Follow the cameras' boresights over the drives in a store.

    Every drive that was ingested by ``adjusted`` has estimated a small turn of each camera, with its sigma.
    Drives may have used different rig files: all turns are told against the newest drive's.

    Parameters
    ----------
    store : Store
    apply : Path or str, optional
        Rig file to write: the newest drive's, with ``correction_sensor_R_FLU`` of the advised cameras.

    Raises
    ------
    ConfigError
        If no drive in the store was ingested by ``adjusted``.
    RefusedError
        If the rig file cannot be written.
    """
    drives = _drives(store)
    newest = drives[-1]
    alone = tuple(
        _history(name, [d for d in drives if name in d.boresight], newest.rig)
        for name in sorted({name for d in drives for name in d.boresight} & newest.rig.cameras.keys())
    )
    cameras, shared = _without_crossfall(alone, newest.rig)
    advised = tuple(
        c.camera for c in cameras if c.chance > _LEAST_CHANCE and max(map(abs, c.mounting_deg)) > MOVED_DEG
    )
    written = None
    if apply is not None:
        written = _apply(newest, [c for c in cameras if c.camera in advised], Path(apply))
    return Histories(cameras, (*(w for c in cameras for w in _moves(c)), *shared), advised, written)


@dataclass(frozen=True, slots=True)
class _StoredDrive:
    drive_id: str
    name: str
    started_ns: int
    document: Mapping[str, Any]
    rig: Rig
    boresight: Mapping[str, Boresight]


def _drives(store: Store) -> list[_StoredDrive]:
    """Drives that were adjusted, by time."""
    drive, method = schema.drive, schema.drive_method
    rows = store.rows(
        sa.select(drive.c.drive_id, drive.c.name, drive.c.started_ns, drive.c.rig, method.c.corrections)
        .join(method, method.c.drive_id == drive.c.drive_id)
        .where(method.c.method == "adjusted")
        .order_by(drive.c.started_ns, drive.c.drive_id)
    )
    drives = []
    for row in rows:
        corrections = Corrections.from_json(row["corrections"])
        if corrections is not None and corrections.boresight_deg:
            document = json.loads(zlib.decompress(row["rig"]).decode().removeprefix("\ufeff"))
            rig = rig_from_document(document, f"the rig of {row['name']}")
            place = (row["drive_id"], row["name"], row["started_ns"])
            drives.append(_StoredDrive(*place, document, rig, corrections.boresight_deg))
    if not drives:
        raise ConfigError(
            "No drive in the store was ingested by the method adjusted, which is what finds how cameras sit:"
            " ingest some first."
        )
    return drives


def _history(camera: str, drives: Sequence[_StoredDrive], newest: Rig) -> CameraHistory:
    turns = [_turn(drive, camera, newest) for drive in drives]
    turn = np.array([t.turn_deg for t in turns])
    sigma = np.array([t.sigma_deg for t in turns])
    since = 0
    for i in range(1, len(turns)):
        mean, mean_sigma = _mean(turn[since:i], sigma[since:i])
        if _differs(turn[i] - mean, np.hypot(sigma[i], mean_sigma)):
            since = i
    mean, mean_sigma = _mean(turn[since:], sigma[since:])
    return CameraHistory(camera, tuple(turns), since, _three(mean), _three(mean_sigma))


def _turn(drive: _StoredDrive, camera: str, newest: Rig) -> DriveTurn:
    turn = drive.boresight[camera]
    angles = (turn.pitch, turn.yaw, turn.roll)
    value = np.array([angle.value for angle in angles], dtype=np.float64)
    sigma = np.array([_PRIOR_DEG if angle.sigma is None else angle.sigma for angle in angles])
    value, sigma = _without_prior(value, sigma)
    own = drive.rig.camera(camera).rig_R_camera @ Rotation.from_rotvec(np.radians(value)).as_matrix()
    against = Rotation.from_matrix(newest.camera(camera).rig_R_camera.T @ own).as_rotvec()
    sigma = np.hypot(sigma, _SYSTEMATIC_DEG)
    return DriveTurn(drive.drive_id, drive.name, drive.started_ns, _three(np.degrees(against)), _three(sigma))


def _without_prior(value: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What a drive alone says: every adjustment begins with "0 ± 0.2°", which must not count each time."""
    precision = np.maximum(1.0 / sigma**2 - 1.0 / _PRIOR_DEG**2, 1.0 / _KNOWS_NOTHING_DEG**2)
    return value / sigma**2 / precision, 1.0 / np.sqrt(precision)


def _mean(turn: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    weight = 1.0 / sigma**2
    total = np.maximum(weight.sum(axis=0), 1e-12)
    return (weight * turn).sum(axis=0) / total, 1.0 / np.sqrt(total)


def _without_crossfall(
    cameras: Sequence[CameraHistory], rig: Rig
) -> tuple[tuple[CameraHistory, ...], list[str]]:
    """Tell each camera's own turn from a roll that the roads' crossfall gives all of them."""
    part = mounting_part(
        np.array([rig.camera(c.camera).rig_R_camera for c in cameras]).reshape(-1, 3, 3),
        np.array([c.turn_deg for c in cameras]).reshape(-1, 3),
        np.array([np.diag(np.square(c.sigma_deg)) for c in cameras]).reshape(-1, 3, 3),
        np.array([_ROLL_DEG, 0.0, 0.0]),
    )
    sigma = np.sqrt(np.diagonal(part.total_covariance_deg2, axis1=1, axis2=2))
    found = tuple(
        replace(
            c, sigma_deg=_three(sigma[i]), mounting_deg=_three(part.turn_deg[i]), chance=float(part.chance[i])
        )
        for i, c in enumerate(cameras)
    )
    roll, own = float(part.common_deg[0]), float(part.common_sigma_deg[0])
    if abs(roll) <= max(MOVED_SIGMAS * own, MOVED_DEG):
        return found, []
    sentence = (
        f"The cameras have {roll:+.2f}° of roll together, which the roads' crossfall may have made"
        f" (± {_ROLL_DEG}°): {part.common_part_deg[0]:+.2f}° of it is counted as their mounting. Verify on"
        " level ground."
    )
    return found, [sentence]


def _differs(turn_deg: FloatArray, sigma_deg: FloatArray) -> bool:
    return bool((np.abs(turn_deg) > np.maximum(MOVED_SIGMAS * sigma_deg, MOVED_DEG)).any())


def _moves(history: CameraHistory) -> list[str]:
    """A sentence for the last move of a camera."""
    if history.since == 0:
        return []
    before, after = history.drives[history.since - 1], history.drives[history.since]
    parts = [
        f"{axis} {new - old:+.2f}°"
        for axis, old, new in zip(AXES, before.turn_deg, after.turn_deg, strict=True)
        if abs(new - old) > MOVED_DEG
    ]
    sentence = (
        f"{history.camera} has turned between {before.name} and {after.name} ({', '.join(parts)}): look at"
        " its mount, and calibrate it anew if it was touched."
    )
    return [sentence]


def _apply(newest: _StoredDrive, cameras: Sequence[CameraHistory], path: Path) -> Path:
    rotations = {
        history.camera: turned(newest.rig.camera(history.camera), *history.mounting_deg).rig_R_camera
        for history in cameras
    }
    return write_corrected_rig(path, newest.document, rotations, newest.rig.source)


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
