"""Cameras against objects at surveyed positions: the turn of each camera that explains what is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from geoloc.arrays import FloatArray, IntArray
from geoloc.locate.error_budget import ErrorBudget
from geoloc.rig.rig import Rig, RigCamera

_ROUNDS = 30
_HUBER = 2.0
_SETTLED_RAD = 1e-10
_LEAST_SIGMA_PX = 0.05
_ROLL_RAD = np.radians(0.3)
_MOUNTING_DEG = ErrorBudget().boresight_deg
MIN_SIGHTINGS = 3
SURE_SIGMAS = 2.0


@dataclass(frozen=True, slots=True)
class KnownSightings:
    """Sightings of objects whose positions are known.

    Attributes
    ----------
    camera : str (n,)
    pixel_px : float64 (n, 2)
    rig_point_m : float64 (n, 3)
        Where the object is in the rig frame at the moment of the picture.
    object : int64 (n,)
        The same number is the same object: its sightings share the error of its position.
    """

    camera: NDArray[np.str_]
    pixel_px: FloatArray
    rig_point_m: FloatArray
    object: IntArray


@dataclass(frozen=True, slots=True)
class CameraTurn:
    """How a camera should be turned.

    Attributes
    ----------
    camera : str
    pitch_deg, yaw_deg, roll_deg : float
        About the camera's own x, y and z axes: positive pitch looks further up, positive yaw further right,
        positive roll turns its top to the right.
    sigma_pitch_deg, sigma_yaw_deg, sigma_roll_deg : float
        One sigma; sightings of one object count as far as their objects differ.
    before_px, after_px : float
        Median difference of seen and expected pixel, without the turn and with it.
    after_deg : float
        The latter as an angle of rays.
    n_sightings, n_objects : int
    covariance_deg2 : tuple of tuple of float
        (3, 3) of pitch, yaw and roll.
    """

    camera: str
    pitch_deg: float
    yaw_deg: float
    roll_deg: float
    sigma_pitch_deg: float
    sigma_yaw_deg: float
    sigma_roll_deg: float
    before_px: float
    after_px: float
    after_deg: float
    n_sightings: int
    n_objects: int
    covariance_deg2: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True, eq=False)
class MountingPart:
    """What of the cameras' turns belongs to their mounting; pitch, yaw and roll about each camera's x, y, z.

    Attributes
    ----------
    turn_deg : float64 (n, 3)
        What is certain; an angle that is not is 0.
    total_covariance_deg2 : float64 (n, 3, 3)
        Of the turns as found, the drive's own error included.
    covariance_deg2 : float64 (n, 3, 3)
        Of what is left of them.
    common_deg : float64 (3,)
        What all cameras ask for together, about the rig's x, y and z.
    common_sigma_deg : float64 (3,)
        Its sigma, without the drive's own.
    is_known : bool (3,)
        Whether the common turn is told apart from the drive's own: else `turn_deg` is without it.
    """

    turn_deg: FloatArray
    total_covariance_deg2: FloatArray
    covariance_deg2: FloatArray
    common_deg: FloatArray
    common_sigma_deg: FloatArray
    is_known: NDArray[np.bool_]


def camera_turns(rig: Rig, known: KnownSightings) -> dict[str, CameraTurn]:
    """Find the pitch, yaw and roll by which each camera is off.

    Robust least squares on the difference of the seen and the expected ray, in pixels. Roll has a prior of
    0.3°, since objects that stand in a column of the picture do not show it. The covariance is that of
    clustered observations, as the error of an object's surveyed position is in all its sightings.

    Parameters
    ----------
    rig : Rig
    known : KnownSightings

    Returns
    -------
    dict of camera name to CameraTurn
        Cameras with at least 3 usable sightings.

    Notes
    -----
    Cluster-robust covariance: Cameron and Miller, "A Practitioner's Guide to Cluster-Robust Inference",
    Journal of Human Resources 50 (2015), equation 11.
    """
    found = {}
    for name in np.unique(known.camera).tolist():
        mine = known.camera == name
        turn = _turn(rig.camera(name), known.pixel_px[mine], known.rig_point_m[mine], known.object[mine])
        if turn is not None:
            found[name] = turn
    return found


def mounting_part(
    rig_R_camera: FloatArray,
    turn_deg: FloatArray,
    covariance_deg2: FloatArray,
    drive_sigma_deg: FloatArray,
    sigmas: float = SURE_SIGMAS,
    mounting_sigma_deg: float = _MOUNTING_DEG,
) -> MountingPart:
    """Tell the cameras' mounting from an error of the drive's own angles, which turns all of them alike.

    Each turn is the camera's own, the drive's, and noise. The common turn is the weighted mean in the rig
    frame, where cameras scatter by `mounting_sigma_deg` a camera and axis. About an axis where it is no more
    than the drive may be off it is taken off, and how cameras differ remains. Angles that are then not
    certain are left at 0: the others are told against the cameras that stay as they are, so that nothing is
    left to apply.

    Parameters
    ----------
    rig_R_camera : float64 (n, 3, 3)
    turn_deg : float64 (n, 3)
        Pitch, yaw and roll.
    covariance_deg2 : float64 (n, 3, 3)
    drive_sigma_deg : float64 (3,)
        One sigma of the drive's own roll, pitch and heading (the rig's x, y and z), the same for all cameras.
    sigmas : float
        How many of them are certain.
    mounting_sigma_deg : float
        One sigma of a camera's own angles, an axis.
    """
    camera_R_rig = np.swapaxes(rig_R_camera, 1, 2)
    turn_rig = np.einsum("nij,nj->ni", rig_R_camera, turn_deg)
    variance = np.diagonal(rig_R_camera @ covariance_deg2 @ camera_R_rig, axis1=1, axis2=2)
    weight = 1.0 / (variance + mounting_sigma_deg**2)
    weight = weight / weight.sum(axis=0)
    common = (weight * turn_rig).sum(axis=0)
    # Cameras see the same objects: their errors are taken as shared, and so add up.
    common_sigma = (weight * np.sqrt(variance)).sum(axis=0)
    is_known = np.abs(common) > sigmas * np.hypot(common_sigma, drive_sigma_deg)
    is_known |= drive_sigma_deg <= common_sigma

    def with_drive(sigma_deg: FloatArray) -> FloatArray:
        return np.asarray(covariance_deg2 + camera_R_rig @ np.diag(sigma_deg**2) @ rig_R_camera)

    kept = with_drive(np.where(is_known, drive_sigma_deg, 0.0))
    # The drive's own is in `is_known` already: where it is, all cameras turn, and they differ by their own.
    least = sigmas * np.sqrt(np.diagonal(covariance_deg2, axis1=1, axis2=2))
    turn = np.zeros_like(turn_deg)
    for _ in range(_ROUNDS):
        remains = np.einsum("nij,nj->ni", rig_R_camera, turn_deg - turn)
        shared = np.where(is_known, 0.0, (weight * remains).sum(axis=0))
        left = np.einsum("nij,nj->ni", camera_R_rig, remains - shared)
        sure = np.abs(left + turn) > least
        step = np.where(sure & (np.abs(left) > least / 10.0), left, 0.0)
        if not step.any():
            break
        turn = turn + step
    return MountingPart(turn, with_drive(drive_sigma_deg), kept, common, common_sigma, is_known)


def with_angles(found: CameraTurn, turn_deg: FloatArray, covariance_deg2: FloatArray) -> CameraTurn:
    """Give a camera's turn other angles (pitch, yaw, roll) and their covariance (3, 3)."""
    pitch, yaw, roll = turn_deg.tolist()
    sigma_pitch, sigma_yaw, sigma_roll = np.sqrt(np.diag(covariance_deg2)).tolist()
    return replace(
        found,
        pitch_deg=pitch,
        yaw_deg=yaw,
        roll_deg=roll,
        sigma_pitch_deg=sigma_pitch,
        sigma_yaw_deg=sigma_yaw,
        sigma_roll_deg=sigma_roll,
        covariance_deg2=tuple(tuple(row) for row in covariance_deg2.tolist()),
    )


def turned(camera: RigCamera, pitch_deg: float, yaw_deg: float, roll_deg: float) -> RigCamera:
    """Turn a camera about its own x (pitch), y (yaw) and z (roll) axes."""
    turn = Rotation.from_rotvec(np.radians([pitch_deg, yaw_deg, roll_deg])).as_matrix()
    return replace(camera, rig_R_camera=camera.rig_R_camera @ turn)


def rig_turned(rig: Rig, turns: Mapping[str, CameraTurn]) -> Rig:
    """Turn those cameras of a rig."""
    cameras = dict(rig.cameras)
    for name, turn in turns.items():
        cameras[name] = turned(cameras[name], turn.pitch_deg, turn.yaw_deg, turn.roll_deg)
    return replace(rig, cameras=cameras)


def _turn(
    camera: RigCamera, pixel_px: FloatArray, rig_point_m: FloatArray, groups: IntArray
) -> CameraTurn | None:
    rays = camera.model.rays(pixel_px[:, 0], pixel_px[:, 1], slopes=True)
    away = (rig_point_m - camera.rig_t_camera_m) @ camera.rig_R_camera
    use = rays.inside & np.isfinite(away).all(axis=1)
    if use.sum() < MIN_SIGHTINGS:
        return None
    seen = np.stack(rays.ray, axis=-1)[use]
    px_from_ray = np.asarray(np.linalg.pinv(rays.by_pixel()[use]), dtype=np.float64)
    expected = away[use] / np.linalg.norm(away[use], axis=1, keepdims=True)
    turn = np.zeros(3)
    for _ in range(_ROUNDS):
        residual, jacobian = _residuals(turn, seen, expected, px_from_ray)
        scale = _scale_px(residual)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(np.linalg.norm(residual, axis=1), 1e-12))
        # The prior in pixels squared, as the residuals are.
        prior = np.diag([0.0, 0.0, (scale / _ROLL_RAD) ** 2])
        bread = np.einsum("n,nij,nik->jk", weight, jacobian, jacobian) + prior
        score = np.einsum("n,nij,ni->nj", weight, jacobian, residual)
        step = np.linalg.solve(bread, score.sum(axis=0) + prior @ turn)
        turn = turn - step
        if np.abs(step).max() < _SETTLED_RAD:
            break
    covariance = _clustered_covariance(np.linalg.inv(bread), score, groups[use], prior)
    before, _ = _residuals(np.zeros(3), seen, expected, px_from_ray)
    apart = np.linalg.norm(seen @ Rotation.from_rotvec(turn).as_matrix().T - expected, axis=1)
    found = CameraTurn(
        *(camera.name, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        before_px=float(np.median(np.linalg.norm(before, axis=1))),
        after_px=float(np.median(np.linalg.norm(residual, axis=1))),
        after_deg=float(np.degrees(np.median(apart))),
        n_sightings=int(use.sum()),
        n_objects=len(np.unique(groups[use])),
        covariance_deg2=(),
    )
    return with_angles(found, np.degrees(turn), np.degrees(1.0) ** 2 * covariance)


def _residuals(
    turn: FloatArray, seen: FloatArray, expected: FloatArray, px_from_ray: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Turned seen ray less the expected one in pixels (n, 2), and its derivative by the turn (n, 2, 3)."""
    moved = seen @ Rotation.from_rotvec(turn).as_matrix().T
    # Small turns w: the derivative of w x r by w.
    by_turn = np.swapaxes(np.cross(np.eye(3), moved[:, np.newaxis, :]), 1, 2)
    return np.einsum("nij,nj->ni", px_from_ray, moved - expected), px_from_ray @ by_turn


def _scale_px(residual: FloatArray) -> float:
    """One sigma of a coordinate: 1.1774 is the median length of two standard normals."""
    return max(float(np.median(np.linalg.norm(residual, axis=1))) / 1.1774, _LEAST_SIGMA_PX)


def _clustered_covariance(
    bread: FloatArray, score: FloatArray, groups: IntArray, prior: FloatArray
) -> FloatArray:
    names, place = np.unique(groups, return_inverse=True)
    sums = np.zeros((len(names), 3))
    np.add.at(sums, place, score)
    # One object says nothing of how objects differ: its sightings are taken as independent.
    meat = sums.T @ sums * len(names) / (len(names) - 1.0) if len(names) > 1 else score.T @ score
    return np.asarray(bread @ (meat + prior) @ bread, dtype=np.float64)
