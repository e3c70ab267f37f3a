"""One pass through the pictures in time order: every sighting joins a known object or starts a new one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.association.bearings import AssociationRules, Bearings
from geoloc.association.inverse_depth import Innovations, Points, first_points, innovations, update


def track(seen: Bearings, rules: AssociationRules) -> IntArray:
    """Follow objects from picture to picture.

    Each object is a point with a covariance (:class:`Points`). In each picture the sightings are assigned
    one-to-one to the objects of their kind and label by likelihood, "a new object" competing; then the
    points of the objects that were seen take a Kalman step. What can never meet (:func:`_runs`) is followed
    side by side, a picture of each at a time.

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
    run, step = _runs(seen, rules.memory_s)
    now_s = np.empty(int(run.max(initial=-1)) + 1)
    active = np.empty(0, dtype=np.int64)
    order = np.lexsort((run, step))
    for rows in np.split(order, np.flatnonzero(np.diff(step[order])) + 1):
        now_s[:] = np.inf
        now_s[run[rows]] = seen.time_s[rows]
        active = active[last_s[active] >= now_s[run[active]] - rules.memory_s]
        pair, track_of, found = _partners(seen, rows, run, points, active, label, rules)
        new, known, pair = rows[pair < 0], rows[pair >= 0], pair[pair >= 0]
        mine = track_of[pair]
        if known.size:
            update(points, mine, found.take(pair))
            label[mine] = np.where(label[mine] == 0, seen.label[known], label[mine])
        group[known], group[new] = mine, new
        last_s[group[rows]] = seen.time_s[rows]
        active = np.concatenate([active, new])
        active = active[np.argsort(run[active], kind="stable")]
    return numbered(group)


def _runs(seen: Bearings, memory_s: float) -> tuple[IntArray, IntArray]:
    """Sightings that may come to share a track, by number, and the picture of each among those of its run.

    Kinds never mix, nor do labels of a kind of which no sighting lacks one; and a pause that is longer than
    tracks are remembered parts what lies before it from what comes after.
    """
    any_label = np.array([np.any(seen.label[seen.face == face] == 0) for face in (False, True)])
    label = np.where(any_label[seen.face.astype(np.int64)], 0, seen.label)
    order = np.lexsort((label, seen.face))
    face, label, time_s, frame = seen.face[order], label[order], seen.time_s[order], seen.frame[order]
    begins = np.ones(order.size, dtype=bool)
    begins[1:] = (face[1:] != face[:-1]) | (label[1:] != label[:-1]) | (time_s[:-1] < time_s[1:] - memory_s)
    picture = np.cumsum(begins | (np.diff(frame, prepend=-1) != 0))
    run, step = np.empty_like(order), np.empty_like(order)
    run[order] = np.cumsum(begins) - 1
    step[order] = picture - picture[begins][run[order]]
    return run, step


def numbered(group: IntArray) -> IntArray:
    """Number groups 0, 1, … by their first row; negative stays -1."""
    names, first, inverse = np.unique(group, return_index=True, return_inverse=True)
    rank = np.full(names.size, -1, dtype=np.int64)
    kept = names >= 0
    rank[np.flatnonzero(kept)[np.argsort(first[kept])]] = np.arange(np.count_nonzero(kept))
    return np.asarray(rank[inverse])


def ranges(first: IntArray, size: IntArray) -> IntArray:
    """Numbers ``first`` … ``first + size - 1`` of each row, one row after the other."""
    before = np.cumsum(size) - size
    return np.asarray(np.arange(int(size.sum())) + np.repeat(first - before, size))


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
    run: IntArray,
    points: Points,
    active: IntArray,
    label: IntArray,
    rules: AssociationRules,
) -> tuple[IntArray, IntArray, Innovations]:
    """Pair that each sighting of one picture of each run forms with a track, -1 for none; tracks, by pair.

    `rows` and `active` are in order of their runs.
    """
    low, high = (np.searchsorted(run[active], run[rows], side=side) for side in ("left", "right"))
    size = high - low
    ends = np.cumsum(size)
    i, j = np.repeat(rows, size), active[ranges(low, size)]
    found = innovations(seen, i, points, j)
    partner = np.full(rows.size, -1, dtype=np.int64)
    if not i.size:
        return partner, j, found
    joined = may_join(seen.face[i], seen.label[i], seen.face[j], label[j])
    cost = costs(found, points.covariance[j], joined, rules)
    bounds = np.append(np.flatnonzero(np.diff(run[rows], prepend=-1)), rows.size)
    for first, last in pairwise(bounds.tolist()):
        begins, of_each = ends[first] - size[first], size[first]
        column = one_to_one(cost[begins : ends[last - 1]].reshape(last - first, of_each))
        partner[first:last] = np.where(column >= 0, begins + np.arange(last - first) * of_each + column, -1)
    return partner, j, found


def may_join(face: BoolArray, label: IntArray, other_face: BoolArray, other_label: IntArray) -> BoolArray:
    """Whether kinds are equal, and labels equal or one of them empty."""
    return np.asarray(
        (face == other_face) & ((label == other_label) | (label == 0) | (other_label == 0)), dtype=np.bool_
    )
