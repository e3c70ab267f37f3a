"""Maps over a camera's picture, in the cells that reports keep."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.intrinsics.coverage import MAP_PX

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NOT_KNOWN = "#d9d9d9"
"""Where nothing is vouched for."""


def draw_cells(
    axes: Axes,
    values: FloatArray,
    size_px: tuple[int, int],
    *,
    title: str,
    label: str,
    signed: bool = False,
    most: float | None = None,
) -> None:
    """Draw values (rows, columns) of cells over the picture, with a scale; NaN is grey.

    Parameters
    ----------
    axes : matplotlib Axes
    values : float64 (rows, columns)
    size_px : (int, int)
        Width and height of the picture.
    title, label : str
        What is shown, and its unit.
    signed : bool
        Zero is the middle of the scale.
    most : float, optional
        End of the scale. Default: the largest value.
    """
    rows, columns = values.shape
    largest = most or float(np.nanmax(np.abs(values), initial=0.0)) or 1e-12
    shown = axes.imshow(
        values,
        extent=(-0.5, columns * MAP_PX - 0.5, rows * MAP_PX - 0.5, -0.5),
        cmap="RdBu_r" if signed else "viridis_r",
        vmin=-largest if signed else 0.0,
        vmax=largest,
        interpolation="nearest",
    )
    axes.set_facecolor(NOT_KNOWN)
    axes.set(xlim=(-0.5, size_px[0] - 0.5), ylim=(size_px[1] - 0.5, -0.5))
    axes.tick_params(labelsize=7)
    axes.set_title(title, loc="left", fontsize=9)
    figure = axes.get_figure()
    if figure is not None:
        figure.colorbar(shown, ax=axes, label=label, fraction=0.03, pad=0.02)
