"""What an adjustment knows of the ground under the feet: the plane of the road, or a terrain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.adjustment.scene import Bodies
from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.terrain import Terrain

_SLOPE_STEP_M = 1.0


@dataclass(frozen=True, slots=True)
class Ground:
    """What is known of the ground under the feet.

    Attributes
    ----------
    point : int64 (f,)
    body : Bodies (f,)
        Where the car stood nearest: its road's plane runs through each foot but for `sigma_m`.
    origin_m : float64 (f, 3)
        The rig's origin then, in the point's local frame.
    sigma_m : float64 (f,)
    beside_m : float64 (f, 2)
        How far to the left and to the right of the car each foot stands; one of the two is 0.
    left, share : int64, float64 (f,)
        Node before that epoch, and how far on the way to the next.
    weight : float64 (f,)
        How much of it counts: less than 1 where rays contradict it, as of a foot on a wall.
    """

    point: IntArray
    body: Bodies
    origin_m: FloatArray
    sigma_m: FloatArray
    beside_m: FloatArray
    left: IntArray
    share: FloatArray
    weight: FloatArray


@dataclass(frozen=True, slots=True)
class MeasuredGround:
    """A terrain under the feet, instead of the road's plane.

    Attributes
    ----------
    point : int64 (f,)
    terrain : Terrain
    grid_m : float64 (f, 2)
        Each point's anchor, EPSG:25833.
    grid_R_enu : float64 (f, 2, 2)
        From true east and north to the grid's.
    above_m : float64 (f,)
        How much higher the car stood than the terrain, where it was nearest to the point.
    sigma_m, weight : float64 (f,)
    """

    point: IntArray
    terrain: Terrain
    grid_m: FloatArray
    grid_R_enu: FloatArray
    above_m: FloatArray
    sigma_m: FloatArray
    weight: FloatArray

    def height_and_slope(self, offset_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ellipsoidal height (f,) under offsets (f, 2) from the anchors, and its rise east and north."""

        def height(shift_m: FloatArray) -> FloatArray:
            east, north = (self.grid_m + (self.grid_R_enu @ (offset_m + shift_m)[:, :, None])[:, :, 0]).T
            return self.terrain.height_m(east, north) + self.above_m

        steps = np.eye(2) * _SLOPE_STEP_M
        rise = [(height(step) - height(-step)) / (2.0 * _SLOPE_STEP_M) for step in steps]
        return height(np.zeros(2)), np.stack(rise, axis=1)
