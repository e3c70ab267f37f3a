"""Coverage as a picture: where boards were seen, and how they were held."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoloc.calibration.intrinsics.missing_views import Reach, ShownViews, Tilt
from twin.calibrate.cell_maps import draw_cells
from twin.calibrate.coverage.look import CoverageReport
from twin.store.figure_files import check_figure_name, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {Reach.NEAR: "#1f5fa8", Reach.MIDDLING: "#3f8f4f", Reach.FAR: "#c8452e"}
_ENOUGH, _TOO_FEW = "#3f8f4f", "#c8452e"
_DIRECTIONS = {Tilt.RIGHT: (1.0, 0.0), Tilt.LEFT: (-1.0, 0.0), Tilt.TOP: (0.0, 1.0), Tilt.BOTTOM: (0.0, -1.0)}


def draw_coverage(shown: ShownViews, report: CoverageReport, size_px: tuple[int, int], path: Path) -> None:
    """Write `coverage_figure` as PNG, SVG or PDF, by the name's ending.

    Raises
    ------
    ConfigError
        If the ending is none of these.
    """
    check_figure_name(path)
    write_figure(coverage_figure(shown, report, size_px), path)


def coverage_figure(shown: ShownViews, report: CoverageReport, size_px: tuple[int, int]) -> Figure:
    """Draw how often each part of the picture was covered, and how the board was tilted, by its size."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 5.2), dpi=110, facecolor="white", layout="constrained")
    picture, tilts = figure.subplots(1, 2, width_ratios=(2.2, 1.0))
    covered = np.where(shown.covered > 0, shown.covered, np.nan)
    missing = "enough" if not report.missing else f"about {report.missing} more are needed"
    title = f"{report.boards} pictures with the board, {missing}; grey: no board yet"
    draw_cells(picture, covered, size_px, title=title, label="boards over this place")
    width, height = size_px
    for line in (1, 2):
        picture.axvline(line * width / 3.0, color="white", lw=1.0)
        picture.axhline(line * height / 3.0, color="white", lw=1.0)
    for number, boards in enumerate(shown.zone_views.ravel().tolist()):
        few = shown.lacking_zones[number] > 0
        picture.text(
            (number % 3 + 0.5) * width / 3.0,
            (number // 3 + 0.5) * height / 3.0,
            f"{np.floor(10.0 * boards) / 10.0:.1f}" + ("\nmore" if few else ""),
            ha="center",
            va="center",
            color="white",
            fontsize=11,
            bbox={"facecolor": _TOO_FEW if few else _ENOUGH, "edgecolor": "none", "alpha": 0.85},
        )
    _draw_tilts(tilts, shown)
    return figure


def _draw_tilts(axes: Axes, shown: ShownViews) -> None:
    rng = np.random.default_rng(0)
    for reach, colour in _COLOURS.items():
        places = [
            view.tilt_deg * np.array(_DIRECTIONS[view.tilt]) + rng.normal(scale=2.0, size=2)
            if view.tilt is not None
            else rng.normal(scale=4.0, size=2)
            for view in shown.views
            if view.reach is reach
        ]
        x, y = np.array(places).reshape(-1, 2).T
        axes.plot(x, y, "o", ms=6, color=colour, mec="white", label=f"{reach.value} ({len(places)})")
    for tilt, (across, up) in _DIRECTIONS.items():
        lacks = shown.lacking[tilt]
        text = f"{tilt.value} side\nnearer" + (f"\n{lacks} more" if lacks else "")
        colour = _TOO_FEW if lacks else _ENOUGH
        axes.text(70.0 * across, 70.0 * up, text, ha="center", va="center", fontsize=8, color=colour)
    axes.set(xlim=(-95.0, 95.0), ylim=(-85.0, 85.0), aspect="equal", xticks=[], yticks=[])
    axes.set_title("Tilts, by the board's size in the picture", loc="left", fontsize=9)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, -0.12), ncols=3, fontsize=8, frameon=False)
