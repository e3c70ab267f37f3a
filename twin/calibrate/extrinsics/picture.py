"""A calibration of extrinsics as a picture: cameras and tags from above and from the side, and residuals."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics import Extrinsics, Pose
from twin.calibrate.extrinsics.layout import FIRST_BOARD, YardLayout, board_size_m, outline_m
from twin.figures import png
from twin.store.atomic_files import replace_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_SIZE_IN = (12.0, 7.0)
_COLOURS = ("#1f6f8b", "#c8553d", "#6a994e", "#7b4b94", "#b08900", "#3d405b", "#0a9396", "#9b2226")
_TAG, _FLOOR, _BAD, _CAR = "#333333", "#8a8a8a", "#cc3311", "#d9dee4"
_AXIS_M = 1.2
_LABEL_M = 0.45
"""From a tag's middle to its number: beyond its edges, whichever way it is turned."""
_CLOSE_M = 0.7
"""Of numbers that would stand closer than this one is written."""
_ABOVE_M, _ABOVE_LYING_M = 0.6, 0.3
_LYING = 0.7


def draw_extrinsics(result: Extrinsics, layout: YardLayout, path: Path) -> None:
    """Write `extrinsics_figure` as a PNG."""
    replace_file(path, png(extrinsics_figure(result, layout)))


def extrinsics_figure(result: Extrinsics, layout: YardLayout) -> Figure:
    """Draw where cameras and tags are, in the rig frame, and how far the corners are off.

    Left from above (x forward to the right, y left upwards), with each camera's line of sight and the tags'
    numbers; top right from the side, where one tag hides another, with the numbers of rejected tags alone;
    below it the corners' residuals in pixels. What was left out, or is not where it was measured, is red.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN, dpi=120, facecolor="white", layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.0, 1.0], height_ratios=[1.0, 1.5])
    plan, side = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    rejected = _rejected(result)
    _draw_scene(plan, result, layout, (0, 1), rejected)
    _write_numbers(plan, _beyond_tags(result), layout, rejected)
    plan.set(xlabel="x forward [m]", ylabel="y left [m]", title="From above")
    plan.legend(loc="best", fontsize=8)
    _draw_scene(side, result, layout, (0, 2), rejected)
    above = {n: place for n, place in _above_tags(result).items() if n in rejected}
    _write_numbers(side, above, layout, rejected)
    side.axhline(0.0, color=_FLOOR, lw=1.0)
    side.set(xlabel="x forward [m]", ylabel="z up [m]", title="From the side")
    _draw_residuals(figure.add_subplot(grid[1, 1]), result)
    return figure


def _rejected(result: Extrinsics) -> set[int]:
    """Tags that were left out somewhere, or whose measured place was."""
    left_out = {s.tag for s, used in zip(result.sightings, result.used, strict=True) if not used}
    return left_out | result.misplaced.keys() | result.bumps.keys()


def _draw_scene(
    axes: Axes, result: Extrinsics, layout: YardLayout, shown: tuple[int, int], rejected: set[int]
) -> None:
    first, second = shown
    for number, pose in result.state.tags.items():
        outline = _outline_m(number, layout) @ pose.R.T + pose.t_m
        closed = np.vstack([outline, outline[:1]])
        colour = _colour(number, layout, rejected)
        axes.plot(closed[:, first], closed[:, second], color=colour, lw=1.3)
    for colour, (name, camera) in zip(_cycled(len(result.cameras)), result.cameras.items(), strict=True):
        eye = camera.rig_T_camera.t_m
        ahead = eye + _AXIS_M * camera.rig_T_camera.R[:, 2]
        line = np.stack([eye, ahead])
        axes.plot(line[:, first], line[:, second], color=colour, lw=2.0, label=name)
        axes.plot(eye[first], eye[second], "o", color=colour, ms=5)
    for name, pose in result.state.views.items():
        if name not in result.cameras:
            axes.plot(pose.t_m[first], pose.t_m[second], "+", color=_FLOOR, ms=6)
    axes.plot(0.0, 0.0, marker="s", color=_CAR, mec=_TAG, ms=6)
    axes.annotate("rear axle", (0.0, 0.0), fontsize=7, color=_TAG, xytext=(6, 4), textcoords="offset points")
    # Room for numbers, which count for nothing in the limits.
    axes.margins(0.08, 0.12)
    axes.set_aspect("equal")
    axes.grid(color="#eeeeee")
    axes.set_axisbelow(True)


def _lies(pose: Pose) -> bool:
    return bool(abs(pose.R[2, 2]) > _LYING)


def _beyond_tags(result: Extrinsics) -> dict[int, FloatArray]:
    """Places (x, y) for numbers: of standing tags beyond them as the cameras see it, else in their middle."""
    eye = np.mean([camera.rig_T_camera.t_m for camera in result.cameras.values()], axis=0)
    places = {}
    for number, pose in result.state.tags.items():
        away = (pose.t_m - eye)[:2]
        beyond_m = 0.0 if _lies(pose) else _LABEL_M
        places[number] = pose.t_m[:2] + beyond_m * away / max(float(np.linalg.norm(away)), 1e-9)
    return places


def _above_tags(result: Extrinsics) -> dict[int, FloatArray]:
    """Places (x, z) for numbers."""
    return {
        number: pose.t_m[[0, 2]] + np.array([0.0, _ABOVE_LYING_M if _lies(pose) else _ABOVE_M])
        for number, pose in result.state.tags.items()
    }


def _write_numbers(
    axes: Axes, places: Mapping[int, FloatArray], layout: YardLayout, rejected: set[int]
) -> None:
    """Write the numbers that have room; rejected ones first: they are what the picture is looked at for."""
    taken: list[FloatArray] = []
    for number in sorted(places, key=lambda n: (n not in rejected, n)):
        place = places[number]
        if any(np.linalg.norm(place - other) < _CLOSE_M for other in taken):
            continue
        taken.append(place)
        at, colour = (float(place[0]), float(place[1])), _colour(number, layout, rejected)
        axes.annotate(_name(number), at, fontsize=8, color=colour, ha="center", va="center")


def _name(number: int) -> str:
    return "board" if number >= FIRST_BOARD else str(number)


def _colour(number: int, layout: YardLayout, rejected: set[int]) -> str:
    if number in rejected:
        return _BAD
    return _FLOOR if layout.tags[number].on_floor else _TAG


def _outline_m(number: int, layout: YardLayout) -> FloatArray:
    """Corners (4, 3) of a tag's black square, or of a board, in its own frame."""
    if number not in layout.boards:
        return layout.tags[number].corners_m()
    return outline_m(*board_size_m(layout.boards[number]))


def _draw_residuals(axes: Axes, result: Extrinsics) -> None:
    camera = np.array([s.camera for s in result.sightings])
    for colour, name in zip(_cycled(len(result.sigma_px)), result.sigma_px, strict=True):
        residual = result.residual_px[result.used & (camera == name)].reshape(-1, 2)
        label = f"{name}: {np.sqrt(np.mean(residual**2)):.2f} px"
        axes.plot(residual[:, 0], residual[:, 1], ".", ms=3.0, color=colour, label=label)
    span = 1.15 * float(np.abs(result.residual_px[result.used]).max())
    out = np.clip(result.residual_px[~result.used].reshape(-1, 2), -span, span)
    if len(out):
        axes.plot(out[:, 0], out[:, 1], "x", ms=5.0, color=_BAD, label="left out (beyond the frame)")
    axes.set(xlim=(-span, span), ylim=(span, -span), title="Residuals of the corners")
    axes.set(xlabel="right [px]", ylabel="down [px]")
    axes.set_aspect("equal")
    axes.grid(color="#eeeeee")
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), fontsize=8, frameon=False)


def _cycled(n: int) -> list[str]:
    return [_COLOURS[i % len(_COLOURS)] for i in range(n)]
