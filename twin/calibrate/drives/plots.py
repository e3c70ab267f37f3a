"""Pictures of a verification and of the cameras' history."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.calibrate.drives.history import AXES, DriveTurn, Histories
from twin.calibrate.drives.verify import Verification
from twin.store.figure_files import check_figure_name, write_figure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

_NOW, _TURNED = "#c8553d", "#1f6f8b"
_COLOURS = ("#1f6f8b", "#c8553d", "#6a994e")
_MOVED = "#b08900"
_BESIDE = 0.012
"""Marks of one distance stand side by side, this share of it to the left and right."""
_FLOOR_M = 0.01


def draw_verification(found: Verification, path: Path) -> None:
    """Draw errors of single frames by distance for each camera, with the rig as it is and turned.

    Raises
    ------
    ConfigError
        If the name ends in none of ``.png``, ``.svg`` and ``.pdf``.
    """
    figure, n = _figure(path, len(found.errors_at))
    grid = figure.subplots(1, n, squeeze=False, sharey=True)[0]
    for axes, (camera, at) in zip(grid, found.errors_at.items(), strict=True):
        for column, colour, shift in ((1, _NOW, -_BESIDE), (2, _TURNED, _BESIDE)):
            error = np.maximum(at[:, column], _FLOOR_M)
            axes.plot(at[:, 0] * (1.0 + shift), error, ".", ms=3, color=colour, alpha=0.25, mew=0)
        rows = [e for e in found.errors if e.camera == camera]
        distance = np.array([e.distance_m for e in rows])
        before, after = [e.before_m for e in rows], [e.after_m for e in rows]
        axes.plot(distance * (1.0 - _BESIDE), before, "-D", ms=7, color=_NOW, mec="white", label="now")
        axes.plot(distance * (1.0 + _BESIDE), after, "-o", ms=7, color=_TURNED, mec="white", label="turned")
        axes.set(title=camera, xlabel="distance [m]")
        axes.grid(color="#eeeeee")
    largest = max((e.before_m for e in found.errors), default=1.0)
    # Errors grow with the square of the distance: only a logarithm shows near and far ones in one picture.
    # Slips of the annotator would press everything that matters to the floor.
    grid[0].set(ylabel="horizontal error [m]", yscale="log", ylim=(_FLOOR_M, 4.0 * max(largest, 0.1)))
    grid[0].yaxis.set_major_formatter("{x:g}")
    grid[0].legend(frameon=False, title="medians")
    write_figure(figure, path)


def draw_histories(found: Histories, path: Path) -> None:
    """Draw pitch, yaw and roll of each camera drive by drive, with one sigma; moves as a line between.

    Raises
    ------
    ConfigError
        If the name ends in none of ``.png``, ``.svg`` and ``.pdf``.
    """
    figure, n = _figure(path, len(found.cameras))
    grid = figure.subplots(1, n, squeeze=False, sharey=True)[0]
    for axes, history in zip(grid, found.cameras, strict=True):
        turn = np.array([d.turn_deg for d in history.drives])
        sigma = np.array([d.sigma_deg for d in history.drives])
        place = np.arange(len(turn))
        for axis, colour in enumerate(_COLOURS):
            shift = 0.12 * (axis - 1)
            axes.errorbar(
                place + shift, turn[:, axis], sigma[:, axis], fmt="o", ms=4, color=colour, label=AXES[axis]
            )
        if history.since:
            axes.axvline(history.since - 0.5, color=_MOVED, ls="--", lw=1.2)
        axes.set_xticks(place, tick_labels(history.drives), rotation=60, fontsize=7)
        axes.set(title=history.camera, xlim=(-0.6, len(place) - 0.4))
        axes.grid(color="#eeeeee")
    grid[0].set(ylabel="against the newest rig file [°]")
    grid[0].legend(frameon=False)
    write_figure(figure, path)


def tick_labels(drives: Sequence[DriveTurn]) -> list[str]:
    """Days, or where two drives were on one day the drives' names."""
    days = [f"{dt.datetime.fromtimestamp(d.started_ns / 1e9, tz=dt.UTC):%Y-%m-%d}" for d in drives]
    return days if len(set(days)) == len(days) else [d.name for d in drives]


def _figure(path: Path, n: int) -> tuple[Figure, int]:
    from matplotlib.figure import Figure

    check_figure_name(path)
    figure = Figure(figsize=(4.2 * max(n, 1), 4.2), dpi=120, facecolor="white", layout="constrained")
    return figure, max(n, 1)
