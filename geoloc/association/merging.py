"""Tracks that are one object are merged, and sightings go to the object that they fit best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.association.bearings import AssociationRules, Bearings
from geoloc.association.inverse_depth import (
    Points,
    Triangulation,
    fit_points,
    in_axes_of,
    innovations,
    mahalanobis2,
)
from geoloc.association.tracking import costs, may_join, numbered, one_to_one, ranges, track

# χ² with three degrees of freedom, 99.9 %.
_SAME_PLACE = 16.3
# Objects farther from the camera, or farther off the ray, are no candidates for a sighting.
_REACH_M = 90.0
_MAX_OFF_RAD = np.radians(15.0)
# Tracks whose places are farther apart are not compared, unless the depth of one is unknown.
_NEAR_M = 8.0
# Depths at which a track of unknown depth looks for others.
_DEPTHS_M = np.array([4.0, 6.0, 9.0, 13.0, 19.0, 28.0, 40.0, 60.0])
_ROUNDS = 4
# With this many sightings an object counts in full.
_MANY = 20
# How often an object is annotated falls with this power of its distance.
_FADE = 2.0
# A side of a merger may lose this share of its sightings.
_MAY_LOSE = 0.1
# In this share of the rarer track's pictures two tracks of one object may both appear.
_MAY_SHARE = 0.05


def refine(
    seen: Bearings, group: IntArray, rules: AssociationRules, fitted: Triangulation
) -> tuple[IntArray, BoolArray, BoolArray]:
    """Correct tracks with the knowledge of the whole drive.

    Until nothing changes, at most four times: merge tracks that are one object; give each sighting to the
    object that it fits best, one-to-one in each picture; follow those that fit none as tracks of their own.

    Parameters
    ----------
    group : int64 (n,)
        From `track`.
    fitted : Triangulation
        Of `seen`.

    Returns
    -------
    group : int64 (n,)
    merged, split : bool (n,)
        Sightings that changed object in company: their track was merged, or a part of another.
    """
    merged, split = np.zeros(group.size, dtype=bool), np.zeros(group.size, dtype=bool)
    for _ in range(_ROUNDS):
        before = group
        group, joined = merge(seen, group, rules, _MAY_SHARE, fitted)
        merged |= joined
        group = _reassigned(seen, group, rules, fitted)
        loose = group < 0
        if loose.any():
            group = group.copy()
            group[loose] = group.max(initial=-1) + 1 + track(seen.take(loose), rules)
            split |= loose
        group = numbered(group)
        if np.array_equal(group, before):
            break
    group, joined = merge(seen, group, rules, 0.0, fitted)
    return numbered(group), merged | joined, split


def merge(
    seen: Bearings,
    group: IntArray,
    rules: AssociationRules,
    shared: float,
    fitted: Triangulation,
    allowed: Callable[[IntArray, IntArray], BoolArray] | None = None,
) -> tuple[IntArray, BoolArray]:
    """Merge tracks that stand at one place and do not appear in one picture.

    Parameters
    ----------
    shared : float
        In this share of the rarer one's pictures both may appear: a slip of the hand in a long track is no
        proof that two tracks are two objects.
    fitted : Triangulation
        Of `seen`.
    allowed : callable, optional
        Of the groups (n,) and pairs of them (k, 2): which pairs (k,) may be merged. Default: all.

    Returns
    -------
    group : int64 (n,)
    merged : bool (n,)
        Sightings of tracks that were merged.
    """
    merged = np.zeros(group.size, dtype=bool)
    while True:
        group = numbered(group)
        size = int(group.max(initial=-1)) + 1
        points = fitted.points(group)
        pairs = _same_place(seen, group, points, rules, shared)
        pairs = pairs if allowed is None else pairs[allowed(group, pairs)]
        order = np.argsort(group, kind="stable")
        bounds = np.searchsorted(group[order], np.arange(size + 1))
        sides = [order[bounds[g] : bounds[g + 1]] for g in pairs.reshape(-1)]
        pairs = pairs[fit_together(seen, sides, rules)]
        if not pairs.size:
            return group, merged
        name = np.arange(size)
        taken: set[int] = set()
        for i, j in pairs.tolist():
            if not {i, j} & taken:
                taken |= {i, j}
                name[max(i, j)] = min(i, j)
        merged |= np.isin(group, np.fromiter(taken, np.int64))
        group = np.where(group >= 0, name[group], -1)


def labels_of(seen: Bearings, group: IntArray, size: int) -> IntArray:
    """The one label of each group, 0 where all are empty."""
    label = np.zeros(size, dtype=np.int64)
    named = (group >= 0) & (seen.label > 0)
    # Backwards, so that the first is written last.
    rows = np.flatnonzero(named)[::-1]
    label[group[rows]] = seen.label[rows]
    return label


def faces_of(seen: Bearings, group: IntArray, size: int) -> BoolArray:
    """Whether each group is one of faces."""
    face = np.zeros(size, dtype=bool)
    face[group[group >= 0]] = seen.face[group >= 0]
    return face


def _same_place(
    seen: Bearings, group: IntArray, points: Points, rules: AssociationRules, shared: float
) -> IntArray:
    """Pairs of groups (k, 2) whose places agree, likeliest first."""
    size = points.state.shape[0]
    pairs = _near_pairs(points)
    label, face = labels_of(seen, group, size), faces_of(seen, group, size)
    i, j = pairs.T
    pairs = pairs[may_join(face[i], label[i], face[j], label[j])]
    pairs = pairs[_in_one_picture(seen, group, size, pairs) <= shared]
    i, j = pairs.T
    relative = np.sqrt(points.covariance[:, 2, 2]) / points.state[:, 2]
    # The vaguer of the two is asked, in its own coordinates, whether the other one could be it.
    vaguer = np.where(relative[i] >= relative[j], i, j)
    asked, other = points.take(vaguer), points.take(i + j - vaguer)
    state, covariance = in_axes_of(asked, other, rules.place_m)
    d2 = mahalanobis2(state - asked.state, asked.covariance + covariance)
    order = np.lexsort((i + j - vaguer, vaguer, d2))
    return np.asarray(pairs[order[d2[order] <= _SAME_PLACE]])


def _near_pairs(points: Points) -> IntArray:
    """Pairs of points (k, 2) that may be one: near each other, or the one near the other's ray."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points.place_m)
    found = [tree.query_pairs(_NEAR_M, output_type="ndarray").astype(np.int64).reshape(-1, 2)]
    vague = np.flatnonzero(points.vague)
    direction = points.place_m[vague] - points.anchor_m[vague]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for depth in _DEPTHS_M:
        near = tree.query_ball_point(points.anchor_m[vague] + depth * direction, 0.3 * depth)
        found += [np.array([(v, o) for o in others if o != v]) for v, others in zip(vague, near, strict=True)]
    pairs = np.concatenate([part.reshape(-1, 2) for part in found]).astype(np.int64)
    return np.asarray(np.unique(np.sort(pairs, axis=1), axis=0))


def _in_one_picture(seen: Bearings, group: IntArray, size: int, pairs: IntArray) -> FloatArray:
    """In which share of the pictures of the rarer of a pair both appear."""
    from scipy.sparse import csc_array

    kept = group >= 0
    shape = (int(seen.frame.max(initial=-1)) + 1, size)
    appears = csc_array((np.ones(kept.sum()), (seen.frame[kept], group[kept])), shape=shape)
    i, j = pairs.T
    together = np.asarray(appears[:, i].multiply(appears[:, j]).sum(axis=0)).reshape(-1)
    count = np.bincount(group[kept], minlength=size)
    return np.asarray(together / np.minimum(count[i], count[j]))


def fit_together(seen: Bearings, sides: list[IntArray], rules: AssociationRules) -> BoolArray:
    """Whether one point explains the sightings of two sides as well as a point for each.

    Parameters
    ----------
    sides : list of int64 arrays (2 k)
        Rows of `seen`; each two in turn are compared.

    Returns
    -------
    bool (k,)
    """
    if not sides:
        return np.zeros(0, dtype=bool)
    length = np.array([side.size for side in sides])
    both = seen.take(np.concatenate(sides))
    side = np.repeat(np.arange(length.size), length)
    apart = _explained(both, fit_points(both, side), side, rules)
    joint = _explained(both, fit_points(both, side // 2), side // 2, rules)
    lost = np.bincount(side, weights=apart.astype(float) - joint, minlength=length.size) / length
    return np.asarray((lost.reshape(-1, 2) <= _MAY_LOSE).all(axis=1))


def _explained(seen: Bearings, points: Points, group: IntArray, rules: AssociationRules) -> BoolArray:
    found = innovations(seen, np.arange(group.size), points, group)
    d2, _ = found.distance2(points.covariance[group])
    return np.asarray(d2 <= rules.gate)


def _reassigned(seen: Bearings, group: IntArray, rules: AssociationRules, fitted: Triangulation) -> IntArray:
    """Give each sighting to the object that it fits best, one-to-one in each picture; -1 for none."""
    size = int(group.max(initial=-1)) + 1
    points = fitted.points(group)
    row, other = _candidates(seen, group, points)
    label, face = labels_of(seen, group, size), faces_of(seen, group, size)
    joined = may_join(seen.face[row], seen.label[row], face[other], label[other])
    found = innovations(seen, row, points, other)
    cost = costs(found, points.covariance[other], joined, rules)
    # Tracks of slips have hardly any sightings, and far objects are annotated less often than near ones.
    weight = np.minimum(np.bincount(group[group >= 0], minlength=size), _MANY)[other] / _MANY
    range_m = np.linalg.norm(points.place_m[other] - seen.centre_m[row], axis=1)
    cost += 2.0 * (_FADE * np.log(np.maximum(range_m, _NEAR_M) / _NEAR_M) - np.log(weight))
    good = cost < 0.0
    row, other, cost = row[good], other[good], cost[good]
    result = np.full(group.size, -1, dtype=np.int64)
    result[row] = other
    for rows, columns, values in _contested(seen.frame[row], row, other, cost, size):
        names_row, r = np.unique(rows, return_inverse=True)
        names_other, c = np.unique(columns, return_inverse=True)
        matrix = np.full((names_row.size, names_other.size), np.inf)
        matrix[r, c] = values
        chosen = one_to_one(matrix)
        result[names_row] = np.where(chosen >= 0, names_other[chosen], -1)
    return result


def _contested(
    frame: IntArray, row: IntArray, other: IntArray, cost: FloatArray, size: int
) -> list[tuple[IntArray, IntArray, FloatArray]]:
    """Candidates of the pictures in which a sighting has a choice, or an object has."""
    choices = np.bincount(row, minlength=int(row.max(initial=-1)) + 1)[row]
    _, key, count = np.unique(frame * size + other, return_inverse=True, return_counts=True)
    pictures = np.unique(frame[(choices > 1) | (count[key] > 1)])
    order = np.argsort(frame, kind="stable")
    low = np.searchsorted(frame[order], pictures)
    high = np.searchsorted(frame[order], pictures, side="right")
    parts = [order[a:b] for a, b in zip(low, high, strict=True)]
    return [(row[part], other[part], cost[part]) for part in parts]


def _candidates(seen: Bearings, group: IntArray, points: Points) -> tuple[IntArray, IntArray]:
    """Sightings and objects near their rays, their own object among them."""
    from scipy.spatial import cKDTree

    place = points.place_m
    first = np.flatnonzero(np.diff(seen.frame, prepend=-1))
    near = cKDTree(place).query_ball_point(seen.centre_m[first], _REACH_M, return_sorted=True)
    in_frame = np.diff(np.append(first, seen.row.size))
    lists = [np.array(objects, dtype=np.int64) for objects in near]
    size = np.array([part.size for part in lists])
    begins, of_each = (np.repeat(column, in_frame) for column in (np.cumsum(size) - size, size))
    row = np.repeat(np.arange(seen.row.size), of_each)
    other = np.concatenate(lists)[ranges(begins, of_each)]
    offset = place[other] - seen.centre_m[row]
    along = np.einsum("ij,ij->i", offset, seen.ray[row])
    towards = along >= np.cos(_MAX_OFF_RAD) * np.linalg.norm(offset, axis=1)
    row, other = row[towards], other[towards]
    foreign = group[row] != other
    own = np.flatnonzero(group >= 0)
    return np.concatenate([row[foreign], own]), np.concatenate([other[foreign], group[own]])
