"""Error ellipses in a picture: to scale on the map, and enlarged beside a mark that hides one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from geoloc.locate.combine import SIGMAS_95
from twin.export.appearance import ESTIMATE_COLOUR, MARK
from twin.export.picture.map_frame import Window, east_north, frame_map

if TYPE_CHECKING:
    import geopandas as gpd
    import pandas as pd
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

ELLIPSE_FILL = f"{ESTIMATE_COLOUR}22"
_NEAR_M = 2.0
"""A change belongs to an estimate within this distance, if to any."""
_SIDE = 0.46
"""Side of the enlarged square, as a share of the narrower side of the close-up."""
_GAP = 0.035


def draw_ellipses(axes: Axes, estimates: gpd.GeoDataFrame) -> None:
    """Draw the ellipses that hold the signs with 95 % probability, to scale."""
    from matplotlib.patches import Ellipse

    known = estimates[estimates.geometry.notna()]
    if known.empty:
        return
    east, north = east_north(known).T
    convergence = grid_convergence_deg(*geographic_from_utm33(east, north))
    # Matplotlib turns counter-clockwise from east; the azimuth runs clockwise from true north.
    turn = 90.0 - (known["sigma_azimuth_deg"].to_numpy() - convergence)
    major = 2 * SIGMAS_95 * known["sigma_major_m"].to_numpy()
    minor = 2 * SIGMAS_95 * known["sigma_minor_m"].to_numpy()
    for x, y, width, height, angle in zip(east, north, major, minor, turn, strict=True):
        if np.isfinite([width, height, angle]).all():
            ellipse = Ellipse((x, y), width, height, angle=angle, fc=ELLIPSE_FILL, ec=ESTIMATE_COLOUR, lw=0.9)
            axes.add_patch(ellipse).set_zorder(2)


def enlarge_ellipse(
    axes: Axes,
    window: Window,
    estimates: gpd.GeoDataFrame,
    change: pd.Series[Any],
    marked: NDArray[np.float64],
) -> None:
    """Draw a change's ellipse once more in a corner of its close-up, where the mark does not hide it.

    Nothing is drawn where the sign was not seen, or where its ellipse is wider than the mark.

    Parameters
    ----------
    axes : Axes
        The close-up, with `window` as its limits.
    window : Window
    estimates : GeoDataFrame of Point
    change : Series
        A row of ``changes`` with a geometry.
    marked : float64 (n, 2)
        What the corner must keep clear of, EPSG:25833.
    """
    own = _estimate_of(change, estimates)
    if own is None or SIGMAS_95 * own["sigma_major_m"].iloc[0] > 0.2 * window.half_width_m:
        return
    (place,) = east_north(own)
    left, bottom, side_x, side_y = _free_corner(axes, window, marked)
    box = axes.get_position()
    figure = axes.get_figure(root=True)
    if figure is None:  # pragma: no cover - every axes of ours is on a figure
        return
    inset = figure.add_axes(
        (box.x0 + left * box.width, box.y0 + bottom * box.height, side_x * box.width, side_y * box.height)
    )
    major, minor = SIGMAS_95 * own[["sigma_major_m", "sigma_minor_m"]].iloc[0].to_numpy(np.float64)
    frame_map(inset, Window(float(place[0]), float(place[1]), 1.7 * major, 1.7 * major))
    inset.set_facecolor("white")
    draw_ellipses(inset, own)
    east, north = change.geometry.x, change.geometry.y
    colour = MARK[str(change["verdict"])].colour
    inset.plot([east], [north], marker="+", ms=7, mew=1.6, color=colour, zorder=4)
    words: dict[str, Any] = {"ha": "center", "fontsize": 7, "color": "#222222", "transform": inset.transAxes}
    inset.text(0.5, 0.95, "95 % ellipse", va="top", **words)
    inset.text(0.5, 0.05, f"± {major:.2f} × {minor:.2f} m", va="bottom", **words)
    _connect(axes, (east, north), (left + side_x / 2, bottom + side_y / 2))


def _estimate_of(change: pd.Series[Any], estimates: gpd.GeoDataFrame) -> gpd.GeoDataFrame | None:
    """Find the nearest estimate with an ellipse, as a layer of one row."""
    known = estimates[estimates.geometry.notna() & estimates["sigma_major_m"].notna()]
    if known.empty or not change["n_sightings"]:
        return None
    apart = np.linalg.norm(east_north(known) - [change.geometry.x, change.geometry.y], axis=1)
    nearest = int(np.argmin(apart))
    return known.iloc[[nearest]] if apart[nearest] <= _NEAR_M else None


def _free_corner(
    axes: Axes, window: Window, marked: NDArray[np.float64]
) -> tuple[float, float, float, float]:
    """Left, bottom, width and height, as shares of the axes, of a corner without marks.

    The lower right one, unless another lies farther from them: in none of them is the scale bar.
    """
    box = axes.get_window_extent()
    side_px = _SIDE * min(box.width, box.height)
    wide, high = side_px / box.width, side_px / box.height
    shares = (marked - [window.east_m, window.north_m]) / [window.half_width_m, window.half_height_m]
    corners = [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    # Rounded, so that a hair's breadth does not send it elsewhere.
    right, up = max(corners, key=lambda c: round(float(np.linalg.norm(shares - c, axis=1).min()), 0))
    left = 1 - wide - _GAP if right > 0 else _GAP
    bottom = 1 - high - _GAP if up > 0 else _GAP
    return left, bottom, wide, high


def _connect(axes: Axes, point: tuple[float, float], share: tuple[float, float]) -> None:
    """Draw a thin line from the mark towards the enlarged square, which covers its end."""
    axes.annotate(
        "",
        point,
        share,
        textcoords="axes fraction",
        arrowprops={"arrowstyle": "-", "color": "#777777", "lw": 0.8},
        zorder=1.5,
    )
