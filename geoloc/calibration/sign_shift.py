"""What a wrong ray and a wrong place of a camera do to a sign: metres sideways and along.

A sign's foot at a distance D on level ground, h below the camera: a ray that is wrong by an angle to the side
shifts it sideways by D times that angle; one that is wrong upwards shifts it along by (D² + h²) / h times it,
since it meets the ground at a flat angle.
"""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.rig.rig import RigCamera

DISTANCES_M = (10.0, 20.0)
"""Of the sign from the camera, on the ground."""
USUAL_HEIGHT_M = 1.5
"""Of a camera above the road, where no mounting is known."""
_LEAST_HEIGHT_M = 0.2


def height_m(camera: RigCamera) -> float:
    """Height of a camera above the road; the usual one where its rig does not say, or says none above it."""
    above = float(camera.rig_t_camera_m[2])
    return above if above > _LEAST_HEIGHT_M else USUAL_HEIGHT_M


def foot_slopes(ray_rig: FloatArray, distance_m: float, height_m: float) -> FloatArray:
    """Derivatives (n, 2, 6) of a foot's place, to the left and along, by its ray and by the camera's place.

    Parameters
    ----------
    ray_rig : float64 (n, 3)
        Unit rays in the rig frame (FLU).
    distance_m : float
        Of the foot, on the ground.
    height_m : float
        Of the camera above it.
    """
    x, y, z = ray_rig.T
    flat = np.maximum(np.hypot(x, y), 1e-9)
    zero, one = np.zeros_like(x), np.ones_like(x)
    along = np.stack([x / flat, y / flat, zero], axis=-1)
    left = np.stack([-y / flat, x / flat, zero], axis=-1)
    up = np.stack([-z * x / flat, -z * y / flat, flat], axis=-1)
    reach = float(np.hypot(distance_m, height_m))
    lifted = np.stack([zero, zero, one], axis=-1) * distance_m / height_m
    return np.stack(
        [
            np.concatenate([reach * left, left], axis=-1),
            np.concatenate([reach**2 / height_m * up, along + lifted], axis=-1),
        ],
        axis=-2,
    )


def mounting_slopes(ray_rig: FloatArray) -> FloatArray:
    """Derivatives (n, 6, 6) of ray and place by a small rotation about the rig's axes and by the place."""
    x, y, z = ray_rig.T
    zero = np.zeros_like(x)
    slopes = np.zeros((len(x), 6, 6))
    # ω × r = -[r]× ω
    slopes[:, :3, :3] = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=-1).reshape(-1, 3, 3)
    slopes[:, 3:, 3:] = np.eye(3)
    return slopes


def foot_sigma_m(
    ray_rig: FloatArray, covariance: FloatArray, distance_m: float, height_m: float
) -> FloatArray:
    """One sigma (n, 2) of a foot's place, sideways and along.

    Parameters
    ----------
    ray_rig : float64 (n, 3)
    covariance : float64 (n, 6, 6)
        Of ray and camera's place in the rig frame.
    distance_m, height_m : float
        As in `foot_slopes`.
    """
    slopes = foot_slopes(ray_rig, distance_m, height_m)
    return np.asarray(np.sqrt(np.einsum("nij,njk,nik->ni", slopes, covariance, slopes)))
