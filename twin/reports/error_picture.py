"""Figures of an evaluation: error against distance and against speed, as bands of quantiles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import FloatArray
from twin.reports.evaluation import Evaluation
from twin.store.figure_files import check_figure_name, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class _Axis:
    """What errors are drawn against: a column of `Evaluation`, in the unit of the label."""

    column: str
    picture_label: str
    sign_label: str
    scale: float
    step: float


_AXES = {
    "error_distance": _Axis(
        "range_m", "distance from the camera [m]", "distance of its nearest picture [m]", 1.0, 2.5
    ),
    "error_speed": _Axis("speed_mps", "speed of the car [km/h]", "mean speed of the car [km/h]", 3.6, 5.0),
}
# Okabe and Ito's colours, told apart by the colour-blind; line and mark repeat what they say.
_LOOKS = {
    "paper": ("#d55e00", ":", "s"),
    "single-frame": ("#0072b2", "--", "D"),
    "adjusted": ("#009e73", "-", "o"),
}
_LEAST_ERROR_M = 0.003
"""What is smaller is drawn here: a logarithm has no zero."""
_FEWEST = 10
"""Errors in a step of the bands; steps with fewer are joined to the next."""


def plot(evaluation: Evaluation, folder: Path | str, *, ending: str = ".png") -> list[Path]:
    """Draw error against distance and against speed, every method in each, as the paper does.

    Left, single sightings of the methods of one frame; right, whole objects: at the distance of their nearest
    sighting, or at the car's mean speed while it saw them. The line is the median of the errors, the dark
    band holds half of them and the light one 95 %, in steps of 2.5 m and 5 km/h that hold ten errors or more.
    The errors' axis is logarithmic: methods are a factor of ten and more apart.

    Parameters
    ----------
    evaluation : Evaluation
    folder : Path
        Made if it does not exist.
    ending : {".png", ".svg", ".pdf"}

    Returns
    -------
    list of Path
        ``error_distance`` and ``error_speed`` with that ending.

    Raises
    ------
    ConfigError
        Another ending.
    """
    files = {check_figure_name(Path(folder) / f"{name}{ending}"): axis for name, axis in _AXES.items()}
    return [write_figure(_figure(evaluation, axis), path) for path, axis in files.items()]


def quantile_bands(x: FloatArray, y: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Percentiles of `y` in steps of `x`.

    Parameters
    ----------
    x, y : float64 (n,)
        Pairs that are not both finite are left out.
    step : float
        Width of a step about its own multiples, in the unit of `x`. A step with fewer than ten values takes
        the next ones in; the last joins the one before it.

    Returns
    -------
    at : float64 (m + 2,)
        Mean `x` of each step, between the least and the greatest `x`; empty where no pair is finite.
    percentiles : float64 (5, m + 2)
        2.5, 25, 50, 75 and 97.5 %, the first and the last step's also at the ends.
    """
    known = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[known], kind="stable")
    x, y = x[known][order], y[known][order]
    if not x.size:
        return np.empty(0), np.empty((5, 0))
    starts = [0]
    for edge in (np.arange(np.round(x[0] / step), np.round(x[-1] / step)) + 0.5) * step:
        first = int(np.searchsorted(x, edge))
        if min(first - starts[-1], x.size - first) >= _FEWEST:
            starts.append(first)
    groups = list(zip(starts, [*starts[1:], x.size], strict=True))
    at = np.array([x[0], *(x[i:j].mean() for i, j in groups), x[-1]])
    middle = np.array([np.percentile(y[i:j], [2.5, 25.0, 50.0, 75.0, 97.5]) for i, j in groups])
    return at, np.concatenate([middle[:1], middle, middle[-1:]]).T


def _figure(evaluation: Evaluation, axis: _Axis) -> Figure:
    from matplotlib.figure import Figure

    kinds = (
        ("One picture at a time", "pictures", axis.picture_label, evaluation.sightings),
        ("All pictures of a sign together", "signs", axis.sign_label, evaluation.estimates),
    )
    shown = [kind for kind in kinds if kind[-1]]
    figure = Figure(figsize=(0.5 + 4.6 * len(shown), 4.8), dpi=120, facecolor="white", layout="constrained")
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for axes, (title, noun, label, errors) in zip(panels, shown, strict=True):
        _panel(axes, errors, axis, noun)
        axes.set_title(title, loc="left", fontsize=11)
        axes.set_xlabel(label)
    panels[0].set_yscale("log")
    panels[0].set_ylabel("horizontal error [m]")
    panels[0].yaxis.set_major_formatter("{x:g}")
    low_m, high_m = panels[0].get_ylim()
    # Room for the legends above what is drawn.
    panels[0].set_ylim(low_m, high_m * (high_m / low_m) ** 0.22)
    figure.supxlabel(
        "Line: median of the errors. Dark band: half of them. Light band: 95 %.", fontsize=9, color="#444444"
    )
    return figure


def _panel(axes: Axes, errors: Mapping[str, Mapping[str, FloatArray]], axis: _Axis, noun: str) -> None:
    for method in filter(errors.__contains__, _LOOKS):
        colour, line, marker = _LOOKS[method]
        error_m = np.maximum(errors[method]["error_m"], _LEAST_ERROR_M)
        at, percentiles = quantile_bands(errors[method][axis.column] * axis.scale, error_m, axis.step)
        low, quarter, median, three_quarters, high = percentiles
        for lower, upper, alpha in ((low, high, 0.16), (quarter, three_quarters, 0.34)):
            axes.fill_between(at, lower, upper, color=colour, alpha=alpha, lw=0)
        name = f"{method}: {error_m.size:,} {noun}, median {np.median(error_m):.2f} m"
        axes.plot(at, median, color=colour, ls=line, lw=1.8, label=name)
        axes.plot(at[1:-1], median[1:-1], color=colour, ls="", marker=marker, ms=5, mec="white", mew=0.6)
    axes.grid(color="#dddddd", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper left", fontsize=8.5, framealpha=0.9, edgecolor="#cccccc")
