"""What is done with finished objects: faces go to the foot they stand over, slips of the hand go out."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.association.bearings import AssociationRules, Bearings
from geoloc.association.inverse_depth import Points, Triangulation, innovations, mahalanobis2
from geoloc.association.merging import faces_of, labels_of
from geoloc.association.tracking import may_join

# χ² with two degrees of freedom, 99.9 %.
_OVER_GATE = 13.8
# How high the middle of a sign's face may be over the foot of its pole.
_FACE_HEIGHT_M = (0.2, 9.0)
_NEAR_M = 10.0
# An object that its camera saw this shortly before or after was due in the picture.
_DUE_S = 0.6
# Slips about one object agree by chance in so many sightings, not more.
_FEW = 4


def faces_on_feet(
    seen: Bearings, group: IntArray, on_pole: BoolArray, rules: AssociationRules, fitted: Triangulation
) -> IntArray:
    """Give objects of faces the number of the foot over which they stand.

    Parameters
    ----------
    group : int64 (n,)
    on_pole : bool (labels, labels)
        Whether a face of the one label (row) may hang on a pole of the other (column).
    fitted : Triangulation
        Of `seen`.

    Returns
    -------
    int64 (n,)
    """
    size = int(group.max(initial=-1)) + 1
    points = fitted.points(group)
    face, label = faces_of(seen, group, size), labels_of(seen, group, size)
    faces, feet = np.flatnonzero(face & ~points.vague), np.flatnonzero(~face & ~points.vague)
    over = np.arange(size)
    if not (faces.size and feet.size):
        return group
    from scipy.spatial import cKDTree

    near = cKDTree(points.place_m[feet]).query_ball_point(points.place_m[faces], _NEAR_M, return_sorted=True)
    lists = [np.array(found, dtype=np.int64) for found in near]
    i, j = np.repeat(faces, [part.size for part in lists]), feet[np.concatenate(lists)]
    allowed = on_pole[label[i], label[j]]
    i, j = i[allowed], j[allowed]
    d2 = _beside(seen, group, points, i, j, rules.lean_m)
    order = np.flatnonzero(d2 <= _OVER_GATE)
    # The best is written last.
    order = order[np.lexsort((j[order], -d2[order]))]
    over[i[order]] = j[order]
    return np.where(group >= 0, over[group], -1)


def strays(seen: Bearings, group: IntArray, rules: AssociationRules, fitted: Triangulation) -> list[int]:
    """Find sightings that miss an object which was due in their picture and is not there.

    Only those that stand alone or in a few count, and only if that holds for all of the few: slips of the
    hand about one object may agree on a place by chance.

    Returns
    -------
    list of int
        Their rows.
    """
    size = int(group.max(initial=-1)) + 1
    count = np.bincount(group[group >= 0], minlength=size)
    points = fitted.points(group)
    face, label = faces_of(seen, group, size), labels_of(seen, group, size)
    trusted = (count > _FEW) & ~points.vague
    slips: list[int] = []
    for number in np.flatnonzero(count <= _FEW):
        missed: list[int] = []
        for row in np.flatnonzero(group == number).tolist():
            due = _due(seen, group, row)
            due = due[trusted[due]]
            mine = np.full(due.size, row)
            seeing = innovations(seen, mine, points, due)
            joined = may_join(seen.face[mine], seen.label[mine], face[due], label[due])
            off_deg = np.where(seeing.ahead & joined, np.degrees(np.hypot(*seeing.z.T)), np.inf)
            if off_deg.min(initial=np.inf) <= rules.stray_deg:
                missed.append(row)
        if len(missed) == count[number]:
            slips += missed
    return slips


def _due(seen: Bearings, group: IntArray, row: int) -> IntArray:
    """Objects that the camera of a sighting saw shortly before or after, but not in that picture."""
    low, high = np.searchsorted(seen.time_s, seen.time_s[row] + np.array([-_DUE_S, _DUE_S]))
    about = np.arange(low, high)
    about = about[(seen.camera[about] == seen.camera[row]) & (group[about] >= 0)]
    there = group[about[seen.frame[about] == seen.frame[row]]]
    return np.setdiff1d(group[about], there)


def _beside(
    seen: Bearings, group: IntArray, points: Points, face: IntArray, foot: IntArray, lean_m: float
) -> FloatArray:
    """Squared Mahalanobis distance of faces from the verticals of feet; infinite if below or too high."""
    up = np.zeros((points.state.shape[0], 3))
    up[group[group >= 0]] = seen.up[group >= 0]
    vertical = up[foot]
    offset = points.place_m[face] - points.place_m[foot]
    height = np.einsum("ij,ij->i", offset, vertical)
    level = np.eye(3) - vertical[:, :, None] * vertical[:, None, :]
    covariance = points.place_covariance_m2[face] + points.place_covariance_m2[foot]
    covariance = level @ covariance @ level + lean_m**2 * np.eye(3)
    beside = np.einsum("nij,nj->ni", level, offset)
    low, high = _FACE_HEIGHT_M
    return np.where((height >= low) & (height <= high), mahalanobis2(beside, covariance), np.inf)
