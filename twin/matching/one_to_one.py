"""Sparse one-to-one assignment: each connected cluster solved exactly, and what each alternative costs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray

_IMPOSSIBLE = 1e6
"""Cost of a forbidden pair: above any sum of log likelihoods, finite so that the solver stays exact."""


@dataclass(frozen=True, slots=True)
class Cluster:
    """Rows and columns that are connected by pairs.

    Attributes
    ----------
    rows, columns : int64 (n,), (m,)
    pairs : int64 (k,)
        Which of the pairs lie in it.
    cost : float64 (n + m, m + n)
        ``[pairs | row alone]`` over ``[column alone | free]``: every row and every column gets exactly one
        hypothesis. Being alone costs 0.
    """

    rows: IntArray
    columns: IntArray
    pairs: IntArray
    cost: FloatArray


def cheapest_pairs(i: IntArray, j: IntArray, cost: FloatArray) -> dict[int, int]:
    """Row → column of the one-to-one assignment that costs least; staying alone costs 0.

    Parameters
    ----------
    i, j : int64 (k,)
        The pairs that are possible.
    cost : float64 (k,)
    """
    partner: dict[int, int] = {}
    single = lonely_pairs(i, j)
    good = single & (cost < 0)
    partner.update(zip(i[good].tolist(), j[good].tolist(), strict=True))
    for cluster in clusters(i[~single], j[~single], cost[~single]):
        n, m = len(cluster.rows), len(cluster.columns)
        for a, b in enumerate(solve(cluster)[:n].tolist()):
            if b < m:
                partner[int(cluster.rows[a])] = int(cluster.columns[b])
    return partner


def lonely_pairs(i: IntArray, j: IntArray) -> NDArray[np.bool_]:
    """Tell which pairs have a row and a column that occur in no other pair: they need no solver."""
    if not i.size:
        return np.zeros(0, dtype=np.bool_)
    return np.asarray((np.bincount(i)[i] == 1) & (np.bincount(j)[j] == 1))


def clusters(i: IntArray, j: IntArray, cost: FloatArray) -> Iterator[Cluster]:
    """Yield the connected clusters of pairs, in the order of their first row."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not i.size:
        return
    rows, a = np.unique(i, return_inverse=True)
    columns, b = np.unique(j, return_inverse=True)
    size = rows.size + columns.size
    graph = coo_array((np.ones(i.size), (a, rows.size + b)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    order = np.argsort(label[a], kind="stable")
    for pairs in np.split(order, np.flatnonzero(np.diff(label[a[order]])) + 1):
        r, local_r = np.unique(a[pairs], return_inverse=True)
        c, local_c = np.unique(b[pairs], return_inverse=True)
        n, m = r.size, c.size
        matrix = np.full((n + m, m + n), _IMPOSSIBLE)
        matrix[local_r, local_c] = cost[pairs]
        matrix[np.arange(n), m + np.arange(n)] = 0.0
        matrix[n + np.arange(m), np.arange(m)] = 0.0
        matrix[n:, m:] = 0.0
        yield Cluster(rows[r], columns[c], pairs, matrix)


def solve(cluster: Cluster) -> IntArray:
    """Column of each row, of the assignment that costs least (Jonker–Volgenant, scipy)."""
    from scipy.optimize import linear_sum_assignment

    return np.asarray(linear_sum_assignment(cluster.cost)[1], dtype=np.int64)


def extra_costs(cluster: Cluster, column_of: IntArray) -> FloatArray:
    """What forcing each hypothesis adds to the cost of the best assignment; infinite where it is forbidden.

    To force row r into column b, the row that holds b must move to another column, whose row must move …
    until somebody takes what r left: the cheapest such chain is a shortest path between rows, found for all
    pairs at once (Floyd–Warshall). So a rival that would rob another row of its only column is charged for
    that: these are the exact min-marginals of the assignment problem.

    Returns
    -------
    float64 (n + m, m + n)
        Not negative; 0 for the hypotheses chosen.
    """
    cost, size = cluster.cost, len(column_of)
    row_of = np.empty(size, dtype=np.int64)
    row_of[column_of] = np.arange(size)
    # step[r, s]: row r gives up its column for that of row s.
    step = cost[:, column_of] - cost[np.arange(size), column_of][:, np.newaxis]
    chain = step.copy()
    for k in range(size):
        np.minimum(chain, chain[:, k, np.newaxis] + chain[k], out=chain)
    extra = (step + chain.T)[:, row_of]
    extra[np.arange(size), column_of] = 0.0
    return np.where(cost < _IMPOSSIBLE, np.maximum(extra, 0.0), np.inf)
