"""What is wrong with a set of views, named: what, how much, and what helps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.intrinsics.consistency import (
    TwoCameras,
    alikeness,
    square_m,
    two_cameras,
    unlike_noise,
)
from geoloc.calibration.intrinsics.coverage import Coverage
from geoloc.calibration.intrinsics.fit import Fit
from geoloc.doubts import Doubt
from geoloc.errors import CalibrationError

ENOUGH_VIEWS = 10
"""With fewer, the comparison of models and the uncertainties rest on little."""
_SURE = 5.0
"""Sigmas beyond which a board's shape is a finding."""
_SMALLEST_PART = 1e-3
"""Shape errors below this part of the board's half size are left alone: what a flat print has anyway."""
_ENOUGH_COVERED = 0.6
_WEAK_DEG = 0.05
_DISTANCE_PART, _DISTANCE_M, _DISTANCE_SIGMAS = 0.005, 0.006, 3.0
"""Of measured distances: the least that is told, and the tape's and the lens's own place, one sigma."""
_NO_CAMERA_PX = 0.5
_NAMES = 5


class ViewFault(StrEnum):
    """What can be wrong with a set of views."""

    MISFIT = "misfit"
    BENT_BOARD = "bent_board"
    STRETCHED_BOARD = "stretched_board"
    FEW_VIEWS = "few_views"
    POOR_COVERAGE = "poor_coverage"
    WEAK_GEOMETRY = "weak_geometry"
    NO_RAYS = "no_rays"
    WRONG_SQUARE_SIZE = "wrong_square_size"


def some(names: Sequence[str]) -> str:
    """The first five names, and how many more there are."""
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    return ", ".join(names[:_NAMES]) + more


def _two_cameras(found: TwoCameras, names: Sequence[str]) -> CalibrationError:
    x, y = found.shift_px
    return CalibrationError(
        f"The views do not fit one camera: {some([names[n] for n in found.other])} "
        f"({len(found.other)} of {len(names)}) look like another camera, another zoom or focus, or turned "
        f"pictures (focal length {found.zoom:.3f} times that of the others, principal point moved by "
        f"{x:.1f}, {y:.1f} px): calibrate them apart."
    )


def misfit_faults(fit: Fit, names: Sequence[str], other_models: Sequence[str] = ()) -> list[Doubt]:
    """Residuals that are no noise: the model does not fit; `names` are those of the views.

    `other_models` are those that were not compared: where there are none, they are no cure.

    Raises
    ------
    CalibrationError
        If the views are two cameras', or the residuals larger than half a pixel.
    """
    if not unlike_noise(fit):
        return []
    found = two_cameras(fit)
    if found is not None:
        raise _two_cameras(found, names)
    sigma, alike = fit.adjusted.sigma_px, alikeness(fit)
    if sigma > _NO_CAMERA_PX:
        raise CalibrationError(
            f"The views do not fit one camera: the best model, {fit.label}, leaves {sigma:.2f} px a corner, "
            f"and neighbouring corners are off alike (correlation {alike:.2f}). See that all pictures are of "
            "one camera with fixed zoom and focus, not scaled or cropped, and of one flat board."
        )
    cure = "take the pictures with a fixed focus, of a flatter board"
    if other_models:
        cure = f"try {', '.join(other_models)} as well (--model auto), or {cure}"
    return [
        Doubt(
            ViewFault.MISFIT,
            f"The model {fit.label} does not fit: it leaves {sigma:.3f} px a corner, and neighbouring "
            f"corners are off alike (correlation {alike:.2f}; noise has 0). The error bars are too small: "
            f"{cure}.",
        )
    ]


def shape_findings(trial: Fit) -> tuple[str, ...]:
    """Which parts of the board's shape, of those left free, a fit is sure of: ``stretch``, ``bend``."""
    found = []
    if "stretch" in trial.bundle.free_shape and _sure(*trial.shape["stretch"]):
        found.append("stretch")
    if "bend_xx" in trial.bundle.free_shape and _sure(*_bend(trial)):
        found.append("bend")
    return tuple(found)


def _sure(value: float, sigma: float) -> bool:
    return abs(value) > max(_SURE * sigma, _SMALLEST_PART)


def shape_faults(fit: Fit) -> list[Doubt]:
    """Sentences about the shape that was adjusted with the camera."""
    faults, half_m, found = [], fit.bundle.corners.half_size_m, shape_findings(fit)
    if "bend" in found:
        bend, sigma = _bend(fit)
        size = _plus_minus(1e3 * half_m * abs(bend), 1e3 * half_m * sigma)
        faults.append(
            Doubt(
                ViewFault.BENT_BOARD,
                f"The board is bent: its edges stand {size} mm {'behind' if bend > 0.0 else 'before'} its "
                "middle. The bend was estimated with the camera; better glue the print to a stiff, flat "
                "plate.",
            )
        )
    if "stretch" in found:
        stretch, sigma = fit.shape["stretch"]
        faults.append(
            Doubt(
                ViewFault.STRETCHED_BOARD,
                "The board is stretched, its squares are not square: "
                f"{_plus_minus(100 * abs(stretch), 100 * sigma)} % "
                f"{'higher' if stretch > 0.0 else 'lower'} than wide. The ratio was estimated with the "
                "camera; measure the print, and print it at 100 % in both directions.",
            )
        )
    return faults


def _plus_minus(value: float, sigma: float) -> str:
    """Write both with the digits that show the sigma's first."""
    digits = max(1, -math.floor(math.log10(max(sigma, 1e-4))))
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def view_faults(fit: Fit, coverage: Coverage, sigma_deg: FloatArray) -> list[Doubt]:
    """Few views, poor coverage, rays that stay uncertain; `sigma_deg` is that of rays in covered cells."""
    faults, n_views = [], fit.bundle.corners.n_views
    if n_views < ENOUGH_VIEWS:
        faults.append(
            Doubt(
                ViewFault.FEW_VIEWS,
                f"Only {n_views} views were used: take {ENOUGH_VIEWS} or more, better 30, near and tilted, "
                "all over the image.",
            )
        )
    missing = coverage.missing()
    if coverage.fraction < _ENOUGH_COVERED:
        where = f" (hardly any {', '.join(missing)})" if missing else ""
        faults.append(
            Doubt(
                ViewFault.POOR_COVERAGE,
                f"Boards cover {coverage.fraction:.0%} of the image{where}: nothing is vouched for "
                "elsewhere; show the board there.",
            )
        )
    worst = float(np.nanmax(sigma_deg, initial=0.0))
    if worst > _WEAK_DEG:
        faults.append(
            Doubt(
                ViewFault.WEAK_GEOMETRY,
                f"Rays are uncertain by up to {worst:.2f}° (one sigma) even where boards were seen: show the "
                "board nearer, so that it fills a third of the image or more, and tilted by 30 to 50 degrees "
                "in all directions.",
            )
        )
    return faults


def domain_fault(fit: Fit) -> list[Doubt]:
    """Pixels of the image for which the model has no ray, because its function stops rising."""
    camera = fit.camera
    u, v = np.meshgrid(np.arange(0.0, camera.width_px, 16.0), np.arange(0.0, camera.height_px, 16.0))
    part = float((~camera.camera_ray_from_pixel(np.stack([u, v], axis=-1))[1]).mean())
    if part == 0.0:
        return []
    return [
        Doubt(
            ViewFault.NO_RAYS,
            f"The model {fit.label} has no rays in {100 * part:.1f} % of the image, outside of all boards: "
            "it does not rise there; show the board nearer to the corners.",
        )
    ]


def distance_faults(fit: Fit, names: tuple[str, ...], measured_m: Mapping[str, float]) -> list[Doubt]:
    """Compare measured distances (camera to the middle of the board) with those of the views' poses.

    A wrong square size scales all distances and leaves the camera's parameters as they are: only a distance
    that was measured tells.
    """
    middle = np.append(fit.bundle.corners.middle_m, 0.0)
    poses = fit.adjusted.state.poses
    distance = np.linalg.norm(poses.position_m + poses.rotation @ middle, axis=-1)
    found = [(distance[names.index(name)], m, name) for name, m in measured_m.items() if name in names]
    if not found:
        return []
    seen, measured = np.array([pair[:2] for pair in found], dtype=np.float64).T
    # One factor for all of them, by least squares: where they agree they tell it the better.
    factor = float(measured @ seen / (seen @ seen))
    sigma = _DISTANCE_M / float(np.linalg.norm(seen))
    if abs(factor - 1.0) <= max(_DISTANCE_SIGMAS * sigma, _DISTANCE_PART):
        return []
    worst = int(np.abs(seen - measured).argmax())
    square = square_m(fit.bundle.corners)
    more = f", and {len(found) - 1} more alike" if len(found) > 1 else ""
    return [
        Doubt(
            ViewFault.WRONG_SQUARE_SIZE,
            f"View {found[worst][2]} was taken from {measured[worst]:.3f} m{more}, but squares of"
            f" {square:.4f} m put the board at {seen[worst]:.3f} m: they are rather {square * factor:.4f} m"
            f" (± {100.0 * sigma:.1f} %); measure the print.",
        )
    ]


def _bend(fit: Fit) -> tuple[float, float]:
    """Largest curvature of the board and its sigma: depth of the edges in half sizes."""
    names = ("bend_xx", "bend_xy", "bend_yy")
    xx, xy, yy = (fit.shape[name][0] for name in names)
    values, axes = np.linalg.eigh(np.array([[xx, 0.5 * xy], [0.5 * xy, yy]]))
    x, y = axes[:, int(np.abs(values).argmax())]
    slope = np.array([x * x, x * y, y * y])
    first = len(fit.lens.parameters) + fit.bundle.free_shape.index("bend_xx")
    covariance = fit.adjusted.covariance[first : first + 3, first : first + 3]
    return float(values[np.abs(values).argmax()]), float(np.sqrt(slope @ covariance @ slope))
