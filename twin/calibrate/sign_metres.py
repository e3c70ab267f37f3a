"""How well a calibration places a sign: its uncertainty in metres over the picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.calibration.intrinsics import Intrinsics
from geoloc.calibration.intrinsics.coverage import map_pixels
from geoloc.calibration.intrinsics.known_lens import KnownLens, lens_of_fit
from geoloc.calibration.lens_difference import without_common_turn
from geoloc.calibration.sign_shift import DISTANCES_M, USUAL_HEIGHT_M, foot_sigma_m, height_m, mounting_slopes
from geoloc.rig.rig import FLU_R_RDF, RigCamera
from twin.calibrate.cell_maps import draw_cells
from twin.store.figure_files import write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twin.calibrate.difference.fits import CameraFit


def lens_metres(intrinsics: Intrinsics, name: str) -> Figure:
    """Draw what the lens's uncertainty is at signs 10 and 20 m away, of a camera that looks ahead."""
    camera = RigCamera(name, intrinsics.camera, FLU_R_RDF, np.array([0.0, 0.0, USUAL_HEIGHT_M]))
    covered = intrinsics.coverage.covers(map_pixels(camera.model.width_px, camera.model.height_px))
    maps = sigma_maps(camera, covered, lens_of_fit(intrinsics.fit), None)
    what = f"the lens alone; a level camera {USUAL_HEIGHT_M:g} m above the road"
    return _figure({name: (camera, maps, what)})


def draw_mounted_metres(fits: Mapping[str, CameraFit], cameras: Sequence[str], path: Path) -> None:
    """Draw the same for cameras whose mounting is known, with their lenses where their reports are there."""
    rows = {}
    for name in cameras:
        fit = fits[name]
        model = fit.camera.model
        covered = np.ones(map_pixels(model.width_px, model.height_px).shape[:2], dtype=bool)
        lens = None if fit.lens is None else fit.lens.known
        if fit.lens is not None and fit.lens.covered is not None:
            covered = fit.lens.covered
        maps = sigma_maps(fit.camera, covered, lens, fit.mounting_covariance)
        what = (
            "mounting alone: of the lens no report is beside the rig" if lens is None else "mounting and lens"
        )
        rows[name] = (fit.camera, maps, what)
    write_figure(_figure(rows), path)


def sigma_maps(
    camera: RigCamera, covered: BoolArray, lens: KnownLens | None, mounting: FloatArray | None
) -> dict[float, FloatArray]:
    """Give one sigma (rows, columns, 2) of a sign's foot, sideways and along, by its distance in metres.

    In each cell: of a foot at that distance, in the direction of the cell, on level ground below the camera.

    Parameters
    ----------
    camera : RigCamera
    covered : bool (rows, columns)
        Cells that are worked out; the others are NaN.
    lens : KnownLens, optional
        With a mounting, what turns all rays alike is not counted: the mounting's angles make up for it.
    mounting : float64 (6, 6), optional
        Covariance of a small rotation about the rig's axes and of the position.
    """
    pixel = map_pixels(camera.model.width_px, camera.model.height_px)
    ray, inside = camera.model.camera_ray_from_pixel(pixel[covered])
    ray = ray[inside]
    rig = ray @ camera.rig_R_camera.T
    covariance = np.zeros((len(ray), 6, 6))
    if mounting is not None:
        slopes = mounting_slopes(rig)
        covariance += slopes @ mounting @ np.swapaxes(slopes, -1, -2)
    if lens is not None:
        by_lens = lens.ray_slopes(ray)
        if mounting is not None:
            by_lens = without_common_turn(by_lens, ray)
        by_lens = camera.rig_R_camera @ by_lens
        covariance[:, :3, :3] += by_lens @ lens.covariance @ np.swapaxes(by_lens, -1, -2)
    where = covered.copy()
    where[covered] = inside
    maps = {}
    for distance_m in DISTANCES_M:
        maps[distance_m] = np.full((*covered.shape, 2), np.nan)
        maps[distance_m][where] = foot_sigma_m(rig, covariance, distance_m, height_m(camera))
    return maps


def _figure(rows: Mapping[str, tuple[RigCamera, dict[float, FloatArray], str]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(17.0, 3.1 * len(rows)), dpi=110, facecolor="white", layout="constrained")
    parts = np.atleast_1d(np.array(figure.subfigures(len(rows), 1)))
    for part, (name, (camera, maps, what)) in zip(parts, rows.items(), strict=True):
        part.suptitle(
            f"{name}: one sigma of a sign's foot that is seen there, in centimetres; {what}", fontsize=10
        )
        size = camera.model.width_px, camera.model.height_px
        axes = iter(part.subplots(1, 2 * len(maps)))
        for distance_m, values in maps.items():
            for number, direction in enumerate(("sideways", "along")):
                title = f"{distance_m:g} m away, {direction}"
                draw_cells(next(axes), 100.0 * values[..., number], size, title=title, label="cm")
    return figure
