"""Tracks of several cameras, each numbered by itself → objects: which of them show the same one."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import BoolArray, IntArray, TextArray
from geoloc.association.bearings import AssociationRules, Bearings
from geoloc.association.faces_and_strays import faces_on_feet
from geoloc.association.inverse_depth import Triangulation
from geoloc.association.merging import merge
from geoloc.association.tracking import numbered


def join_tracks(
    seen: Bearings, ids: TextArray, is_track: BoolArray, on_pole: BoolArray, rules: AssociationRules
) -> TextArray:
    """Join tracks of different cameras that stand at one place.

    A camera's own tracks are trusted: none is taken apart, and no two of one camera become one, whether a
    picture shows both or not. Neither do two objects that an annotator told apart.

    Parameters
    ----------
    seen : Bearings (n,)
    ids : str (n,)
        What each sighting belongs to; "" for none.
    is_track : bool (n,)
        Whether the id is that of a track, which another camera numbers anew; else it is an object's own.
    on_pole : bool (labels, labels)
        As `geoloc.association.faces_and_strays.faces_on_feet` takes it.

    Returns
    -------
    str (n,)
        Of each sighting: its own id, or the one that its object got; an object's own comes before a track's,
        of two tracks' the first in alphabetical order.
    """
    names, number = np.unique(ids, return_inverse=True)
    objects = _Objects(number, seen.camera, ~is_track, names.size)
    known = names[number] != ""
    for face in np.unique(seen.face[known]).tolist():
        rows = np.flatnonzero((seen.face == face) & known)
        mine = number[rows]

        def allowed(group: IntArray, pairs: IntArray, mine: IntArray = mine) -> BoolArray:
            return objects.may_join(mine, group, pairs)

        mine_seen = seen.take(rows)
        group, _ = merge(mine_seen, objects.of[mine], rules, 0.0, Triangulation(mine_seen), allowed)
        objects.join(mine, group)
    # Feet and faces of one object are two groups here.
    group = numbered(np.where(known, 2 * objects.of[number] + seen.face, -1))
    over = faces_on_feet(seen, group, on_pole, rules, Triangulation(seen))
    for face_group in np.unique(group[over != group]).tolist():
        row = int(np.argmax(group == face_group))
        pair = number[[row, int(np.argmax(group == over[row]))]]
        if objects.may_join(pair, np.arange(2), np.array([[0, 1]]))[0]:
            objects.join(pair, np.zeros(2, dtype=np.int64))
    return _named(names, objects)[number]


class _Objects:
    """Which ids are one object so far, which cameras saw it, and whether an annotator named it."""

    def __init__(self, number: IntArray, camera: IntArray, is_own: BoolArray, size: int) -> None:
        self.of = np.arange(size)
        """Object of each id: its first id."""
        self.is_own = np.zeros(size, dtype=bool)
        self.is_own[number] = is_own
        self._seen_by = np.zeros((size, int(camera.max(initial=0)) + 1), dtype=bool)
        self._seen_by[number, camera] = True

    def may_join(self, ids: IntArray, group: IntArray, pairs: IntArray) -> BoolArray:
        """Whether pairs of groups may be one object; `ids` and groups are of the same sightings."""
        size, of = int(group.max(initial=-1)) + 1, self.of[ids]
        seen_by = _any_of(_any_of(self._seen_by, self.of, self.of.size)[of], group, size)
        own = _any_of(_any_of(self.is_own, self.of, self.of.size)[of], group, size)
        i, j = pairs.T
        return np.asarray(~(seen_by[i] & seen_by[j]).any(axis=1) & ~(own[i] & own[j]))

    def join(self, ids: IntArray, group: IntArray) -> None:
        """Make each group of sightings one object."""
        first = np.full(int(group.max(initial=-1)) + 1, self.of.size)
        np.minimum.at(first, group, self.of[ids])
        new = np.arange(self.of.size)
        new[self.of[ids]] = first[group]
        self.of = new[self.of]


def _any_of(values: BoolArray, group: IntArray, size: int) -> BoolArray:
    """Whether any value of each group is true, (size, …)."""
    found = np.zeros((size, *values.shape[1:]), dtype=bool)
    np.logical_or.at(found, group, values)
    return found


def _named(names: TextArray, objects: _Objects) -> TextArray:
    """Name of the object of each id."""
    # Backwards, so that the first is written last, and what an annotator named at the very end.
    order = np.lexsort((-np.arange(names.size), objects.is_own))
    name = np.arange(names.size)
    name[objects.of[order]] = order
    return np.asarray(names[name[objects.of]])
