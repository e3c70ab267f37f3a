"""Whether one camera explains all views: residuals of neighbours, and views that two cameras would fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.calibration.intrinsics.bundle import adjust_poses
from geoloc.calibration.intrinsics.fit import Fit, fit
from geoloc.calibration.intrinsics.initial_guess import BoardPoses
from geoloc.calibration.intrinsics.views import Corners
from geoloc.errors import CalibrationError

_ALIKE = 0.3
"""Correlation of neighbours' residuals from which they are no noise."""
_LEAST_PAIRS = 100
_NEIGHBOUR = 1.05
"""Of a square: the farthest that neighbouring corners are apart on the board."""
_STEPS = 8
_LEAST_VIEWS = 3
"""Of the smaller group: fewer are views that went wrong, not another camera."""
_LEAST_CORE = 5
_EXPLAINED = 3.0
"""Times the residuals of the views fitted: another view with more is not that camera's."""
_LESS_AND_NOISE, _LESS = 0.6, 0.15
"""One group alone must leave less than this part of what both leave: with noise only, or else."""
_APART = 5.0
"""Distance of the groups' medians in standard deviations inside them; a bell cut in two has 2.3."""


@dataclass(frozen=True, slots=True)
class TwoCameras:
    """Views that another camera fits better.

    Attributes
    ----------
    other : int64 (k,)
        Numbers of the views in the smaller group.
    zoom : float
        Focal length there, as part of that of the other views.
    shift_px : float64 (2,)
        How far the principal point lies from theirs.
    """

    other: IntArray
    zoom: float
    shift_px: FloatArray


def alikeness(fitted: Fit) -> float:
    """Correlation of the residuals of neighbouring corners: 0 for noise, near 1 where the model is wrong.

    Neighbours are the next corners in a row or column of the same view (Moran's I, whose mean is known to be
    nil; Moran 1950, doi:10.1093/biomet/37.1-2.17). NaN with fewer than 100 pairs.
    """
    first, second = _neighbours(fitted.bundle.corners)
    used = fitted.adjusted.inlier[first] & fitted.adjusted.inlier[second]
    if used.sum() < _LEAST_PAIRS:
        return float("nan")
    a, b = fitted.adjusted.residual_px[first[used]], fitted.adjusted.residual_px[second[used]]
    return float(2.0 * np.sum(a * b) / max(float(np.sum(a * a) + np.sum(b * b)), 1e-300))


def unlike_noise(fitted: Fit) -> bool:
    """Whether neighbouring corners have residuals so alike that the model must be wrong somewhere."""
    return alikeness(fitted) > _ALIKE


def two_cameras(fitted: Fit) -> TwoCameras | None:
    """Find views of another camera or zoom, or turned ones; None if one camera is as good for all.

    Every view gets a zoom and a principal point of its own. Where one of these falls into two groups, the
    middle of the larger is fitted alone, then all views that this explains. If that leaves much less, the
    others' changes against it are what is found. A model that does not fit the lens leaves other residuals
    at other places: those stay.
    """
    core = _core(own_cameras(fitted, fitted.adjusted.state.poses))
    if core is None:
        return None
    try:
        left_px = _left_px(fitted, _alone(fitted, core))
        like = left_px < _EXPLAINED * np.median(left_px[core])
        like = like if 2 * like.sum() >= len(like) else ~like
        other = np.flatnonzero(~like)
        if not _LEAST_VIEWS <= len(other) <= len(like) - _LEAST_VIEWS:
            return None
        alone = _alone(fitted, np.flatnonzero(like))
    except CalibrationError:
        return None
    less = _LESS if unlike_noise(alone) else _LESS_AND_NOISE
    if alone.adjusted.sigma_px > less * fitted.adjusted.sigma_px:
        return None
    whole = replace(alone, bundle=fitted.bundle)
    change = np.median(own_cameras(whole, fitted.adjusted.state.poses)[other], axis=0)
    return TwoCameras(other, 1.0 + float(change[0]), change[1:])


def _alone(fitted: Fit, views: IntArray) -> Fit:
    """Fit some of the views."""
    state = fitted.adjusted.state
    return fit(
        fitted.lens,
        fitted.bundle.corners.of(views),
        fitted.curve(),
        BoardPoses(state.poses.rotation[views], state.poses.position_m[views]),
        free_shape=fitted.bundle.free_shape,
        shape=state.shape,
    )


def _left_px(fitted: Fit, alone: Fit) -> FloatArray:
    """Medians (v,) of the residuals' lengths that another fit's camera leaves, the poses adjusted."""
    state = alone.adjusted.state._replace(poses=fitted.adjusted.state.poses)
    corners = fitted.bundle.corners
    state = adjust_poses(fitted.bundle, state, fitted.adjusted.inlier.astype(np.float64))
    residual, _, _, valid = fitted.bundle.residuals(state)
    length = np.where(valid, np.linalg.norm(residual, axis=1), np.inf)
    return np.array([np.median(length[corners.view == view]) for view in range(corners.n_views)])


def own_cameras(fitted: Fit, poses: BoardPoses) -> FloatArray:
    """Each view's own zoom, as a part, and shift of the principal point in pixels (v, 3).

    The lens stays; a view's picture is enlarged about the principal point and shifted, and the view's pose is
    adjusted with that (Gauss and Newton, all corners in full).
    """
    bundle = replace(fitted.bundle, free_lens=False, free_shape=())
    corners, centre, state = bundle.corners, fitted.values[:2], fitted.adjusted.state._replace(poses=poses)
    change = np.zeros((corners.n_views, 3))
    for _ in range(_STEPS):
        residual, _, by_pose, valid = bundle.residuals(state)
        offset = residual + corners.pixel_px - centre
        zoom = 1.0 + change[corners.view, :1]
        left = centre + zoom * offset + change[corners.view, 1:] - corners.pixel_px
        one = np.broadcast_to(np.eye(2), (len(left), 2, 2))
        design = np.concatenate([zoom[:, np.newaxis] * by_pose, offset[..., np.newaxis], one], axis=-1)
        step = np.zeros((corners.n_views, 9))
        for view in range(corners.n_views):
            mine = valid & (corners.view == view)
            step[view] = np.linalg.lstsq(design[mine].reshape(-1, 9), -left[mine].ravel(), rcond=1e-10)[0]
        state = bundle.moved(state, np.zeros(0), step[:, :6])
        change += step[:, 6:]
    return change


def _core(change: FloatArray) -> IntArray | None:
    """Middle half (k,) of the larger of two groups; None if no column of the changes (v, 3) has two."""
    best, found = _APART, None
    for values in change.T:
        order = np.argsort(values)
        for low in range(_LEAST_VIEWS, len(values) - _LEAST_VIEWS + 1):
            groups = order[:low], order[low:]
            off = [np.abs(values[group] - np.median(values[group])) for group in groups]
            middles = [float(np.median(values[group])) for group in groups]
            spread = 1.48 * float(np.median(np.concatenate(off)))
            apart = (middles[1] - middles[0]) / max(spread, 1e-9)
            if apart > best:
                larger = int(len(groups[1]) > len(groups[0]))
                n = max(_LEAST_CORE, len(groups[larger]) // 2)
                best, found = apart, groups[larger][np.argsort(off[larger])[:n]]
    return None if found is None else np.sort(found)


def _neighbours(corners: Corners) -> tuple[IntArray, IntArray]:
    """Pairs of corners that are one square apart in the same view."""
    from scipy.spatial import cKDTree

    side = square_m(corners)
    # Views lie above each other in a third dimension: one tree finds the pairs of all.
    place = np.column_stack([corners.board_m / side, 10.0 * corners.view])
    pairs = cKDTree(place).query_pairs(_NEIGHBOUR, output_type="ndarray")
    return pairs[:, 0], pairs[:, 1]


def square_m(corners: Corners) -> float:
    """Side of the board's squares: the smallest distance of two rows of corners."""
    return float(np.diff(np.unique(np.round(corners.board_m[:, 0], 9))).min())
