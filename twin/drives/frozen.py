"""Positions that a receiver repeats while the car drives on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geoloc.earth.geodesy import metres_per_degree

FROZEN = "position repeated while the car drove (frozen fix)"
"""Why such fixes are left out."""

LEAST_FIXES = 5
"""Fewer may be those of a logger that asks its receiver too often."""
_LEAST_NS = 2_000_000_000
_LONGEST_STEP_S = 2.0
_HARDEST_MPS2 = 10.0
"""No car brakes or starts harder than that: a repeat that begins or ends with more is the receiver's."""
_NOISE_MPS = 1.0


def frozen(
    epoch_ns: NDArray[np.int64],
    latitude_deg: NDArray[np.float64],
    longitude_deg: NDArray[np.float64],
    height_m: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Mask the positions that repeat the one before to the last digit although the car drove.

    A car that stands repeats its position too, where the receiver holds it; but it stops and starts no harder
    than a car can. At least `LEAST_FIXES` in a row over 2 s count.

    Parameters
    ----------
    epoch_ns : int64 (n,)
        Rising.
    latitude_deg, longitude_deg, height_m : float64 (n,)

    Returns
    -------
    bool (n,)
        False for the first of each row of repeats, which was measured.
    """
    mask = np.zeros(epoch_ns.size, dtype=np.bool_)
    east, north = metres_per_degree(latitude_deg)
    step_m = np.hypot(np.diff(longitude_deg) * east[1:], np.diff(latitude_deg) * north[1:])
    step_s = np.diff(epoch_ns) / 1e9
    repeats = (step_m == 0) & (np.diff(height_m) == 0)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], repeats, [False])).astype(np.int8)))
    # No step longer than a car can stop or start in tells anything.
    beyond = (step_m > (_HARDEST_MPS2 * step_s + _NOISE_MPS) * step_s) & (step_s <= _LONGEST_STEP_S)
    for first, last in edges.reshape(-1, 2).tolist():
        long = last - first + 1 >= LEAST_FIXES and epoch_ns[last] - epoch_ns[first] >= _LEAST_NS
        if long and (beyond[max(first - 1, 0)] or beyond[min(last, beyond.size - 1)]):
            mask[first + 1 : last + 1] = True
    return mask


def never_moves(
    latitude_deg: NDArray[np.float64], longitude_deg: NDArray[np.float64], height_m: NDArray[np.float64]
) -> bool:
    """Whether there are `LEAST_FIXES` or more, all of them the same to the last digit."""
    if latitude_deg.size < LEAST_FIXES:
        return False
    return not any(np.ptp(values) for values in (latitude_deg, longitude_deg, height_m))
