"""Which errors of an estimate drives past one pole have in common, by their source."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.trajectory.fix_checks import CODE_LASTS_S, changing_m

TRACK, CLOCK = "gnss", "time"
SAME_IN_EVERY_PASS = frozenset(
    {"ground", "lever arm", "camera position", "lens", "boresight", "rolling shutter", "datum"}
)
"""Of the ground below a pole, of the car, which is taken for the same one in every drive, and of a change of
datum and the place of a base station, which drives on one road mostly share."""


class Parts(NamedTuple):
    """What errors of estimates are made of, as `geoloc.fusion.fuse.Passes` has them."""

    own_m2: FloatArray
    common_m2: FloatArray
    track_m: FloatArray
    ahead_mps: FloatArray


class FoundClock(NamedTuple):
    """One sigma (s) of a clock: taken for granted, by the least squares, and as it is stated in the end."""

    prior_s: float
    solved_s: float
    stated_s: float


def parts_of(
    by_source: Mapping[str, FloatArray],
    heading_deg: FloatArray,
    clock: FoundClock,
    lasts_s: float = CODE_LASTS_S,
) -> Parts:
    """Split covariances.

    With s the sigma of the clock by the least squares, p its prior's and u what was added to s in the end, a
    place that moves by v a second has v² (s⁴ / p² + u²) from the source ``time``: by what bearings say of the
    clock, s is smaller than p, and v² (s² - s⁴ / p²) has come to the other sources.

    Parameters
    ----------
    by_source : mapping source → float64 (n, 2, 2)
        East and north, as `geoloc.adjustment.result.Adjusted` has them.
    heading_deg : float64 (n,)
        Where the car drove to as it saw each pole, clockwise from that north.
    clock : FoundClock
    lasts_s : float
        Correlation time of what the track is off; longer than that of fixes where velocities say how the car
        went on.
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
    by_prior = clock.solved_s**4 / clock.prior_s**2
    added = max(clock.stated_s**2 - clock.solved_s**2, 0.0)
    ahead = np.sqrt(late / (by_prior + added))[:, None] * ahead
    elsewhere = max(clock.solved_s**2 - by_prior, 0.0) * ahead[:, :, None] * ahead[:, None, :]
    # What the track errs for seconds is each pole's own: only the rest lasts. By velocities it comes apart
    # from pole to pole as its process says, and no further.
    whole_m = np.sqrt(track / 2.0)
    seconds_m2 = changing_m(whole_m) ** 2 * (lasts_s <= CODE_LASTS_S)
    own = _at_least_zero(own - elsewhere) + seconds_m2[:, None, None] * np.eye(2)
    return Parts(own, common, np.sqrt(whole_m**2 - seconds_m2), ahead)


def _at_least_zero(covariance_m2: FloatArray) -> FloatArray:
    """Covariances (n, 2, 2) without negative variances."""
    values, axes = np.linalg.eigh(covariance_m2)
    return np.asarray((axes * np.maximum(values, 0.0)[:, None, :]) @ axes.swapaxes(1, 2))
