"""Error against distance as the paper draws it: linear axes, slow and fast series, trend lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.reproduce.experiments import METHODS, SHOWN_M, Error, Experiment, Points
from twin.reproduce.published import MOVING_M, MOVING_WITHIN_M, STANDING_AT_M, STANDING_M, URBAN_M
from twin.store.kinds import Method

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart by the colour-blind; marks repeat what they say.
_LOOKS = (("#0072b2", "o", "-"), ("#d55e00", "s", "--"), ("#009e73", "D", "-."), ("#cc79a7", "v", ":"))
_MOST_POINTS = 4_000
_PUBLISHED = "#000000"


def figure(experiment: Experiment) -> Figure:
    """Draw the errors of every method, single frames above, whole objects below.

    Parameters
    ----------
    experiment : Experiment

    Returns
    -------
    matplotlib Figure
        Axes are linear and shared; series are slow and fast, or cameras where the car stood; lines are least
        squares. What the paper gives is black, in the panel of its method.
    """
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(11.0, 6.6), dpi=90, facecolor="white", layout="constrained")
    panels = drawn.subplots(2, len(METHODS), sharex=True, sharey=True)
    for column, method in enumerate(METHODS):
        for row, errors in enumerate(experiment.of(method)):
            if row == 0 and method == Method.ADJUSTED:
                _explain(panels[row][column], experiment)
                continue
            axes = panels[row][column]
            _panel(axes, experiment, errors)
            axes.set_title(f"{method}, {('single frames', 'whole objects')[row]}", loc="left", fontsize=10)
            if row == 0 and method == Method.PAPER:
                _published(axes, experiment)
            if axes.get_legend_handles_labels()[0]:
                axes.legend(fontsize=7.5, loc="upper left", framealpha=0.85)
    for axes in panels[:, 0]:
        axes.set_ylabel("horizontal error [m]")
    for axes in panels[1]:
        axes.set_xlabel("distance [m]")
    panels[0][0].set_xlim(0.0, SHOWN_M + 0.5)
    panels[0][0].set_ylim(0.0, _highest_m(experiment))
    return drawn


def _panel(axes: Axes, experiment: Experiment, errors: Sequence[Error]) -> None:
    axes.grid(color="#dddddd", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    for (name, points), (colour, marker, line) in zip(
        experiment.series(errors).items(), _LOOKS * 4, strict=False
    ):
        step = max(1, points.error_m.size // _MOST_POINTS)
        few = len(errors) < 60
        axes.plot(
            points.distance_m[::step],
            points.error_m[::step],
            marker,
            color=colour,
            ms=4.5 if few else 2.5,
            alpha=0.9 if few else 0.35,
            mew=0,
            label=_label(name, points),
        )
        if (trend := points.trend()) is not None:
            ends = np.array([points.distance_m.min(), points.distance_m.max()])
            axes.plot(ends, trend[0] + trend[1] * ends, line, color=colour, lw=1.6)


def _label(name: str, points: Points) -> str:
    speed = f", {points.kmh:.0f} km/h" if np.isfinite(points.kmh) and points.kmh >= 1.0 else ""
    return f"{name}{speed}: {points.error_m.size:,}"


def _published(axes: Axes, experiment: Experiment) -> None:
    """Draw what the paper gives of this experiment."""
    if experiment.stands:
        for (camera, errors), marker in zip(STANDING_M.items(), "^<>", strict=True):
            axes.plot(STANDING_AT_M, errors, marker, color=_PUBLISHED, mfc="none", label=f"paper's {camera}")
        return
    axes.plot(
        [0.0, MOVING_WITHIN_M], [MOVING_M] * 2, color=_PUBLISHED, ls=":", lw=1.2, label="paper: below 4 m"
    )
    if experiment.name == "urban":
        axes.plot(*zip(*URBAN_M, strict=True), "^", color=_PUBLISHED, mfc="none", label="paper's best, worst")


def _explain(axes: Axes, experiment: Experiment) -> None:
    """Say in the panel that has no points why, and what the others show."""
    what = f"figure {experiment.figure} of the paper, anew" if experiment.figure else "as the paper draws it"
    lines = (
        *(f"{experiment.name}: {what}.", ""),
        *("Above: each picture by itself, as the paper", "has it, at the distance from the car."),
        *("Below: all pictures of an object together,", "at the distance of the nearest."),
        *("Lines: least squares. Black: the paper's own.", ""),
        *("adjusted places whole objects only:", "it has no panel here."),
    )
    text = "\n".join(lines)
    axes.text(0.0, 1.0, text, transform=axes.transAxes, va="top", fontsize=9, color="#333333")
    axes.set_axis_off()


def _highest_m(experiment: Experiment) -> float:
    """Room for all but the wildest hundredth, and for the paper's own."""
    shown = [one.error_m for one in experiment.sightings if one.distance_m <= SHOWN_M]
    published = max(STANDING_M.values())[-1] if experiment.stands else MOVING_M
    return max(1.15 * float(np.percentile(shown, 99.0)) if shown else 0.0, 1.15 * published)
