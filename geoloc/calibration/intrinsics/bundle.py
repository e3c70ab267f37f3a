"""Bundle adjustment of one camera: its parameters, the board's shape and every view's pose, together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.calibration.intrinsics.initial_guess import BoardPoses
from geoloc.calibration.intrinsics.lens import Lens
from geoloc.calibration.intrinsics.views import Corners

SHAPE = ("stretch", "bend_xx", "bend_xy", "bend_yy")
"""Unknowns of the board's shape. Stretch: y distances are longer by this part than stated, against x. Bends,
in half sizes of the board: depth is (xx x² + xy x y + yy y²) with x, y in half sizes from its middle."""
NO_SHAPE = np.zeros(len(SHAPE))

_MAX_STEPS = 60
_MAX_TRIES = 12
_CONVERGED = 1e-8
"""Part of the cost that the next step would still take away."""
_SCALES = (30.0, 10.0, 4.0)
_GATE = -2.0 * np.log(1e-4)
"""χ² with two degrees of freedom: a corner beyond it is no detection of that corner."""
_GATE_ROUNDS = 6
_FEWEST_VIEWS = 10
"""With fewer, views tell little of what their corners share."""


class BundleState(NamedTuple):
    """Values of all unknowns."""

    lens: FloatArray
    """(p,)"""
    shape: FloatArray
    """(4,): see `SHAPE`."""
    poses: BoardPoses


class Normal(NamedTuple):
    """Normal equations: common unknowns first, a block a view after them."""

    common: FloatArray
    """(g, g)"""
    mixed: FloatArray
    """(v, g, 6)"""
    pose: FloatArray
    """(v, 6, 6)"""
    right_common: FloatArray
    right_pose: FloatArray
    cost: float


@dataclass(frozen=True, slots=True)
class Bundle:
    """What is adjusted, and which of the common unknowns are free.

    Attributes
    ----------
    lens : Lens
    corners : Corners
    free_lens : bool
        Whether the camera is adjusted; otherwise only the views' poses are.
    free_shape : tuple of str
        Names out of `SHAPE` that are adjusted.
    """

    lens: Lens
    corners: Corners
    free_lens: bool = True
    free_shape: tuple[str, ...] = ()

    @property
    def columns(self) -> IntArray:
        """Numbers of the free ones among the common unknowns (lens, then shape)."""
        n_lens = len(self.lens.parameters)
        lens = np.arange(n_lens if self.free_lens else 0)
        shape = [n_lens + SHAPE.index(name) for name in self.free_shape]
        return np.array([*lens, *shape], dtype=np.int64)

    def residuals(self, state: BundleState) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Expected minus seen (n, 2), its derivatives by common unknowns and by poses, and validity."""
        corners, rotation = self.corners, state.poses.rotation[self.corners.view]
        board, by_shape = shaped(corners, state.shape)
        turned = np.einsum("nij,nj->ni", rotation, board)
        projection = self.lens.project(state.lens, turned + state.poses.position_m[corners.view])
        by_common = np.concatenate(
            [projection.by_lens, projection.by_point @ (rotation @ by_shape)], axis=-1
        )[:, :, self.columns]
        x, y, z = turned.T
        zero = np.zeros_like(x)
        by_turn = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=-1).reshape(-1, 3, 3)
        by_pose = np.concatenate([projection.by_point @ by_turn, projection.by_point], axis=-1)
        return projection.pixel_px - corners.pixel_px, by_common, by_pose, projection.valid

    def normal(self, state: BundleState, weight: FloatArray) -> Normal | None:
        """Normal equations; None where a corner that counts is outside the lens's domain."""
        residual, by_common, by_pose, valid = self.residuals(state)
        if not valid[weight > 0.0].all():
            return None
        residual = np.where(valid[:, np.newaxis], residual, 0.0)
        first = self.corners.first
        weighted = weight[:, np.newaxis, np.newaxis] * by_common
        weighted_pose = weight[:, np.newaxis, np.newaxis] * by_pose
        return Normal(
            np.einsum("nia,nib->ab", weighted, by_common),
            np.add.reduceat(np.einsum("nia,nib->nab", weighted, by_pose), first),
            np.add.reduceat(np.einsum("nia,nib->nab", weighted_pose, by_pose), first),
            np.einsum("nia,ni->a", weighted, residual),
            np.add.reduceat(np.einsum("nia,ni->na", weighted_pose, residual), first),
            float(weight @ np.sum(residual**2, axis=-1)),
        )

    def moved(self, state: BundleState, common: FloatArray, pose: FloatArray) -> BundleState:
        """Move by a step of the common unknowns (g,) and of the poses (v, 6)."""
        whole = np.concatenate([state.lens, state.shape])
        whole[self.columns] += common
        n_lens = len(state.lens)
        rotation = _rotation(pose[:, :3]) @ state.poses.rotation
        return BundleState(
            whole[:n_lens], whole[n_lens:], BoardPoses(rotation, state.poses.position_m + pose[:, 3:])
        )


@dataclass(frozen=True, slots=True)
class AdjustedBundle:
    """Where the unknowns came to rest.

    Attributes
    ----------
    state : BundleState
    residual_px : float64 (n, 2)
        Expected minus seen; NaN outside the lens's domain.
    inlier : bool (n,)
    sigma_px : float
        Standard deviation of a coordinate of a corner, from the residuals of the inliers.
    covariance : float64 (g, g)
        Of the free common unknowns.
    converged : bool
    """

    state: BundleState
    residual_px: FloatArray
    inlier: BoolArray
    sigma_px: float
    covariance: FloatArray
    converged: bool


def adjust(bundle: Bundle, start: BundleState) -> AdjustedBundle:
    """Adjust robustly: Cauchy weights that narrow, then all corners inside a χ² gate in full.

    The normal matrix in the end is that of the corners used, scaled by their residuals.
    """
    state, converged = start, False
    square = _squares(bundle, state)
    for scale in _SCALES:
        # 1.2²: the median of a χ² with two degrees of freedom is 1.39 σ².
        spread = max(float(np.median(square[np.isfinite(square)], axis=None)) / 1.39, 1e-6)
        weight = np.where(np.isfinite(square), 1.0 / (1.0 + square / (scale**2 * spread)), 0.0)
        state, converged = minimise(bundle, state, weight)
        square = _squares(bundle, state)
    inlier = np.isfinite(square)
    for _ in range(_GATE_ROUNDS):
        before = inlier
        spread = float(np.median(square[np.isfinite(square)])) / 1.39
        inlier = square <= _GATE * max(spread, 1e-12)
        if np.array_equal(before, inlier):
            break
        state, converged = minimise(bundle, state, inlier.astype(np.float64))
        square = _squares(bundle, state)
    return _result(bundle, state, inlier, converged)


def adjust_poses(bundle: Bundle, start: BundleState, weight: FloatArray) -> BundleState:
    """Adjust the poses alone, corners weighing as given."""
    return minimise(replace(bundle, free_lens=False, free_shape=()), start, weight)[0]


def minimise(bundle: Bundle, state: BundleState, weight: FloatArray) -> tuple[BundleState, bool]:
    """Levenberg and Marquardt with fixed weights; whether it converged."""
    normal, damping = bundle.normal(state, weight), 1e-4
    if normal is None:
        weight = np.where(bundle.residuals(state)[3], weight, 0.0)
        normal = bundle.normal(state, weight)
    for _ in range(_MAX_STEPS):
        if normal is None:
            return state, False
        for _ in range(_MAX_TRIES):
            common, pose = _step(normal, damping)
            promised = float(-common @ normal.right_common - np.sum(pose * normal.right_pose))
            following = bundle.moved(state, common, pose)
            new = bundle.normal(following, weight)
            if new is not None and new.cost <= normal.cost:
                break
            damping *= 8.0
        else:
            return state, promised <= _CONVERGED * normal.cost
        state, normal, damping = following, new, max(0.1 * damping, 1e-12)
        if promised <= _CONVERGED * normal.cost + 1e-15:
            return state, True
    return state, False


def _step(normal: Normal, damping: float) -> tuple[FloatArray, FloatArray]:
    """Solve the damped equations by the Schur complement of the poses."""
    pose = normal.pose * (1.0 + damping * np.eye(6))
    eliminated = np.linalg.solve(pose, np.swapaxes(normal.mixed, -1, -2))
    pose_alone = np.linalg.solve(pose, normal.right_pose[:, :, np.newaxis])[:, :, 0]
    n_common = len(normal.right_common)
    reduced = normal.common * (1.0 + damping * np.eye(n_common)) - np.einsum(
        "vap,vpb->ab", normal.mixed, eliminated
    )
    right = normal.right_common - np.einsum("vap,vp->a", normal.mixed, pose_alone)
    common = -np.linalg.lstsq(reduced, right, rcond=1e-15)[0]
    return common, -pose_alone - np.einsum("vpa,a->vp", eliminated, common)


def _result(bundle: Bundle, state: BundleState, inlier: BoolArray, converged: bool) -> AdjustedBundle:
    residual, _, _, valid = bundle.residuals(state)
    residual = np.where(valid[:, np.newaxis], residual, np.nan)
    normal = bundle.normal(state, inlier.astype(np.float64))
    n_common, n_views = len(bundle.columns), bundle.corners.n_views
    covariance, sigma = np.full((n_common, n_common), np.nan), np.nan
    redundancy = 2 * int(inlier.sum()) - n_common - 6 * n_views
    if normal is not None and redundancy > 0:
        sigma = float(np.sqrt(normal.cost / redundancy))
        eliminated: FloatArray = np.asarray(
            np.linalg.solve(normal.pose, np.swapaxes(normal.mixed, -1, -2)), dtype=np.float64
        )
        reduced = normal.common - np.einsum("vap,vpb->ab", normal.mixed, eliminated)
        inverse = _inverse(reduced)
        covariance = sigma**2 * _shared_in_views(bundle, state, inlier, eliminated, inverse, sigma) * inverse
    return AdjustedBundle(state, residual, inlier, sigma, covariance, converged and normal is not None)


def _shared_in_views(
    bundle: Bundle,
    state: BundleState,
    inlier: BoolArray,
    eliminated: FloatArray,
    inverse: FloatArray,
    sigma_px: float,
) -> float:
    """Factor of the covariance for errors that a view's corners share; 1 where they seem to share none.

    Light, blur and a print that is not flat shift neighbouring corners alike. What each view asks the common
    unknowns to be then differs by more than their scatter says. The factor is the sum of the views' scores'
    squares over what independent corners would give, leverage counted (Cameron and Miller 2015, as
    in `verify_mounting`, as one number: so few views give no matrix).
    """
    first = bundle.corners.first
    if len(first) < _FEWEST_VIEWS or not len(inverse) or not np.isfinite(inverse).all():
        return 1.0
    residual, by_common, by_pose, _ = bundle.residuals(state)
    free = by_common - by_pose @ eliminated[bundle.corners.view]
    weighted = inlier[:, np.newaxis, np.newaxis] * free
    score = np.add.reduceat(np.einsum("nia,ni->na", weighted, np.nan_to_num(residual)), first)
    normal = np.add.reduceat(np.einsum("nia,nib->nab", weighted, free), first)
    part = inverse @ normal
    expected = sigma_px**2 * float(np.einsum("vaa->", part) - np.einsum("vab,vba->", part, part))
    return max(1.0, float(np.einsum("va,ab,vb->", score, inverse, score)) / max(expected, 1e-300))


def _inverse(normal: FloatArray) -> FloatArray:
    """Inverse of a normal matrix whose unknowns have different scales; NaN if it has none."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    try:
        return np.asarray(scale[:, None] * np.linalg.inv(scale[:, None] * normal * scale) * scale)
    except np.linalg.LinAlgError:
        return np.full_like(normal, np.nan)


def _squares(bundle: Bundle, state: BundleState) -> FloatArray:
    """Squared residuals (n,); infinite outside the lens's domain."""
    residual, _, _, valid = bundle.residuals(state)
    return np.where(valid, np.sum(residual**2, axis=-1), np.inf)


def shaped(corners: Corners, shape: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Corners of the board as it is (n, 3), and their derivatives by `SHAPE` (n, 3, 4)."""
    half = corners.half_size_m
    x, y = ((corners.board_m - corners.middle_m) / half).T
    stretch, xx, xy, yy = shape
    point = np.column_stack(
        [
            corners.board_m[:, 0],
            corners.board_m[:, 1] + stretch * half * y,
            half * (xx * x * x + xy * x * y + yy * y * y),
        ]
    )
    by_shape = np.zeros((len(x), 3, len(SHAPE)))
    by_shape[:, 1, 0] = half * y
    by_shape[:, 2, 1:] = half * np.column_stack([x * x, x * y, y * y])
    return point, by_shape


def _rotation(vector: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3): Rodrigues."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
