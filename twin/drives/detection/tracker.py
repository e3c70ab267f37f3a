"""Boxes in consecutive pictures of one camera → tracks.

In each picture the boxes are assigned to the tracks one-to-one, at the least total cost, by how far each lies
from where its track must appear now and by how its size and class fit. Signs come nearer in a known way:
where a track has been seen twice, its motion and growth are carried on.

That is SORT (Bewley et al. 2016, doi:10.1109/ICIP.2016.7533003) without its Kalman filter: boxes of a network
are sharper than its predictions, and what it is for, people who turn, signs do not do. A distance in sizes of
the box stands for the overlap, which is zero for a small sign that moves by its own width between two
pictures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from twin.drives.detection.yolo_output import Detections

MIN_BOXES = 3
"""A sign is passed within many pictures; what is seen in one or two is a reflection, or cannot be placed."""
LEAST_SHARE = 0.25
"""A sign is found in at least this share of the pictures from its first to its last; noise is not."""
LONGEST_GAP_S = 0.5
"""A track ends where its sign was not found for so long, or in two pictures where there are fewer of them."""

_NEW_GATE, _NEW_GATE_PER_S, _WIDEST_GATE = 0.6, 20.0, 4.0
_GATE, _GATE_PER_S = 0.6, 6.0
_GROWTH = math.log(1.6)
_OTHER_CLASS = 0.5
_IMPOSSIBLE = 1e6
_MEMORY = 0.5
"""Share of the motion that the newest pair of boxes says; the rest is what was known."""


@dataclass(slots=True)
class _Track:
    """One sign that is being followed; places are centre x, centre y, log of the size."""

    epoch_ns: int
    place: FloatArray
    class_index: int
    rows: list[int] = field(default_factory=list)
    pictures: list[int] = field(default_factory=list)
    motion_per_s: FloatArray | None = None

    def predicted(self, epoch_ns: int) -> FloatArray:
        if self.motion_per_s is None:
            return self.place
        return self.place + self.motion_per_s * ((epoch_ns - self.epoch_ns) / 1e9)

    def is_sign(self) -> bool:
        """Whether it has boxes enough."""
        return len(self.rows) >= max(MIN_BOXES, LEAST_SHARE * (self.pictures[-1] - self.pictures[0] + 1))

    def take(self, row: int, picture: int, epoch_ns: int, place: FloatArray, class_index: int) -> None:
        motion = (place - self.place) / ((epoch_ns - self.epoch_ns) / 1e9)
        known = self.motion_per_s
        self.motion_per_s = motion if known is None else _MEMORY * motion + (1.0 - _MEMORY) * known
        self.epoch_ns, self.place, self.class_index = epoch_ns, place, class_index
        self.rows.append(row)
        self.pictures.append(picture)


def tracks(epoch_ns: Sequence[int], pictures: Sequence[Detections]) -> IntArray:
    """Link the boxes of one camera.

    Parameters
    ----------
    epoch_ns : sequence of int (m,)
        Of each picture, increasing.
    pictures : sequence of Detections (m,)

    Returns
    -------
    int64 (n,)
        Track of each box of all pictures in turn: 0, 1, … in order of first sighting; -1 for boxes of
        tracks with too few.
    """
    gap_ns = _longest_gap_ns(epoch_ns)
    alive: list[_Track] = []
    ended: list[_Track] = []
    first_row = 0
    for picture, (epoch, found) in enumerate(zip(epoch_ns, pictures, strict=True)):
        ended += [track for track in alive if epoch - track.epoch_ns > gap_ns]
        alive = [track for track in alive if epoch - track.epoch_ns <= gap_ns]
        places = _places(found.box_px)
        taken = _assigned(alive, places, found.class_index, epoch)
        for i, place in enumerate(places):
            row, kind = first_row + i, int(found.class_index[i])
            if i in taken:
                alive[taken[i]].take(row, picture, epoch, place, kind)
            else:
                alive.append(_Track(epoch, place, kind, [row], [picture]))
        first_row += len(places)
    number = np.full(first_row, -1, dtype=np.int64)
    signs = [track.rows for track in ended + alive if track.is_sign()]
    for i, rows in enumerate(sorted(signs)):
        number[rows] = i
    return number


def _longest_gap_ns(epoch_ns: Sequence[int]) -> float:
    if len(epoch_ns) < 2:
        return 0.0
    step_ns = float(np.median(np.diff(np.asarray(epoch_ns, dtype=np.int64))))
    return max(LONGEST_GAP_S * 1e9, 2.5 * step_ns)


def _places(box_px: FloatArray) -> FloatArray:
    """Centre x, centre y and log of the size (geometric mean of the sides), (n, 3)."""
    side = np.maximum(box_px[:, 2:] - box_px[:, :2], 1e-3)
    size = np.log(side).mean(axis=1)
    return np.column_stack([(box_px[:, :2] + box_px[:, 2:]) / 2.0, size])


def _assigned(
    alive: Sequence[_Track], places: FloatArray, class_index: IntArray, epoch_ns: int
) -> dict[int, int]:
    """Track of each box that belongs to one, by row of `places`."""
    from scipy.optimize import linear_sum_assignment

    if not alive or not len(places):
        return {}
    cost = np.array([_costs(track, places, class_index, epoch_ns) for track in alive])
    return {
        int(i): int(t) for t, i in zip(*linear_sum_assignment(cost), strict=True) if cost[t, i] < _IMPOSSIBLE
    }


def _costs(track: _Track, places: FloatArray, class_index: IntArray, epoch_ns: int) -> FloatArray:
    """What it costs that a track goes on with each of the boxes, (n,); impossible outside its gate."""
    passed_s = (epoch_ns - track.epoch_ns) / 1e9
    expected = track.predicted(epoch_ns)
    if track.motion_per_s is None:
        gate = min(_NEW_GATE + _NEW_GATE_PER_S * passed_s, _WIDEST_GATE)
    else:
        gate = min(_GATE + _GATE_PER_S * passed_s, _WIDEST_GATE)
    size = np.exp(np.minimum(expected[2], 12.0))
    distance = np.hypot(places[:, 0] - expected[0], places[:, 1] - expected[1]) / size / gate
    growth = np.abs(places[:, 2] - expected[2]) / (_GROWTH * (1.0 + passed_s))
    possible = (distance <= 1.0) & (growth <= 1.0)
    cost = distance + 0.5 * growth + _OTHER_CLASS * (class_index != track.class_index)
    return np.where(possible, cost, _IMPOSSIBLE)
