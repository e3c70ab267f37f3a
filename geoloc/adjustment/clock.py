"""Whether the stated camera clock can be, and what the rays say instead."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoloc.adjustment.covariance import Spread
from geoloc.adjustment.result import Correction
from geoloc.adjustment.scene import Bodies
from geoloc.adjustment.solve import Solution
from geoloc.adjustment.unknowns import TIME, Prior

# So many sigmas, of what the rays say and of what was stated together, and a stated clock is given up. Honest
# clocks reach 4.7 in 180 simulated drives: long bends with slip look like a clock that is late.
_CERTAIN = 6.0
# From here on a clock is doubted: the stated one is kept, and what the rays say is added to the ellipses.
_DOUBTED = 2.5

# Bends and the driver's wander show a clock by the yaw rate. What tyres do beyond a slip in proportion looks
# the same, and so does that part of a heading's error which goes on for as long as the drive.
_LOOKS_ALIKE_MS, _NOTHING_TOLD_MS = 5.0, 1000.0
_LASTING_SHARE = 0.3


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


def lasting_doubt_s(rays: Correction, time_ms: float, body: Bodies, *, is_poor: bool) -> float:
    """One sigma to add to the clock's, since what looks like a clock in the rays does not average.

    Parameters
    ----------
    rays : Correction
        From `clock_of_the_rays`.
    time_ms : float
        One sigma of the clock's prior.
    body : Bodies
        The car at each sighting.
    is_poor : bool
        Whether the track is of fixes without a carrier-phase solution, whose headings are off for minutes.
    """
    turning = max(float(np.sqrt(np.mean(body.yaw_rate_radps**2))), 1e-6)
    share = 1.0 if is_poor else _LASTING_SHARE
    heading_ms = 1e3 * share * float(np.median(body.sigma_rad[:, 2])) / turning
    alike_ms = min(max(heading_ms, _LOOKS_ALIKE_MS), _NOTHING_TOLD_MS)
    taken, honest = (
        1.0 / (time_ms**-2.0 + 1.0 / (rays.sigma**2 + more_ms**2)) for more_ms in (0.0, alike_ms)
    )
    return 1e-3 * float(np.sqrt(honest - taken))


def about(prior: Prior, taken: Mapping[int, float]) -> Prior:
    """Return what is known beforehand where so much of some unknowns was taken off already, by place."""
    constant = prior.constant.copy()
    for place, value in taken.items():
        its = np.flatnonzero(prior.column == place)
        constant[prior.row[its]] += prior.value[its] * value
    return prior._replace(constant=constant)
