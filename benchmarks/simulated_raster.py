"""The simulated road as a surveyor's raster: what a terrain model of it would hold."""

from __future__ import annotations

from functools import cache

import numpy as np
import pyproj

from geoloc.arrays import FloatArray
from geoloc.simulation.noise import stream
from geoloc.simulation.road import MARGIN_M, Road

_STATION_STEP_M = 0.25


@cache
def _utm33() -> pyproj.Transformer:
    return pyproj.Transformer.from_crs("EPSG:4258", "EPSG:25833", always_xy=True)


def rasterised(
    road: Road, step_m: float = 0.5, reach_m: float = 25.0, noise_m: float = 0.0, seed: int = 0
) -> tuple[float, float, FloatArray]:
    """Heights of the road's surface on a grid in EPSG:25833. Kerbs are left out, as a terrain model does.

    Parameters
    ----------
    road : Road
    step_m : float
        Distance of neighbouring nodes.
    reach_m : float
        How far from the centre line heights are known.
    noise_m : float
        One sigma of what each node has for itself.
    seed : int
        Of that noise.

    Returns
    -------
    east_m, north_m : float
        The south-western node.
    grid_m : float64 (rows, columns)
        Ellipsoidal; rows go north. NaN further than `reach_m` from the centre line.
    """
    from scipy.spatial import cKDTree

    station = np.arange(-MARGIN_M, road.spec.length_m + MARGIN_M, _STATION_STEP_M)
    line = road.plan_m(station, np.zeros_like(station))
    lat, lon, _ = road.frame.geographic_from_enu(np.column_stack([line, np.zeros(len(line))]))
    east, north = _utm33().transform(lon, lat)
    west, south = (np.floor((np.min(axis) - reach_m) / step_m) * step_m for axis in (east, north))
    columns, rows = (
        int((np.max(axis) + reach_m - start) / step_m) + 2 for axis, start in ((east, west), (north, south))
    )
    grid_east, grid_north = np.meshgrid(west + np.arange(columns) * step_m, south + np.arange(rows) * step_m)
    nodes = np.column_stack([grid_east.ravel(), grid_north.ravel()])
    tree = cKDTree(np.column_stack([east, north]))
    distance, nearest = tree.query(nodes, distance_upper_bound=reach_m)
    known = np.flatnonzero(np.isfinite(distance))
    start = np.asarray(nearest)[known]
    lon, lat = _utm33().transform(nodes[known, 0], nodes[known, 1], direction="INVERSE")
    place = road.frame.enu_from_geographic(lat, lon, np.full_like(lat, road.spec.height_m))[:, :2]
    yaw, to = road.yaw_rad(station[start]), place - line[start]
    along = station[start] + to[:, 0] * np.cos(yaw) + to[:, 1] * np.sin(yaw)
    across = to[:, 1] * np.cos(yaw) - to[:, 0] * np.sin(yaw)
    up = _surface_m(road, along, across)
    height = np.full(rows * columns, np.nan)
    _, _, height[known] = road.frame.geographic_from_enu(np.column_stack([place, up]))
    noise = stream(seed, "terrain raster").normal(size=height.size) * noise_m
    return float(west), float(south), (height + noise).reshape(rows, columns)


def _surface_m(road: Road, station_m: FloatArray, offset_m: FloatArray) -> FloatArray:
    """`Road.surface_m` for many points: that of the centre line, and the fall from there."""
    profile = np.arange(np.min(station_m) - 1.0, np.max(station_m) + 1.0, 0.05)
    crown = np.concatenate(
        [road.surface_m(part, np.zeros_like(part)) for part in np.array_split(profile, 20)]
    )
    return np.asarray(np.interp(station_m, profile, crown) + road.fall_m(station_m, offset_m))
