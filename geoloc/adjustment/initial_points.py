"""First guesses that survive wrong pixels: the candidate that most rays agree on."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from geoloc.adjustment.scene import Bodies, origin_from_anchor
from geoloc.arrays import BoolArray, FloatArray, IntArray

MAX_START_M = 150.0
"""No sign that an annotator can mark stands further away."""
_SPREAD = 14
# What mounting and body can turn a ray by, before anything is estimated.
_RAY_SIGMA_RAD = np.radians(0.5)
_TRUNCATED = 9.0
_INDEPENDENT = 6
# What a foot may stand above or below the plane of the road: at once, and a metre away.
_GROUND_M, _GROUND_SLOPE = 0.2, 0.03


def first_guesses(
    bodies: Bodies,
    rays_rig: FloatArray,
    camera_m: FloatArray,
    point: IntArray,
    is_foot: BoolArray,
    mounted_rad: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Find a start for each point.

    Candidates are the places where pairs of rays pass closest, and for feet where rays meet the road's plane.
    Each is scored by the angles to all rays, truncated so that a wrong pixel costs no more than a bad one.

    Parameters
    ----------
    bodies : Bodies (n,)
    rays_rig, camera_m : float64 (n, 3)
        Unit rays and their origins in the rig frame.
    point : int64 (n,)
        Which point a row belongs to, 0 … m-1, each at least once.
    mounted_rad : float
        How far cameras may be turned, one sigma.
    is_foot : bool (m,)

    Returns
    -------
    anchor_deg : float64 (m, 2)
        Latitude and longitude of the frame: where the rig was at the point's first row.
    start_m : float64 (m, 3)
        East, north and ellipsoidal height; NaN where no candidate lies in front of the camera within
        `MAX_START_M`.
    """
    order = np.argsort(point, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(point[order])) + 1)
    anchor = np.array([[bodies.latitude_deg[g[0]], bodies.longitude_deg[g[0]]] for g in groups])
    origin = origin_from_anchor(bodies, anchor[point])
    eye = origin + np.einsum("nij,nj->ni", bodies.enu_R_rig, camera_m)
    ray = np.einsum("nij,nj->ni", bodies.enu_R_rig, rays_rig)
    up = bodies.enu_R_rig[:, :, 2]
    start = np.full((len(groups), 3), np.nan)
    sigma_rad = max(_RAY_SIGMA_RAD, mounted_rad)
    for m, rows in enumerate(groups):
        few = rows[np.linspace(0, rows.size - 1, min(rows.size, _SPREAD)).round().astype(int)]
        candidates = _crossings(eye[few], ray[few])
        if is_foot[m]:
            candidates = np.concatenate([candidates, _on_planes(eye[few], ray[few], origin[few], up[few])])
        if candidates.size:
            start[m] = _best(candidates, eye[rows], ray[rows], origin[rows], up[rows], is_foot[m], sigma_rad)
    return anchor, start


def _crossings(eye: FloatArray, ray: FloatArray) -> FloatArray:
    """Middle of the shortest line between the rays of each pair (c, 3)."""
    pairs = np.array(list(combinations(range(len(eye)), 2)), dtype=np.int64).reshape(-1, 2)
    a, b = pairs[:, 0], pairs[:, 1]
    across = eye[b] - eye[a]
    cosine = np.sum(ray[a] * ray[b], axis=1)
    on_a, on_b = np.sum(across * ray[a], axis=1), np.sum(across * ray[b], axis=1)
    determinant = 1.0 - cosine**2
    with np.errstate(divide="ignore", invalid="ignore"):
        along_a = (on_a - cosine * on_b) / determinant
        along_b = (cosine * on_a - on_b) / determinant
    ahead = (determinant > 1e-7) & (along_a > 0) & (along_b > 0)
    middle = 0.5 * (eye[a] + along_a[:, None] * ray[a] + eye[b] + along_b[:, None] * ray[b])
    return np.asarray(middle[ahead])


def _on_planes(eye: FloatArray, ray: FloatArray, origin: FloatArray, up: FloatArray) -> FloatArray:
    """Where rays meet the plane on which the wheels stand."""
    height = np.sum((eye - origin) * up, axis=1)
    down = -np.sum(ray * up, axis=1)
    falls = down > 1e-3
    return np.asarray((eye + (height / np.where(falls, down, 1.0))[:, None] * ray)[falls])


def _best(
    candidates: FloatArray,
    eye: FloatArray,
    ray: FloatArray,
    origin: FloatArray,
    up: FloatArray,
    foot: bool,
    sigma_rad: float,
) -> FloatArray:
    """The candidate (3,) with the smallest truncated cost; NaN if none is possible."""
    to = candidates[:, None, :] - eye
    distance = np.linalg.norm(to, axis=2)
    cosine = np.clip(np.sum(to * ray, axis=2) / np.maximum(distance, 1e-6), -1.0, 1.0)
    # Mounting errors are shared: a hundred rays of one camera say no more about them than a few.
    say = min(len(ray), _INDEPENDENT)
    cost = say * np.minimum((np.arccos(cosine) / sigma_rad) ** 2, _TRUNCATED).mean(axis=1)
    if foot:
        from_rig = candidates[:, None, :] - origin
        above = np.sum(from_rig * up, axis=2)
        tolerance = _GROUND_M + _GROUND_SLOPE * np.linalg.norm(from_rig, axis=2)
        cost += np.minimum((above / tolerance) ** 2, _TRUNCATED).mean(axis=1)
    possible = np.median(distance, axis=1) < MAX_START_M
    if not possible.any():
        return np.full(3, np.nan)
    return np.asarray(candidates[np.argmin(np.where(possible, cost, np.inf))])
