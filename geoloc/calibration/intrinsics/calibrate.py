"""Intrinsics from pictures of a board: the whole of it, corners in, camera with covariance and report out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.intrinsics.bundle import SHAPE
from geoloc.calibration.intrinsics.comparison import Candidate, Progress, best, compare
from geoloc.calibration.intrinsics.coverage import CELL_PX, Coverage, coverage_of
from geoloc.calibration.intrinsics.faults import (
    distance_faults,
    domain_fault,
    misfit_faults,
    shape_faults,
    shape_findings,
    view_faults,
)
from geoloc.calibration.intrinsics.fit import MODELS, Fit, fit, inlier_share, lenses
from geoloc.calibration.intrinsics.initial_guess import BoardPoses, first_guess
from geoloc.calibration.intrinsics.lens import Lens, RadialCurve
from geoloc.calibration.intrinsics.radial_lenses import FThetaLens
from geoloc.calibration.intrinsics.views import Corners, View, corners_of
from geoloc.cameras import CameraModel
from geoloc.cameras.base import on_image
from geoloc.doubts import Doubt
from geoloc.errors import CalibrationError

MIN_VIEWS = 5
_BENDS = SHAPE[1:]
_BAD_VIEW = 0.5


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A calibrated camera and all that its report says.

    Attributes
    ----------
    camera : CameraModel
    fit : Fit
        Parameters, covariance, poses, residuals.
    candidates : tuple of Candidate
        All models that were compared; the chosen one among them.
    views : tuple of str
        Names of the views used.
    left_out : mapping of str to str
        Views that were not, and why.
    coverage : Coverage
    sigma_deg : float64 (rows, columns)
        One sigma of the rays (the longer axis) in the middles of `coverage`'s cells; NaN where not covered.
    faults : tuple of Doubt
        Of a `ViewFault` each.
    """

    camera: CameraModel
    fit: Fit
    candidates: tuple[Candidate, ...]
    views: tuple[str, ...]
    left_out: Mapping[str, str]
    coverage: Coverage
    sigma_deg: FloatArray
    faults: tuple[Doubt, ...]

    @property
    def chosen(self) -> Candidate:
        """The candidate that the camera is."""
        return next(c for c in self.candidates if c.fit is self.fit)


def calibrate_intrinsics(
    views: Sequence[View],
    width_px: int,
    height_px: int,
    *,
    models: Sequence[str] = MODELS,
    linear: bool = False,
    distances_m: Mapping[str, float] | None = None,
    progress: Progress = lambda _text: None,
) -> Intrinsics:
    """Calibrate a camera from views of a flat board.

    Poses, camera and, where the views are sure of it, the board's bend and stretch are adjusted together.
    Corners that no camera explains are left out one by one; a view half of whose corners are, as a whole.

    Parameters
    ----------
    views : sequence of View
    width_px, height_px : int
        Size of the pictures.
    models : sequence of str
        Which of `MODELS` to compare.
    linear : bool
        Only with the linear terms c and d of f-theta and ocam free. Otherwise they are where views that were
        left out say so.
    distances_m : mapping of view name to float, optional
        Measured distances of the camera from the middle of the board.

    Raises
    ------
    CalibrationError
        Too few views, a mirrored board, views of two cameras, no model that fits.

    Notes
    -----
    Zhang (2000), doi:10.1109/34.888718, for the principle; the start and the models are this package's own.
    """
    candidates = [lens for model in models for lens in lenses(model, width_px, height_px, linear=linear)]
    _check_on_image(views, width_px, height_px)
    kept, left_out, curve, poses = _consistent_views(_enough(views), width_px, height_px, linear=linear)
    corners = corners_of(kept)
    progress("looking at the board's shape")
    shape = _shape(_first_lens(width_px, height_px, linear=linear), corners, curve, poses)
    compared = compare(candidates, corners, curve, poses, free_shape=shape, progress=progress)
    fitted = best(compared).fit
    if fitted is None:
        raise CalibrationError("No camera model fits these views.")
    coverage = coverage_of(corners, fitted.adjusted.inlier, width_px, height_px)
    sigma_deg = _sigma_deg(fitted, coverage)
    names = tuple(view.name for view in kept)
    faults = [
        *misfit_faults(fitted, names, [model for model in MODELS if model not in models]),
        *shape_faults(fitted),
        *distance_faults(fitted, names, distances_m or {}),
        *view_faults(fitted, coverage, sigma_deg),
        *domain_fault(fitted),
    ]
    return Intrinsics(fitted.camera, fitted, compared, names, left_out, coverage, sigma_deg, tuple(faults))


def _check_on_image(views: Sequence[View], width_px: int, height_px: int) -> None:
    for view in views:
        if not on_image(view.pixel_px, width_px, height_px).all():
            raise CalibrationError(
                f"View {view.name} has corners outside of an image of {width_px} x {height_px} pixels: give "
                "the size of the pictures that they were found in."
            )


def _enough(views: Sequence[View]) -> Sequence[View]:
    if len(views) < MIN_VIEWS:
        raise CalibrationError(
            f"There are {len(views)} views of the board and {MIN_VIEWS} are the least that give a camera: "
            "take 30 or more, near and tilted, all over the image."
        )
    return views


def _first_lens(width_px: int, height_px: int, *, linear: bool) -> Lens:
    """The most general lens: what it cannot explain is no lens's doing."""
    return FThetaLens(width_px, height_px, 5, linear)


def _consistent_views(
    views: Sequence[View], width_px: int, height_px: int, *, linear: bool
) -> tuple[Sequence[View], dict[str, str], RadialCurve, BoardPoses]:
    """Views whose corners mostly agree with the others', why not the rest, and where to start from."""
    lens = _first_lens(width_px, height_px, linear=linear)
    left_out: dict[str, str] = {}
    while True:
        corners = corners_of(views)
        curve, poses = first_guess(corners, width_px, height_px)
        fitted = fit(lens, corners, curve, poses)
        share = inlier_share(corners, fitted.adjusted.inlier)
        good = share >= _BAD_VIEW
        if good.all():
            return views, left_out, fitted.curve(), fitted.adjusted.state.poses
        for view, part in zip(views, share, strict=True):
            if part < _BAD_VIEW:
                left_out[view.name] = (
                    f"{1 - part:.0%} of its corners fit no camera that the other views fit: was the board, "
                    "or the camera, moving, or is its zoom another?"
                )
        views = _enough([view for view, keep in zip(views, good, strict=True) if keep])


def _shape(lens: Lens, corners: Corners, curve: RadialCurve, poses: BoardPoses) -> tuple[str, ...]:
    """Unknowns of the board's shape that the views are sure of; none if they cannot tell."""
    free: tuple[str, ...] = SHAPE
    before: tuple[str, ...] = ()
    # One part may stand in for another that is free as well: what is left must be sure by itself.
    while free and free != before:
        try:
            found = shape_findings(fit(lens, corners, curve, poses, free_shape=free))
        except CalibrationError:
            return ()
        before = free
        free = (*(("stretch",) if "stretch" in found else ()), *(_BENDS if "bend" in found else ()))
    return free


def _sigma_deg(fitted: Fit, coverage: Coverage) -> FloatArray:
    """Longer axis of the rays' one-sigma ellipses in the middles of covered cells; NaN elsewhere."""
    rows, columns = np.nonzero(coverage.covered)
    pixel = CELL_PX * (np.column_stack([columns, rows]) + 0.5) - 0.5
    pixel = np.minimum(pixel, (coverage.width_px - 1.0, coverage.height_px - 1.0))
    covariance = fitted.ray_covariance(pixel)
    known = np.isfinite(covariance).all(axis=(1, 2))
    largest = np.full(len(pixel), np.nan)
    largest[known] = np.linalg.eigvalsh(covariance[known])[:, -1]
    sigma = np.full(coverage.covered.shape, np.nan)
    sigma[rows, columns] = np.degrees(np.sqrt(largest))
    return sigma
