"""Cameras against objects at surveyed positions: the turn of each camera that explains what is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from geoloc.arrays import FloatArray, IntArray
from geoloc.locate.error_budget import ErrorBudget
from geoloc.rig.rig import Rig, RigCamera

_ROUNDS = 30
_HUBER = 2.0
_SETTLED_RAD = 1e-10
_LEAST_SIGMA_PX = 0.05
_ROLL_RAD = np.radians(0.3)
_MOUNTING_DEG = ErrorBudget().boresight_deg
_SHARED_NOISE = 0.8
"""Correlation of the turns' noise between cameras: mostly errors of places, which all of them see."""
_OBJECT_M = 0.03
_OBJECT_FREEDOM = 4.0
_MODEL_OBJECTS = 8.0
"""Before anything is seen an object is off by 3 cm (its survey, its foot, the ground below it), as if four
residuals had said so. The model of such errors weighs as eight objects against what objects say."""
MIN_SIGHTINGS = 3


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
        The mounting's part of each turn by expectation.
    covariance_deg2 : float64 (n, 3, 3)
        How far the mounting may be from `turn_deg`.
    chance : float64 (n,)
        Probability that a camera which is turned by `turn_deg` sits nearer to the truth than before.
    total_covariance_deg2 : float64 (n, 3, 3)
        Of the turns as found, the drive's own error included.
    common_deg : float64 (3,)
        What all cameras ask for together, about the rig's x, y and z.
    common_sigma_deg : float64 (3,)
        Its sigma, without the drive's own.
    common_part_deg : float64 (3,)
        What of `common_deg` is counted as their mounting: in `turn_deg`.
    """

    turn_deg: FloatArray
    covariance_deg2: FloatArray
    chance: FloatArray
    total_covariance_deg2: FloatArray
    common_deg: FloatArray
    common_sigma_deg: FloatArray
    common_part_deg: FloatArray


def camera_turns(rig: Rig, known: KnownSightings) -> dict[str, CameraTurn]:
    """Find the pitch, yaw and roll by which each camera is off.

    Robust least squares on the difference of the seen and the expected ray, in pixels. Roll has a prior of
    0.3°, since objects that stand in a column of the picture do not show it. The covariance is that of
    clustered observations, as the error of an object's surveyed position is in all its sightings; for few
    objects mostly that of a model, in which places are off by some centimetres.

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
    mounting_sigma_deg: float = _MOUNTING_DEG,
) -> MountingPart:
    """Tell the cameras' mounting from an error of the drive's own angles, which turns all of them alike.

    Each turn is the camera's own, the drive's, and noise; all three have a sigma before anything is seen, and
    what is seen is shared out between them by their covariances. So a common turn is the mounting's as far as
    cameras may be off against what the drive may be off: neither all of it nor nothing.

    Parameters
    ----------
    rig_R_camera : float64 (n, 3, 3)
    turn_deg : float64 (n, 3)
        Pitch, yaw and roll.
    covariance_deg2 : float64 (n, 3, 3)
    drive_sigma_deg : float64 (3,)
        One sigma of the drive's own roll, pitch and heading (the rig's x, y and z), the same for all cameras.
    mounting_sigma_deg : float
        One sigma of a camera's own angles, an axis.

    Notes
    -----
    The conditional mean of jointly normal unknowns: the estimate with the smallest expected square of what is
    left, in every direction (Anderson and Moore, "Optimal Filtering" (1979), chapter 2).
    """
    n = len(turn_deg)
    camera_R_rig = np.swapaxes(rig_R_camera, 1, 2)
    turn_rig = np.einsum("nij,nj->ni", rig_R_camera, turn_deg)
    noise = rig_R_camera @ covariance_deg2 @ camera_R_rig
    drive = np.diag(np.square(drive_sigma_deg))
    prior = mounting_sigma_deg**2
    seen = np.kron(np.ones((n, n)), drive) + _all_noise(noise) + prior * np.eye(3 * n)
    gain = prior * np.linalg.inv(seen)
    own = (gain @ turn_rig.ravel()).reshape(n, 3)
    left = prior * (np.eye(3 * n) - gain).reshape(n, 3, n, 3)
    covariance = camera_R_rig @ np.einsum("ninj->nij", left) @ rig_R_camera
    turn = np.einsum("nij,nj->ni", camera_R_rig, own)
    variance = np.diagonal(noise, axis1=1, axis2=2)
    weight = 1.0 / (variance + prior)
    weight = weight / weight.sum(axis=0)
    return MountingPart(
        turn_deg=turn,
        covariance_deg2=covariance,
        chance=_chance_of_nearer(turn, covariance),
        total_covariance_deg2=np.asarray(covariance_deg2 + camera_R_rig @ drive @ rig_R_camera),
        common_deg=(weight * turn_rig).sum(axis=0),
        # Nearly all of the noise is shared, and so adds up.
        common_sigma_deg=(weight * np.sqrt(variance)).sum(axis=0),
        common_part_deg=(weight * own).sum(axis=0),
    )


def _all_noise(noise: FloatArray) -> FloatArray:
    """Covariance (3 n, 3 n) of the noise of all cameras' turns, from each camera's (n, 3, 3), rig axes."""
    values, vectors = np.linalg.eigh(noise)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis] @ np.swapaxes(vectors, 1, 2)
    both = _SHARED_NOISE * np.einsum("aij,bkj->aibk", root, root)
    for i, own in enumerate(noise):
        both[i, :, i] = own
    return np.asarray(both.reshape(3 * len(noise), -1))


def _chance_of_nearer(turn: FloatArray, covariance: FloatArray) -> FloatArray:
    """Probability (n,) that a normal vector with this mean and covariance is nearer to its mean than to 0."""
    length = np.linalg.norm(turn, axis=1)
    along = turn / np.maximum(length, 1e-12)[:, np.newaxis]
    sigma = np.sqrt(np.einsum("ni,nij,nj->n", along, covariance, along))
    return np.asarray(ndtr(0.5 * length / np.maximum(sigma, 1e-12)))


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
    distance_m = np.linalg.norm(away[use], axis=1)
    meat = _objects_meat(score, residual, jacobian, px_from_ray, weight, distance_m, groups[use], scale)
    inverse = np.linalg.inv(bread)
    covariance = inverse @ (meat + prior) @ inverse
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


def _objects_meat(
    score: FloatArray,
    residual: FloatArray,
    jacobian: FloatArray,
    px_from_ray: FloatArray,
    weight: FloatArray,
    distance_m: FloatArray,
    groups: IntArray,
    scale_px: float,
) -> FloatArray:
    """Covariance (3, 3) of the scores' sum: what objects say by differing, and a model of their errors.

    Three objects fix three angles, so that their scores hardly differ however wrong their places are: alone
    they would make sigmas ten times too small.
    """
    names, place, count = np.unique(groups, return_inverse=True, return_counts=True)
    n = len(names)
    sums = _sums(score, place, n)
    # One object says nothing of how objects differ: its sightings are taken as independent.
    seen = sums.T @ sums * n / (n - 1.0) if n > 1 else score.T @ score
    px_a_metre = np.sqrt(np.einsum("nij,nij->n", px_from_ray, px_from_ray) / 2.0) / distance_m
    variance = (_OBJECT_M * _sums(px_a_metre, place, n) / count) ** 2 + scale_px**2 / count
    mean = _sums(weight[:, np.newaxis] * residual, place, n) / _sums(weight, place, n)[:, np.newaxis]
    spare = max(2 * n - 3, 0)
    factor = (_OBJECT_FREEDOM + float((mean**2 / variance[:, np.newaxis]).sum())) / (_OBJECT_FREEDOM + spare)
    by_turn = _sums(weight[:, np.newaxis, np.newaxis] * jacobian, place, n)
    model = factor * np.einsum("n,nij,nik->jk", variance, by_turn, by_turn)
    return np.asarray((n * seen + _MODEL_OBJECTS * model) / (n + _MODEL_OBJECTS))


def _sums(values: FloatArray, place: IntArray, n: int) -> FloatArray:
    """Sums (n, …) of the values (m, …) of each group."""
    total = np.zeros((n, *values.shape[1:]))
    np.add.at(total, place, values)
    return total
