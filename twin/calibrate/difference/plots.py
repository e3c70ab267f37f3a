"""Two calibrations of the same cameras as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.calibrate.cell_maps import draw_cells
from twin.calibrate.difference.compare import SIGN_M, ComparedMaps, FitVerdict
from twin.calibrate.difference.words import verdict_sentence
from twin.store.figure_files import check_figure_name, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIGMAS_SHOWN = 5.0
_ARROWS = 24
"""Across the picture."""


def draw_difference(maps: Sequence[ComparedMaps], path: Path) -> None:
    """Write `difference_figure` as PNG, SVG or PDF, by the name's ending.

    Raises
    ------
    ConfigError
        If the ending is none of these.
    """
    check_figure_name(path)
    write_figure(difference_figure(maps), path)


def difference_figure(maps: Sequence[ComparedMaps]) -> Figure:
    """Draw a row of maps for each camera: degrees, units of the joint uncertainty, metres at 20 m."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(17.0, 3.1 * len(maps)), dpi=110, facecolor="white", layout="constrained")
    rows = np.atleast_1d(np.array(figure.subfigures(len(maps), 1)))
    for row, one in zip(rows, maps, strict=True):
        row.suptitle(verdict_sentence(one.compared), fontsize=10, x=0.005, ha="left")
        _draw_row(row.subplots(1, 4), one)
    return figure


def _draw_row(axes: Sequence[Axes], maps: ComparedMaps) -> None:
    size = maps.size_px
    same = maps.compared.lens.verdict is FitVerdict.SAME
    if same:
        _say(axes[0], "The same lens in both")
    else:
        draw_cells(axes[0], maps.apart_deg, size, title="Rays apart, one turn taken out", label="degrees")
        step = max(1, maps.pixel_px.shape[1] // _ARROWS)
        place, off = maps.pixel_px[::step, ::step], maps.apart_px[::step, ::step]
        axes[0].quiver(*np.moveaxis(place, -1, 0), *np.moveaxis(off, -1, 0), angles="xy", width=0.003)
    if maps.in_sigmas is None or same:
        _say(axes[1], "" if same else "Not both calibrations have\na covariance of this lens")
    else:
        title = "The same, in joint sigmas"
        draw_cells(axes[1], maps.in_sigmas, size, title=title, label="sigmas", most=_SIGMAS_SHOWN)
    whole = "lens alone" if maps.compared.mounting is None else "lens and mounting"
    for number, name in enumerate(("to the left", "further away")):
        title = f"A sign's foot {SIGN_M:g} m away, {name}: {whole}"
        draw_cells(axes[2 + number], maps.sign_m[..., number], size, title=title, label="metres", signed=True)


def _say(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, ha="center", va="center")
    axes.set_axis_off()
