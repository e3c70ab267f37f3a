"""Observed poles × sites → pairs: gate, score every hypothesis, assign one-to-one over each cluster."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvdb.datakatalog import sign_family
from twin.matching.config import MatchConfig
from twin.matching.observed import ObservedPole
from twin.matching.sites import Site

FloatArray = NDArray[np.float64]

_IMPOSSIBLE = 1e6
"""Cost of a forbidden pair: above any sum of log likelihoods, finite so that the solver stays exact."""


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
    """

    site_of_pole: NDArray[np.int64]
    confidence_of_pole: FloatArray
    confidence_of_site: FloatArray
    rival_of_pole: NDArray[np.int64]


def assign(
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    p_unannotated: FloatArray,
    config: MatchConfig,
) -> Assignment:
    """Assign poles to sites one-to-one, with "no match" as a hypothesis that competes.

    Parameters
    ----------
    p_unannotated : float64 (n_sites,)
        Probability that the site's pole, if it still stands, goes unannotated: about 1 where no drive had
        it in view, small where a completely annotated drive did.

    Notes
    -----
    A pair costs minus the log of [position density × code probability × site seen]; a pole alone costs minus
    the log of the density of unknown signs with its code; a site alone minus the log that it is gone or was
    overlooked. The assignment is the exact minimum over each connected cluster (Jonker–Volgenant, scipy).
    """
    n_poles, n_sites = len(poles), len(sites)
    pairs = _candidates(poles, sites, config)
    pair_cost = {(i, j): _pair_cost(poles[i], sites[j], p_unannotated[j], config) for i, j in pairs}
    pole_alone = np.array([_pole_alone(pole, config) for pole in poles])
    site_alone = -np.log(config.p_gone + (1 - config.p_gone) * p_unannotated)
    result = Assignment(
        site_of_pole=np.full(n_poles, -1, dtype=np.int64),
        confidence_of_pole=np.ones(n_poles),
        confidence_of_site=np.ones(n_sites),
        rival_of_pole=np.full(n_poles, -1, dtype=np.int64),
    )
    for cluster in _clusters(n_poles, n_sites, pairs):
        _solve_cluster(cluster, pair_cost, pole_alone, site_alone, result)
    return result


def _candidates(
    poles: Sequence[ObservedPole], sites: Sequence[Site], config: MatchConfig
) -> list[tuple[int, int]]:
    """Pairs within the gate; wider for sites that NVDB only places on the centre line."""
    from scipy.spatial import cKDTree

    if not poles or not sites:
        return []
    reach = np.array([config.gate_m + (0 if s.own_geometry else 2 * s.sigma_m) for s in sites])
    tree = cKDTree([(p.east_m, p.north_m) for p in poles])
    near = tree.query_ball_point([(s.east_m, s.north_m) for s in sites], reach)
    return sorted((int(i), j) for j, hits in enumerate(near) for i in hits)


def _pair_cost(pole: ObservedPole, site: Site, p_unannotated: float, config: MatchConfig) -> float:
    offset = np.array([pole.east_m - site.east_m, pole.north_m - site.north_m])
    spread = pole.covariance_m2 + site.sigma_m**2 * np.eye(2)
    mahalanobis2 = float(offset @ np.linalg.solve(spread, offset))
    in_place = np.exp(-0.5 * mahalanobis2) / (2 * np.pi * np.sqrt(np.linalg.det(spread)))
    # A sign that was moved may stand anywhere near: uniform over the gate.
    density = (1 - config.p_moved) * in_place + config.p_moved / (np.pi * config.gate_m**2)
    seen = (1 - config.p_gone) * max(1 - p_unannotated, 0.5)
    return -float(np.log(density * code_probability(pole.codes, site.codes, config) * seen))


def _pole_alone(pole: ObservedPole, config: MatchConfig) -> float:
    """A sign that NVDB does not have carries a given code by chance."""
    return -float(np.log(config.new_per_m2 * (config.p_code if pole.codes else 1.0)))


def code_probability(seen: Sequence[str], known: Sequence[str], config: MatchConfig) -> float:
    """Probability of the codes seen, given the codes that NVDB has: best over shared, family, other."""
    if not seen or not known:
        return 1.0
    if set(seen) & set(known):
        return 1.0 - config.p_code_wrong
    if {family(code) for code in seen} & {family(code) for code in known}:
        return config.p_code_family
    return config.p_code_other


def family(code: str) -> str:
    """``"362"`` for ``"362.50"``; retired ``U…`` codes belong to the family they retired from."""
    return sign_family(code).removeprefix("U")


def _clusters(
    n_poles: int, n_sites: int, pairs: Sequence[tuple[int, int]]
) -> list[tuple[list[int], list[int]]]:
    """Connected clusters of poles and sites; what has no candidate at all is left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not pairs:
        return []
    index = np.array(pairs)
    size = n_poles + n_sites
    graph = coo_array((np.ones(len(index)), (index[:, 0], n_poles + index[:, 1])), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    members: dict[int, tuple[list[int], list[int]]] = {}
    for node in np.unique(np.concatenate([index[:, 0], n_poles + index[:, 1]])):
        poles, sites = members.setdefault(int(label[node]), ([], []))
        if node < n_poles:
            poles.append(int(node))
        else:
            sites.append(int(node) - n_poles)
    return [members[key] for key in sorted(members)]


def _solve_cluster(
    cluster: tuple[list[int], list[int]],
    pair_cost: dict[tuple[int, int], float],
    pole_alone: FloatArray,
    site_alone: FloatArray,
    result: Assignment,
) -> None:
    """Solve one cluster with "alone" rows and columns, and write it into `result`."""
    from scipy.optimize import linear_sum_assignment

    poles, sites = cluster
    n, m = len(poles), len(sites)
    # [pairs | pole alone] over [site alone | free]: every pole and every site gets exactly one hypothesis.
    cost = np.full((n + m, m + n), _IMPOSSIBLE)
    for a, i in enumerate(poles):
        for b, j in enumerate(sites):
            cost[a, b] = pair_cost.get((i, j), _IMPOSSIBLE)
        cost[a, m + a] = pole_alone[i]
    for b, j in enumerate(sites):
        cost[n + b, b] = site_alone[j]
    cost[n:, m:] = 0.0
    rows, columns = linear_sum_assignment(cost)
    total = float(cost[rows, columns].sum())
    column_of = dict(zip(rows.tolist(), columns.tolist(), strict=True))
    for a, i in enumerate(poles):
        chosen = column_of[a]
        result.site_of_pole[i] = sites[chosen] if chosen < m else -1
        confidence, rival = _posterior(cost, a, chosen, total)
        result.confidence_of_pole[i] = confidence
        result.rival_of_pole[i] = sites[rival] if 0 <= rival < m else -1
    row_of = {c: r for r, c in column_of.items()}
    for b, j in enumerate(sites):
        result.confidence_of_site[j] = _posterior(cost.T, b, row_of[b], total)[0]


def _posterior(cost: FloatArray, row: int, chosen: int, total: float) -> tuple[float, int]:
    """Probability of the chosen column for one row: each rival is forced and the rest solved again.

    Forcing a rival and re-solving gives the best *joint* hypothesis in which it holds, so that a rival which
    would rob another pole of its only site is charged for that.
    """
    from scipy.optimize import linear_sum_assignment

    rivals = [c for c in np.flatnonzero(cost[row] < _IMPOSSIBLE) if c != chosen]
    weights: list[float] = []
    for rival in rivals:
        forced = cost.copy()
        forced[row] = _IMPOSSIBLE
        forced[row, rival] = cost[row, rival]
        rows, columns = linear_sum_assignment(forced)
        weights.append(float(np.exp(min(total - forced[rows, columns].sum(), 50.0))))
    if not weights:
        return 1.0, -1
    return 1.0 / (1.0 + sum(weights)), int(rivals[int(np.argmax(weights))])
