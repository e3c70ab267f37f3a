"""One camera model fitted to all views, as numbers with their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.calibration.intrinsics.bundle import (
    NO_SHAPE,
    SHAPE,
    AdjustedBundle,
    Bundle,
    BundleState,
    adjust,
    shaped,
)
from geoloc.calibration.intrinsics.initial_guess import BoardPoses, angle_between
from geoloc.calibration.intrinsics.lens import Lens, PinholeLens, RadialCurve
from geoloc.calibration.intrinsics.radial_lenses import FisheyeLens, FThetaLens, OcamLens
from geoloc.calibration.intrinsics.views import Corners
from geoloc.cameras import CameraModel
from geoloc.errors import CalibrationError

MODELS = ("ftheta", "fisheye", "pinhole", "ocam")
_DEGREES = (4, 5)
"""Of polynomials: DriveWorks' older files have four coefficients after the constant, newer up to five."""
_CURVE_SAMPLES = 80
_NEARLY_SQUARE = 0.01


@dataclass(frozen=True, slots=True)
class Fit:
    """A camera with the numbers it rests on.

    Attributes
    ----------
    lens : Lens
    camera : CameraModel
    bundle : Bundle
    adjusted : AdjustedBundle
    """

    lens: Lens
    camera: CameraModel
    bundle: Bundle
    adjusted: AdjustedBundle

    @property
    def label(self) -> str:
        """Model, and the degree of its polynomial."""
        return label(self.lens)

    @property
    def values(self) -> FloatArray:
        """(p,): parameters as calibration files write them (`Lens.parameters`)."""
        return np.asarray(self.adjusted.state.lens * self.lens.units)

    @property
    def covariance(self) -> FloatArray:
        """(p, p): of `values`."""
        n, units = len(self.lens.parameters), self.lens.units
        return np.asarray(units[:, np.newaxis] * self.adjusted.covariance[:n, :n] * units)

    @property
    def shape(self) -> dict[str, tuple[float, float]]:
        """Value and sigma of those of `SHAPE` that were adjusted."""
        n = len(self.lens.parameters)
        sigma = np.sqrt(np.diag(self.adjusted.covariance)[n:])
        values = (float(self.adjusted.state.shape[SHAPE.index(name)]) for name in self.bundle.free_shape)
        return dict(zip(self.bundle.free_shape, zip(values, sigma.tolist(), strict=True), strict=True))

    def residuals_rad(self) -> FloatArray:
        """Angles (n,) between the rays of the corners seen and the corners themselves; NaN if no ray."""
        return angular_residuals(self.camera, self.bundle, self.adjusted.state)

    def ray_covariance(self, pixel_px: FloatArray) -> FloatArray:
        """Covariance (n, 2, 2) of rays of pixels (n, 2), rad², across the ray.

        What the parameters' covariance does to a ray (`ray_slopes`). NaN outside the domain.
        """
        ray, inside = self.camera.camera_ray_from_pixel(pixel_px)
        ray = np.where(inside[:, np.newaxis], ray, (0.0, 0.0, 1.0))
        n = len(self.lens.parameters)
        by_lens = np.swapaxes(tangents(ray), -1, -2) @ ray_slopes(self.lens, self.adjusted.state.lens, ray)
        covariance = by_lens @ self.adjusted.covariance[:n, :n] @ np.swapaxes(by_lens, -1, -2)
        return np.where(inside[:, np.newaxis, np.newaxis], covariance, np.nan)

    def curve(self) -> RadialCurve:
        """Angle and radius as far out as there are corners: where to start another model."""
        centre = self.values[:2]
        farthest = np.linalg.norm(self.bundle.corners.pixel_px - centre, axis=-1).max()
        radius = np.linspace(0.0, farthest, _CURVE_SAMPLES + 1)[1:]
        azimuth = np.arange(8) * np.pi / 4.0
        across = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
        ray, _ = self.camera.camera_ray_from_pixel(centre + radius[:, np.newaxis, np.newaxis] * across)
        theta = angle_between(ray, np.array([0.0, 0.0, 1.0])).mean(axis=-1)
        known = np.isfinite(theta)
        return RadialCurve(theta[known], radius[known], float(centre[0]), float(centre[1]))


def label(lens: Lens) -> str:
    """Model, the degree of its polynomial, and whether its pixels may be other than square."""
    if not isinstance(lens, FThetaLens | OcamLens):
        return lens.name
    return f"{lens.name}, degree {lens.degree}{', with c and d' if lens.linear else ''}"


def with_linear_terms(fits: Sequence[Fit]) -> tuple[Lens, ...]:
    """The lenses with c and d free: of f-theta and of ocam that degree which fits better without them."""
    best: dict[str, tuple[float, FThetaLens | OcamLens]] = {}
    for fitted in fits:
        lens, sigma_px = fitted.lens, fitted.adjusted.sigma_px
        if not isinstance(lens, FThetaLens | OcamLens) or lens.linear:
            continue
        if lens.name not in best or sigma_px < best[lens.name][0]:
            best[lens.name] = sigma_px, lens
    return tuple(replace(lens, linear=True) for _, lens in best.values())


def check_nearly_square(fitted: Fit) -> None:
    """Refuse pixels that no sensor has: pictures were scaled unevenly, which is to be told and not fitted.

    Raises
    ------
    CalibrationError
        If c or d is off by more than a hundredth.
    """
    c, d = fitted.values[2:4].tolist()
    if max(abs(c - 1.0), abs(d)) > _NEARLY_SQUARE:
        raise CalibrationError(
            f"its pixels would not be square by {100.0 * max(abs(c - 1.0), abs(d)):.1f} %: give --linear if"
            " the sensor's are not"
        )


def lenses(model: str, width_px: int, height_px: int, *, linear: bool = False) -> tuple[Lens, ...]:
    """Lenses of one model, simplest first.

    Raises
    ------
    CalibrationError
        If the model is none of `MODELS`.
    """
    if model == "ftheta":
        return tuple(FThetaLens(width_px, height_px, degree, linear) for degree in _DEGREES)
    if model == "ocam":
        return tuple(OcamLens(width_px, height_px, degree, linear) for degree in _DEGREES)
    simple: dict[str, Callable[[int, int], Lens]] = {"fisheye": FisheyeLens, "pinhole": PinholeLens}
    if model not in simple:
        raise CalibrationError(f"There is no camera model {model} to fit: choose from {', '.join(MODELS)}.")
    return (simple[model](width_px, height_px),)


def fit(
    lens: Lens,
    corners: Corners,
    curve: RadialCurve,
    poses: BoardPoses,
    *,
    free_shape: Sequence[str] = (),
    shape: FloatArray = NO_SHAPE,
) -> Fit:
    """Fit one lens to all views.

    Raises
    ------
    CalibrationError
        If it does not converge.
    """
    bundle = Bundle(lens, corners, free_shape=tuple(free_shape))
    try:
        adjusted = adjust(bundle, BundleState(lens.start(curve), shape, poses))
    except np.linalg.LinAlgError:
        adjusted = None
    if adjusted is None or not adjusted.converged or not np.isfinite(adjusted.covariance).all():
        raise CalibrationError(
            f"the model {label(lens)} does not fit these views: its adjustment does not converge"
        )
    return Fit(lens, lens.camera(adjusted.state.lens), bundle, adjusted)


def angular_residuals(camera: CameraModel, bundle: Bundle, state: BundleState) -> FloatArray:
    """Angles (n,) between the rays of the pixels seen and the corners of the posed boards; NaN if no ray."""
    view = bundle.corners.view
    board, _ = shaped(bundle.corners, state.shape)
    expected = np.einsum("nij,nj->ni", state.poses.rotation[view], board) + state.poses.position_m[view]
    return angle_between(camera.camera_ray_from_pixel(bundle.corners.pixel_px)[0], expected)


def ray_slopes(lens: Lens, k: FloatArray, ray: FloatArray) -> FloatArray:
    """Derivatives (n, 3, p) of the unit rays (n, 3) of pixels by the lens's unknowns (p,).

    The pixel stays: to first order, d ray = -(∂π/∂ray)⁻¹ ∂π/∂k dk.
    """
    projection, basis = lens.project(k, ray), tangents(ray)
    return np.asarray(-basis @ np.linalg.solve(projection.by_point @ basis, projection.by_lens))


def tangents(ray: FloatArray) -> FloatArray:
    """Two unit vectors across each ray (n, 3): (n, 3, 2)."""
    aside = np.where(np.abs(ray[:, 1:2]) < 0.9, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    first = np.cross(aside, ray)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(ray, first)], axis=-1)


def inlier_share(corners: Corners, inlier: BoolArray) -> FloatArray:
    """Part (v,) of each view's corners that were used."""
    return np.asarray(
        np.bincount(corners.view, weights=inlier, minlength=corners.n_views) / np.bincount(corners.view)
    )
