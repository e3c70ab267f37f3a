"""One estimate as a picture: the rays that it rests on from above, close up, and what they are off."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.export.appearance import DRIVE_COLOUR, ESTIMATE_COLOUR, NVDB_COLOUR
from twin.export.picture.labels import place_labels
from twin.export.picture.map_frame import Window, draw_north, draw_scale_bar, frame_map
from twin.reports.estimate import EstimateExplained
from twin.store.figure_files import check_figure_name, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    BoolArray = NDArray[np.bool_]

SIZE_IN = (12.0, 7.0)
# Figure fractions (left, bottom, width, height).
_PLAN = (0.012, 0.020, 0.580, 0.880)
_CLOSE_UP = (0.628, 0.480, 0.362, 0.420)
_RESIDUALS = (0.672, 0.085, 0.318, 0.330)

_USED, _REJECTED, _EYE = "#6f8fb3", "#cc3311", "#33516e"
_MARKERS = ("o", "x", "^", "+", "v", "D", "<", "s")
_FURTHEST_CLOSE_M, _NEAREST_CLOSE_M = 4.0, 0.4
_BEYOND = 1.04
"""How far past the object a line of sight is drawn, as a part of the distance."""


def draw_estimate(explained: EstimateExplained, path: Path | str, *, dpi: int = 150) -> Path:
    """Draw what an estimate rests on.

    In plan, north up along the grid of EPSG:25833: where the car drove, the cameras' places and lines of
    sight (used ones thin, rejected ones red and dashed), the estimate with its 95 % ellipse, NVDB's signs
    near it. Beside it the last metres, and the residuals by distance. A line of sight is turned from the
    estimate by its residual, so that the lines cross as the camera saw them. Methods of one frame keep no
    camera places: instead of lines there is a dot where each sighting alone puts the object.

    Parameters
    ----------
    explained : EstimateExplained
    path : Path
        PNG, SVG or PDF, by its ending; replaced atomically. Its folder is made if it does not exist.
    dpi : int
        The picture is 12 by 7 inches.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ConfigError
        The name has another ending.
    RefusedError
        The file or its folder cannot be written.
    """
    from matplotlib.figure import Figure

    path = check_figure_name(path)
    figure = Figure(figsize=SIZE_IN, dpi=dpi, facecolor="white")
    _draw_plan(figure.add_axes(_PLAN), explained)
    _draw_close_up(figure.add_axes(_CLOSE_UP), explained)
    _draw_residuals(figure.add_axes(_RESIDUALS), explained)
    _draw_heading(figure.add_axes((0.0, 0.0, 1.0, 1.0), frameon=False), explained)
    return write_figure(figure, path)


def _draw_heading(axes: Axes, explained: EstimateExplained) -> None:
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    name = " ".join(text for text in (explained.object, explained.skiltnummer.replace(";", " + ")) if text)
    axes.text(0.012, 0.955, name, fontsize=13, weight="bold", va="center")
    size = f"95 % ellipse {explained.major95_m:.2f} × {explained.minor95_m:.2f} m (half axes)"
    left_out = f", {explained.n_rejected} left out" if explained.n_rejected else ""
    about = f"{explained.drive_name}, {explained.method}: {explained.n_sightings} sightings{left_out}, {size}"
    axes.text(0.012, 0.922, about, fontsize=9.5, color="#444444", va="center")


def _draw_plan(axes: Axes, explained: EstimateExplained) -> None:
    frames, here = explained.frames, _here(explained)
    reach = explained.major95_m
    shown = np.vstack(
        [
            here - reach,
            here + reach,
            *(places[np.isfinite(places).all(axis=1)] for places in _places(explained)),
        ]
    )
    window = _window(axes, shown.min(axis=0), shown.max(axis=0))
    frame_map(axes, window)
    axes.plot(*explained.line_m.T, color=DRIVE_COLOUR, lw=2.2, solid_capstyle="round", zorder=1)
    _draw_sightings(axes, explained, width=0.5)
    for camera, marker in _marker_of(explained).items():
        mine = (frames.camera == camera) & np.isfinite(frames.eye_m).all(axis=1)
        east, north = frames.eye_m[mine].T
        axes.plot(east, north, ls="", marker=marker, ms=4.5, mfc="none", mec=_EYE, mew=0.8, zorder=4)
    _draw_estimate(axes, explained)
    _draw_signs(axes, explained, window, here, explained.object)
    _draw_legend(axes, explained)
    draw_scale_bar(axes, window)
    draw_north(axes, window)


def _draw_close_up(axes: Axes, explained: EstimateExplained) -> None:
    here = _here(explained)
    apart = [np.hypot(site.east_m - here[0], site.north_m - here[1]) for site in explained.neighbours]
    near = [distance for distance in apart if distance < _FURTHEST_CLOSE_M - 0.5]
    half = max(1.6 * explained.major95_m, 1.25 * max(near, default=0.0), _NEAREST_CLOSE_M)
    window = _window(axes, here - half / 1.15, here + half / 1.15)
    frame_map(axes, window)
    axes.plot(*explained.line_m.T, color=DRIVE_COLOUR, lw=2.2, zorder=1)
    _draw_sightings(axes, explained, width=0.6)
    _draw_estimate(axes, explained)
    _draw_signs(axes, explained, window, here, "")
    draw_scale_bar(axes, window)
    axes.set_title("Close up", loc="left", fontsize=9.5)


def _draw_sightings(axes: Axes, explained: EstimateExplained, *, width: float) -> None:
    """Lines of sight where the cameras' places are known, else dots where each sighting alone points."""
    from matplotlib.collections import LineCollection

    frames = explained.frames
    for rows, colour, style, order in (
        (frames.used, _USED, "-", 2.0),
        (~frames.used, _REJECTED, (0, (4, 3)), 2.5),
    ):
        rays = _rays(explained, rows)
        if len(rays):
            alpha = 0.9 if order > 2 else float(np.clip(12.0 / np.sqrt(len(rays)) / 3.0, 0.25, 0.8))
            lines = LineCollection(
                list(rays), colors=colour, linewidths=width * (1.6 if order > 2 else 1.0), linestyles=style
            )
            lines.set(alpha=alpha, zorder=order)
            axes.add_collection(lines)
        elif not np.isfinite(frames.eye_m).any():
            axes.plot(*frames.alone_m[rows].T, ls="", marker=".", ms=4, color=colour, alpha=0.6, zorder=order)


def _rays(explained: EstimateExplained, rows: BoolArray) -> FloatArray:
    """Lines of sight (k, 2, 2), from the camera to a little beyond the object."""
    frames = explained.frames
    rows = rows & np.isfinite(frames.eye_m).all(axis=1) & np.isfinite(frames.turn_deg)
    eye, turn = frames.eye_m[rows], np.radians(frames.turn_deg[rows])
    way = _BEYOND * (_here(explained) - eye)
    # Clockwise, as seen from above.
    east = np.cos(turn) * way[:, 0] + np.sin(turn) * way[:, 1]
    north = np.cos(turn) * way[:, 1] - np.sin(turn) * way[:, 0]
    return np.stack([eye, eye + np.column_stack([east, north])], axis=1)


def _draw_estimate(axes: Axes, explained: EstimateExplained) -> None:
    from matplotlib.patches import Ellipse

    from geoloc.locate.combine import ellipse

    here = _here(explained)
    azimuth = float(ellipse(explained.covariance_m2)[2])
    # Matplotlib turns counter-clockwise from east, the azimuth clockwise from grid north.
    shape = Ellipse(
        (here[0], here[1]),
        2 * explained.major95_m,
        2 * explained.minor95_m,
        angle=90.0 - azimuth,
        fc=f"{ESTIMATE_COLOUR}33",
        ec=ESTIMATE_COLOUR,
        lw=1.3,
    )
    axes.add_patch(shape).set_zorder(6)
    axes.plot(*here, "+", ms=9, mew=1.6, color=ESTIMATE_COLOUR, zorder=7)


def _draw_signs(
    axes: Axes, explained: EstimateExplained, window: Window, here: FloatArray, name: str
) -> None:
    """NVDB's signs that lie in the window, with their codes, and the estimate's own name."""
    places = np.array([(s.east_m, s.north_m) for s in explained.neighbours]).reshape(-1, 2)
    inside = (np.abs(places[:, 0] - window.east_m) < window.half_width_m) & (
        np.abs(places[:, 1] - window.north_m) < window.half_height_m
    )
    east, north = places[inside].T
    axes.scatter(
        east,
        north,
        s=46,
        marker="s",
        facecolors="none",
        edgecolors=NVDB_COLOUR,
        linewidths=1.3,
        zorder=5,
    )
    texts = [f"NVDB {' + '.join(filter(None, site.codes)) or site.nvdb_id}" for site in explained.neighbours]
    labels = [(place, text) for place, text, seen in zip(places, texts, inside, strict=True) if seen]
    if name:
        labels.append((here, name))
    if labels:
        place_labels(axes, np.array([place for place, _ in labels]), [text for _, text in labels])


def _draw_residuals(axes: Axes, explained: EstimateExplained) -> None:
    frames = explained.frames
    if np.isfinite(frames.residual_px).any():
        axes.set(ylabel="seen − expected [px]")
        axes.set_title("Residuals by distance", loc="left", fontsize=9.5)
        _draw_points(axes, explained, frames.residual_px[:, 0], "across (u)", filled=True)
        _draw_points(axes, explained, frames.residual_px[:, 1], "down (v)", filled=False)
        _make_room_for_outliers(axes, frames.residual_px[frames.used], frames.residual_px[~frames.used])
    else:
        axes.set(ylabel="from the estimate [m]")
        axes.set_title("Single sightings by distance", loc="left", fontsize=9.5)
        off = np.hypot(*(frames.alone_m - _here(explained)).T)
        _draw_points(axes, explained, off, "one sighting alone", filled=True)
        axes.set_ylim(0.0, None)
    axes.axhline(0.0, color="#888888", lw=0.8, zorder=0)
    axes.set_xlabel("distance from the camera [m]")
    for text in (axes.xaxis.label, axes.yaxis.label):
        text.set_fontsize(8.5)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25)
    axes.legend(fontsize=7.5, ncols=2, loc="best", framealpha=0.85, edgecolor="#cccccc")


def _draw_points(
    axes: Axes, explained: EstimateExplained, values: FloatArray, label: str, *, filled: bool
) -> None:
    frames = explained.frames
    look: dict[str, Any] = {"ls": "", "marker": "o" if filled else "^", "ms": 4, "mew": 0.7, "alpha": 0.8}
    for rows, colour, name in ((frames.used, _USED, label), (~frames.used, _REJECTED, None)):
        face = colour if filled else "none"
        axes.plot(frames.range_m[rows], values[rows], mfc=face, mec=colour, label=name, **look)


def _make_room_for_outliers(axes: Axes, used_px: FloatArray, rejected_px: FloatArray) -> None:
    """Squeeze what lies far out, so that the residuals that count stay readable."""
    usual = 1.2 * float(np.nanmax(np.abs(used_px), initial=1.0))
    furthest = float(np.nanmax(np.abs(rejected_px), initial=0.0))
    if furthest <= 3.0 * usual:
        axes.margins(y=0.12)
        return
    axes.set_yscale("symlog", linthresh=usual, linscale=2.0)
    title = f"Residuals by distance (squeezed beyond ±{usual:.0f} px)"
    axes.set_title(title, loc="left", fontsize=9.5)
    axes.set_ylim(-1.6 * furthest, 1.6 * furthest)
    step = next((s for s in (1, 2, 5, 10, 20, 50) if s > 0.45 * usual), 100)
    ticks = [0.0, float(step), float(f"{furthest:.1g}")]
    axes.set_yticks([*(-t for t in ticks[:0:-1]), *ticks])
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()


def _draw_legend(axes: Axes, explained: EstimateExplained) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    frames = explained.frames
    lines = np.isfinite(frames.eye_m).any()
    n_used, n_rejected = int(frames.used.sum()), int((~frames.used).sum())

    def sight(colour: str, style: str, label: str) -> Line2D:
        if lines:
            return Line2D([], [], color=colour, ls=style, lw=1.2, label=f"line of sight, {label}")
        return Line2D([], [], color=colour, ls="", marker=".", label=f"one sighting alone, {label}")

    marks: list[Line2D | Patch] = [
        Patch(fc=f"{ESTIMATE_COLOUR}33", ec=ESTIMATE_COLOUR, label="estimate, 95 % ellipse")
    ]
    marks.append(sight(_USED, "-", f"used ({n_used})" if lines else f"located ({n_used})"))
    if n_rejected and (lines or np.isfinite(frames.alone_m[~frames.used]).any()):
        marks.append(sight(_REJECTED, "--", f"rejected ({n_rejected})"))
    if lines:
        marks += [
            Line2D([], [], ls="", marker=marker, ms=4.5, mfc="none", mec=_EYE, label=f"camera {camera}")
            for camera, marker in _marker_of(explained).items()
        ]
    if explained.neighbours:
        marks.append(
            Line2D([], [], ls="", marker="s", ms=6, mfc="none", color=NVDB_COLOUR, label="sign in NVDB")
        )
    marks.append(Line2D([], [], color=DRIVE_COLOUR, lw=2.2, label="drive"))
    axes.legend(handles=marks, loc="best", fontsize=8, framealpha=0.9, edgecolor="#cccccc").set_zorder(20)


def _marker_of(explained: EstimateExplained) -> dict[str, str]:
    names = [camera.camera for camera in explained.cameras]
    return {name: _MARKERS[k % len(_MARKERS)] for k, name in enumerate(names)}


def _here(explained: EstimateExplained) -> FloatArray:
    return np.array([explained.east_m, explained.north_m])


def _places(explained: EstimateExplained) -> list[FloatArray]:
    """What the plan must show: the cameras' places, else where the sightings point; and NVDB's signs."""
    frames = explained.frames
    seen = frames.eye_m if np.isfinite(frames.eye_m).any() else frames.alone_m[frames.used]
    signs = np.array([(site.east_m, site.north_m) for site in explained.neighbours]).reshape(-1, 2)
    return [seen, signs]


def _window(axes: Axes, low: FloatArray, high: FloatArray) -> Window:
    """Window around a box with a margin, shaped like the axes so that a metre is a metre both ways."""
    box = axes.get_window_extent()
    wide, high_half = 0.575 * (high - low)
    half_width = max(wide, high_half * box.width / box.height, 0.5)
    middle = (low + high) / 2
    return Window(float(middle[0]), float(middle[1]), half_width, half_width * box.height / box.width)
