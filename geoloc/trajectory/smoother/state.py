"""How the state of the smoother in the plane is laid out, and directions in it."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray

POSITION, VELOCITY, ACCELERATION = slice(0, 2), slice(2, 4), slice(4, 6)
"""East and north: m, m/s, m/s²."""
YAW, YAW_RATE = 6, 7
"""Counter-clockwise from east, rad and rad/s; absent from the state of a point that has no heading."""
OWN = 8
"""From here on what lasts of receivers' errors, in units of its sigma: east and north of each antenna's
fixes, then the headings of the antennas that have any."""


def forward_axis(yaw_rad: FloatArray) -> FloatArray:
    """Unit vector ahead, east and north ``(..., 2)``."""
    return np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=-1)


def turned(vector: FloatArray) -> FloatArray:
    """A quarter turn to the left of ``(..., 2)``."""
    return np.stack([-vector[..., 1], vector[..., 0]], axis=-1)
