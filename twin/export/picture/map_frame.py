"""What every map picture has: a window of the map, a scale bar, an arrow to the north."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg

if TYPE_CHECKING:
    import geopandas as gpd
    from matplotlib.axes import Axes
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of the map, EPSG:25833 metres."""

    east_m: float
    north_m: float
    half_width_m: float
    half_height_m: float


def frame_map(axes: Axes, window: Window) -> None:
    """Set the axes to a window of the map, without ticks."""
    axes.set_xlim(window.east_m - window.half_width_m, window.east_m + window.half_width_m)
    axes.set_ylim(window.north_m - window.half_height_m, window.north_m + window.half_height_m)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_facecolor("#fbfbf9")
    for spine in axes.spines.values():
        spine.set_color("#bbbbbb")


def draw_scale_bar(axes: Axes, window: Window) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten metres, about a fifth of the width."""
    wanted = 0.45 * window.half_width_m
    power = 10.0 ** np.floor(np.log10(wanted))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted)
    east = window.east_m - 0.92 * window.half_width_m
    north = window.north_m - 0.92 * window.half_height_m
    axes.plot(
        [east, east + length], [north, north], color="#222222", lw=2.5, solid_capstyle="butt", zorder=16
    )
    text = f"{length:g} m" if length < 1000 else f"{length / 1000:g} km"
    axes.annotate(
        text,
        (east + length / 2, north),
        (0, 3),
        textcoords="offset points",
        ha="center",
        fontsize=8,
        zorder=15,
        # What runs below the bar must not run through its number.
        bbox={"boxstyle": "square,pad=0.15", "fc": "#fbfbf9", "ec": "none", "alpha": 0.85},
    )


def draw_north(axes: Axes, window: Window) -> None:
    """Point to true north, which the grid of zone 33 misses by up to 12° in Norway."""
    convergence = grid_convergence_deg(*geographic_from_utm33(window.east_m, window.north_m))
    grid_azimuth = np.radians(-float(convergence))
    tail = np.array([0.955, 0.045])
    box = axes.get_window_extent()
    tip = tail + 0.075 * np.array([np.sin(grid_azimuth) * box.height / box.width, np.cos(grid_azimuth)])
    arrow = {"arrowstyle": "-|>", "color": "#222222", "lw": 1.8}
    axes.annotate(
        "",
        tuple(tip),
        tuple(tail),
        xycoords="axes fraction",
        textcoords="axes fraction",
        arrowprops=arrow,
        zorder=15,
    )
    axes.annotate(
        "N", tuple(tip), (0, 2), xycoords="axes fraction", textcoords="offset points", ha="center", fontsize=9
    )


def east_north(frame: gpd.GeoDataFrame) -> NDArray[np.float64]:
    """East and north (n, 2) of the points that are known."""
    import shapely

    return np.asarray(shapely.get_coordinates(frame.geometry.to_numpy()), dtype=np.float64)
