"""Tags that were printed upside down: told from places that were measured of their corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics.contradiction import first_state
from geoloc.calibration.extrinsics.network import NetworkState
from geoloc.calibration.extrinsics.observations import Pose, Sighting, Tag, TagPicture
from geoloc.cameras.base import CameraModel

_BETTER = 0.25
"""Of how far a tag's places are off as stated: as printed upside down they fit better than that."""
_LEAST_PART = 0.5
"""Of a tag's side: corners that are exchanged with the opposite ones are off by more."""
_MOST_M = 1.0
"""Counted of a place that is off by more: it is another slip."""
_ROUNDS = 3
_HALF_TURN = np.array([-1.0, -1.0, 1.0])


def as_printed(
    models: Mapping[str, CameraModel],
    pictures: Sequence[TagPicture],
    tags: Mapping[int, Tag],
    nominal: Mapping[str, Pose],
) -> tuple[list[Sighting], NetworkState, dict[int, Tag], tuple[int, ...]]:
    """Start an adjustment with every tag the way up in which it was printed.

    OpenCV's generator makes every AprilTag turned by 180° against the authors' print, so that a layout which
    names corners by the print means the opposite ones. Middles are the same either way. Only tags with a
    measured corner can tell, and only where something else says how they stand.

    Returns
    -------
    list of Sighting
    NetworkState
        As `first_state` has them.
    dict of id to Tag
        With the corners of those that are turned.
    tuple of int
        Which those are.

    Raises
    ------
    CalibrationError
        As `first_state`.
    """
    sightings, state = first_state(models, pictures, tags, nominal)
    marked = [number for number in sorted(state.tags) if tags[number].has_marks and not tags[number].is_board]
    best, chosen = _off_m(tags, state), dict(tags)
    turned: tuple[int, ...] = ()
    tried = {turned}
    for some in (tuple(marked), *([None] * _ROUNDS)):
        following = _upside_down(tags, state, marked, turned) if some is None else some
        if following in tried:
            continue
        tried.add(following)
        now = _with_turned(tags, following)
        again = first_state(models, pictures, now, nominal)
        off_m = _off_m(now, again[1])
        if off_m < 0.5 * best:
            best, turned, chosen, (sightings, state) = off_m, following, now, again
    return sightings, state, chosen, turned


def _off_m(tags: Mapping[int, Tag], state: NetworkState) -> float:
    """How far measured points lie from their places, on average, each counted up to a metre."""
    off = np.concatenate([_off(tags[number], pose) for number, pose in state.tags.items()])
    known = off[np.isfinite(off)]
    return float(np.minimum(known, _MOST_M).mean()) if known.size else 0.0


def _off(tag: Tag, pose: Pose) -> FloatArray:
    """Metres (1 + k,) between a tag's points and where they were measured; NaN where not, or not wholly."""
    return np.asarray(np.linalg.norm(tag.points_m() @ pose.R.T + pose.t_m - tag.places_m(), axis=1))


def _upside_down(
    tags: Mapping[int, Tag], state: NetworkState, marked: Sequence[int], turned: Sequence[int]
) -> tuple[int, ...]:
    """Tags whose corners lie where the opposite ones were measured; where that is not clear, as before."""
    found = []
    for number in marked:
        other = _with_turned(tags, [number])[number]
        ways = [float(np.nanmax(_off(tag, state.tags[number]), initial=0.0)) for tag in (tags[number], other)]
        clear = max(ways) > _LEAST_PART * tags[number].size_m and min(ways) < _BETTER * max(ways)
        if (ways[1] < ways[0]) if clear else number in turned:
            found.append(number)
    return tuple(found)


def _with_turned(tags: Mapping[int, Tag], some: Sequence[int]) -> dict[int, Tag]:
    return {
        number: replace(tag, marks_m=tag.marks_m * _HALF_TURN) if number in some else tag
        for number, tag in tags.items()
    }
