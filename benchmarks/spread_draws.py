"""What a drive has one draw of: laid evenly over its distribution instead of drawn by chance.

At speed a clock is most of an ellipse, and beside a road most of a height is how the car leans, which follows
from the antennas' heights against one another and from the road's mean crossfall. Twenty or forty draws of
one number are a lottery: the mean square of 40 is 1 only to a quarter.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.simulation.as_stated import BETWEEN_ANTENNAS_M


def evenly(drives: int, order: int = 0) -> FloatArray:
    """Quantiles (drives,) of a normal distribution, in sigmas, of mean square 1, in one of many orders."""
    from scipy.stats import norm

    values = norm.ppf((np.arange(drives) + 0.5) / drives) if drives > 1 else np.ones(1)
    return np.random.default_rng(order).permutation(values / np.sqrt(np.mean(values**2)))


def taped(
    arms_m: Mapping[str, FloatArray], off_m: Mapping[str, FloatArray], sigmas: float
) -> dict[str, FloatArray]:
    """Lever arms (3,) of antennas as somebody taped them who was off by so many sigmas between two heights.

    `off_m` is how far each antenna really sits from `arms_m`. One antenna is as it is.
    """
    arms = dict(arms_m)
    if len(arms) == 2:
        one, other = arms
        wanted_m = np.sqrt(2.0) * BETWEEN_ANTENNAS_M * sigmas
        up_m = np.array([0.0, 0.0, 0.5 * (off_m[one][2] - off_m[other][2] - wanted_m)])
        arms[one], arms[other] = arms[one] + up_m, arms[other] - up_m
    return arms
