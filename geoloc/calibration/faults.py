"""What is wrong with a set of views, named: what, how much, and what helps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geoloc.calibration.coverage import Coverage
from geoloc.calibration.fit import Fit
from geoloc.calibration.lens import FloatArray
from geoloc.calibration.views import Corners

ENOUGH_VIEWS = 10
"""With fewer, the comparison of models and the uncertainties rest on little."""
_SURE = 5.0
"""Sigmas beyond which a board's shape is a finding."""
_SMALLEST_PART = 1e-3
"""Shape errors below this part of the board's half size are left alone: what a flat print has anyway."""
_ENOUGH_COVERED = 0.6
_WEAK_DEG = 0.05
_DISTANCE_PART, _DISTANCE_M = 0.02, 0.01


@dataclass(frozen=True, slots=True)
class Fault:
    """One finding: its name for programs and a sentence for people."""

    kind: str
    sentence: str


def shape_findings(trial: Fit) -> tuple[str, ...]:
    """Which parts of the board's shape a fit with all of them free is sure of: ``stretch``, ``bend``."""
    found = []
    stretch, stretch_sigma = trial.shape["stretch"]
    if abs(stretch) > max(_SURE * stretch_sigma, _SMALLEST_PART):
        found.append("stretch")
    bend, bend_sigma = _bend(trial)
    if abs(bend) > max(_SURE * bend_sigma, _SMALLEST_PART):
        found.append("bend")
    return tuple(found)


def shape_faults(made: Fit) -> list[Fault]:
    """Sentences about the shape that was adjusted with the camera."""
    faults, half_m = [], made.bundle.corners.half_size_m
    if "bend_xx" in made.bundle.free_shape:
        bend, sigma = _bend(made)
        faults.append(
            Fault(
                "bent_board",
                f"The board is bent: its edges stand {1e3 * half_m * abs(bend):.1f} ± "
                f"{1e3 * half_m * sigma:.1f} mm {'behind' if bend > 0.0 else 'before'} its middle. The bend "
                "was estimated with the camera; better glue the print to a stiff, flat plate.",
            )
        )
    if "stretch" in made.bundle.free_shape:
        stretch, sigma = made.shape["stretch"]
        faults.append(
            Fault(
                "stretched_board",
                f"The board's squares are not square: {100 * abs(stretch):.2f} ± {100 * sigma:.2f} % "
                f"{'higher' if stretch > 0.0 else 'lower'} than wide. The ratio was estimated with the "
                "camera; measure the print, and print it at 100 % in both directions.",
            )
        )
    return faults


def view_faults(made: Fit, coverage: Coverage, sigma_deg: FloatArray) -> list[Fault]:
    """Few views, poor coverage, rays that stay uncertain; `sigma_deg` is that of rays in covered cells."""
    faults, n_views = [], made.bundle.corners.n_views
    if n_views < ENOUGH_VIEWS:
        faults.append(
            Fault(
                "few_views",
                f"Only {n_views} views were used: take {ENOUGH_VIEWS} or more, better 30, near and tilted, "
                "all over the image.",
            )
        )
    missing = coverage.missing()
    if coverage.fraction < _ENOUGH_COVERED:
        where = f" (hardly any {', '.join(missing)})" if missing else ""
        faults.append(
            Fault(
                "poor_coverage",
                f"Boards cover {coverage.fraction:.0%} of the image{where}: nothing is vouched for "
                "elsewhere; show the board there.",
            )
        )
    worst = float(np.nanmax(sigma_deg, initial=0.0))
    if worst > _WEAK_DEG:
        faults.append(
            Fault(
                "weak_geometry",
                f"Rays are uncertain by up to {worst:.2f}° (one sigma) even where boards were seen: show the "
                "board nearer, so that it fills a third of the image or more, and tilted by 30 to 50 degrees "
                "in all directions.",
            )
        )
    return faults


def domain_fault(made: Fit) -> list[Fault]:
    """Pixels of the image for which the model has no ray, because its function stops rising."""
    camera = made.camera
    u, v = np.meshgrid(np.arange(0.0, camera.width_px, 16.0), np.arange(0.0, camera.height_px, 16.0))
    part = float((~camera.camera_ray_from_pixel(np.stack([u, v], axis=-1))[1]).mean())
    if part == 0.0:
        return []
    return [
        Fault(
            "no_rays",
            f"The model {made.label} has no rays in {100 * part:.1f} % of the image, outside of all boards: "
            "it does not rise there; show the board nearer to the corners.",
        )
    ]


def distance_faults(made: Fit, names: tuple[str, ...], measured_m: Mapping[str, float]) -> list[Fault]:
    """Compare measured distances (camera to the middle of the board) with those of the views' poses.

    A wrong square size scales all distances and leaves the camera's parameters as they are: only a distance
    that was measured tells.
    """
    middle = np.append(made.bundle.corners.middle_m, 0.0)
    poses = made.adjusted.state.poses
    distance = np.linalg.norm(poses.position_m + poses.rotation @ middle, axis=-1)
    found = [
        (distance[names.index(name)], metres, name) for name, metres in measured_m.items() if name in names
    ]
    wrong = [f for f in found if abs(f[0] - f[1]) > _DISTANCE_PART * f[1] + _DISTANCE_M]
    if not wrong:
        return []
    seen, metres, name = wrong[0]
    square = square_m(made.bundle.corners)
    return [
        Fault(
            "wrong_square_size",
            f"View {name} was taken from {metres:.3f} m, but squares of {square:.4f} m put the board at "
            f"{seen:.3f} m: they are rather {square * metres / seen:.4f} m; measure the print.",
        )
    ]


def square_m(corners: Corners) -> float:
    """Side of the board's squares: the smallest distance of two rows of corners."""
    across = np.unique(np.round(corners.board_m[:, 0], 9))
    return float(np.diff(across).min())


def _bend(made: Fit) -> tuple[float, float]:
    """Largest curvature of the board and its sigma: depth of the edges in half sizes."""
    names = ("bend_xx", "bend_xy", "bend_yy")
    xx, xy, yy = (made.shape[name][0] for name in names)
    values, axes = np.linalg.eigh(np.array([[xx, 0.5 * xy], [0.5 * xy, yy]]))
    x, y = axes[:, int(np.abs(values).argmax())]
    slope = np.array([x * x, x * y, y * y])
    first = len(made.lens.parameters) + made.bundle.free_shape.index("bend_xx")
    covariance = made.adjusted.covariance[first : first + 3, first : first + 3]
    return float(values[np.abs(values).argmax()]), float(np.sqrt(slope @ covariance @ slope))
