"""The ground as a raster of heights: height and slope anywhere on it, and where rays meet it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geoloc.arrays import BoolArray, FloatArray, TextArray
from geoloc.earth.ground import MAX_RANGE_M
from geoloc.errors import GeolocError
from geoloc.reasons import Reason

_BLOCK = 512
"""Rays marched at a time: their samples stay within ten megabytes or so."""
_BISECTIONS = 30
_STEPS_A_CELL = 2.0


class TerrainHits(NamedTuple):
    """Where rays meet the terrain."""

    point_m: FloatArray
    """float64 (..., 3): east, north, ellipsoidal height; NaN where there is no hit."""
    valid: BoolArray
    """bool (...)."""
    reason: TextArray
    """str (...): why there is no hit, a `Reason`; "" where there is one."""


@dataclass(frozen=True, slots=True)
class Terrain:
    """Heights of the ground on a regular grid, bilinear between its nodes.

    Attributes
    ----------
    east_m, north_m : float
        The south-western node, EPSG:25833.
    step_m : float
        Distance of neighbouring nodes, both ways.
    grid_m : float64 (rows, columns)
        Heights above the GRS80 ellipsoid; rows go north, columns east. NaN: not known.
    sigma_m : float
        One sigma of an error that the whole raster shares (its datum, its geoid).
    noise_m : float
        One sigma of what each node has for itself.

    Raises
    ------
    GeolocError
        If the grid has fewer than two rows or columns, or the step is not positive.
    """

    east_m: float
    north_m: float
    step_m: float
    grid_m: FloatArray
    sigma_m: float = 0.1
    noise_m: float = 0.02

    def __post_init__(self) -> None:
        if self.grid_m.ndim != 2 or min(self.grid_m.shape) < 2 or not self.step_m > 0:
            raise GeolocError(
                f"A terrain of {' x '.join(map(str, self.grid_m.shape))} nodes, {self.step_m:g} m apart, is"
                " no surface: it needs two rows, two columns and a positive step."
            )

    def height_m(self, east_m: ArrayLike, north_m: ArrayLike) -> FloatArray:
        """Ellipsoidal height at places in EPSG:25833; NaN outside, and beside nodes that are not known.

        Returns
        -------
        float64 (...)
        """
        west, east, south, north, x, y = self._cell(east_m, north_m)
        lower = self.grid_m[south, west] * (1.0 - x) + self.grid_m[south, east] * x
        upper = self.grid_m[north, west] * (1.0 - x) + self.grid_m[north, east] * x
        return np.asarray(lower * (1.0 - y) + upper * y)

    def slope(self, east_m: ArrayLike, north_m: ArrayLike, reach_m: float = 2.0) -> FloatArray:
        """Rise to the east and to the north, metres per metre on the grid.

        Between the heights `reach_m` away on both sides, at least one node: over less, the noise of the nodes
        would outweigh the slope. NaN where one of these heights is not known.

        Returns
        -------
        float64 (..., 2)
        """
        east, north = np.broadcast_arrays(np.asarray(east_m, float), np.asarray(north_m, float))
        reach = max(reach_m, self.step_m)
        rise_east = self.height_m(east + reach, north) - self.height_m(east - reach, north)
        rise_north = self.height_m(east, north + reach) - self.height_m(east, north - reach)
        return np.stack([rise_east, rise_north], axis=-1) / (2.0 * reach)

    def intersect(
        self, origin_m: FloatArray, direction: FloatArray, max_range_m: float = MAX_RANGE_M
    ) -> TerrainHits:
        """First point of each ray that lies on the terrain.

        The ray is followed in steps of half a node's distance until it is under the ground, and the crossing
        is then halved in: a crest that it cuts for less than half a step may be missed.

        Parameters
        ----------
        origin_m : float64 (..., 3)
            Where the rays start: east, north (EPSG:25833), ellipsoidal height.
        direction : float64 (..., 3)
            Any length, same axes. Broadcasts against `origin_m`.
        max_range_m : float
            Hits horizontally further from the start are refused.

        Returns
        -------
        TerrainHits
            Without a hit: a ray that is NaN, starts under the ground, leaves the known terrain, or meets
            nothing within `max_range_m`.
        """
        origin, ray = np.broadcast_arrays(origin_m, direction)
        shape = origin.shape[:-1]
        flat_origin, flat_ray = origin.reshape(-1, 3), ray.reshape(-1, 3)
        blocks = [
            self._first_hits(flat_origin[i : i + _BLOCK], flat_ray[i : i + _BLOCK], max_range_m)
            for i in range(0, len(flat_origin), _BLOCK)
        ]
        if not blocks:
            return TerrainHits(np.zeros((*shape, 3)), np.zeros(shape, bool), np.zeros(shape, "U1"))
        point, reason = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
        return TerrainHits(
            point.reshape(*shape, 3), (reason == "").reshape(shape), reason.reshape(shape).astype(np.str_)
        )

    def _first_hits(
        self, origin: FloatArray, ray: FloatArray, max_range_m: float
    ) -> tuple[FloatArray, TextArray]:
        """Points and reasons of one block of rays, ``(n, 3)`` and ``(n,)``."""
        end = self._reach(origin, ray, max_range_m)
        known = np.isfinite(origin).all(axis=1) & np.isfinite(ray).all(axis=1)
        with np.errstate(invalid="ignore"):
            horizontal = np.where(known, end * np.hypot(ray[:, 0], ray[:, 1]), 0.0)
        count = 2 + int(np.ceil(_STEPS_A_CELL * float(np.max(horizontal, initial=0.0)) / self.step_m))
        along = end[:, None] * np.linspace(0.0, 1.0, count)
        gap = self._gap(origin[:, None, :], ray[:, None, :], along)
        with np.errstate(invalid="ignore"):
            stop = ~(gap > 0.0)
        first = np.argmax(stop, axis=1)
        rows = np.arange(len(first))
        reached = stop[rows, first]
        unknown = reached & np.isnan(gap[rows, first])
        hit = known & reached & ~unknown & (first > 0)
        before = along[rows, np.maximum(first - 1, 0)]
        distance = self._crossing(origin, ray, before, along[rows, first])
        point = np.where(hit[:, None], origin + distance[:, None] * ray, np.nan)
        with np.errstate(invalid="ignore"):
            rising = ray[:, 2] >= 0.0
        reason = np.select(
            [hit, ~known, unknown, reached, rising],
            [
                "",
                Reason.NO_RAY,
                Reason.TERRAIN_UNKNOWN,
                Reason.CAMERA_UNDERGROUND,
                Reason.ABOVE_HORIZON,
            ],
            default=Reason.TOO_FAR_ON_TERRAIN,
        )
        return point, reason

    def _reach(self, origin: FloatArray, ray: FloatArray, max_range_m: float) -> FloatArray:
        """Multiple of each ray to where it need not be followed any further."""
        lowest = np.nanmin(self.grid_m) if np.isfinite(self.grid_m).any() else np.nan
        with np.errstate(invalid="ignore", divide="ignore"):
            sideways = max_range_m / np.hypot(ray[:, 0], ray[:, 1])
            # A millimetre under the lowest ground, every ray that goes down has met it.
            down = np.where(ray[:, 2] < 0.0, (origin[:, 2] - lowest + 1e-3) / -ray[:, 2], np.inf)
            reach = np.maximum(np.fmin(sideways, down), 0.0)
        # Straight up: nothing is there.
        return np.where(np.isinf(reach), 0.0, reach)

    def _gap(self, origin: FloatArray, ray: FloatArray, along: FloatArray) -> FloatArray:
        """How high the ray is above the ground."""
        place = origin + along[..., None] * ray
        return np.asarray(place[..., 2] - self.height_m(place[..., 0], place[..., 1]))

    def _crossing(
        self, origin: FloatArray, ray: FloatArray, above: FloatArray, below: FloatArray
    ) -> FloatArray:
        """Halve the stretch between a point above the ground and one below it."""
        for _ in range(_BISECTIONS):
            middle = 0.5 * (above + below)
            with np.errstate(invalid="ignore"):
                over = self._gap(origin, ray, middle) > 0.0
            above, below = np.where(over, middle, above), np.where(over, below, middle)
        return below

    def _cell(self, east_m: ArrayLike, north_m: ArrayLike) -> tuple[NDArray[np.intp], ...]:
        """Columns west and east, rows south and north of each place, and how far it is between them.

        Places outside the grid get NaN for the latter.
        """
        rows, columns = self.grid_m.shape
        x = (np.asarray(east_m, dtype=np.float64) - self.east_m) / self.step_m
        y = (np.asarray(north_m, dtype=np.float64) - self.north_m) / self.step_m
        x, y = np.broadcast_arrays(x, y)
        with np.errstate(invalid="ignore"):
            inside = (x >= 0.0) & (x <= columns - 1) & (y >= 0.0) & (y <= rows - 1)
        x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
        west, south = (
            np.minimum(x.astype(np.intp), columns - 2),
            np.minimum(y.astype(np.intp), rows - 2),
        )
        outside = np.where(inside, 0.0, np.nan)
        return west, west + 1, south, south + 1, x - west + outside, y - south + outside
