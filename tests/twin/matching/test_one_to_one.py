"""Sparse assignment: the same answers as trying everything."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from twin.matching.one_to_one import cheapest_pairs, clusters, extra_costs, lonely_pairs, solve


def random_pairs(seed: int, n: int = 6, m: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw half of all pairs, with costs on both sides of being alone."""
    rng = np.random.default_rng(seed)
    i, j = np.nonzero(rng.random((n, m)) < 0.5)
    return i, j, rng.normal(-1.0, 4.0, i.size)


@pytest.mark.parametrize("seed", range(10))
def test_cheapest_pairs_cost_what_a_dense_solver_finds(seed: int) -> None:
    """Cluster by cluster the total is that of one dense problem with a column "alone" for every row."""
    i, j, cost = random_pairs(seed)
    dense = np.full((6, 5 + 6), 1e6)
    dense[i, j] = cost
    dense[np.arange(6), 5 + np.arange(6)] = 0.0
    found = cheapest_pairs(i, j, cost)
    price = {(int(a), int(b)): c for a, b, c in zip(i, j, cost, strict=True)}
    assert len(set(found.values())) == len(found)
    assert sum(price[pair] for pair in found.items()) == pytest.approx(
        dense[linear_sum_assignment(dense)].sum()
    )


@pytest.mark.parametrize("seed", range(10))
def test_extra_costs_are_those_of_solving_again(seed: int) -> None:
    """What forcing a hypothesis adds equals the cost of solving with it forced, less that of the best."""
    for cluster in clusters(*random_pairs(seed)):
        column_of = solve(cluster)
        best = cluster.cost[np.arange(len(column_of)), column_of].sum()
        extra = extra_costs(cluster, column_of)
        for r, c in np.argwhere(cluster.cost < 1e6).tolist():
            forced = cluster.cost.copy()
            forced[r] = 1e6
            forced[r, c] = cluster.cost[r, c]
            again = forced[linear_sum_assignment(forced)].sum()
            assert extra[r, c] == pytest.approx(again - best, abs=1e-6)
        assert np.isinf(extra[cluster.cost >= 1e6]).all()


def test_clusters_share_no_row_and_no_column() -> None:
    """Every pair lies in exactly one cluster, and clusters have nothing in common."""
    i, j, cost = random_pairs(3, 40, 40)
    keep = (i // 4) == (j // 4)
    found = list(clusters(i[keep], j[keep], cost[keep]))
    assert sorted(np.concatenate([c.pairs for c in found]).tolist()) == list(range(int(keep.sum())))
    rows = np.concatenate([c.rows for c in found])
    assert len(np.unique(rows)) == len(rows)
    assert len(found) >= 8


def test_lonely_pairs_are_those_nobody_competes_for() -> None:
    """Rows 0 and 1 compete for column 0; row 2 and column 3 have only each other."""
    assert lonely_pairs(np.array([0, 1, 2]), np.array([0, 0, 3])).tolist() == [False, False, True]
    assert lonely_pairs(np.zeros(0, int), np.zeros(0, int)).tolist() == []
    assert cheapest_pairs(np.array([2]), np.array([3]), np.array([1.0])) == {}
