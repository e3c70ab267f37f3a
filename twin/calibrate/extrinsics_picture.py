"""A calibration of extrinsics as a picture: cameras and tags from above and from the side, and residuals."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geoloc.calibration.extrinsics.calibrate import Extrinsics
from twin.calibrate.layout import Layout
from twin.export.atomic import replace_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

_SIZE_IN = (12.0, 6.0)
_COLOURS = ("#1f6f8b", "#c8553d", "#6a994e", "#7b4b94", "#b08900", "#3d405b", "#0a9396", "#9b2226")
_TAG, _FLOOR, _BAD, _CAR = "#333333", "#8a8a8a", "#cc3311", "#d9dee4"
_AXIS_M = 1.2


def draw_extrinsics(found: Extrinsics, layout: Layout, path: Path) -> None:
    """Draw where cameras and tags are, in the rig frame, and how far the corners are off.

    Left from above (x forward to the right, y left upwards), with each camera's line of sight; in the middle
    from the side; right the corners' residuals in pixels, those left out in red.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN, dpi=120, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    plan, side, residuals = figure.subplots(1, 3, width_ratios=[1.25, 1.0, 0.9])
    _draw_scene(plan, found, layout, (0, 1))
    plan.set(xlabel="x forward [m]", ylabel="y left [m]", title="From above")
    _draw_scene(side, found, layout, (0, 2))
    side.axhline(0.0, color=_FLOOR, lw=1.0)
    side.set(xlabel="x forward [m]", ylabel="z up [m]", title="From the side")
    _draw_residuals(residuals, found)
    plan.legend(loc="upper left", fontsize=8, frameon=False)
    image = io.BytesIO()
    figure.savefig(image, format="png", metadata={"Software": None})
    replace_file(path, image.getvalue())


def _draw_scene(axes: Axes, found: Extrinsics, layout: Layout, shown: tuple[int, int]) -> None:
    first, second = shown
    for number, pose in found.state.tags.items():
        outline = layout.tags[number].corners_m() @ pose.R.T + pose.t_m
        closed = np.vstack([outline, outline[:1]])
        colour = _FLOOR if layout.tags[number].on_floor else _TAG
        axes.plot(closed[:, first], closed[:, second], color=colour, lw=1.3)
        place = (float(pose.t_m[first]), float(pose.t_m[second]))
        axes.annotate(str(number), place, fontsize=7, color=colour, ha="left")
    for colour, (name, camera) in zip(_cycled(len(found.cameras)), found.cameras.items(), strict=True):
        eye = camera.rig_T_camera.t_m
        ahead = eye + _AXIS_M * camera.rig_T_camera.R[:, 2]
        line = np.stack([eye, ahead])
        axes.plot(line[:, first], line[:, second], color=colour, lw=2.0, label=name)
        axes.plot(eye[first], eye[second], "o", color=colour, ms=5)
    for name, pose in found.state.views.items():
        if name not in found.cameras:
            axes.plot(pose.t_m[first], pose.t_m[second], "+", color=_FLOOR, ms=6)
    axes.plot(0.0, 0.0, marker="s", color=_CAR, mec=_TAG, ms=6)
    axes.annotate("rear axle", (0.0, 0.0), fontsize=7, color=_TAG, xytext=(4, -9), textcoords="offset points")
    axes.set_aspect("equal")
    axes.grid(color="#eeeeee")
    axes.set_axisbelow(True)


def _draw_residuals(axes: Axes, found: Extrinsics) -> None:
    camera = np.array([s.camera for s in found.sightings])
    for colour, name in zip(_cycled(len(found.sigma_px)), found.sigma_px, strict=True):
        residual = found.residual_px[found.used & (camera == name)].reshape(-1, 2)
        label = f"{name}: {np.sqrt(np.mean(residual**2)):.2f} px"
        axes.plot(residual[:, 0], residual[:, 1], ".", ms=3.0, color=colour, label=label)
    span = 1.15 * float(np.abs(found.residual_px[found.used]).max())
    out = np.clip(found.residual_px[~found.used].reshape(-1, 2), -span, span)
    if len(out):
        axes.plot(out[:, 0], out[:, 1], "x", ms=5.0, color=_BAD, label="left out (beyond the frame)")
    axes.set(xlim=(-span, span), ylim=(span, -span), title="Residuals of the corners")
    axes.set(xlabel="right [px]", ylabel="down [px]")
    axes.set_aspect("equal")
    axes.grid(color="#eeeeee")
    axes.legend(loc="lower left", fontsize=8)


def _cycled(n: int) -> list[str]:
    return [_COLOURS[i % len(_COLOURS)] for i in range(n)]
