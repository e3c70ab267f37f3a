"""What a ray can hit: the plane of the road under the car."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, TextArray
from geoloc.reasons import Reason

MAX_RANGE_M = 60.0
"""A flat road says nothing about what is further away: 0.1° of pitch is 4 m there."""


def intersect_plane(
    origin_m: FloatArray, direction: FloatArray, plane_z: float = 0.0, max_range_m: float = MAX_RANGE_M
) -> tuple[FloatArray, BoolArray]:
    """Intersect rays with the horizontal plane ``z = plane_z`` of the rig frame.

    Parameters
    ----------
    origin_m : float64 (..., 3)
        Where the rays start, rig frame (FLU), metres.
    direction : float64 (..., 3)
        Any length, rig frame. Broadcasts against `origin_m`.
    plane_z : float
        Height of the plane above the rig's origin.
    max_range_m : float
        Hits horizontally further from the ray's start are refused.

    Returns
    -------
    point_m : float64 (..., 3)
        NaN where there is no hit.
    valid : bool (...)
        False where the ray is NaN, does not go down, starts below the plane (the hit would lie behind it), or
        hits beyond `max_range_m`; `miss_reason` says which.
    """
    origin, ray = np.broadcast_arrays(origin_m, direction)
    distance = _distance(origin, ray, plane_z)
    with np.errstate(invalid="ignore", over="ignore"):
        point = origin + distance[..., None] * ray
        valid = (distance > 0) & (_horizontal(point - origin) <= max_range_m)
    point = np.where(valid[..., None], point, np.nan)
    # The plane's own height, exactly: rounding must not lift the foot off the road.
    point[..., 2] = np.where(valid, plane_z, np.nan)
    return point, valid


def miss_reason(
    origin_m: FloatArray, direction: FloatArray, plane_z: float = 0.0, max_range_m: float = MAX_RANGE_M
) -> TextArray:
    """Say why each ray misses the plane: a `Reason`, "" where it hits."""
    origin, ray = np.broadcast_arrays(origin_m, direction)
    _, valid = intersect_plane(origin, ray, plane_z, max_range_m)
    known = np.isfinite(origin).all(axis=-1) & np.isfinite(ray).all(axis=-1)
    with np.errstate(invalid="ignore"):
        rising = ray[..., 2] >= 0
        below = origin[..., 2] <= plane_z
    return np.select(
        [valid, ~known, rising, below],
        ["", Reason.NO_RAY, Reason.ABOVE_HORIZON, Reason.CAMERA_UNDERGROUND],
        default=Reason.TOO_FAR,
    )


def _distance(origin: FloatArray, ray: FloatArray, plane_z: float) -> FloatArray:
    """Multiple of the ray to the plane; NaN for rays that do not go down."""
    down = -ray[..., 2]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return np.where(down > 0, (origin[..., 2] - plane_z) / down, np.nan)


def _horizontal(vector: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(vector[..., 0], vector[..., 1]))
