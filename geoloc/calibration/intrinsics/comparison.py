"""Camera models compared by views that they were not fitted to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.calibration.intrinsics.bundle import Bundle, BundleState, adjust_poses, minimise
from geoloc.calibration.intrinsics.fit import (
    Fit,
    angular_residuals,
    check_nearly_square,
    fit,
    label,
    with_linear_terms,
)
from geoloc.calibration.intrinsics.initial_guess import BoardPoses
from geoloc.calibration.intrinsics.lens import Lens, RadialCurve
from geoloc.calibration.intrinsics.views import Corners
from geoloc.errors import CalibrationError

_FOLDS = 5
_EQUAL_SIGMAS = 2.0
_EQUAL_PART = 0.01
"""Models whose held-out error differs by less are equal in practice, however sure the difference is."""
_MOST_PART = 0.1
"""Models whose held-out error differs by more are not equal, however few views tell them apart."""

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Candidate:
    """One model in the comparison.

    Attributes
    ----------
    label : str
    model : str
    n_parameters : int
    fit : Fit or None
        From all views; None if it failed.
    held_out_deg : float
        RMS angle between the rays of corners and where the board says they are, in views that were left out
        of the fit. Infinite if a corner has no ray.
    square_by_view : float64 (v,)
        Mean square of those angles view by view, deg².
    reason : str
        Why it failed; empty if it did not.
    """

    label: str
    model: str
    n_parameters: int
    fit: Fit | None
    held_out_deg: float
    square_by_view: FloatArray
    reason: str = ""


def compare(
    lenses: Sequence[Lens],
    corners: Corners,
    curve: RadialCurve,
    poses: BoardPoses,
    *,
    free_shape: Sequence[str] = (),
    progress: Progress = lambda _text: None,
) -> tuple[Candidate, ...]:
    """Fit every lens, and judge each by views that it has not seen.

    F-theta and ocam come with c and d free too: pixels that are not square are found without being asked for.
    The corners that count are the same for all: those that the best-fitting model does not reject.

    Raises
    ------
    CalibrationError
        If none fits.
    """
    tried = list(lenses)
    fits = [_fit(lens, corners, curve, poses, free_shape, progress) for lens in tried]
    more = with_linear_terms([fitted for fitted in fits if isinstance(fitted, Fit)])
    tried += more
    fits += [_fit(lens, corners, curve, poses, free_shape, progress, unasked=True) for lens in more]
    good = [fitted for fitted in fits if isinstance(fitted, Fit)]
    if not good:
        reasons = "; ".join(str(reason) for reason in fits)
        raise CalibrationError(f"No camera model fits these views: {reasons}. Is the board's size right?")
    inlier = min(good, key=lambda fitted: fitted.adjusted.sigma_px).adjusted.inlier
    candidates = []
    for lens, fitted in zip(tried, fits, strict=True):
        progress(f"leaving views out: {label(lens)}")
        candidates.append(_judged(lens, fitted, inlier))
    return tuple(candidates)


def _fit(
    lens: Lens,
    corners: Corners,
    curve: RadialCurve,
    poses: BoardPoses,
    free_shape: Sequence[str],
    progress: Progress,
    *,
    unasked: bool = False,
) -> Fit | CalibrationError:
    progress(f"fitting {label(lens)}")
    try:
        fitted = fit(lens, corners, curve, poses, free_shape=free_shape)
        if unasked:
            check_nearly_square(fitted)
    except CalibrationError as error:
        return error
    return fitted


def best(candidates: Sequence[Candidate]) -> Candidate:
    """Take the candidate with the smallest held-out error; a simpler one if that is as good.

    As good: by less than two standard errors of differences and ratios view by view and by less than a tenth,
    or by less than one per cent.

    Raises
    ------
    CalibrationError
        If no candidate has a held-out error.
    """
    known = [c for c in candidates if c.fit is not None and np.isfinite(c.held_out_deg)]
    if not known:
        raise CalibrationError("No camera model fits views that were left out: show the board in more views.")
    first = min(known, key=lambda c: c.held_out_deg)
    equal = [c for c in known if _as_good(c, first)]
    return min(equal, key=lambda c: (c.n_parameters, c.held_out_deg))


def _as_good(candidate: Candidate, first: Candidate) -> bool:
    """Whether no view, and not all of them together, tells that a candidate is worse than the first one.

    A model that is wrong at the image's edge shows it in the views there alone: their squares outweigh the
    others and make the mean difference uncertain, which the ratios view by view are not.
    """
    ratio = candidate.held_out_deg / max(first.held_out_deg, 1e-30)
    if ratio <= 1.0 + _EQUAL_PART:
        return True
    squares = np.maximum([candidate.square_by_view, first.square_by_view], 1e-60)
    worse = (squares[0] - squares[1], np.log(squares[0] / squares[1]))
    return ratio <= 1.0 + _MOST_PART and all(
        w.mean() <= _EQUAL_SIGMAS * w.std(ddof=1) / np.sqrt(len(w)) for w in worse
    )


def _judged(lens: Lens, fitted: Fit | CalibrationError, inlier: BoolArray) -> Candidate:
    n_parameters = len(lens.parameters)
    if isinstance(fitted, CalibrationError):
        return Candidate(label(lens), lens.name, n_parameters, None, np.inf, np.array([]), str(fitted))
    square, reason = held_out(fitted, inlier), ""
    rms = float(np.degrees(np.sqrt(square.mean())))
    if not np.isfinite(rms):
        rms, reason = np.inf, "corners of views that were left out have no ray"
    return Candidate(label(lens), lens.name, n_parameters, fitted, rms, np.degrees(1.0) ** 2 * square, reason)


def held_out(fitted: Fit, inlier: BoolArray) -> FloatArray:
    """Mean squares (v,) of the angles, rad², view by view: each by a camera fitted to other views.

    In a view that was left out, the board's pose alone is adjusted. Infinite where a corner has no ray, or
    the other views alone fit no camera.
    """
    corners, adjusted, poses = fitted.bundle.corners, fitted.adjusted, fitted.adjusted.state.poses
    weight = inlier.astype(np.float64)
    views = np.arange(corners.n_views)
    square = np.full(corners.n_views, np.inf)
    for fold in range(min(_FOLDS, corners.n_views)):
        # Neighbours in a film look alike: every fold takes views from all over it.
        out = views[fold :: min(_FOLDS, corners.n_views)]
        kept = np.setdiff1d(views, out)
        start = BundleState(adjusted.state.lens, adjusted.state.shape, _some(poses, kept))
        others = replace(fitted.bundle, corners=corners.of(kept))
        state, converged = minimise(others, start, weight[np.isin(corners.view, kept)])
        if not converged:
            continue
        bundle = replace(fitted.bundle, corners=corners.of(out))
        start = BundleState(state.lens, state.shape, _some(poses, out))
        square[out] = _squares(fitted.lens, bundle, start, weight[np.isin(corners.view, out)])
    return square


def _squares(lens: Lens, bundle: Bundle, start: BundleState, weight: FloatArray) -> FloatArray:
    """Mean squares of the angles view by view, the poses adjusted."""
    state = adjust_poses(bundle, start, weight)
    angle = angular_residuals(lens.camera(state.lens), bundle, state)
    square = np.where(weight > 0.0, np.where(np.isfinite(angle), angle**2, np.inf), 0.0)
    first = bundle.corners.first
    return np.asarray(np.add.reduceat(square, first) / np.add.reduceat(weight, first))


def _some(poses: BoardPoses, views: IntArray) -> BoardPoses:
    return BoardPoses(poses.rotation[views], poses.position_m[views])
