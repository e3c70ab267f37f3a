"""The ground of the sample's pictures: sky, hills, the road with its lines, and the verges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.simulation.pictures.scene import Patch, Rgb
from geoloc.simulation.road import MARGIN_M, Road

_AHEAD_M = np.concatenate([[-2.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.5, 8.0], np.geomspace(10.0, 130.0, 15)])
_ASPHALT, _SHOULDER, _PATH = (92, 94, 98), (110, 109, 106), (142, 139, 133)
_GRASS, _MEADOW = (96, 122, 62), (112, 138, 74)
_WHITE, _YELLOW, _FOREST, _HILL = (232, 232, 228), (226, 178, 42), (58, 84, 62), (120, 146, 164)
_BANDS: tuple[tuple[float, float, Rgb], ...] = (
    (60.0, 8.8, _MEADOW),
    (8.8, 6.6, _PATH),
    (6.6, 3.7, _GRASS),
    (3.7, 3.25, _SHOULDER),
    (3.25, 0.0, _ASPHALT),
    (0.0, -3.25, _ASPHALT),
    (-3.25, -3.7, _SHOULDER),
    (-3.7, -6.2, _GRASS),
    (-6.2, -8.6, _PATH),
    (-8.6, -60.0, _MEADOW),
    (3.18, 3.06, _WHITE),
    (-3.06, -3.18, _WHITE),
)
"""Left and right edge by their offset, and the colour."""
CROSSINGS_M = (81.0, 307.0)
"""Where zebra stripes cross the road, 3 m wide."""
_FAR_M = 4000.0


def sky(height_px: int, width_px: int) -> NDArray[np.uint8]:
    """Return a sky that is lighter towards the horizon, in the middle of the picture."""
    share = np.clip(np.linspace(0.0, 2.0, height_px), 0.0, 1.0)[:, np.newaxis, np.newaxis]
    rows = np.array([116.0, 160.0, 208.0]) * (1.0 - share) + np.array([218.0, 230.0, 240.0]) * share
    return np.broadcast_to(np.round(rows), (height_px, width_px, 3)).astype(np.uint8)


def ground(road: Road, eye_m: FloatArray, heading_rad: float, station_m: float) -> list[Patch]:
    """Return hills, ground and road as seen from a place on it, the farthest first.

    Parameters
    ----------
    road : Road
    eye_m : float64 (3,)
        Where the camera is, in the road's frame.
    heading_rad : float
        Where it looks, counter-clockwise from east.
    station_m : float
        Where on the road it is.
    """
    patches = [*_distance(eye_m, heading_rad)]
    last = road.spec.length_m + MARGIN_M - 1.0
    stations = np.clip(station_m + _AHEAD_M, -MARGIN_M + 1.0, last)
    stations = np.unique(stations)
    edges = np.unique([offset for left, right, _ in _BANDS for offset in (left, right)])
    grid = _grid(road, stations, edges)
    column = {float(offset): k for k, offset in enumerate(edges)}
    for left, right, colour in _BANDS:
        a, b = column[left], column[right]
        for i in range(stations.size - 2, -1, -1):
            ring = np.array([grid[i, a], grid[i + 1, a], grid[i + 1, b], grid[i, b]])
            patches.append(Patch((ring,), colour))
    return patches + list(_markings(road, station_m))


def _grid(road: Road, stations: FloatArray, offsets: FloatArray) -> FloatArray:
    """Points of the surface ``(stations, offsets, 3)``."""
    station, offset = (m.ravel() for m in np.meshgrid(stations, offsets, indexing="ij"))
    points = np.concatenate([road.plan_m(station, offset), road.surface_m(station, offset)[:, None]], axis=-1)
    return np.asarray(points.reshape(stations.size, offsets.size, 3))


def _distance(eye_m: FloatArray, heading_rad: float) -> Iterator[Patch]:
    """Hills and forest on the horizon by azimuth, and the ground up to it."""
    azimuth = heading_rad + np.radians(np.linspace(70.0, -70.0, 57))
    hill = 0.045 + 0.02 * np.sin(3.0 * azimuth) + 0.010 * np.sin(11.0 * azimuth + 1.0)
    forest = 0.020 + 0.006 * np.sin(7.0 * azimuth) + 0.004 * np.sin(61.0 * azimuth)
    for rise, fall, colour in ((hill, 0.0, _HILL), (forest, 0.0, _FOREST), (np.zeros(57), 0.9, _MEADOW)):
        upper = np.stack([np.cos(azimuth), np.sin(azimuth), rise], axis=-1)
        lower = np.stack([np.cos(azimuth), np.sin(azimuth), np.full(57, -fall - 0.002)], axis=-1)[::-1]
        yield Patch((eye_m + _FAR_M * np.concatenate([upper, lower]),), colour)


def _markings(road: Road, station_m: float) -> Iterator[Patch]:
    """The yellow line between the lanes, dashed, and zebra stripes."""
    first = int(np.ceil(max(station_m - 4.0, -MARGIN_M + 4.0) / 9.0))
    last = int(np.floor(min(station_m + 90.0, road.spec.length_m + MARGIN_M - 8.0) / 9.0))
    rectangles = [(9.0 * k, 9.0 * k + 3.0, 0.07, -0.07, _YELLOW) for k in range(last, first - 1, -1)]
    for crossing in CROSSINGS_M:
        if -4.0 < crossing - station_m < 90.0:
            stripes = np.arange(-3.0, 2.6, 1.0)
            rectangles += [(crossing - 1.5, crossing + 1.5, o + 0.5, o, _WHITE) for o in stripes.tolist()]
    for start, end, left, right, colour in rectangles:
        corners = _grid(road, np.array([start, end]), np.array([left, right]))
        yield Patch((corners.reshape(4, 3)[[0, 2, 3, 1]],), colour)
