"""Observed poles × sites → pairs: gate, score every hypothesis, assign one-to-one over each cluster."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from twin.matching.config import MatchConfig
from twin.matching.likelihood import TERMS, Pairs, gated_pairs
from twin.matching.one_to_one import Cluster, clusters, extra_costs, lonely_pairs, solve
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Site

__all__ = ["Assignment", "assign"]


_NEVER_MATTERS = 12.0
"""A pair that would make the whole less likely by this many units of log odds is not looked at."""
_WORTH_NAMING = 0.01
"""Alternatives of less probability are not named."""

Alternatives = tuple[tuple[int, float], ...]
"""Index on the other side (-1: none) and probability, likeliest first."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """What each pole and each site was assigned to.

    Attributes
    ----------
    site_of_pole : int (n_poles,)
        Index of the site, -1 for none.
    confidence_of_pole, confidence_of_site : float (n,)
        Posterior probability of that hypothesis among its competitors.
    rival_of_pole : int (n_poles,)
        The site that competes most, -1 if "no match" or nothing does.
    terms_of_pole : float (n_poles, 6)
        Log odds of the pair by term (:data:`twin.matching.likelihood.TERMS`); NaN for a pole alone.
    alternatives_of_pole, alternatives_of_site : dict
        What else it may be, where that has a probability worth naming.
    together : Pairs
        All that were weighed against one another.
    gated : Pairs
        All within the gate.
    """

    site_of_pole: NDArray[np.int64]
    confidence_of_pole: FloatArray
    confidence_of_site: FloatArray
    rival_of_pole: NDArray[np.int64]
    terms_of_pole: FloatArray
    alternatives_of_pole: dict[int, Alternatives]
    alternatives_of_site: dict[int, Alternatives]
    together: Pairs
    gated: Pairs

    def ends(self, pairs: Pairs) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers of the pole and the site of each pair, sites counted on behind the poles."""
        return pairs.pole, len(self.site_of_pole) + pairs.site

    def groups(self) -> NDArray[np.int64]:
        """Group of each pole, then of each site: those that pairs hold together have the same."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        size = len(self.site_of_pole) + len(self.confidence_of_site)
        ends = self.ends(self.together)
        graph = coo_array((np.ones(ends[0].size), ends), shape=(size, size))
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def assign(
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    p_unannotated: FloatArray,
    config: MatchConfig,
    common: Mapping[str, float] | None = None,
) -> Assignment:
    """Assign poles to sites one-to-one, with "no match" as a hypothesis that competes.

    Parameters
    ----------
    p_unannotated : float64 (n_sites,)
        Probability that the site's pole, if it still stands, goes unannotated: about 1 where no drive had
        it in view, small where a completely annotated drive did.
    common : mapping of a sign code to log odds, optional
        As :func:`twin.matching.likelihood.cost_of_common` gives them; by default of these sites.

    Notes
    -----
    A pair is scored by log odds (:mod:`twin.matching.likelihood`) against the pole being new and the site
    being gone or overlooked. The assignment is the exact minimum over each connected cluster. A hypothesis
    competes by the best joint assignment in which it holds (:func:`twin.matching.one_to_one.extra_costs`).
    """
    gated = gated_pairs(poles, sites, p_unannotated, config, common)
    pairs = _that_matter(gated, len(poles), len(sites))
    result = Assignment(
        site_of_pole=np.full(len(poles), -1, dtype=np.int64),
        confidence_of_pole=np.ones(len(poles)),
        confidence_of_site=np.ones(len(sites)),
        rival_of_pole=np.full(len(poles), -1, dtype=np.int64),
        terms_of_pole=np.full((len(poles), len(TERMS)), np.nan),
        alternatives_of_pole={},
        alternatives_of_site={},
        together=pairs,
        gated=gated,
    )
    single = lonely_pairs(pairs.pole, pairs.site)
    _settle_single(pairs.part(single), result)
    rest = pairs.part(~single)
    for cluster in clusters(rest.pole, rest.site, rest.cost):
        _settle_cluster(cluster, rest, result)
    return result


def _that_matter(pairs: Pairs, n_poles: int, n_sites: int) -> Pairs:
    """Leave out pairs that no likely joint assignment holds.

    Half of what its best pair gains each pole, and each site, is a feasible solution of the dual problem
    where best pairs are mutual; the reduced cost of a pair is then a lower bound of what forcing it costs.
    """
    cost = pairs.cost
    best_of_pole, best_of_site = np.zeros(n_poles), np.zeros(n_sites)
    np.minimum.at(best_of_pole, pairs.pole, cost)
    np.minimum.at(best_of_site, pairs.site, cost)
    reduced = cost - (best_of_pole[pairs.pole] + best_of_site[pairs.site]) / 2
    return pairs.part(reduced <= _NEVER_MATTERS)


def _settle_single(pairs: Pairs, result: Assignment) -> None:
    """Decide pairs whose pole and site have no other: together, or both alone."""
    together = 1.0 / (1.0 + np.exp(np.clip(pairs.cost, -50.0, 50.0)))
    chosen = pairs.cost < 0
    i, j = pairs.pole, pairs.site
    result.site_of_pole[i[chosen]] = j[chosen]
    result.terms_of_pole[i[chosen]] = pairs.terms[chosen]
    confidence = np.where(chosen, together, 1.0 - together)
    result.confidence_of_pole[i] = result.confidence_of_site[j] = confidence
    result.rival_of_pole[i[~chosen]] = j[~chosen]
    for k in np.flatnonzero(confidence < 1.0 - _WORTH_NAMING).tolist():
        other = 1.0 - float(confidence[k])
        result.alternatives_of_pole[int(i[k])] = ((-1 if chosen[k] else int(j[k]), other),)
        result.alternatives_of_site[int(j[k])] = ((-1 if chosen[k] else int(i[k]), other),)


def _settle_cluster(cluster: Cluster, pairs: Pairs, result: Assignment) -> None:
    """Solve one cluster, and write it into `result`."""
    m = len(cluster.columns)
    column_of = solve(cluster)
    weight = np.exp(-extra_costs(cluster, column_of))
    row_of = np.argsort(column_of)
    terms = {(int(pairs.pole[k]), int(pairs.site[k])): pairs.terms[k] for k in cluster.pairs.tolist()}
    for a, i in enumerate(cluster.rows.tolist()):
        chance = weight[a] / weight[a].sum()
        chosen = int(column_of[a])
        result.confidence_of_pole[i] = chance[chosen]
        if chosen < m:
            j = int(cluster.columns[chosen])
            result.site_of_pole[i] = j
            result.terms_of_pole[i] = terms[i, j]
        named = _alternatives(chance, chosen, cluster.columns)
        if named:
            result.alternatives_of_pole[i] = named
            result.rival_of_pole[i] = named[0][0]
    for b, j in enumerate(cluster.columns.tolist()):
        chance = weight[:, b] / weight[:, b].sum()
        result.confidence_of_site[j] = chance[row_of[b]]
        named = _alternatives(chance, int(row_of[b]), cluster.rows)
        if named:
            result.alternatives_of_site[j] = named


def _alternatives(chance: FloatArray, chosen: int, others: NDArray[np.int64]) -> Alternatives:
    """Everything but the chosen hypothesis that is worth naming; what lies beyond `others` is "none"."""
    named = [
        (int(others[k]) if k < len(others) else -1, float(chance[k]))
        for k in np.flatnonzero(chance > _WORTH_NAMING).tolist()
        if k != chosen
    ]
    return tuple(sorted(named, key=lambda one: -one[1]))
