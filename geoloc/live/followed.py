"""Which object a sighting without an id shows: the tracker of recorded drives, picture by picture."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.association.bearings import AssociationRules, Bearings, bearings_from_sightings, geocentric_m
from geoloc.association.inverse_depth import Points, first_points, innovations, update
from geoloc.association.tracking import costs, may_join, one_to_one
from geoloc.locate.observations import Observations
from geoloc.trajectory.interpolation import NANOSECONDS

_RULES = AssociationRules()
NOWHERE = -1
"""A sighting that has no ray or no pose."""


class Followed:
    """Objects as points with a covariance in inverse depth (`geoloc.association.tracking`).

    All cameras look at the same points, so that what one of them lost another goes on with.
    """

    def __init__(self) -> None:
        self._about_m: FloatArray | None = None
        self._points: Points | None = None
        self._number = np.empty(0, dtype=np.int64)
        self._label = np.empty(0, dtype=np.int64)
        self._face = np.empty(0, dtype=np.bool_)
        self._last_ns = np.empty(0, dtype=np.int64)
        self._count = 0

    def join(self, picture: Observations, label: IntArray) -> IntArray:
        """Say which object each sighting of one picture shows.

        Parameters
        ----------
        picture : Observations (n,)
            Of one camera at one epoch; what it says of objects is not looked at.
        label : int64 (n,)
            0: none.

        Returns
        -------
        int64 (n,)
            Numbers of objects, new ones of their own; `NOWHERE` for sightings that cannot be used.
        """
        poses = picture.trajectory.poses_at(picture.epoch_ns)
        result = np.full(label.size, NOWHERE)
        if not poses.valid.any():
            return result
        if self._about_m is None:
            place = poses.latitude_deg, poses.longitude_deg, poses.height_m
            self._about_m = geocentric_m(*place)[np.argmax(poses.valid)]
        seen, _ = bearings_from_sightings(picture, poses, label, _RULES, self._about_m)
        if not seen.row.size:
            return result
        epoch_ns = int(picture.epoch_ns[0])
        self._forget(epoch_ns)
        result[seen.row] = self._joined(seen, epoch_ns)
        return result

    def _joined(self, seen: Bearings, epoch_ns: int) -> IntArray:
        n, k = seen.row.size, self._number.size
        partner = np.full(n, -1)
        number = np.empty(n, dtype=np.int64)
        if self._points is not None and k:
            i, j = np.repeat(np.arange(n), k), np.tile(np.arange(k), n)
            found = innovations(seen, i, self._points, j)
            may = may_join(seen.face[i], seen.label[i], self._face[j], self._label[j])
            partner = one_to_one(costs(found, self._points.covariance[j], may, _RULES).reshape(n, k))
            rows = np.flatnonzero(partner >= 0)
            mine = partner[rows]
            update(self._points, mine, found.take(rows * k + mine))
            self._label[mine] = np.where(self._label[mine] == 0, seen.label[rows], self._label[mine])
            self._last_ns[mine] = epoch_ns
            number[rows] = self._number[mine]
        new = np.flatnonzero(partner < 0)
        number[new] = self._count + np.arange(new.size)
        self._count += new.size
        self._add(seen.take(new), number[new], epoch_ns)
        return number

    def _add(self, seen: Bearings, number: IntArray, epoch_ns: int) -> None:
        points = first_points(seen)
        if self._points is None:
            self._points = points
        else:
            both = (self._points, points)
            columns = (np.concatenate([getattr(one, name) for one in both]) for name in Points.__slots__)
            self._points = Points(*columns)
        self._number = np.concatenate([self._number, number])
        self._label, self._face = np.append(self._label, seen.label), np.append(self._face, seen.face)
        self._last_ns = np.append(self._last_ns, np.full(number.size, epoch_ns))

    def _forget(self, epoch_ns: int) -> None:
        keep = epoch_ns - self._last_ns <= _RULES.memory_s * NANOSECONDS
        if keep.all() or self._points is None:
            return
        self._points = self._points.take(keep)
        self._number, self._label = self._number[keep], self._label[keep]
        self._face, self._last_ns = self._face[keep], self._last_ns[keep]
