"""Whether the stated camera clock can be, and what the rays say instead."""

from __future__ import annotations

import numpy as np

from geoloc.adjustment.covariance import Spread
from geoloc.adjustment.result import Correction
from geoloc.adjustment.solve import Solution
from geoloc.adjustment.unknowns import TIME, Prior

# So many sigmas, of what the rays say and of what was stated together, and a stated clock is given up. Honest
# clocks reach 4.7 in 180 simulated drives: long bends with slip look like a clock that is late.
_CERTAIN = 6.0
# From here on a clock is doubted: the stated one is kept, and what the rays say is added to the ellipses.
_DOUBTED = 2.5


def clock_of_the_rays(solution: Solution, found: Spread, time_ms: float, shift_s: float) -> Correction:
    """What the rays alone say of the camera clock, milliseconds: the solution without the clock's prior.

    Parameters
    ----------
    time_ms : float
        One sigma of that prior.
    shift_s : float
        What had been added to the clock before the adjustment.
    """
    value, variance = 1e3 * (shift_s + float(solution.x[TIME])), 1e6 * float(found.shared[TIME, TIME])
    information = 1.0 / variance - 1.0 / time_ms**2
    if information <= 0.0:
        return Correction(0.0, np.inf)
    return Correction(value / variance / information, float(np.sqrt(1.0 / information)))


def cannot_be(rays: Correction, time_ms: float) -> bool:
    """Whether the rays refute a clock that is stated to `time_ms`."""
    return bool(abs(rays.value) > _CERTAIN * np.hypot(rays.sigma, time_ms))


def may_not_be(rays: Correction, time_ms: float) -> bool:
    """Whether the rays speak against such a clock."""
    return bool(abs(rays.value) > _DOUBTED * np.hypot(rays.sigma, time_ms))


def about(prior: Prior, shift_s: float) -> Prior:
    """Return what is known beforehand where `shift_s` was already added to the clock."""
    of_time = np.flatnonzero(prior.column == TIME)
    constant = prior.constant.copy()
    constant[prior.row[of_time]] += prior.value[of_time] * shift_s
    return prior._replace(constant=constant)
