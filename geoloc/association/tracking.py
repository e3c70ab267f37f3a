"""One pass through the pictures in time order: every sighting joins a known object or starts a new one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.association.bearings import AssociationRules, Bearings
from geoloc.association.inverse_depth import Innovations, Points, first_points, innovations, updated


def track(seen: Bearings, rules: AssociationRules) -> IntArray:
    """Follow objects from picture to picture.

    Each object is a point with a covariance (:class:`Points`). In each picture the sightings are assigned
    one-to-one to the objects of their kind and label by likelihood, "a new object" competing; then the
    points of the objects that were seen take a Kalman step.

    Parameters
    ----------
    seen : Bearings (n,)

    Returns
    -------
    int64 (n,)
        Track of each sighting, numbered by first sighting.
    """
    n = seen.row.size
    group = np.full(n, -1, dtype=np.int64)
    points, label = first_points(seen), seen.label.copy()
    # Rows of `points` are taken by tracks as these begin: a track is the row of its first sighting.
    last_s = np.full(n, -np.inf)
    active = np.empty(0, dtype=np.int64)
    bounds = np.flatnonzero(np.diff(seen.frame, prepend=-1, append=-1))
    for start, stop in pairwise(bounds.tolist()):
        rows = np.arange(start, stop)
        active = active[last_s[active] >= seen.time_s[start] - rules.memory_s]
        pair, found = _partners(seen, rows, points, active, label, rules)
        new, known = rows[pair < 0], rows[pair >= 0]
        mine = active[pair[pair >= 0] % max(active.size, 1)]
        if known.size:
            moved = updated(points.take(mine), found.take(pair[pair >= 0]))
            points.state[mine], points.covariance[mine] = moved.state, moved.covariance
            label[mine] = np.where(label[mine] == 0, seen.label[known], label[mine])
        group[known], group[new] = mine, new
        last_s[group[rows]] = seen.time_s[start]
        active = np.concatenate([active, new])
    return numbered(group)


def numbered(group: IntArray) -> IntArray:
    """Number groups 0, 1, … by their first row; negative stays -1."""
    names, first, inverse = np.unique(group, return_index=True, return_inverse=True)
    rank = np.full(names.size, -1, dtype=np.int64)
    kept = names >= 0
    rank[np.flatnonzero(kept)[np.argsort(first[kept])]] = np.arange(np.count_nonzero(kept))
    return np.asarray(rank[inverse])


def costs(
    found: Innovations, covariance: FloatArray, joined: BoolArray, rules: AssociationRules
) -> FloatArray:
    """What it costs a sighting to belong to an object instead of being a new one; row by row.

    Parameters
    ----------
    found : Innovations (k,)
    covariance : float64 (k, 3, 3)
        Of the objects.
    joined : bool (k,)
        Whether kind and label allow it.

    Returns
    -------
    float64 (k,)
        -2 log of the likelihood ratio; infinite beyond the gate.
    """
    d2, log_determinant = found.distance2(covariance)
    cost = d2 + log_determinant + 2.0 * np.log(2.0 * np.pi * rules.new_per_sr)
    return np.where(joined & (d2 <= rules.gate), cost, np.inf)


def one_to_one(cost: FloatArray) -> IntArray:
    """Assign rows to columns, or to none (-1) at a cost of 0, so that the total cost is least."""
    n, k = cost.shape
    if n == 1:
        best = int(np.argmin(cost[0])) if k else -1
        return np.array([best if k and cost[0, best] < 0.0 else -1])
    from scipy.optimize import linear_sum_assignment

    # A finite ceiling: assignment refuses rows that are infinite throughout.
    wide = np.concatenate([np.minimum(cost, 1e6), np.zeros((n, n))], axis=1)
    _, column = linear_sum_assignment(wide)
    taken = np.where(column < k, column, -1)
    return np.where((taken >= 0) & (cost[np.arange(n), np.minimum(column, k - 1)] < 0.0), taken, -1)


def _partners(
    seen: Bearings,
    rows: IntArray,
    points: Points,
    active: IntArray,
    label: IntArray,
    rules: AssociationRules,
) -> tuple[IntArray, Innovations]:
    """Pair that each sighting of one picture forms with a track, -1 for none, and the pairs, row by row."""
    i, j = np.repeat(rows, active.size), np.tile(active, rows.size)
    there = points.take(j)
    found = innovations(seen.take(i), there)
    if not active.size:
        return np.full(rows.size, -1), found
    joined = may_join(seen.face[i], seen.label[i], seen.face[j], label[j])
    cost = costs(found, there.covariance, joined, rules).reshape(rows.size, active.size)
    column = one_to_one(cost)
    return np.where(column >= 0, np.arange(rows.size) * active.size + column, -1), found


def may_join(face: BoolArray, label: IntArray, other_face: BoolArray, other_label: IntArray) -> BoolArray:
    """Whether kinds are equal, and labels equal or one of them empty."""
    return np.asarray(
        (face == other_face) & ((label == other_label) | (label == 0) | (other_label == 0)), dtype=np.bool_
    )
