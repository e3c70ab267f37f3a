"""Signs that NVDB has measured well tie drives with a poor receiver to the ground: an option of matching."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from twin.matching.config import MatchConfig
from twin.matching.kept import Kept
from twin.matching.poles.many_drives import Driven, Measured, with_fused_places
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Site
from twin.store.records import Estimate

_REACH_SIGMAS = 4.0


def map_aided(
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    estimates: Sequence[Estimate],
    drives: Sequence[Driven],
    config: MatchConfig,
    kept: Kept,
) -> tuple[list[ObservedPole], str]:
    """Place poles by all drives and by NVDB's measured signs, and say in a sentence what that did.

    A sign never takes part in the place of its own pole: what is then judged against NVDB has not been drawn
    to it.
    """
    measured = _measured(poles, sites, config)
    placed, tied_by = with_fused_places(poles, estimates, drives, measured, kept)
    if not tied_by:
        return list(poles), (
            f"Map-aided: nothing was moved. {len(measured)} signs of NVDB that were measured to "
            f"{config.measured_m:g} m could be told apart near the drives, and no three of them agree."
        )
    ends = [np.array([(pole.east_m, pole.north_m) for pole in some]) for some in (poles, placed)]
    moved = ends[1] - ends[0]
    moved = moved[np.hypot(*moved.T) > 0.0]
    east, north = moved.mean(axis=0)
    return placed, (
        f"Map-aided: {len(moved)} poles were moved, in the mean by {east:+.1f} m east and {north:+.1f} m "
        f"north, by {len(tied_by)} measured signs of NVDB that agree with one another; left out were "
        f"{len(measured) - len(tied_by)} that do not. No sign moved its own pole."
    )


def _measured(
    poles: Sequence[ObservedPole], sites: Sequence[Site], config: MatchConfig
) -> dict[int, Measured]:
    """Pole's number → the one measured sign that it can be, where no other pole can be that sign."""
    from scipy.spatial import cKDTree

    good = [site for site in sites if site.own_geometry and site.sigma_m <= config.measured_m]
    if not good or not poles:
        return {}
    tree = cKDTree([(site.east_m, site.north_m) for site in good])
    reach = [_REACH_SIGMAS * float(np.hypot(pole.sigma_m, config.measured_m)) for pole in poles]
    near = tree.query_ball_point([(pole.east_m, pole.north_m) for pole in poles], reach)
    claims = {
        k: [j for j in some if not set(poles[k].codes).isdisjoint(good[j].codes)]
        for k, some in enumerate(near)
    }
    claimed = Counter(j for some in claims.values() for j in some)
    only = {k: some[0] for k, some in claims.items() if len(some) == 1 and claimed[some[0]] == 1}
    return {k: Measured(good[j].east_m, good[j].north_m, good[j].sigma_m) for k, j in only.items()}
