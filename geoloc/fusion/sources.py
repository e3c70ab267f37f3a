"""Which errors of an estimate drives past one pole have in common, by their source."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray

TRACK, CLOCK = "gnss", "time"
SAME_IN_EVERY_PASS = frozenset({"ground", "lever arm", "camera position", "boresight", "rolling shutter"})
"""Of the ground below a pole and of the car, which is taken for the same one in every drive."""


class Parts(NamedTuple):
    """What errors of estimates are made of, as `geoloc.fusion.fuse.Passes` has them."""

    own_m2: FloatArray
    common_m2: FloatArray
    track_m: FloatArray
    ahead_mps: FloatArray


def parts_of(by_source: Mapping[str, FloatArray], heading_deg: FloatArray, clock_sigma_s: float) -> Parts:
    """Split covariances.

    Parameters
    ----------
    by_source : mapping source → float64 (n, 2, 2)
        East and north, as `geoloc.adjustment.result.Adjusted` has them.
    heading_deg : float64 (n,)
        Where the car drove to as it saw each pole, clockwise from that north.
    clock_sigma_s : float
        What the estimates take the clock to be known to: their part of it is what that moves them.
    """
    n = heading_deg.size
    own, common = np.zeros((n, 2, 2)), np.zeros((n, 2, 2))
    for source, covariance in by_source.items():
        if source in SAME_IN_EVERY_PASS:
            common = common + covariance
        elif source not in (TRACK, CLOCK):
            own = own + covariance
    track, late = (
        np.trace(by_source.get(source, np.zeros((n, 2, 2))), axis1=1, axis2=2) for source in (TRACK, CLOCK)
    )
    turn = np.radians(heading_deg)
    ahead = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    return Parts(own, common, np.sqrt(track / 2.0), np.sqrt(late)[:, None] / clock_sigma_s * ahead)
