"""A picture of the layers where there is no QGIS: the same colours and shapes, and close-ups of changes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from twin.export.appearance import DRIVE_COLOUR, ESTIMATE_COLOUR, MARK, MARKS, NVDB_COLOUR
from twin.export.layers import ExportLayers, normalised
from twin.export.picture.ellipses import ELLIPSE_FILL, draw_ellipses, enlarge_ellipse
from twin.export.picture.labels import place_labels
from twin.export.picture.map_frame import Window, draw_north, draw_scale_bar, east_north, frame_map
from twin.export.picture.road_names import draw_road_names
from twin.figures import FORMATS
from twin.store.atomic_files import replace_file
from twin.store.figure_files import check_figure_name
from twin.store.kinds import QUIET, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping

    import geopandas as gpd
    import pandas as pd
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

SIZE_IN = (12.0, 7.0)
# Figure fractions (left, bottom, width, height): the map, then the close-ups.
_BESIDE = (
    (0.012, 0.020, 0.636, 0.925),
    (0.664, 0.520, 0.160, 0.425),
    (0.832, 0.520, 0.160, 0.425),
    (0.664, 0.020, 0.160, 0.425),
    (0.832, 0.020, 0.160, 0.425),
)
_BELOW = (
    (0.012, 0.435, 0.976, 0.515),
    (0.012, 0.020, 0.235, 0.350),
    (0.259, 0.020, 0.235, 0.350),
    (0.506, 0.020, 0.235, 0.350),
    (0.753, 0.020, 0.235, 0.350),
)
_SOMEWHERE = (270_000.0, 7_041_000.0, 270_100.0, 7_041_060.0)
"""What an empty map shows, EPSG:25833: Trondheim."""


def render_map(layers: ExportLayers, path: Path | str, *, title: str = "", dpi: int = 150) -> Path:
    """Draw a map of all changes with the names of the roads, and close-ups of up to four changes.

    Filled marks are changes in the colours of the QGIS style, hollow ones are NVDB's signs, ellipses hold
    the estimate with 95 % probability. North is up along the grid of EPSG:25833; the arrow shows true north.

    Parameters
    ----------
    layers : ExportLayers
    path : Path
        PNG, SVG or PDF, by its ending; replaced atomically. Its folder must exist.
    title : str
        Default: which drives, and the day of NVDB's data.
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
    ExportRefusedError
        The layers are not as they must be, or the file cannot be written.
    """
    from matplotlib.figure import Figure

    path = check_figure_name(path)
    checked = normalised(layers)
    figure = Figure(figsize=SIZE_IN, dpi=dpi, facecolor="white")
    west, south, east, north = _extent(checked)
    overview, *panels = _BELOW if east - west > 1.6 * (north - south) else _BESIDE
    chosen = _worth_a_look(checked.changes).head(len(panels))
    letters = dict(zip(chosen["change_id"], "ABCD", strict=False))
    _draw_overview(figure.add_axes(overview), checked, letters, title or _title(checked))
    for place, (_, change) in zip(panels, chosen.iterrows(), strict=False):
        _draw_close_up(figure.add_axes(place), checked, change, letters[change["change_id"]])
    replace_file(path, FORMATS[path.suffix.lower()](figure))
    return path


def _draw_overview(axes: Axes, layers: ExportLayers, letters: Mapping[str, str], title: str) -> None:
    window = _around(_extent(layers), axes)
    frame_map(axes, window)
    _draw_layers(axes, layers, mark_scale=1.0, sign_scale=1.0)
    draw_road_names(axes, window, layers)
    _draw_legend(axes, layers)
    draw_scale_bar(axes, window)
    draw_north(axes, window)
    axes.set_title(title, loc="left", fontsize=11)
    changes = layers.changes
    loud = changes[~changes["verdict"].isin(QUIET) & changes.geometry.notna()]
    texts = [
        f"{letters.get(change['change_id'], '')} {_code(change)}".strip() for _, change in loud.iterrows()
    ]
    place_labels(axes, east_north(loud), texts)


def _title(layers: ExportLayers) -> str:
    """``What trip_1 and trip_2 say of NVDB's signs of 2026-06-10``, as far as it is known."""
    drives = sorted(layers.drives["name"])
    who = " and ".join(drives) if 0 < len(drives) <= 2 else f"{len(drives)} drives"
    day = layers.nvdb_signs["synced_at"].max() if len(layers.nvdb_signs) else ""
    return (
        f"What {who} say{'s' if len(drives) == 1 else ''} of NVDB's signs{f' of {day[:10]}' if day else ''}"
    )


def _draw_close_up(axes: Axes, layers: ExportLayers, change: pd.Series[Any], letter: str) -> None:
    """Draw what lies around one change, with the way from NVDB's position to the sign."""
    mark = MARK[str(change["verdict"])]
    here = np.array([change.geometry.x, change.geometry.y])
    there = _nvdb_position(layers.nvdb_signs, change)
    apart = np.linalg.norm(there - here) if there is not None else 0.0
    middle = (here + there) / 2 if there is not None else here
    half = max(3.0, 0.8 * float(apart) + 1.0)
    box = axes.get_window_extent()
    window = Window(float(middle[0]), float(middle[1]), half, half * box.height / box.width)
    frame_map(axes, window)
    # NVDB's rings wide enough to show around a mark at the same place.
    _draw_layers(axes, layers, mark_scale=1.3, sign_scale=2.4)
    if there is not None and apart > 0.5:
        arrow = {"arrowstyle": "-|>", "color": mark.colour, "lw": 1.5, "shrinkA": 8, "shrinkB": 9}
        axes.annotate("", xy=tuple(here), xytext=tuple(there), arrowprops=arrow, zorder=6)
    draw_scale_bar(axes, window)
    enlarge_ellipse(
        axes, window, layers.estimates, change, np.array([here, here if there is None else there])
    )
    heading = mark.label
    if np.isfinite(change["distance_m"]) and change["verdict"] == Verdict.MOVED:
        heading += f" {change['distance_m']:.1f} m"
    axes.set_title(f"{letter}  {heading}\n{_code(change)}", loc="left", fontsize=8.5, color="#222222")


def _draw_layers(axes: Axes, layers: ExportLayers, *, mark_scale: float, sign_scale: float) -> None:
    for line in layers.drives.geometry[layers.drives.geometry.notna()]:
        east, north = line.xy
        axes.plot(east, north, color=DRIVE_COLOUR, lw=1.6, solid_capstyle="round", zorder=1)
    draw_ellipses(axes, layers.estimates)
    signs = layers.nvdb_signs
    for kind, marker, size in ((95, "s", 26), (96, "o", 44)):
        east, north = east_north(signs[(signs["nvdb_type"] == kind) & signs["own_geometry"]]).T
        axes.scatter(
            east,
            north,
            s=size * sign_scale**2,
            marker=marker,
            facecolors="none",
            edgecolors=NVDB_COLOUR,
            linewidths=1.1,
            zorder=3,
        )
    for order, mark in enumerate(MARKS):
        east, north = east_north(layers.changes[layers.changes["verdict"] == mark.verdict]).T
        axes.scatter(
            east,
            north,
            s=(2.2 * mark.size_mm * mark_scale) ** 2,
            marker=mark.mpl_marker,
            color=mark.colour,
            edgecolors="white",
            linewidths=0.5,
            zorder=4 + 0.1 * order,
        )


def _draw_legend(axes: Axes, layers: ExportLayers) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    count = layers.changes["verdict"].value_counts()
    marks: list[Line2D | Patch] = [
        Line2D(
            [],
            [],
            ls="",
            marker=mark.mpl_marker,
            color=mark.colour,
            ms=1.9 * mark.size_mm,
            mec="white",
            mew=0.5,
            label=f"{mark.label} ({count[mark.verdict]})",
        )
        for mark in reversed(MARKS)
        if mark.verdict in count
    ]
    marks += [
        Line2D([], [], ls="", marker="o", ms=6, mfc="none", color=NVDB_COLOUR, label="Skiltplate in NVDB"),
        Line2D([], [], ls="", marker="s", ms=5, mfc="none", color=NVDB_COLOUR, label="Skiltpunkt in NVDB"),
        Patch(fc=ELLIPSE_FILL, ec=ESTIMATE_COLOUR, lw=0.9, label="95 % error ellipse"),
        Line2D([], [], color=DRIVE_COLOUR, lw=1.6, label="Drive"),
    ]
    box = axes.get_window_extent()
    place: Literal["upper right", "best"] = "upper right" if box.width > 2 * box.height else "best"
    legend = axes.legend(handles=marks, loc=place, fontsize=8, framealpha=0.9, edgecolor="#cccccc")
    legend.set_zorder(20)


def _extent(layers: ExportLayers) -> tuple[float, float, float, float]:
    """West, south, east and north of changes, estimates and drives; else of NVDB; else some place."""
    boxes = np.array([frame.total_bounds for frame in (layers.changes, layers.estimates, layers.drives)])
    if not np.isfinite(boxes).any():
        boxes = np.array([layers.nvdb_signs.total_bounds])
    if not np.isfinite(boxes).any():
        return _SOMEWHERE
    west, south = np.nanmin(boxes[:, :2], axis=0)
    east, north = np.nanmax(boxes[:, 2:], axis=0)
    return float(west), float(south), float(east), float(north)


def _around(extent: tuple[float, float, float, float], axes: Axes) -> Window:
    """Window around an extent, shaped like the axes so that a metre is a metre both ways.

    With a margin, and in wide axes with a free strip in the east for the legend.
    """
    west, south, east, north = extent
    box = axes.get_window_extent()
    strip = 0.14 if box.width > 2 * box.height else 0.0
    wide, high = 0.55 * (east - west) / (1 - strip), 0.55 * (north - south)
    half_width = max(wide, high * box.width / box.height, 10.0)
    middle = (west + east) / 2 + strip * half_width
    return Window(middle, (south + north) / 2, half_width, half_width * box.height / box.width)


def _worth_a_look(changes: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """Give what needs a decision: the surest change of each kind, then the next surest of each kind."""
    loud = changes[~changes["verdict"].isin(QUIET) & changes.geometry.notna()]
    rank = loud["verdict"].map({mark.verdict: -number for number, mark in enumerate(MARKS)})
    loud = loud.assign(rank=rank).sort_values(["confidence", "change_id"], ascending=[False, True])
    turn = loud.groupby("verdict").cumcount()
    return loud.assign(turn=turn).sort_values(["turn", "rank"], kind="stable")


def _nvdb_position(signs: gpd.GeoDataFrame, change: pd.Series[Any]) -> NDArray[np.float64] | None:
    sign = signs[(signs["nvdb_id"] == change["nvdb_id"]).fillna(value=False) & signs.geometry.notna()]
    return None if sign.empty else east_north(sign)[0]


def _code(change: pd.Series[Any]) -> str:
    known, seen = str(change["skiltnummer_nvdb"]), str(change["skiltnummer_seen"])
    code = f"{known} → {seen}" if change["verdict"] == Verdict.WRONG_TYPE else seen or known
    return code.replace(";", " + ")
