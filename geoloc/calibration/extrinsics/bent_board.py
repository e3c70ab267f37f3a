"""Whether a board is flat, as far as the residuals of its corners can tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.calibration.extrinsics.calibrate import Extrinsics
from geoloc.calibration.extrinsics.network import Network

_SURE = 5.0
_LEAST_PART = 0.001
"""Of the board's half diagonal: what less of a bend does is lost in the corners' noise."""
_FEWEST_SPARE = 5
"""Equations beyond the unknowns: the four corners of a tag tell nothing."""


@dataclass(frozen=True, slots=True)
class Bend:
    """How far a board stands off the plane through it where its corners were seen, with one sigma, metres."""

    off_m: float
    sigma_m: float


def bends(result: Extrinsics) -> dict[int, Bend]:
    """Find boards that are bent for certain.

    A paraboloid ``z = a x² + b xy + c y²`` is fitted to the residuals of each board in all pictures, together
    with its pose in each of them: neither the cameras' poses nor what was left out as not flat count.

    Returns
    -------
    dict of target to Bend
        Those that are off by more than five sigmas and a thousandth of their size.
    """
    seen = [s for s, r in zip(result.sightings, result.residual_px, strict=True) if np.isfinite(r).all()]
    network = Network(seen, result.network.tags, result.network.sigmas, result.network.corner_px)
    residual, slopes = network.corner_residuals_px(result.state), network.corners_by_tag(result.state)
    views = np.unique([f"{s.view} {s.picture}" for s in seen], return_inverse=True)[1]
    found = {}
    for tag in network.tag_ids:
        mine = np.array([s.tag == tag for s in seen])
        points = np.concatenate([s.points_m for s in seen if s.tag == tag])
        view = np.repeat(np.unique(views[mine], return_inverse=True)[1], 4)
        by_pose = slopes[mine].reshape(-1, 2, 6)
        bend = _bend(points, residual[mine].reshape(-1, 2), by_pose, view, result.state.tags[tag].R[:, 2])
        if bend is not None:
            found[tag] = bend
    return found


def _bend(
    points_m: FloatArray, residual_px: FloatArray, by_pose: FloatArray, view: IntArray, normal: FloatArray
) -> Bend | None:
    n, n_views = len(points_m), int(view.max()) + 1
    spare = 2 * n - 6 * n_views - 3
    if spare < _FEWEST_SPARE or len(np.unique(points_m, axis=0)) <= 4:
        return None
    size = float(np.linalg.norm(points_m, axis=1).max())
    x, y = points_m[:, 0] / size, points_m[:, 1] / size
    shapes = np.stack([x * x, x * y, y * y], axis=1)
    design = np.zeros((n, 2, 3 + 6 * n_views))
    # What moves a point along the normal moves it in the picture as a shift of the whole board does.
    design[:, :, :3] = (by_pose[:, :, 3:] @ normal)[:, :, np.newaxis] * shapes[:, np.newaxis]
    for i in range(n_views):
        design[view == i, :, 3 + 6 * i : 9 + 6 * i] = by_pose[view == i]
    equations = design.reshape(2 * n, -1)
    fit, _, rank, _ = np.linalg.lstsq(equations, -residual_px.ravel(), rcond=None)
    if rank < equations.shape[1]:
        return None
    left = residual_px.ravel() + equations @ fit
    covariance = np.linalg.inv(equations.T @ equations)[:3, :3] * float(left @ left) / spare
    # Only what no plane takes up is a bend.
    plane = np.column_stack([np.ones(n), x, y])
    shapes = shapes - plane @ np.linalg.lstsq(plane, shapes, rcond=None)[0]
    off = shapes @ fit[:3]
    worst = int(np.abs(off).argmax())
    sigma = float(np.sqrt(shapes[worst] @ covariance @ shapes[worst]))
    if abs(off[worst]) <= max(_SURE * sigma, _LEAST_PART * size):
        return None
    return Bend(float(abs(off[worst])), sigma)
